//! The arguments of each subcommand, as data.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use super::parse;
use crate::converge::external::ExternalSpec;

/// Arguments of `wavepath render`.
///
/// What is `None` is the scene's or the engine's own choice. Numbers take a leading hyphen, so that
/// a negative one is told what is expected and not that it is an unknown option.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct RenderArgs {
    /// Scene to render, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// Image to write: OUT.exr (linear) or OUT.png (sRGB)
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    pub output: Option<PathBuf>,

    /// Samples per pixel [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::spp, allow_hyphen_values = true)]
    pub spp: Option<u32>,

    /// End after this time: 30s, 2m, 1.5h, 500ms
    #[arg(long, value_name = "TIME", value_parser = parse::duration, allow_hyphen_values = true)]
    pub time: Option<Duration>,

    /// End when the estimated relMSE is this small, such as 0.005 [without --spp: at 1048576 spp at the latest]
    #[arg(long, value_name = "RELMSE", value_parser = parse::error, allow_hyphen_values = true)]
    pub error: Option<f64>,

    /// Take more samples where the error is; --spp is the mean over the pixels then
    #[arg(long)]
    pub adaptive: bool,

    /// How paths are executed
    #[arg(long, value_enum, default_value_t = Engine::Wavefront)]
    pub engine: Engine,

    /// Random numbers [default: the scene's]
    #[arg(long, value_enum)]
    pub sampler: Option<SamplerChoice>,

    /// Worker threads [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// Seed of the random numbers [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::seed, allow_hyphen_values = true)]
    pub seed: Option<u64>,

    /// Paths in the pool of each worker, wavefront engine [default: fitted to the cache]
    #[arg(long, value_name = "N", value_parser = parse::batch, allow_hyphen_values = true)]
    pub batch: Option<usize>,

    /// How rays go through the tree, wavefront engine
    #[arg(long, value_enum, default_value_t = Traversal::Auto)]
    pub traversal: Traversal,

    /// Size of the image in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = parse::resolution)]
    pub resolution: Option<Resolution>,

    /// Brightens the PNG by this many stops; EXR files keep the values
    #[arg(long, value_name = "STOPS", default_value = "0", value_parser = parse::stops,
          allow_hyphen_values = true)]
    pub exposure: f32,

    /// Add each pixel's standard error (stderr.R, .G, .B) and number of samples (samples) to the EXR
    #[arg(long)]
    pub layers: bool,

    /// Show the picture in the viewer tev as it goes on, such as localhost:14158
    #[arg(long, value_name = "HOST:PORT", value_parser = parse::host_and_port)]
    pub tev: Option<String>,

    /// How the light of spheres is sampled
    #[arg(long, value_enum, default_value_t = SphericalLights::Cone)]
    pub spherical_lights: SphericalLights,

    /// Write the report as JSON to this file
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,

    /// Print errors only
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `wavepath plan`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct PlanArgs {
    /// Scene to plan for, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wavepath bench`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct BenchArgs {
    /// Scenes to measure [default: five that ship with wavepath, in the folder scenes]
    #[arg(value_name = "SCENE.pbrt")]
    pub scenes: Vec<PathBuf>,

    /// Rounds of each comparison
    #[arg(long, value_name = "N", value_parser = parse::rounds, default_value = "5", allow_hyphen_values = true)]
    pub rounds: usize,

    /// Time of one measurement
    #[arg(long, value_name = "TIME", value_parser = parse::duration, default_value = "300ms",
          allow_hyphen_values = true)]
    pub each: Duration,

    /// Most worker threads [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// Print JSON instead of a table
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wavepath compare`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct CompareArgs {
    /// Image to judge
    #[arg(value_name = "IMAGE.exr")]
    pub image: PathBuf,

    /// What it should be
    #[arg(value_name = "REFERENCE.exr")]
    pub reference: PathBuf,

    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,

    /// Write each pixel's relative squared error as an image: values (.exr) or colours (.png)
    #[arg(long, value_name = "FILE.exr|FILE.png")]
    pub map: Option<PathBuf>,
}

/// Arguments of `wavepath converge`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct ConvergeArgs {
    /// Scene to render, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// Folder for the results; it is made if it is missing
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,

    /// The converged picture [default: for each run, the mean of the runs with other seeds]
    #[arg(long, value_name = "REFERENCE.exr")]
    pub reference: Option<PathBuf>,

    /// Engines to compare
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Engine::Wavefront, Engine::Megakernel])]
    pub engines: Vec<Engine>,

    /// Samplers to compare
    #[arg(long, value_enum, value_delimiter = ',',
          default_values_t = [SamplerChoice::Sobol, SamplerChoice::Independent])]
    pub samplers: Vec<SamplerChoice>,

    /// Compare each engine and sampler with and without adaptive sampling
    #[arg(long)]
    pub adaptive: bool,

    /// Rendering time of each run: there are engines x samplers x seeds of them, and as many again with --adaptive
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = parse::duration,
          allow_hyphen_values = true)]
    pub budget: Duration,

    /// Runs of each engine and sampler, each with a seed of its own
    #[arg(long, value_name = "N", default_value = "3", value_parser = parse::seeds, allow_hyphen_values = true)]
    pub seeds: usize,

    /// Picture of another program and the seconds that it took; may be given more than once
    #[arg(long, value_name = "NAME:SECONDS:FILE.exr", value_parser = crate::converge::external::parse)]
    pub external: Vec<ExternalSpec>,

    /// Worker threads [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// Size of the image in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = parse::resolution)]
    pub resolution: Option<Resolution>,

    /// Print errors and the table only
    #[arg(long)]
    pub quiet: bool,
}

/// How paths are executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Many paths at a time, stage by stage, in SIMD kernels
    Wavefront,
    /// One path at a time from camera to end: the naive baseline
    Megakernel,
    /// The same through the wavefront's tree
    MegakernelWide,
}

/// How the rays of a batch go through the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Traversal {
    /// What is fastest, by the class of the rays and the size of the tree
    Auto,
    /// One by one
    Single,
    /// Rays from the camera and of first shadows in packets, others one by one
    Mixed,
    /// As many at a time as a vector has lanes
    Packets,
    /// In packets, bounce rays put in order first
    Sorted,
    /// Several in flight, a node each in turn
    Interleaved,
}

/// Random numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SamplerChoice {
    /// Owen-scrambled Sobol points
    Sobol,
    /// Independent uniform numbers
    Independent,
}

/// How the light of spheres is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphericalLights {
    /// Directions in the cone that the sphere fills
    Cone,
    /// Points on the sphere's surface
    Area,
}

/// Writes the name as the command line has it.
macro_rules! display_as_value {
    ($($choice:ty),*) => {$(
        impl fmt::Display for $choice {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let value = self.to_possible_value().expect("no choice is skipped");
                f.write_str(value.get_name())
            }
        }
    )*};
}
display_as_value!(Engine, SamplerChoice, SphericalLights, Traversal);

/// Size of an image in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resolution {
    /// Pixels per row, 1 to 65536.
    pub width: u32,
    /// Rows, 1 to 65536; the product is at most 2^28.
    pub height: u32,
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use clap::error::ErrorKind;

    use super::*;

    fn parse<A: Args>(words: &str) -> Result<A, clap::Error> {
        let command = A::augment_args(clap::Command::new("wavepath"));
        let words = std::iter::once("wavepath").chain(words.split_whitespace());
        A::from_arg_matches(&command.try_get_matches_from(words)?)
    }

    #[test]
    fn render_takes_every_fixed_name() {
        let args: RenderArgs = parse(
            "a.pbrt -o b.exr --spp 16 --time 1.5m --error 0.01 --adaptive --layers --tev localhost:14158 --engine megakernel --sampler independent \
             --threads 3 --seed 9 --batch 4096 --resolution 640x480 --exposure -1.5 \
             --spherical-lights area --traversal mixed --report c.json --quiet",
        )
        .unwrap();
        let expected = RenderArgs {
            scene: "a.pbrt".into(),
            output: Some("b.exr".into()),
            spp: Some(16),
            time: Some(Duration::from_secs(90)),
            error: Some(0.01),
            adaptive: true,
            engine: Engine::Megakernel,
            sampler: Some(SamplerChoice::Independent),
            threads: Some(3),
            seed: Some(9),
            batch: Some(4096),
            resolution: Some(Resolution { width: 640, height: 480 }),
            exposure: -1.5,
            layers: true,
            tev: Some("localhost:14158".into()),
            spherical_lights: SphericalLights::Area,
            traversal: Traversal::Mixed,
            report: Some("c.json".into()),
            quiet: true,
        };
        assert_eq!(args, expected);
    }

    #[test]
    fn render_leaves_choices_to_the_scene() {
        let args: RenderArgs = parse("a.pbrt").unwrap();
        assert_eq!((args.spp, args.sampler, args.seed), (None, None, None));
        assert_eq!((args.engine, args.exposure), (Engine::Wavefront, 0.0));
        assert_eq!(args.spherical_lights, SphericalLights::Cone);
    }

    #[test]
    fn wrong_values_name_the_option_and_what_is_expected() {
        for (words, expected) in [
            ("a.pbrt --spp 0", "from 1 to 2147483648"),
            ("a.pbrt --spp -4", "--spp"),
            ("a.pbrt --time soon", "such as 30s"),
            ("a.pbrt --time -3s", "--time"),
            ("a.pbrt --error 0", "found \"0\"; expected a relMSE that is more than zero"),
            ("a.pbrt --error -1", "--error"),
            ("a.pbrt --engine gpu", "wavefront, megakernel"),
            ("a.pbrt --resolution 0x0", "from 1 to 65536"),
            ("a.pbrt --batch 1", "from 64 to 262144"),
            ("a.pbrt --exposure nan", "from -100 to 100"),
            ("", "SCENE.pbrt"),
        ] {
            let error = parse::<RenderArgs>(words).unwrap_err();
            assert!(error.to_string().contains(expected), "{words}: {error}");
            assert_eq!(error.exit_code(), 2);
        }
    }

    #[test]
    fn the_other_subcommands() {
        let plan: PlanArgs = parse("a.pbrt --json").unwrap();
        assert_eq!(plan, PlanArgs { scene: "a.pbrt".into(), json: true });
        let bench: BenchArgs = parse("a.pbrt b.pbrt").unwrap();
        assert_eq!((bench.scenes.len(), bench.json), (2, false));
        let compare: CompareArgs = parse("a.exr b.exr --map c.png").unwrap();
        assert_eq!(compare.map, Some("c.png".into()));
        let converge: ConvergeArgs =
            parse("a.pbrt --engines megakernel --adaptive --budget 2m --external b:1:b.exr -o c").unwrap();
        assert_eq!((converge.engines, converge.samplers.len()), (vec![Engine::Megakernel], 2));
        assert!(converge.adaptive);
        assert_eq!((converge.budget, converge.seeds), (Duration::from_secs(120), 3));
        assert_eq!(converge.external[0].name, "b");
        let error = parse::<ConvergeArgs>("a.pbrt --seeds 0 -o c").unwrap_err();
        assert!(error.to_string().contains("from 1 to 1000"), "{error}");
        let error = parse::<CompareArgs>("a.exr").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::MissingRequiredArgument);
        assert!(super::super::Cli::try_parse_from(["wavepath", "paint"]).is_err());
    }

    #[test]
    fn choices_are_written_as_they_are_typed() {
        assert_eq!(Engine::Megakernel.to_string(), "megakernel");
        assert_eq!(SamplerChoice::Sobol.to_string(), "sobol");
        assert_eq!(SphericalLights::Cone.to_string(), "cone");
    }
}
