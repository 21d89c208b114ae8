//! What a render cost and how good it is: one record, as JSON and as a table.

use std::fmt;
use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::atomic_file::write_whole;

/// The record of one render.
///
/// The JSON keys are the field names. A figure that is unknown is `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Path of the scene file, as given.
    pub scene: String,
    /// What was set in place of what the scene says, by name; an object in JSON, not written if it is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "ordered_map")]
    pub set: Vec<(String, String)>,
    /// Every file that was read: the scene, what it includes, meshes, spectra; none in reports of earlier versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// `wavefront`, `megakernel` or `megakernel-wide`.
    pub engine: String,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel; the mean where pixels differ. A whole number is written as an integer.
    #[serde(serialize_with = "integral_if_whole")]
    pub spp: f64,
    /// Time spent rendering, in seconds of wall clock.
    pub seconds: f64,
    /// Time before that (reading, building the BVH), in seconds of wall clock.
    pub setup_seconds: f64,
    /// The parts of that time, in seconds of wall clock; an object in JSON. Empty in reports of earlier versions.
    #[serde(default, with = "ordered_map")]
    pub setup_stages: Vec<(String, f64)>,
    /// Pixel samples taken.
    pub samples: u64,
    /// Rays traced.
    pub rays: Rays,
    /// Seconds in each stage, summed over the workers, in the order the stages run; an object in
    /// JSON. Empty if the engine does not measure its stages.
    #[serde(with = "ordered_map")]
    pub stages: Vec<(String, f64)>,
    /// Samples that came out NaN, infinite or negative and were dropped.
    pub invalid_samples: u64,
    /// Estimated relMSE of the picture against the converged one.
    pub estimated_relmse: Option<f64>,
    /// 95 % interval of that estimate, from the spread over pixels.
    pub estimated_relmse_interval: Option<[f64; 2]>,
    /// What `--adaptive` came to; none without it.
    pub adaptive: Option<Adaptive>,
    /// What ended the render: `samples`, `time`, `error` or `interrupt`; none in reports of earlier versions.
    pub stopped_by: Option<String>,
    /// Most memory that the process had resident, in bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Worker threads.
    pub threads: usize,
    /// Paths in the pool of a worker; none for the megakernels.
    pub batch: Option<usize>,
    /// The processes that rendered, where there were several; the figures above are of all of them, but for memory, threads
    /// and what follows here, which are of rank 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranks: Vec<Rank>,
    /// How much less time it would have taken if all ranks had been busy alike, from 0 to 1: 1 - mean / largest of `busy`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imbalance: Option<f64>,
    /// Name of the processor.
    pub cpu: String,
    /// Instruction set that the kernels ran with.
    pub isa: String,
    /// `sobol` or `independent`.
    pub sampler: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Version of wavepath.
    pub version: String,
}

/// A process of a render by several of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rank {
    /// Its number.
    pub rank: usize,
    /// Where it ran.
    pub host: String,
    /// Worker threads.
    pub threads: usize,
    /// Pixel samples taken.
    pub samples: u64,
    /// Seconds of wall clock in which its workers rendered.
    pub busy_seconds: f64,
    /// Pixel samples a second of these.
    pub samples_per_second: f64,
    /// Share of the rendering time in which its workers rendered.
    pub busy: f64,
}

/// What adaptive sampling came to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Adaptive {
    /// Whether samples were spread unevenly: where that would not pay, they are not.
    pub used: bool,
    /// Efficiency, 1 / (relMSE x time), over that of samples spread evenly, as the last decision predicted it; none if
    /// there were too few samples to decide.
    pub predicted_gain: Option<f64>,
    /// Fewest samples of a pixel.
    pub least_spp: u32,
    /// Most samples of a pixel.
    pub most_spp: u32,
}

impl fmt::Display for Adaptive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { used, predicted_gain, least_spp, most_spp } = self;
        match predicted_gain {
            Some(gain) if *used => write!(f, "{least_spp} to {most_spp} spp, predicted gain {gain:.2}"),
            Some(gain) => write!(f, "samples are even: a gain of {gain:.2} was predicted, too little to pay"),
            None => f.write_str("samples are even: too few of them to decide"),
        }
    }
}

/// Rays by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rays {
    /// Rays from the camera.
    pub camera: u64,
    /// Rays from a surface onwards along a path.
    pub bounce: u64,
    /// Rays that test whether a light is visible.
    pub shadow: u64,
}

impl Rays {
    /// Rays of all classes.
    pub fn total(&self) -> u64 {
        self.camera + self.bounce + self.shadow
    }
}

impl Report {
    /// Pixel samples per second of rendering; 0 if no time was spent.
    pub fn samples_per_second(&self) -> f64 {
        self.per_second(self.samples)
    }

    /// Millions of rays of all classes per second of rendering; 0 if no time was spent.
    pub fn mrays_per_second(&self) -> f64 {
        self.per_second(self.rays.total()) / 1e6
    }

    /// Adds what ranks did.
    pub fn set_ranks(&mut self, ranks: Vec<Rank>) {
        let most = ranks.iter().map(|rank| rank.busy).fold(0.0, f64::max);
        let mean = ranks.iter().map(|rank| rank.busy).sum::<f64>() / ranks.len().max(1) as f64;
        self.imbalance = (most > 0.0).then(|| 1.0 - mean / most);
        self.ranks = ranks;
    }

    /// Each stage's share of the time in all stages, from 0 to 1, in their order.
    pub fn stage_shares(&self) -> Vec<(&str, f64)> {
        let total: f64 = self.stages.iter().map(|(_, seconds)| seconds).sum();
        let share = |seconds: f64| if total > 0.0 { seconds / total } else { 0.0 };
        self.stages.iter().map(|(name, seconds)| (name.as_str(), share(*seconds))).collect()
    }

    /// The report as one JSON object, on one line.
    ///
    /// # Panics
    /// Never: the record holds nothing that JSON cannot express.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a record of numbers and strings")
    }

    /// Writes the report as JSON to `path`; the file appears whole or not at all.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write_whole(path, |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            file.write_all(b"\n")
        })
    }

    fn per_second(&self, count: u64) -> f64 {
        if self.seconds > 0.0 { count as f64 / self.seconds } else { 0.0 }
    }
}

/// A table for the terminal, several lines without a last line break.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let batch = self.batch.map(|batch| format!(", batch {batch}")).unwrap_or_default();
        let plural = if self.threads == 1 { "" } else { "s" };
        let Self { width, height, spp, sampler, seed, engine, threads, isa, cpu, .. } = self;
        row(f, "scene", &self.scene)?;
        row(f, "image", format_args!("{width} x {height}, {spp} spp, {sampler}, seed {seed}"))?;
        row(f, "engine", format_args!("{engine}, {threads} thread{plural}{batch}, {isa}"))?;
        row(f, "processor", cpu)?;
        row(
            f,
            "time",
            format_args!("{} rendering, {} setup", seconds(self.seconds), seconds(self.setup_seconds)),
        )?;
        for (index, parts) in self.setup_stages.chunks(3).enumerate() {
            let parts = parts.iter().map(|(name, spent)| format!("{} {name}", seconds(*spent)));
            row(f, if index == 0 { "setup" } else { "" }, parts.collect::<Vec<_>>().join(", "))?;
        }
        if let Some(reason) = &self.stopped_by {
            row(f, "stopped by", reason)?;
        }
        self.fmt_rates(f)?;
        let shares = self.stage_shares();
        if !shares.is_empty() {
            let all =
                if self.threads == 1 { "one thread".into() } else { format!("{} threads", self.threads) };
            let sum = format!("s, sum of {all}");
            row(f, "stages", format_args!("{:<18}   share {sum:>20} {:>13}", "", "s, wall clock"))?;
        }
        for (index, (name, share)) in shares.into_iter().enumerate() {
            let spent = self.stages[index].1;
            // What the stage would have taken of the wall clock, if all threads had it at the same share.
            let wall = share * self.seconds;
            row(f, "", format_args!("{name:<18} {:>5.1} % {spent:>20.3} {wall:>13.3}", 100.0 * share))?;
        }
        match (self.estimated_relmse, self.estimated_relmse_interval) {
            (Some(error), Some([low, high])) => {
                row(f, "relMSE", format_args!("{error:.3e} (estimated; 95 %: {low:.3e} to {high:.3e})"))?;
            }
            (Some(error), None) => row(f, "relMSE", format_args!("{error:.3e} (estimated)"))?,
            (None, _) => row(f, "relMSE", "unknown")?,
        }
        if let Some(adaptive) = self.adaptive {
            row(f, "adaptive", adaptive)?;
        }
        for (index, rank) in self.ranks.iter().enumerate() {
            let Rank { rank, host, threads, samples_per_second, busy, .. } = rank;
            let rates = format_args!(
                "{rank} on {host}, threads: {threads}, {} samples a second, busy {:.1} %",
                count(*samples_per_second as u64),
                100.0 * busy
            );
            row(f, if index == 0 { "ranks" } else { "" }, rates)?;
        }
        if let Some(imbalance) = self.imbalance {
            row(f, "imbalance", format_args!("{:.1} %", 100.0 * imbalance))?;
        }
        row(f, "invalid samples", self.invalid_samples)?;
        let memory = self.peak_memory_bytes.map_or("unknown".into(), mebibytes);
        write!(f, "{:<16}  {memory} at most", "memory")
    }
}

impl Report {
    fn fmt_rates(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let classes = [
            ("samples", "", self.samples),
            ("rays", "camera", self.rays.camera),
            ("", "bounce", self.rays.bounce),
            ("", "shadow", self.rays.shadow),
            ("", "all", self.rays.total()),
        ];
        for (label, class, number) in classes {
            let rate = self.per_second(number) / 1e6;
            let number = count(number);
            row(f, label, format_args!("{class:<8} {number:>10}  {rate:>9.3} M/s"))?;
        }
        Ok(())
    }
}

fn row(f: &mut fmt::Formatter<'_>, label: &str, value: impl fmt::Display) -> fmt::Result {
    writeln!(f, "{label:<16}  {value}")
}

/// A count with four digits and a unit: `19.66 M`.
pub(crate) fn count(number: u64) -> String {
    let value = number as f64;
    match number {
        0..10_000 => number.to_string(),
        10_000..1_000_000 => format!("{:.1} k", value / 1e3),
        1_000_000..1_000_000_000 => format!("{:.2} M", value / 1e6),
        _ => format!("{:.2} G", value / 1e9),
    }
}

fn seconds(value: f64) -> String {
    if value < 1.0 { format!("{:.1} ms", 1e3 * value) } else { format!("{value:.2} s") }
}

fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

fn integral_if_whole<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    // Up to 2^53 every whole f64 is exactly an integer.
    if value.fract() == 0.0 && (0.0..=9_007_199_254_740_992.0).contains(value) {
        serializer.serialize_u64(*value as u64)
    } else {
        serializer.serialize_f64(*value)
    }
}

/// A list of names and values as a JSON object that keeps their order.
mod ordered_map {
    use std::fmt;
    use std::marker::PhantomData;

    use serde::de::{MapAccess, Visitor};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer>(
        entries: &[(String, T)],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_map(entries.iter().map(|(name, value)| (name, value)))
    }

    pub fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<(String, T)>, D::Error> {
        struct Entries<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
            type Value = Vec<(String, T)>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Self::Value, M::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(entries)
            }
        }
        deserializer.deserialize_map(Entries(PhantomData))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;

    fn example() -> Report {
        Report {
            scene: "scenes/cornell.pbrt".into(),
            set: Vec::new(),
            inputs: Vec::new(),
            ranks: Vec::new(),
            imbalance: None,
            engine: "wavefront".into(),
            width: 640,
            height: 480,
            spp: 64.0,
            seconds: 2.0,
            setup_seconds: 0.25,
            setup_stages: vec![("reading".into(), 0.125), ("tree".into(), 0.125)],
            samples: 19_660_800,
            rays: Rays { camera: 19_660_800, bounce: 60_000_000, shadow: 40_339_200 },
            stages: vec![("generate".into(), 1.0), ("a_later_one".into(), 3.0)],
            invalid_samples: 0,
            estimated_relmse: Some(1.25e-3),
            estimated_relmse_interval: Some([1.2e-3, 1.3e-3]),
            adaptive: None,
            stopped_by: Some("samples".into()),
            peak_memory_bytes: Some(10 << 20),
            threads: 2,
            batch: Some(4096),
            cpu: "Example".into(),
            isa: "avx512".into(),
            sampler: "sobol".into(),
            seed: 7,
            version: "0.1.0".into(),
        }
    }

    #[test]
    fn figures_are_derived() {
        let report = example();
        assert_eq!(report.samples_per_second(), 9_830_400.0);
        assert_eq!(report.mrays_per_second(), 60.0);
        assert_eq!(report.stage_shares(), [("generate", 0.25), ("a_later_one", 0.75)]);
        let idle = Report { seconds: 0.0, stages: vec![], ..report };
        assert_eq!((idle.samples_per_second(), idle.mrays_per_second()), (0.0, 0.0));
    }

    #[test]
    fn json_keeps_order_and_whole_numbers() {
        let report = example();
        let json = report.to_json();
        assert!(json.contains(r#""spp":64,"#), "{json}");
        assert!(json.contains(r#""stages":{"generate":1.0,"a_later_one":3.0}"#), "{json}");
        assert_eq!(serde_json::from_str::<Report>(&json).unwrap(), report);
        let adaptive =
            Report { spp: 12.5, estimated_relmse: None, estimated_relmse_interval: None, ..report };
        let json = adaptive.to_json();
        assert!(json.contains(r#""spp":12.5,"#) && json.contains(r#""estimated_relmse":null"#));
        assert_eq!(serde_json::from_str::<Report>(&json).unwrap(), adaptive);
    }

    #[test]
    fn the_file_is_one_object_with_all_the_fixed_keys() {
        let folder = TestFolder::new("report");
        let path = folder.file("report.json");
        example().write(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        for key in [
            "scene",
            "engine",
            "width",
            "height",
            "spp",
            "seconds",
            "setup_seconds",
            "samples",
            "rays",
            "stages",
            "invalid_samples",
            "estimated_relmse",
            "peak_memory_bytes",
            "threads",
            "batch",
            "cpu",
            "isa",
            "sampler",
            "seed",
            "version",
        ] {
            assert!(value.get(key).is_some(), "{key}");
        }
        for key in ["camera", "bounce", "shadow"] {
            assert!(value["rays"][key].is_u64(), "{key}");
        }
        assert_eq!(folder.names(), ["report.json"]);
    }

    #[test]
    fn the_table_shows_rates_shares_and_error() {
        let table = example().to_string();
        for part in [
            "640 x 480, 64 spp",
            "9.830 M/s",
            "60.000 M/s",
            "75.0 %",
            "1.250e-3",
            "10.0 MiB",
            "sum of 2 threads",
            "125.0 ms reading, 125.0 ms tree",
            "stopped by        samples",
        ] {
            assert!(table.contains(part), "{part} is missing in\n{table}");
        }
        let adaptive = Adaptive { used: true, predicted_gain: Some(1.5), least_spp: 8, most_spp: 200 };
        assert!(!table.contains("adaptive"));
        let table = Report { adaptive: Some(adaptive), ..example() }.to_string();
        assert!(table.contains("8 to 200 spp, predicted gain 1.50"), "{table}");
        let width = table.lines().map(str::len).max().unwrap();
        assert!(width < 80, "{table}");
    }

    #[test]
    fn reports_of_earlier_versions_are_read() {
        let mut old: serde_json::Value = serde_json::from_str(&example().to_json()).unwrap();
        for key in ["setup_stages", "stopped_by"] {
            old.as_object_mut().unwrap().remove(key);
        }
        let report: Report = serde_json::from_value(old).unwrap();
        assert!(report.setup_stages.is_empty() && report.stopped_by.is_none());
    }

    #[test]
    fn counts_are_short() {
        let shown = [0, 9_999, 10_000, 1_234_567, 9_876_543_210].map(count);
        assert_eq!(shown, ["0", "9999", "10.0 k", "1.23 M", "9.88 G"]);
    }
}
