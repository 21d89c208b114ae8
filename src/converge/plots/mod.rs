//! Plots as SVG text: by themselves in a file, or inside a page.
//!
//! Drawn by hand instead of by a plotting crate: what makes these plots readable (labels at the lines, two colour
//! schemes in one file, markers beside colours) would be code of our own on top of any of them.

mod axis;
mod efficiency;
mod error;
mod stages;
mod svg;

pub use efficiency::efficiency;
pub use error::{Against, error};
pub use stages::stages;

use super::Experiment;

/// Scene, size and machine: what stands below the title of every plot.
fn setting(experiment: &Experiment) -> String {
    let Experiment { scene, width, height, machine, .. } = experiment;
    let plural = if machine.threads == 1 { "" } else { "s" };
    format!(
        "{scene}, {width} × {height}; {}, {} thread{plural}, {}",
        machine.cpu, machine.threads, machine.isa
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::summary::Summary;
    use crate::converge::synthetic::{self, Law, Normal};
    use crate::converge::{Errors, External, Measure, OwnError};

    fn all(experiment: &Experiment) -> Vec<String> {
        let mut plots = Vec::new();
        for measure in Measure::ALL {
            let summary = Summary::of(experiment, measure);
            plots.push(error(experiment, &summary, Against::Seconds));
            plots.push(error(experiment, &summary, Against::Spp));
            plots.push(stages(experiment, &summary));
            plots.push(efficiency(experiment, &summary));
        }
        plots
    }

    /// Parses the plot and checks that everything drawn has a place: no NaN, nothing far outside.
    fn check(plot: &str) {
        let document = roxmltree::Document::parse(plot).unwrap_or_else(|error| panic!("{error}\n{plot}"));
        let root = document.root_element();
        assert_eq!(root.tag_name().name(), "svg");
        let size = |name: &str| root.attribute(name).unwrap().parse::<f64>().unwrap();
        let (width, height) = (size("width"), size("height"));
        for node in document.descendants().filter(|node| node.is_element()) {
            for attribute in node.attributes() {
                let value = attribute.value();
                assert!(!value.contains("NaN") && !value.contains("inf"), "{value}");
                let limit = match attribute.name() {
                    "x" | "x1" | "x2" | "cx" => width,
                    "y" | "y1" | "y2" | "cy" => height,
                    _ => continue,
                };
                let place: f64 = value.parse().unwrap();
                assert!((0.0..=limit).contains(&place), "{} = {value}\n{plot}", attribute.name());
            }
        }
    }

    #[test]
    fn plots_are_well_formed_and_deterministic() {
        let (experiment, ..) = synthetic::full();
        let plots = all(&experiment);
        plots.iter().for_each(|plot| check(plot));
        assert_eq!(plots, all(&experiment));
        let error = &plots[0];
        for part in [
            "wavefront/sobol",
            "slope −1.08 ± 0.04",
            "pbrt-v4",
            "render time, seconds",
            "prefers-color-scheme",
        ] {
            assert!(error.contains(part), "{part}");
        }
        assert!(plots[2].contains("light_sample") && plots[3].contains("200 (191..209)"), "{}", plots[3]);
    }

    #[test]
    fn names_cannot_break_out() {
        let (mut experiment, ..) = synthetic::full();
        experiment.scene = "<script>&\"'.pbrt".into();
        experiment.variants[0].name = "</text><script>a</script>".into();
        experiment.externals[0].name = "\0\u{1b}[31m]]>".into();
        experiment.variants[0].runs[0].points[5].stage_seconds[0].0 = "<b>".into();
        for plot in all(&experiment) {
            check(&plot);
            assert!(!plot.contains("<script"), "{plot}");
        }
    }

    #[test]
    fn little_or_nothing_to_draw() {
        let law = Law { error_at_one_second: 0.1, slope: -1.0, spread: 0.1, slowness: 1.0 };
        for (laws, seeds) in [(vec![], 3), (vec![law], 0), (vec![law; 4], 1)] {
            let mut experiment = synthetic::experiment(&mut Normal::new(1), &laws, seeds);
            all(&experiment).iter().for_each(|plot| check(plot));
            experiment.externals.clear();
            all(&experiment).iter().for_each(|plot| check(plot));
            for point in
                experiment.variants.iter_mut().flat_map(|v| &mut v.runs).flat_map(|run| &mut run.points)
            {
                (point.errors.relmse, point.errors.mse) = (f64::NAN, 0.0);
                point.stage_seconds.clear();
            }
            all(&experiment).iter().for_each(|plot| check(plot));
        }
    }

    #[test]
    fn extreme_ranges() {
        for (exponent, slowness) in [(-300.0, 1e-9), (12.0, 1e7)] {
            let error_at_one_second = 10_f64.powf(exponent);
            let law = Law { error_at_one_second, slope: -1.0, spread: 2.0, slowness };
            let mut experiment = synthetic::experiment(&mut Normal::new(1), &[law; 9][..4], 2);
            let errors = Errors { mse: 1.0, relmse: 1.0, relmse_trimmed: 1.0, mean_ratio: [1.0; 3] };
            let name =
                "a program whose name is much longer than anyone would type it on a command line".to_string();
            experiment.externals = vec![External { name, file: String::new(), seconds: 1.0, errors }];
            experiment.reference.own_error = Some(OwnError { mse: 1e-9, relmse: 1e-9, relmse_trimmed: 1e-9 });
            all(&experiment).iter().for_each(|plot| check(plot));
        }
    }
}
