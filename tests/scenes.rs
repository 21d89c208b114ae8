//! The shipped scenes against their references: the wavefront with Sobol points against images of the megakernel with
//! independent random numbers, made by `scenes/make-references.sh`. And the white furnaces against 1.

use std::path::Path;

use wavepath::compare::{block_relmse, compare};
use wavepath::picture::{self, Image};
use wavepath::scene::{SamplerKind, SceneOptions};
use wavepath::{Render, Scene};

/// Side of the images and references, in pixels.
const SIDE: u32 = 64;

/// Side of the blocks that are averaged before they are compared.
const BLOCK: u32 = 8;

/// Renders a shipped scene by the wavefront; no sample may be invalid.
fn render(name: &str, spp: u32) -> Image {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("pbrt");
    let options = SceneOptions { resolution: Some([SIDE, SIDE]), ..SceneOptions::default() };
    let scene = Scene::open_with(&path, &options).unwrap();
    assert!(scene.warnings().is_empty(), "{name}: warnings");
    let render = Render::new(&scene).spp(spp).threads(2).seed(1).sampler(SamplerKind::Sobol);
    let picture = render.run().unwrap();
    let report = picture.report();
    assert_eq!(report.invalid_samples, 0, "{name}: invalid samples");
    assert_eq!(report.samples, u64::from(spp) * u64::from(SIDE * SIDE), "{name}: samples");
    picture.into_image()
}

/// Standard error of the mean ratio of a channel, from the spread of the pixels' differences: pixels are independent
/// of each other.
fn standard_error(image: &Image, reference: &Image, channel: usize) -> f64 {
    let n = image.pixels.len() as f64;
    let difference = |(i, r): (&[f32; 3], &[f32; 3])| f64::from(i[channel]) - f64::from(r[channel]);
    let pairs = || image.pixels.iter().zip(&reference.pixels).map(difference);
    let mean = pairs().sum::<f64>() / n;
    let variance = pairs().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let sum: f64 = reference.pixels.iter().map(|r| f64::from(r[channel])).sum();
    (variance * n).sqrt() / sum
}

/// Holds a scene against its reference. `noise` is its relMSE with one independent sample a pixel, at this size, and
/// `reference_spp` the samples that the reference has of them.
///
/// - The mean of every channel is that of the reference within 4 standard errors or 0.3 %, whichever is more; and 4
///   standard errors are at most 1.2 %, so that this says something.
/// - The relMSE of 8x8 blocks is at most four times what noise explains: that of the image, with independent samples, and
///   that of the reference, over 64 independent pixels. The image has Sobol points, which are better; the rest of the
///   four is a margin for the few blocks that see a caustic, which rule the sum.
fn check(name: &str, spp: u32, noise: f64, reference_spp: u32) {
    let image = render(name, spp);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/references");
    let reference = picture::read(&folder.join(name).with_extension("exr")).unwrap();
    let comparison = compare(&image, &reference).unwrap();
    assert_eq!(comparison.invalid_pixels, 0, "{name}");
    for (channel, ratio) in comparison.mean_ratio.into_iter().enumerate() {
        let error = 4.0 * standard_error(&image, &reference, channel);
        println!("{name}: channel {channel}: ratio {ratio:.5} +- {error:.5}");
        assert!(error < 0.012, "{name}: too noisy: {error}");
        assert!((ratio - 1.0).abs() <= error.max(0.003), "{name}: channel {channel}: {ratio} +- {error}");
    }
    let blocks = block_relmse(&image, &reference, BLOCK).unwrap();
    let limit =
        4.0 * noise * (1.0 / f64::from(spp) + 1.0 / f64::from(reference_spp)) / f64::from(BLOCK * BLOCK);
    println!("{name}: relMSE {:.2e}, of blocks {blocks:.2e} of {limit:.2e}", comparison.relmse);
    assert!(blocks <= limit, "{name}: relMSE of blocks {blocks} above {limit}");
}

/// Tests of scenes: name, file, samples a pixel, relMSE of one independent sample a pixel, samples a pixel of the
/// reference (as in `make-references.sh`).
macro_rules! scenes {
    ($($test:ident $name:literal $spp:literal $noise:literal $reference_spp:literal;)*) => {$(
        #[test]
        fn $test() {
            check($name, $spp, $noise, $reference_spp);
        }
    )*};
}
scenes! {
    caustics "caustics" 1024 16.0 24576;
    cornell "cornell" 512 1.1 24576;
    depth_of_field "depth-of-field" 512 1.1 12288;
    glass_pane "glass-pane" 512 1.0 16384;
    inside_emitter "inside-emitter" 256 0.12 8192;
    many_lights "many-lights" 512 6.6 24576;
    metals "metals" 512 2.0 16384;
    oren_nayar "oren-nayar" 256 0.092 8192;
    sky_only "sky-only" 256 0.16 8192;
    spotlight "spotlight" 512 5.6 24576;
    textures "textures" 256 0.092 8192;
    two_spheres "two-spheres" 256 0.016 4096;
    wineglass "wineglass" 1024 5.7 16384;
}

/// Nothing absorbs and light comes evenly from everywhere: all pixels are 1, within 4 standard errors and the
/// `cut_off` by `maxdepth`, in the mean over the image.
fn furnace(name: &str, cut_off: f64) {
    let image = render(name, 256);
    let n = image.pixels.len() as f64;
    for channel in 0..3 {
        let values = || image.pixels.iter().map(|p| f64::from(p[channel]));
        let mean = values().sum::<f64>() / n;
        let error = (values().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
        println!("{name}: channel {channel}: {mean:.6} +- {error:.1e}");
        assert!((mean - 1.0).abs() <= 4.0 * error + cut_off, "{name}: channel {channel}: {mean} +- {error}");
    }
}

#[test]
fn furnaces_without_loss() {
    for name in ["furnace-diffuse", "furnace-dielectric", "furnace-thindielectric", "furnace-conductor"] {
        // Rounding.
        furnace(name, 1e-5);
    }
    // Light that 64 bounces inside of the glass do not let out.
    furnace("furnace-mesh", 1e-3);
}
