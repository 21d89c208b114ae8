//! The command `wavepath compare`, run as a user runs it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use wavepath::picture::{self, DataWindow, Image};

/// A folder of its own for a test, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("compare-{test}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// An image whose pixels all have one colour.
    fn plain(&self, name: &str, width: u32, height: u32, colour: [f32; 3]) -> PathBuf {
        let image = Image::new(width, height, vec![colour; (width * height) as usize]);
        self.image(name, &image)
    }

    fn image(&self, name: &str, image: &Image) -> PathBuf {
        picture::write(&self.path(name), image, 0.0).unwrap();
        self.path(name)
    }

    fn file(&self, name: &str, contents: &[u8]) -> PathBuf {
        fs::write(self.path(name), contents).unwrap();
        self.path(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn compare(image: &Path, reference: &Path, options: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
    command.arg("compare").arg(image).arg(reference).args(options).output().unwrap()
}

fn stdout(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).unwrap()
}

/// Asserts that the command refused `image` with status 2 and one message that names it.
fn assert_refused(image: &Path, reference: &Path, expected: &str) {
    let start = Instant::now();
    let output = compare(image, reference, &["--json"]);
    let message = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "{message}");
    assert!(message.contains(image.to_str().unwrap()), "{message}");
    assert!(message.contains(expected), "{message}");
    assert!(output.stdout.is_empty());
    assert!(start.elapsed() < Duration::from_secs(5), "{message}");
}

#[test]
fn json_has_the_fixed_keys_and_values() {
    let folder = Folder::new("json");
    let image = folder.plain("image.exr", 20, 10, [2.0, 1.0, 1.0]);
    let reference = folder.plain("reference.exr", 20, 10, [1.0, 1.0, 2.0]);
    let output = compare(&image, &reference, &["--json"]);
    assert_eq!(output.status.code(), Some(0));
    let json: serde_json::Value = serde_json::from_str(stdout(&output)).unwrap();
    let near = |value: &serde_json::Value, expected: f64| {
        assert!((value.as_f64().unwrap() - expected).abs() < 1e-12, "{value} {expected}");
    };
    let relmse = (1.0 / 1.01 + 1.0 / 4.01) / 3.0;
    near(&json["mse"], 2.0 / 3.0);
    near(&json["rmse"], (2.0_f64 / 3.0).sqrt());
    near(&json["relmse"], relmse);
    near(&json["relmse_trimmed"], relmse);
    near(&json["mape"], (1.0 / 1.01 + 1.0 / 2.01) / 3.0);
    near(&json["smape"], (2.0 / 3.01 + 2.0 / 3.01) / 3.0);
    for (channel, expected) in [2.0, 1.0, 0.5].into_iter().enumerate() {
        near(&json["mean_ratio"][channel], expected);
    }
    assert_eq!(json["invalid_pixels"], 0);
    assert!(json["flip"].as_f64().unwrap() > 0.1);
    assert!(json["reference_relmse"].is_null() && json["relmse_less_reference"].is_null());
    assert_eq!(json.as_object().unwrap().len(), 11);
}

#[test]
fn the_table_is_for_people() {
    let folder = Folder::new("table");
    let mut image = Image::new(3, 1, vec![[1.0; 3]; 3]);
    image.pixels[1][2] = f32::NAN;
    let image = folder.image("image.exr", &image);
    let output = compare(&image, &image, &[]);
    assert_eq!(output.status.code(), Some(0));
    let table = stdout(&output);
    assert!(table.contains("relMSE") && table.contains("invalid pixels    1"), "{table}");
}

#[test]
fn a_crop_is_judged_against_the_full_reference() {
    let folder = Folder::new("crop");
    let full = Image::new(8, 8, (0..64).map(|i| [i as f32; 3]).collect());
    let crop = full.crop(DataWindow { x: 3, y: 5, ..full.window }, 4, 2).unwrap();
    let (crop, full) = (folder.image("crop.exr", &crop), folder.image("full.exr", &full));
    for (image, reference) in [(&crop, &full), (&full, &crop)] {
        let output = compare(image, reference, &["--json"]);
        assert!(stdout(&output).contains("\"mse\":0.0"), "{output:?}");
    }
}

#[test]
fn png_and_radiance_files_are_read() {
    let folder = Folder::new("formats");
    let exr = folder.plain("a.exr", 4, 2, [1.0, 0.25, 0.0]);
    let png = folder.plain("a.png", 4, 2, [1.0, 0.25, 0.0]);
    // Exponent 129 makes 128 one and 32 a quarter.
    let pixels = [128, 32, 0, 129].repeat(8);
    let hdr =
        folder.file("a.hdr", &[&b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"[..], &pixels].concat());
    for image in [&png, &hdr] {
        for (image, reference) in [(image, &exr), (&exr, image)] {
            let output = compare(image, reference, &["--json"]);
            let json: serde_json::Value = serde_json::from_str(stdout(&output)).unwrap();
            assert!(json["relmse"].as_f64().unwrap() < 1e-4, "{json}");
            assert!(json["flip"].as_f64().unwrap() < 0.02, "{json}");
        }
    }
}

#[test]
fn a_threshold_decides_on_the_status() {
    let folder = Folder::new("threshold");
    let reference = folder.plain("reference.exr", 8, 8, [1.0; 3]);
    let image = folder.plain("image.exr", 8, 8, [1.1; 3]);
    // (0.1)^2 / 1.01 = 0.0099
    for (limit, status) in [("0.01", 0), ("9.8e-3", 1), ("1e-6", 1)] {
        let output = compare(&image, &reference, &["--fail-above", limit]);
        assert_eq!(output.status.code(), Some(status), "{limit}");
        // The figures are there in any case.
        assert!(stdout(&output).contains("relMSE"));
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(
            message.contains(&format!("is above {}", limit.parse::<f64>().unwrap())),
            status == 1,
            "{message}"
        );
    }
    assert_eq!(compare(&image, &reference, &["--fail-above", "0"]).status.code(), Some(2));
    let spoiled = folder.plain("spoiled.exr", 8, 8, [f32::NAN; 3]);
    assert_eq!(compare(&spoiled, &reference, &["--fail-above", "1"]).status.code(), Some(1));
}

#[test]
fn the_references_own_noise_is_subtracted() {
    let folder = Folder::new("own-noise");
    let mut noisy = Image::new(8, 8, vec![[1.0; 3]; 64]);
    for name in ["stderr.R", "stderr.G", "stderr.B"] {
        let samples = picture::Samples::Float(vec![0.05; 64]);
        noisy.channels.push(picture::Channel { name: name.into(), samples });
    }
    let reference = folder.image("reference.exr", &noisy);
    let image = folder.plain("image.exr", 8, 8, [1.1; 3]);
    let output = compare(&image, &reference, &["--json", "--fail-above", "0.008"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let json: serde_json::Value = serde_json::from_str(stdout(&output)).unwrap();
    let number = |key: &str| json[key].as_f64().unwrap();
    assert!((number("reference_relmse") - 0.0025 / 1.01).abs() < 1e-6);
    assert!((number("relmse") - number("reference_relmse") - number("relmse_less_reference")).abs() < 1e-12);
    let table = compare(&image, &reference, &[]);
    assert!(stdout(&table).contains("less the reference's own"), "{table:?}");
}

#[test]
fn the_map_is_written_in_both_formats() {
    let folder = Folder::new("map");
    let mut image = Image::new(4, 2, vec![[1.0; 3]; 8]);
    image.pixels[6] = [3.0, 1.0, 1.0];
    let image = folder.image("image.exr", &image);
    let reference = folder.plain("reference.exr", 4, 2, [1.0; 3]);
    for name in ["map.exr", "map.png"] {
        let path = folder.path(name);
        let output = compare(&image, &reference, &["--map", path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert!(path.exists());
    }
    // A small map has no room for its scale; a wide one has it below.
    assert_eq!(picture::read_any(&folder.path("map.png")).unwrap().height, 2);
    let wide = folder.plain("wide.exr", 160, 2, [1.0; 3]);
    let path = folder.path("wide.png");
    let output = compare(&wide, &wide, &["--map", path.to_str().unwrap()]);
    assert!(stdout(&output).contains("1e-4 (black) to 1e2"), "{output:?}");
    let shown = picture::read_any(&path).unwrap();
    assert!(shown.width == 160 && shown.height > 12);
    let map = picture::read(&folder.path("map.exr")).unwrap();
    let error = 4.0 / 1.01 / 3.0;
    assert!((map.pixel(2, 1)[0] - error).abs() < 1e-6);
    assert_eq!(map.pixel(1, 1), [0.0; 3]);
}

#[test]
fn a_map_that_cannot_be_written_is_refused_first() {
    let folder = Folder::new("map-refused");
    let image = folder.plain("image.exr", 2, 2, [1.0; 3]);
    for map in [folder.path("map.jpg"), folder.path("missing/map.png")] {
        let output = compare(&image, &image, &["--map", map.to_str().unwrap()]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(map.to_str().unwrap()), "{message}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn different_sizes_are_refused() {
    let folder = Folder::new("sizes");
    let image = folder.plain("image.exr", 4, 2, [1.0; 3]);
    let reference = folder.plain("reference.exr", 2, 4, [1.0; 3]);
    assert_refused(&image, &reference, "the image has 4 x 2 pixels, the reference 2 x 4");
}

#[test]
fn what_is_no_image_is_refused() {
    let folder = Folder::new("no-image");
    let good = folder.plain("good.exr", 4, 4, [1.0; 3]);
    assert_refused(&folder.path("missing.exr"), &good, "No such file");
    assert_refused(&folder.file("text.exr", b"This is not a picture."), &good, "not an OpenEXR");
    assert_refused(&folder.file("empty.exr", b""), &good, "not an OpenEXR");
    assert_refused(&folder.0, &good, "not a regular file");
    assert_refused(&folder.file("start.png", b"\x89PNG\r\n\x1a\nand no more"), &good, "cannot read image");
}

#[test]
fn cut_off_files_are_refused() {
    let folder = Folder::new("cut-off");
    let pixels = (0..10_000).map(|i| [i as f32, 0.5, 1.0 / (i + 1) as f32]).collect();
    let good = folder.image("good.exr", &Image::new(100, 100, pixels));
    let bytes = fs::read(&good).unwrap();
    for length in [8, 100, 300, 500, bytes.len() / 2, bytes.len() - 1] {
        let cut = folder.file("cut.exr", &bytes[..length]);
        assert_refused(&cut, &good, "cannot read image");
    }
}

#[test]
fn a_header_that_promises_a_giant_is_refused() {
    let folder = Folder::new("giant");
    let good = folder.plain("good.exr", 16, 16, [1.0; 3]);
    let bytes = fs::read(&good).unwrap();
    // `dataWindow`, type `box2i`, 16 bytes: smallest x and y, largest x and y.
    let name = b"dataWindow\0box2i\0";
    let start = bytes.windows(name.len()).position(|window| window == name).unwrap();
    let start = start + name.len() + 4;
    let windows = [
        [0, 0, i32::MAX - 1, i32::MAX - 1],
        [i32::MIN, i32::MIN, i32::MAX, i32::MAX],
        [0, 0, (1 << 30) - 1, 15],
        [0, 0, 15, (1 << 30) - 1],
        [0, 0, (1 << 14) - 1, (1 << 14) - 1],
        [5, 5, 4, 4],
    ];
    for window in windows {
        let mut damaged = bytes.clone();
        for (i, value) in window.into_iter().enumerate() {
            damaged[start + 4 * i..start + 4 * i + 4].copy_from_slice(&i32::to_le_bytes(value));
        }
        let damaged = folder.file("damaged.exr", &damaged);
        assert_refused(&damaged, &good, "cannot read image");
    }
}

#[test]
fn a_wrong_command_line_has_status_2() {
    for words in [&["compare"][..], &["compare", "a.exr", "b.exr", "--nothing"], &["paint"], &[]] {
        let output = Command::new(env!("CARGO_BIN_EXE_wavepath")).args(words).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{words:?}");
        assert!(!output.stderr.is_empty());
    }
}

/// A picture of two halves, the right one with errors, as `render --layers` writes them.
#[test]
fn a_picture_says_where_its_error_is() {
    use wavepath::picture::{Channel, Samples, write};
    let folder = Folder::new("own-error");
    let path = folder.path("own.exr");
    let mut image = Image::new(64, 32, vec![[1.0; 3]; 64 * 32]);
    let errors: Vec<f32> = (0..64 * 32).map(|i| if i % 64 < 32 { 0.0 } else { 0.1 }).collect();
    image.channels = ["stderr.B", "stderr.G", "stderr.R"]
        .map(|name| Channel { name: name.into(), samples: Samples::Float(errors.clone()) })
        .into();
    write(&path, &image, 0.0).unwrap();
    let run = |path: &Path, options: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_wavepath")).arg("compare").arg(path).args(options).output().unwrap()
    };
    let map = folder.path("map.exr");
    let output = run(&path, &["--json", "--map", map.to_str().unwrap()]);
    let own: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // s^2 / (1 + 0.01) over half of the pixels.
    assert!((own["relmse"].as_f64().unwrap() - 0.005 / 1.01).abs() < 1e-7, "{own}");
    assert_eq!(own["worst"].as_array().unwrap().len(), 4);
    assert!(own["worst"][0]["crop"][0].as_i64().unwrap() >= 32, "{own}");
    let map = wavepath::picture::read(&map).unwrap();
    assert!(map.pixel(3, 3) == [0.0; 3] && (map.pixel(40, 3)[0] - 0.01 / 1.01).abs() < 1e-7);
    assert_eq!(run(&path, &["--fail-above", "0.01"]).status.code(), Some(0));
    assert_eq!(run(&path, &["--fail-above", "0.001"]).status.code(), Some(1));
    let table = String::from_utf8(run(&path, &[]).stdout).unwrap();
    assert!(table.contains("worst blocks") && table.contains("--crop "), "{table}");
    // Without layers there is nothing to say.
    write(&path, &Image::new(2, 2, vec![[1.0; 3]; 4]), 0.0).unwrap();
    let output = run(&path, &[]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && text.contains("--layers"), "{text}");
}
