//! The figures as text for the terminal, in Markdown.

use super::{Figures, SceneFigures, Spread};
use std::fmt;

/// A ratio or rate with its range.
fn spread(s: Spread, digits: usize) -> String {
    format!("{:.digits$} | {:.digits$} to {:.digits$}", s.median, s.min, s.max)
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let clock = if self.processor_time { "processor time" } else { "wall clock" };
        writeln!(
            f,
            "wavepath {}, {}, {}; medians of {} interleaved rounds by {clock}, one thread, with smallest and largest",
            self.version, self.cpu, self.isa, self.rounds
        )?;
        writeln!(f, "\n| scene | wavefront over megakernel | range | over megakernel-wide | range |")?;
        writeln!(f, "|---|---|---|---|---|")?;
        for scene in &self.scenes {
            let step = scene.default_engine();
            let (naive, wide) = (spread(step.over_naive, 2), spread(step.over_wide, 2));
            writeln!(f, "| {} | {naive} | {wide} |", scene.scene)?;
        }
        self.scenes.iter().try_for_each(|scene| write!(f, "\n{scene}"))
    }
}

impl fmt::Display for SceneFigures {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [width, height] = self.resolution;
        writeln!(f, "## {}\n", self.scene)?;
        writeln!(
            f,
            "{} primitives, tree of {:.1} MiB, {} bytes a path, {width} x {height} pixels\n",
            self.primitives,
            self.tree_bytes as f64 / f64::from(1 << 20),
            self.bytes_per_path
        )?;
        writeln!(f, "| variant | sampler | M samples/s | over naive | range | over wide | range |")?;
        writeln!(f, "|---|---|---|---|---|---|---|")?;
        for step in &self.ablation {
            writeln!(
                f,
                "| {} | {} | {:.2} | {} | {} |",
                step.name,
                step.sampler,
                step.samples_per_second.median / 1e6,
                spread(step.over_naive, 2),
                spread(step.over_wide, 2)
            )?;
        }
        writeln!(f, "\n| stage | share | items a sample | ns an item | range | cycles an item |")?;
        writeln!(f, "|---|---|---|---|---|---|")?;
        for stage in &self.stages {
            writeln!(
                f,
                "| {} | {:.1} % | {:.2} | {} | {} |",
                stage.name,
                100.0 * stage.share,
                stage.items_per_sample,
                spread(stage.nanoseconds_per_item, 1),
                stage.cycles_per_item.map_or("".into(), |c| format!("{c:.0}"))
            )?;
        }
        writeln!(f, "\n| rays | a sample | Mrays/s | range |\n|---|---|---|---|")?;
        for rays in &self.rays {
            writeln!(
                f,
                "| {} | {:.2} | {} |",
                rays.class,
                rays.per_sample,
                spread(rays.mrays_per_second, 1)
            )?;
        }
        writeln!(f, "\n| paths in a pool | rate over that of 4096 | range |\n|---|---|---|")?;
        for batch in &self.batches {
            writeln!(f, "| {} | {} |", batch.number, spread(batch.ratio, 2))?;
        }
        writeln!(f, "\n| threads | rate over that of one, wall clock | range |\n|---|---|---|")?;
        for threads in &self.threads {
            writeln!(f, "| {} | {} |", threads.number, spread(threads.ratio, 2))?;
        }
        writeln!(f, "\n| comparison | ratio | range |\n|---|---|---|")?;
        let plan = spread(self.plan_over_everything, 3);
        writeln!(f, "| rate with the scene's plan over that with everything switched on | {plan} |")?;
        for gain in &self.samplers {
            writeln!(
                f,
                "| MSE independent over Sobol, {} spp, equal samples | {:.2} | |",
                gain.spp, gain.at_equal_samples
            )?;
            writeln!(f, "| the same at equal time | {:.2} | |", gain.at_equal_time)?;
        }
        Ok(())
    }
}
