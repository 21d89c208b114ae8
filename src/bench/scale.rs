//! What a render would take on many machines: a model, from figures that are measured on one.
//!
//! The time on n nodes, each like this one, is
//!
//! ```text
//! T(n) = setup + work / (n rate) + tail + ceil(log2 n) (bytes / network + pack + unpack + merge)
//! ```
//!
//! `work` are the samples, `rate` those that a node renders in a second; `tail` is what the last unit and the stock of a rank
//! take, during which others have nothing to do. Films are added up along a tree, as [`docs/scale.md`] tells.
//!
//! [`docs/scale.md`]: https://docs.rs/crate/wavepath/latest/source/docs/scale.md

use crate::film::Film;
use crate::render::{Render, RenderError};
use crate::scene::Scene;
use serde::Serialize;
use std::fmt;
use std::time::{Duration, Instant};

/// Work that a rank has in stock, at least.
pub(crate) const LEAST_STOCK: Duration = Duration::from_millis(50);
/// The same for each rank of a render: rank 0 answers one question a stock and rank.
pub(crate) const STOCK_OF_A_RANK: Duration = Duration::from_micros(100);

/// Time for which rank 0 is busy with a question, as measured between processes of one machine: probe, take, answer.
const QUESTION: f64 = 30e-6;

/// Pixels times samples of a work unit.
const UNIT: f64 = 4096.0;

/// What is measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inputs {
    /// Scene.
    pub scene: String,
    /// Pixels.
    pub pixels: u64,
    /// Samples a pixel of the render that is asked about.
    pub spp: u32,
    /// Worker threads of a node.
    pub threads: usize,
    /// Pixel samples a second of a node.
    pub samples_per_second: f64,
    /// Seconds before the first sample: reading, tables, tree.
    pub setup_seconds: f64,
    /// Bytes of the film as it is sent.
    pub film_bytes: u64,
    /// Seconds to make bytes of the film.
    pub pack_seconds: f64,
    /// Seconds to make a film of the bytes.
    pub unpack_seconds: f64,
    /// Seconds to add a film to another.
    pub merge_seconds: f64,
}

/// What the model says of a number of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Nodes.
    pub nodes: u64,
    /// Seconds in all.
    pub seconds: f64,
    /// Seconds of rendering, of the slowest rank.
    pub rendering: f64,
    /// Seconds in which films are added up.
    pub reduction: f64,
    /// Time of one node over n times that of n nodes.
    pub efficiency: f64,
    /// Share of the time for which rank 0 answers questions: above 1 it cannot.
    pub dealing: f64,
}

/// Measures a scene for about `time`.
///
/// # Errors
/// As [`Render::run`].
pub fn measure(scene: &Scene, spp: u32, threads: usize, time: Duration) -> Result<Inputs, RenderError> {
    let render = || Render::new(scene).threads(threads).time(time);
    let started = Instant::now();
    let tree = scene.tree(render().settings().engine);
    let picture = render().run_in(&tree, started.elapsed())?;
    let (film, report) = (picture.film(), picture.report());
    let timed = |work: &mut dyn FnMut()| {
        let started = Instant::now();
        work();
        started.elapsed().as_secs_f64()
    };
    let mut bytes = Vec::new();
    let pack = timed(&mut || bytes = film.to_bytes());
    let mut copy = None;
    let unpack = timed(&mut || copy = Film::from_bytes(&bytes).ok());
    let other = render().film()?;
    let merge = timed(&mut || {
        if let Some(copy) = &copy {
            // Into an empty film: what is there already takes no longer.
            let _ = other.merge(copy);
        }
    });
    let requirements = scene.plan().requirements();
    let film_bytes = Film::bytes_for_render(film.header().frame, requirements, Some(spp));
    // What was measured holds the samples of a short render.
    let factor = film_bytes as f64 / bytes.len().max(1) as f64;
    let setup = scene.setup().iter().map(|(_, time)| time.as_secs_f64()).sum::<f64>();
    Ok(Inputs {
        scene: scene.name().into(),
        pixels: film.pixels(),
        spp,
        threads,
        samples_per_second: report.samples_per_second(),
        setup_seconds: setup + report.setup_stages.iter().rev().take(2).map(|(_, s)| s).sum::<f64>(),
        film_bytes,
        pack_seconds: pack * factor,
        unpack_seconds: unpack * factor,
        merge_seconds: merge * factor,
    })
}

/// A stock of work for each of so many ranks.
pub(crate) fn stock(ranks: usize) -> Duration {
    LEAST_STOCK.max(STOCK_OF_A_RANK * ranks as u32)
}

impl Inputs {
    /// What the model says of `nodes` nodes with a network of so many bytes a second.
    pub fn on(&self, nodes: u64, network: f64) -> Estimate {
        let one = self.time(1, network);
        let Parts { rendering, reduction } = self.time(nodes, network);
        let seconds = self.setup_seconds + rendering + reduction;
        let alone = self.setup_seconds + one.rendering;
        let efficiency = alone / (nodes as f64 * seconds);
        let dealing = match nodes {
            1 => 0.0,
            _ => (nodes - 1) as f64 * QUESTION / stock(nodes as usize).as_secs_f64(),
        };
        Estimate { nodes, seconds, rendering, reduction, efficiency, dealing }
    }

    fn time(&self, nodes: u64, network: f64) -> Parts {
        let n = nodes as f64;
        let work = self.pixels as f64 * f64::from(self.spp);
        let share = work / (n * self.samples_per_second);
        // The stock of a rank goes down with what is left: half of its share at the end, at most the stock.
        let unit = UNIT * self.threads as f64 / self.samples_per_second;
        let stock = if nodes == 1 { 0.0 } else { stock(nodes as usize).as_secs_f64().min(share / 2.0) };
        let levels = f64::from(nodes.next_power_of_two().ilog2());
        let step =
            self.film_bytes as f64 / network + self.pack_seconds + self.unpack_seconds + self.merge_seconds;
        Parts { rendering: share + unit + stock, reduction: levels * step }
    }
}

struct Parts {
    rendering: f64,
    reduction: f64,
}

/// The model for many numbers of nodes, to be printed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaling {
    /// What was measured.
    pub inputs: Inputs,
    /// Bytes a second of the network.
    pub network: f64,
    /// What follows.
    pub estimates: Vec<Estimate>,
}

impl Scaling {
    /// From 1 to 10,000 nodes.
    pub fn of(inputs: Inputs, network: f64) -> Self {
        let nodes = [1, 2, 4, 10, 30, 100, 300, 1000, 3000, 10_000];
        let estimates = nodes.map(|nodes| inputs.on(nodes, network)).to_vec();
        Scaling { inputs, network, estimates }
    }
}

impl fmt::Display for Scaling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inputs { scene, pixels, spp, threads, samples_per_second, setup_seconds, film_bytes, .. } =
            &self.inputs;
        let [pack, unpack, merge] =
            [self.inputs.pack_seconds, self.inputs.unpack_seconds, self.inputs.merge_seconds];
        writeln!(f, "{scene}: {pixels} pixels, {spp} spp")?;
        writeln!(
            f,
            "a node          {threads} threads, {:.3} million samples a second",
            samples_per_second / 1e6
        )?;
        writeln!(f, "setup           {setup_seconds:.3} s")?;
        writeln!(
            f,
            "film            {:.1} MB; pack {pack:.3} s, unpack {unpack:.3} s, merge {merge:.3} s",
            *film_bytes as f64 / 1e6
        )?;
        writeln!(f, "network         {:.2} GB/s", self.network / 1e9)?;
        write!(f, "\n nodes     seconds   rendering   reduction   efficiency   rank 0 answers")?;
        for Estimate { nodes, seconds, rendering, reduction, efficiency, dealing } in &self.estimates {
            write!(
                f,
                "\n{nodes:6}  {seconds:10.2}  {rendering:10.2}  {reduction:10.3}  {efficiency:11.3}  {:13.1} %",
                100.0 * dealing
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inputs() -> Inputs {
        Inputs {
            scene: "s".into(),
            pixels: 1_000_000,
            spp: 1000,
            threads: 10,
            samples_per_second: 1e6,
            setup_seconds: 1.0,
            film_bytes: 100_000_000,
            pack_seconds: 0.1,
            unpack_seconds: 0.1,
            merge_seconds: 0.1,
        }
    }

    #[test]
    fn the_model_is_what_it_says() {
        let one = inputs().on(1, 1e9);
        assert!((one.seconds - (1.0 + 1000.0 + 0.04096)).abs() < 1e-9);
        assert_eq!((one.efficiency, one.reduction, one.dealing), (1.0, 0.0, 0.0));
        let ten = inputs().on(10, 1e9);
        assert!((ten.reduction - 4.0 * 0.4).abs() < 1e-9);
        assert!((ten.rendering - (100.0 + 0.04096 + 0.05)).abs() < 1e-9);
        let many = inputs().on(10_000, 1e9);
        assert!(many.efficiency < 0.1 && many.dealing < 0.5, "{many:?}");
    }

    #[test]
    fn it_measures() {
        let scene = Scene::parse(
            "Film \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 30 WorldBegin LightSource \"infinite\"",
        )
        .unwrap();
        let inputs = measure(&scene, 256, 1, Duration::from_millis(50)).unwrap();
        assert!(inputs.samples_per_second > 0.0 && inputs.film_bytes > 0 && inputs.pack_seconds > 0.0);
        assert!(Scaling::of(inputs, 1e9).to_string().contains("10000"));
    }
}
