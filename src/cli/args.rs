//! The arguments of each subcommand, as data.

use std::fmt;
use std::num::NonZeroU16;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use super::parse;
use super::part_args::PartArgs;
use crate::converge::external::ExternalSpec;
use crate::engine::{EngineKind, SamplerKind};
use crate::pbrt::Override;
use crate::picture::{Compression, Encoding, Tonemap};
use crate::scene::SphericalLights;
use wavepath_kernels::channels::ChannelSet;
use wavepath_kernels::intersect::Policy;

/// Headings of the help.
const WHAT: &str = "What to render";
const QUALITY: &str = "Quality";
const OUTPUT: &str = "Output";
const SPEED: &str = "Speed";
const REPORTS: &str = "Reports";

/// Arguments of `wavepath render`.
///
/// What is `None` is the scene's or the engine's own choice. Numbers take a leading hyphen, so that
/// a negative one is told what is expected and not that it is an unknown option.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct RenderArgs {
    /// Scene in pbrt's format; or one or more meshes (.ply, .ply.gz), which get a camera, a floor and a sky
    #[arg(value_name = "SCENE.pbrt|MODEL.ply", required = true)]
    pub scene: Vec<PathBuf>,

    /// Render what can be rendered: what wavepath lacks is replaced or left out, with a warning for each
    #[arg(long, help_heading = WHAT)]
    pub lenient: bool,

    /// Size and part of the image.
    #[command(flatten)]
    pub frame: FrameArgs,

    /// How the scene around a mesh is made.
    #[command(flatten)]
    pub model: ModelArgs,

    /// Samples per pixel [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::spp, allow_hyphen_values = true, help_heading = QUALITY)]
    pub spp: Option<u32>,

    /// End after this time: 90, 90s, 1m30s, 2h
    #[arg(long, value_name = "TIME", value_parser = parse::duration, allow_hyphen_values = true,
          help_heading = QUALITY)]
    pub time: Option<Duration>,

    /// End when the estimated relMSE is this small, such as 0.005 [without --spp: at 1048576 spp at the latest]
    #[arg(long, value_name = "RELMSE", value_parser = parse::error, allow_hyphen_values = true,
          help_heading = QUALITY)]
    pub error: Option<f64>,

    /// Take more samples where the error is; --spp is the mean over the pixels then
    #[arg(long, help_heading = QUALITY)]
    pub adaptive: bool,

    /// Random numbers [default: the scene's]
    #[arg(long, value_enum, help_heading = QUALITY)]
    pub sampler: Option<SamplerArg>,

    /// Seed of the random numbers [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::seed, allow_hyphen_values = true, help_heading = QUALITY)]
    pub seed: Option<u64>,

    /// How the light of spheres is sampled
    #[arg(long, value_enum, default_value_t = SphericalLightsArg::Cone, help_heading = QUALITY)]
    pub spherical_lights: SphericalLightsArg,

    /// Image to write, linear (.exr) or for screens (.png), or film (.film); may be given more than once; - is standard
    /// output, png:- the same as PNG [default: the name in the scene's film, else the scene's name with .exr, here; that
    /// replaces an earlier picture of this scene only]
    #[arg(short, long, value_name = "OUT.exr|OUT.png|OUT.film", help_heading = OUTPUT)]
    pub output: Vec<PathBuf>,

    /// Refuse to replace any file that exists
    #[arg(long, help_heading = OUTPUT)]
    pub no_clobber: bool,

    /// How pictures become files.
    #[command(flatten)]
    pub encoding: EncodingArgs,

    /// Add each pixel's standard error (stderr.R, .G, .B) and number of samples (samples) to EXR files
    #[arg(long, help_heading = OUTPUT)]
    pub layers: bool,

    /// What else of each pixel to add to EXR files: all, or a list of depth (depth.Z, along the viewing axis)
    #[arg(long, value_name = "all|LIST", value_delimiter = ',', value_parser = parse::aov, help_heading = OUTPUT)]
    pub aov: Vec<Aov>,

    /// Show the picture in the viewer tev as it goes on, such as localhost:14158
    #[arg(long, value_name = "HOST:PORT", value_parser = parse::host_and_port, help_heading = OUTPUT)]
    pub tev: Option<String>,

    /// How paths are executed
    #[arg(long, value_enum, default_value_t = EngineArg::Wavefront, help_heading = SPEED)]
    pub engine: EngineArg,

    /// Worker threads [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true, help_heading = SPEED)]
    pub threads: Option<usize>,

    /// Paths in the pool of each worker, wavefront engine [default: fitted to the cache]
    #[arg(long, value_name = "N", value_parser = parse::batch, allow_hyphen_values = true, help_heading = SPEED)]
    pub batch: Option<usize>,

    /// How rays go through the tree, wavefront engine
    #[arg(long, value_enum, default_value_t = TraversalArg::Auto, help_heading = SPEED)]
    pub traversal: TraversalArg,

    /// Checkpoints, parts, progress.
    #[command(flatten)]
    pub long: PartArgs,

    /// Write the report as JSON to this file; - is standard output
    #[arg(long, value_name = "FILE.json", help_heading = REPORTS)]
    pub report: Option<PathBuf>,

    /// Print errors only
    #[arg(short, long, help_heading = REPORTS)]
    pub quiet: bool,
}

/// Size and part of the image.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct FrameArgs {
    /// Set a parameter of the scene over what the file says, such as camera.fov=30, camera.orbit=45,
    /// material.NAME.roughness=0.1 or light.0.scale=2; may be given more than once; `plan --names` lists what there is
    #[arg(long, value_name = "NAME=VALUE", help_heading = WHAT)]
    pub set: Vec<Override>,

    /// Size of the full image in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = parse::resolution, help_heading = WHAT)]
    pub resolution: Option<Resolution>,

    /// Render this part only, in fractions of the image (0.25,0.75,0,1) or in pixels (100,200,50,80), from the top left
    /// corner, ends excluded [default: the scene's]
    #[arg(long, value_name = "X0,X1,Y0,Y1", value_parser = parse::crop, allow_hyphen_values = true,
          help_heading = WHAT)]
    pub crop: Option<Crop>,

    /// The same in fractions, as pbrt calls it
    #[arg(long, value_name = "X0,X1,Y0,Y1", value_parser = parse::fractions, allow_hyphen_values = true,
          conflicts_with = "crop", help_heading = WHAT)]
    pub cropwindow: Option<Crop>,

    /// The same in pixels, as pbrt calls it
    #[arg(long, value_name = "X0,X1,Y0,Y1", value_parser = parse::pixels, allow_hyphen_values = true,
          conflicts_with_all = ["crop", "cropwindow"], help_heading = WHAT)]
    pub pixelbounds: Option<Crop>,
}

impl FrameArgs {
    /// The part to render, under whichever name it was given.
    pub fn part(&self) -> Option<Crop> {
        self.crop.or(self.cropwindow).or(self.pixelbounds)
    }
}

/// How the scene around a mesh is made.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct ModelArgs {
    /// Axis of a mesh that points up: x, y, z, -x, -y, -z [default: y]
    #[arg(long, value_name = "AXIS", value_parser = parse::axis, allow_hyphen_values = true, help_heading = WHAT)]
    pub up: Option<[f64; 3]>,

    /// What a mesh is made of [default: neutral]
    #[arg(long, value_enum, help_heading = WHAT)]
    pub material: Option<ModelMaterial>,

    /// Write the scene that is made around a mesh to this file, to go on from there; - is standard output
    #[arg(long, value_name = "FILE.pbrt", help_heading = WHAT)]
    pub write_scene: Option<PathBuf>,
}

/// How pictures become files.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct EncodingArgs {
    /// Brightens PNG files by this many stops [default: 0]
    #[arg(long, value_name = "STOPS", default_value = "0", hide_default_value = true, value_parser = parse::stops,
          allow_hyphen_values = true, help_heading = OUTPUT)]
    pub exposure: f32,

    /// Curve of PNG files
    #[arg(long, value_enum, default_value_t = TonemapChoice::Srgb, help_heading = OUTPUT)]
    pub tonemap: TonemapChoice,

    /// Bits of a channel in PNG files
    #[arg(long, value_name = "8|16", default_value = "8", value_parser = parse::bits, help_heading = OUTPUT)]
    pub bits: u8,

    /// EXR files with 16-bit floating point [default: 32-bit, unless the scene says savefp16]
    #[arg(long, help_heading = OUTPUT)]
    pub half: bool,

    /// Compression of EXR files; all of them keep every bit
    #[arg(long, value_enum, default_value_t = CompressionChoice::Zip, help_heading = OUTPUT)]
    pub compression: CompressionChoice,

    /// EXR files in square tiles of N pixels a side, for programs that show parts of big pictures [default: in lines]
    #[arg(long, value_name = "N", value_parser = parse::tile, help_heading = OUTPUT)]
    pub exr_tiles: Option<NonZeroU16>,
}

impl EncodingArgs {
    /// As pictures are written; `half` if someone else asks for that.
    pub fn encoding(&self, half: bool) -> Encoding {
        Encoding {
            exposure: self.exposure,
            tonemap: match self.tonemap {
                TonemapChoice::Srgb => Tonemap::Srgb,
                TonemapChoice::Agx => Tonemap::Agx,
                TonemapChoice::Aces => Tonemap::Aces,
            },
            sixteen_bits: self.bits == 16,
            half: self.half || half,
            compression: match self.compression {
                CompressionChoice::None => Compression::None,
                CompressionChoice::Rle => Compression::Rle,
                CompressionChoice::Zips => Compression::Zips,
                CompressionChoice::Zip => Compression::Zip,
                CompressionChoice::Piz => Compression::Piz,
            },
            tile: self.exr_tiles,
        }
    }
}

/// Arguments of `wavepath convert`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct ConvertArgs {
    /// Image to read: .exr, .png or .hdr
    #[arg(value_name = "IN.exr")]
    pub input: PathBuf,

    /// Images to write: .exr or .png; - is standard output, png:- the same as PNG
    #[arg(value_name = "OUT.png|OUT.exr", required = true)]
    pub outputs: Vec<PathBuf>,

    /// Keep this part only: fractions (0.25,0.75,0,1) or pixels (100,200,50,80) of the full frame
    #[arg(long, value_name = "X0,X1,Y0,Y1", value_parser = parse::crop, allow_hyphen_values = true)]
    pub crop: Option<Crop>,

    /// Show this layer in place of the colours: NAME.R, .G and .B, or the channel NAME as grey, such as stderr or samples
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,

    /// Leave out all channels but the colours [default: EXR files keep them]
    #[arg(long)]
    pub drop_layers: bool,

    /// Refuse to replace any file that exists
    #[arg(long)]
    pub no_clobber: bool,

    /// How pictures become files.
    #[command(flatten)]
    pub encoding: EncodingArgs,

    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,
}

/// Channels that one word of `--aov` asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Aov(pub ChannelSet);

/// Arguments of `wavepath plan`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct PlanArgs {
    /// Scene to plan for, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// Render what can be rendered: what wavepath lacks is replaced or left out, with a warning for each
    #[arg(long, help_heading = WHAT)]
    pub lenient: bool,

    /// Size and part of the image.
    #[command(flatten)]
    pub frame: FrameArgs,

    /// Samples per pixel [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::spp, allow_hyphen_values = true, help_heading = QUALITY)]
    pub spp: Option<u32>,

    /// As for render: how the light of spheres is sampled
    #[arg(long, value_enum, default_value_t = SphericalLightsArg::Cone, help_heading = QUALITY)]
    pub spherical_lights: SphericalLightsArg,

    /// Worker threads, for the memory of all [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true, help_heading = SPEED)]
    pub threads: Option<usize>,

    /// Paths in the pool of each worker [default: fitted to the cache]
    #[arg(long, value_name = "N", value_parser = parse::batch, allow_hyphen_values = true, help_heading = SPEED)]
    pub batch: Option<usize>,

    /// Print names and values of everything that --set can change, and nothing else
    #[arg(long, help_heading = REPORTS)]
    pub names: bool,

    /// Print one JSON object instead of a table
    #[arg(long, help_heading = REPORTS)]
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

    /// Render what can be rendered: what wavepath lacks is replaced or left out, with a warning for each
    #[arg(long, help_heading = WHAT)]
    pub lenient: bool,

    /// Instead: what one scene would take on 1 to 10,000 nodes like this one, by a model whose figures are measured here
    #[arg(long)]
    pub scale: bool,

    /// With --scale: samples per pixel that are asked about [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse::spp, allow_hyphen_values = true, requires = "scale")]
    pub spp: Option<u32>,

    /// With --scale: bytes a second of the network
    #[arg(long, value_name = "SIZE", value_parser = parse::memory, default_value = "1192M", requires = "scale")]
    pub network: u64,

    /// Print JSON instead of a table
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `wavepath compare`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct CompareArgs {
    /// Image to judge
    #[arg(value_name = "IMAGE")]
    pub image: PathBuf,

    /// What it should be. Both may be OpenEXR, PNG or Radiance HDR; one may show a part of the other's frame. Without it:
    /// where the image itself estimates its error (an EXR file of `render --layers`)
    #[arg(value_name = "REFERENCE")]
    pub reference: Option<PathBuf>,

    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,

    /// Exit with status 1 if the relMSE is above this, such as 1e-3. What the reference is off itself, where its file
    /// states that, is subtracted first
    #[arg(long, value_name = "RELMSE", value_parser = parse::error, allow_hyphen_values = true)]
    pub fail_above: Option<f64>,

    /// Write each pixel's relative squared error as an image: values (.exr), or colours with their scale (.png)
    #[arg(long, value_name = "FILE.exr|FILE.png")]
    pub map: Option<PathBuf>,
}

/// Arguments of `wavepath converge`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct ConvergeArgs {
    /// Scene to render, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// As for render: set a parameter of the scene
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<Override>,

    /// Folder for the results; it is made if it is missing
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,

    /// The converged picture [default: for each run, the mean of the runs with other seeds]
    #[arg(long, value_name = "REFERENCE.exr")]
    pub reference: Option<PathBuf>,

    /// Engines to compare
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [EngineArg::Wavefront, EngineArg::Megakernel])]
    pub engines: Vec<EngineArg>,

    /// Samplers to compare
    #[arg(long, value_enum, value_delimiter = ',',
          default_values_t = [SamplerArg::Sobol, SamplerArg::Independent])]
    pub samplers: Vec<SamplerArg>,

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

    /// Picture of another program and the time that it took; may be given more than once
    #[arg(long, value_name = "NAME:TIME:FILE.exr", value_parser = crate::converge::external::parse)]
    pub external: Vec<ExternalSpec>,

    /// Worker threads [default: one per processor]
    #[arg(long, value_name = "N", value_parser = parse::threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// Size of the image in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = parse::resolution)]
    pub resolution: Option<Resolution>,

    /// Print errors and the table only
    #[arg(short, long)]
    pub quiet: bool,
}

/// A part of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Crop {
    /// `[x0, x1, y0, y1]`, from 0 to 1, not empty.
    Fractions([f64; 4]),
    /// The same in pixels.
    Pixels([u32; 4]),
}

impl Crop {
    /// The pixels `[x0, x1, y0, y1]` of an image of this size, half open. Fractions are rounded up at both ends, as pbrt
    /// does it, so that parts side by side fit together.
    ///
    /// # Errors
    /// In words, if there are none, or not all of them.
    pub fn bounds(self, [width, height]: [u32; 2]) -> Result<[u32; 4], String> {
        let bounds = match self {
            Crop::Pixels(bounds) => bounds,
            Crop::Fractions([x0, x1, y0, y1]) => {
                let up = |fraction: f64, side: u32| (fraction * f64::from(side)).ceil() as u32;
                [up(x0, width), up(x1, width), up(y0, height), up(y1, height)]
            }
        };
        let [x0, x1, y0, y1] = bounds;
        if x1 > width || y1 > height {
            return Err(format!("{x0},{x1},{y0},{y1} reaches beyond the image of {width} x {height} pixels"));
        }
        if x0 >= x1 || y0 >= y1 {
            return Err(format!("no pixel of the image of {width} x {height} is inside"));
        }
        Ok(bounds)
    }
}

/// Curves of PNG files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum TonemapChoice {
    /// None: what is brighter than 1 is white
    #[default]
    Srgb,
    /// AgX: soft, bright colours fade to white
    Agx,
    /// ACES: film-like, with contrast
    Aces,
}

/// Compressions of EXR files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum CompressionChoice {
    /// Largest and fastest
    None,
    /// Runs of equal bytes
    Rle,
    /// Deflate, line by line
    Zips,
    /// Deflate over 16 lines
    #[default]
    Zip,
    /// Wavelets: small for noisy pictures
    Piz,
}

/// What a mesh is made of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum ModelMaterial {
    /// Grey and diffuse
    #[default]
    Neutral,
    /// Warm, diffuse and rough
    Clay,
    /// Rough gold
    Gold,
    /// Rough copper
    Copper,
    /// Polished aluminium
    Mirror,
    /// Clear glass
    Glass,
}

/// Arguments of `wavepath stability`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct StabilityArgs {
    /// Only cases whose name contains this; may be given more than once
    #[arg(long, value_name = "NAME")]
    pub case: Vec<String>,

    /// Engine that renders
    #[arg(long, value_enum, default_value_t = EngineArg::Wavefront)]
    pub engine: EngineArg,

    /// Instruction set [default: the best of this machine]
    #[arg(long, value_name = "SET", value_parser = parse::level)]
    pub isa: Option<wavepath_kernels::isa::Level>,

    /// Rays aimed at edges and vertices, for each of nine closed meshes and four ways through the tree
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    pub rays: usize,

    /// Write a page, stability.html, and stability.json into this folder; it is made if it is missing
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,

    /// Print one JSON object instead of a table
    #[arg(long, conflicts_with = "markdown")]
    pub json: bool,

    /// Print tables in Markdown
    #[arg(long)]
    pub markdown: bool,

    /// Print the names of the cases, and measure nothing
    #[arg(long)]
    pub list: bool,

    /// Print errors and the table only
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `wavepath batch`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct BatchArgs {
    /// A queue; or scenes, folders of scenes and patterns such as 'shots/*.pbrt'
    #[arg(value_name = "JOBS.toml|SCENE|FOLDER", required = true)]
    pub what: Vec<PathBuf>,

    /// Name of the picture of each scene, by pattern: {scene} is its name, #### its number [default: {scene}.exr]
    #[arg(short, long, value_name = "PATTERN")]
    pub output: Option<String>,

    /// Jobs at once, each with its share of the processors
    #[arg(long, value_name = "N", default_value = "1", value_parser = parse::threads, allow_hyphen_values = true)]
    pub jobs: usize,

    /// Memory for all jobs at once, such as 8G: as their plans say [default: nine tenths of what is free]
    #[arg(long, value_name = "SIZE", value_parser = parse::memory)]
    pub memory: Option<u64>,

    /// Do what is done, too
    #[arg(long)]
    pub again: bool,

    /// Print what there is to do, and do nothing
    #[arg(long)]
    pub dry_run: bool,

    /// Where it is kept what is done [default: JOBS.batch beside JOBS.toml; of scenes, wavepath.batch here]
    #[arg(long, value_name = "DIR")]
    pub state: Option<PathBuf>,

    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,

    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,

    /// Options of render, for all jobs
    #[arg(last = true, value_name = "OPTIONS")]
    pub options: Vec<String>,
}

/// Arguments of `wavepath check`.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct CheckArgs {
    /// Scene to check, in pbrt's format
    #[arg(value_name = "SCENE.pbrt")]
    pub scene: PathBuf,

    /// As for render: set a parameter of the scene
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<Override>,

    /// Print one JSON object instead of text
    #[arg(long)]
    pub json: bool,
}

/// How paths are executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EngineArg {
    /// Many paths at a time, stage by stage, in SIMD kernels
    Wavefront,
    /// One path at a time from camera to end: the naive baseline
    Megakernel,
    /// The same through the wavefront's tree
    MegakernelWide,
}

/// How the rays of a batch go through the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TraversalArg {
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
pub enum SamplerArg {
    /// Owen-scrambled Sobol points
    Sobol,
    /// Independent uniform numbers
    Independent,
}

/// How the light of spheres is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphericalLightsArg {
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
display_as_value!(
    CompressionChoice,
    EngineArg,
    ModelMaterial,
    TonemapChoice,
    SamplerArg,
    SphericalLightsArg,
    TraversalArg
);

/// Size of an image in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resolution {
    /// Pixels per row, 1 to 65536.
    pub width: u32,
    /// Rows, 1 to 65536; the product is at most 2^28.
    pub height: u32,
}

impl From<EngineArg> for EngineKind {
    fn from(engine: EngineArg) -> Self {
        match engine {
            EngineArg::Wavefront => EngineKind::Wavefront,
            EngineArg::Megakernel => EngineKind::Megakernel,
            EngineArg::MegakernelWide => EngineKind::MegakernelWide,
        }
    }
}

impl From<SamplerArg> for SamplerKind {
    fn from(sampler: SamplerArg) -> Self {
        match sampler {
            SamplerArg::Sobol => SamplerKind::Sobol,
            SamplerArg::Independent => SamplerKind::Independent,
        }
    }
}

impl From<TraversalArg> for Policy {
    fn from(traversal: TraversalArg) -> Self {
        match traversal {
            TraversalArg::Auto => Policy::Auto,
            TraversalArg::Single => Policy::Single,
            TraversalArg::Mixed => Policy::Mixed,
            TraversalArg::Packets => Policy::Packets,
            TraversalArg::Sorted => Policy::Sorted,
            TraversalArg::Interleaved => Policy::Interleaved,
        }
    }
}

impl From<SphericalLightsArg> for SphericalLights {
    fn from(lights: SphericalLightsArg) -> Self {
        match lights {
            SphericalLightsArg::Cone => SphericalLights::Cone,
            SphericalLightsArg::Area => SphericalLights::Area,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use clap::error::ErrorKind;

    use super::*;
    use wavepath_kernels::channels::Channel;

    fn parse<A: Args>(words: &str) -> Result<A, clap::Error> {
        let command = A::augment_args(clap::Command::new("wavepath"));
        let words = std::iter::once("wavepath").chain(words.split_whitespace());
        A::from_arg_matches(&command.try_get_matches_from(words)?)
    }

    #[test]
    fn render_takes_every_fixed_name() {
        let args: RenderArgs = parse(
            "a.pbrt -o b.exr --spp 16 --time 1.5m --error 0.01 --adaptive --layers --aov depth,all --tev localhost:14158 --engine megakernel --sampler independent \
             --threads 3 --seed 9 --batch 4096 --resolution 640x480 --exposure -1.5 \
             --spherical-lights area --traversal mixed --report c.json -q -o b.png --half --tonemap agx --bits 16 \
             --compression piz --exr-tiles 64 --no-clobber --crop 0,0.5,0,1 --lenient --set camera.fov=30",
        )
        .unwrap();
        let expected = RenderArgs {
            scene: vec!["a.pbrt".into()],
            output: vec!["b.exr".into(), "b.png".into()],
            no_clobber: true,
            frame: FrameArgs {
                resolution: Some(Resolution { width: 640, height: 480 }),
                crop: Some(Crop::Fractions([0.0, 0.5, 0.0, 1.0])),
                set: vec![Override::new("camera.fov", "30")],
                ..FrameArgs::default()
            },
            model: ModelArgs::default(),
            encoding: EncodingArgs {
                exposure: -1.5,
                tonemap: TonemapChoice::Agx,
                bits: 16,
                half: true,
                compression: CompressionChoice::Piz,
                exr_tiles: NonZeroU16::new(64),
            },
            spp: Some(16),
            time: Some(Duration::from_secs(90)),
            error: Some(0.01),
            adaptive: true,
            engine: EngineArg::Megakernel,
            sampler: Some(SamplerArg::Independent),
            threads: Some(3),
            seed: Some(9),
            batch: Some(4096),
            layers: true,
            aov: vec![Aov(ChannelSet::default().with(Channel::Depth)), Aov(ChannelSet::all())],
            tev: Some("localhost:14158".into()),
            spherical_lights: SphericalLightsArg::Area,
            traversal: TraversalArg::Mixed,
            lenient: true,
            long: PartArgs::default(),
            report: Some("c.json".into()),
            quiet: true,
        };
        assert_eq!(args, expected);
    }

    #[test]
    fn render_leaves_choices_to_the_scene() {
        let args: RenderArgs = parse("a.pbrt").unwrap();
        assert_eq!((args.spp, args.sampler, args.seed), (None, None, None));
        assert_eq!((args.engine, args.encoding.exposure), (EngineArg::Wavefront, 0.0));
        assert_eq!(args.spherical_lights, SphericalLightsArg::Cone);
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
            ("a.pbrt --aov depht", "expected all, or a list of: depth"),
            ("a.pbrt --aov depth,radiance", "expected all, or a list of: depth"),
            ("a.pbrt --engine gpu", "wavefront, megakernel"),
            ("a.pbrt --resolution 0x0", "from 1 to 65536"),
            ("a.pbrt --batch 1", "from 64 to 262144"),
            ("a.pbrt --exposure nan", "from -100 to 100"),
            ("a.pbrt --crop 1,2", "X0,X1,Y0,Y1"),
            ("a.pbrt --crop 0,1,0,1 --pixelbounds 0,9,0,9", "cannot be used with"),
            ("a.pbrt --bits 12", "8 or 16"),
            ("a.pbrt --up left", "x, y, z"),
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
        assert!(plan.json && plan.scene.as_path() == std::path::Path::new("a.pbrt") && plan.spp.is_none());
        let convert: ConvertArgs = parse("a.exr b.png c.exr --layer stderr").unwrap();
        assert_eq!((convert.outputs.len(), convert.layer.as_deref()), (2, Some("stderr")));
        let bench: BenchArgs = parse("a.pbrt b.pbrt").unwrap();
        assert_eq!((bench.scenes.len(), bench.json), (2, false));
        let compare: CompareArgs = parse("a.exr b.exr --map c.png").unwrap();
        assert_eq!(compare.map, Some("c.png".into()));
        let converge: ConvergeArgs =
            parse("a.pbrt --engines megakernel --adaptive --budget 2m --external b:1:b.exr -o c").unwrap();
        assert_eq!((converge.engines, converge.samplers.len()), (vec![EngineArg::Megakernel], 2));
        assert!(converge.adaptive);
        assert_eq!((converge.budget, converge.seeds), (Duration::from_secs(120), 3));
        assert_eq!(converge.external[0].name, "b");
        let error = parse::<ConvergeArgs>("a.pbrt --seeds 0 -o c").unwrap_err();
        assert!(error.to_string().contains("from 1 to 1000"), "{error}");
        assert_eq!(parse::<CompareArgs>("a.exr").unwrap().reference, None);
        let error = parse::<CompareArgs>("").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::MissingRequiredArgument);
        assert!(super::super::Cli::try_parse_from(["wavepath", "paint"]).is_err());
    }

    #[test]
    fn choices_are_written_as_they_are_typed() {
        assert_eq!(EngineArg::Megakernel.to_string(), "megakernel");
        assert_eq!(SamplerArg::Sobol.to_string(), "sobol");
        assert_eq!(SphericalLightsArg::Cone.to_string(), "cone");
    }
}
