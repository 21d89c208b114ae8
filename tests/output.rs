//! What the command writes, where, and what it does where it cannot: links, pipes, full disks, little memory; pictures
//! in other forms; a mesh alone.

use std::fs;
use std::io::Write;
use std::process::{Command, Output, Stdio};

use wavepath::picture::{self, Image};

#[path = "support/scratch.rs"]
mod scratch;
use scratch::Scratch;

const SCENE: &str = r#"LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" 30
Film "rgb" "integer xresolution" 16 "integer yresolution" 12 "string filename" "named.exr"
Sampler "sobol" "integer pixelsamples" 2
WorldBegin
LightSource "infinite" "rgb L" [ 0.5 1 2 ]
Shape "sphere"
"#;

impl Scratch {
    fn new(name: &str) -> Self {
        Scratch::with_scene(&format!("output-{name}"), SCENE)
    }
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
        command.args(arguments).current_dir(&self.0);
        command
    }
    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
    #[track_caller]
    fn done(&self, arguments: &[&str]) -> Output {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
        output
    }
    /// Status 2 and a message with all of `expected`; no file comes or goes.
    #[track_caller]
    fn refused(&self, arguments: &[&str], expected: &[&str]) {
        let before = self.names();
        let output = self.run(arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        for part in expected {
            assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
        }
        assert_eq!(message.matches("error: ").count(), 1, "{message}");
        assert_eq!(self.names(), before);
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

// ------------------------------------------------------------------------------------------------- where it goes

#[cfg(unix)]
#[test]
fn links_and_rights_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let scratch = Scratch::new("links");
    fs::create_dir(scratch.file("disk")).unwrap();
    fs::write(scratch.file("disk/o.exr"), "").unwrap();
    fs::set_permissions(scratch.file("disk/o.exr"), fs::Permissions::from_mode(0o640)).unwrap();
    symlink("disk/o.exr", scratch.file("o.exr")).unwrap();
    symlink("disk/r.json", scratch.file("r.json")).unwrap();
    scratch.done(&["render", "s.pbrt", "-o", "o.exr", "--report", "r.json", "-q"]);
    for link in ["o.exr", "r.json"] {
        assert!(fs::symlink_metadata(scratch.file(link)).unwrap().is_symlink(), "{link}");
    }
    assert_eq!(picture::read(&scratch.file("disk/o.exr")).unwrap().width, 16);
    assert_eq!(fs::metadata(scratch.file("disk/o.exr")).unwrap().permissions().mode() & 0o777, 0o640);
    assert!(fs::metadata(scratch.file("disk/r.json")).unwrap().len() > 100);
    fs::set_permissions(scratch.file("disk/o.exr"), fs::Permissions::from_mode(0o444)).unwrap();
    scratch.refused(&["render", "s.pbrt", "-o", "o.exr"], &["o.exr", "write-protected"]);
}

#[test]
fn the_same_file_is_not_written_twice_nor_over_an_input() {
    let scratch = Scratch::new("twice");
    let files: [&[&str]; 5] = [
        &["-o", "x.exr", "--report", "x.exr"],
        &["-o", "x.exr", "-o", "./x.exr"],
        &["-o", "-", "--report", "-"],
        &["-o", "a.exr", "--report", "s.pbrt"],
        &["-o", "a.exr", "--report", "m.ply"],
    ];
    let expected: [&[&str]; 5] =
        [&["same file"], &["same file"], &["standard output"], &["input"], &["input"]];
    fs::write(scratch.file("m.ply"), TETRAHEDRON).unwrap();
    let mut scene = fs::OpenOptions::new().append(true).open(scratch.file("s.pbrt")).unwrap();
    scene.write_all(b"Shape \"plymesh\" \"string filename\" \"m.ply\"\n").unwrap();
    for (files, expected) in files.iter().zip(expected) {
        scratch.refused(&[&["render", "s.pbrt"], *files].concat(), expected);
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("x.exr", scratch.file("link.json")).unwrap();
        let through = ["render", "s.pbrt", "-o", "x.exr", "--report", "link.json"];
        scratch.refused(&through, &["-o and --report", "same file"]);
    }
    scratch.done(&["render", "s.pbrt", "-o", "a.exr", "-q"]);
    scratch.refused(&["compare", "a.exr", "a.exr", "--map", "a.exr"], &["input"]);
    scratch.refused(&["convert", "a.exr", "a.exr"], &["input"]);
}

#[test]
fn several_files_in_one_go() {
    let scratch = Scratch::new("several");
    let output = scratch.done(&["render", "s.pbrt", "-o", "a.exr", "-o", "b.png", "-o", "c.exr"]);
    let told = text(&output.stdout);
    assert!(["wrote a.exr", "wrote b.png", "wrote c.exr"].iter().all(|line| told.contains(line)), "{told}");
    let [a, c] = ["a.exr", "c.exr"].map(|name| picture::read(&scratch.file(name)).unwrap());
    assert_eq!(a.pixels, c.pixels);
    assert_eq!(picture::read_any(&scratch.file("b.png")).unwrap().width, 16);
    assert_eq!(scratch.names(), ["a.exr", "b.png", "c.exr", "s.pbrt"]);
}

#[test]
fn standard_output_takes_pictures_and_reports() {
    let scratch = Scratch::new("stdout");
    let exr = scratch.done(&["render", "s.pbrt", "-o", "-"]);
    assert!(exr.stdout.starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    // What there is to say goes elsewhere.
    assert!(text(&exr.stderr).contains("16 x 12, 2 spp"));
    let file = scratch.file("from.exr");
    fs::write(&file, &exr.stdout).unwrap();
    assert_eq!(picture::read(&file).unwrap().height, 12);
    let png = scratch.done(&["render", "s.pbrt", "-o", "png:-", "-q"]);
    assert!(png.stdout.starts_with(b"\x89PNG") && png.stderr.is_empty());
    let report = scratch.done(&["render", "s.pbrt", "-o", "a.exr", "--report", "-"]);
    let json: serde_json::Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(json["samples"], 16 * 12 * 2);
    let mesh = scratch.done(&["mesh", "box", "-o", "-"]);
    assert!(mesh.stdout.starts_with(b"ply\n") && text(&mesh.stderr).contains("triangles"));
    assert_eq!(scratch.names(), ["a.exr", "from.exr", "s.pbrt"]);
    scratch.refused(&["mesh", "box", "-o", "box.obj"], &["box.obj", ".ply"]);
}

#[test]
fn the_default_name_replaces_its_own_pictures_only() {
    let scratch = Scratch::new("default");
    scratch.done(&["render", "s.pbrt", "-q"]);
    scratch.done(&["render", "s.pbrt", "-q"]);
    scratch.done(&["render", "./s.pbrt", "-q"]);
    // The same name in another scene's film.
    fs::write(scratch.file("other.pbrt"), SCENE).unwrap();
    scratch.refused(&["render", "other.pbrt"], &["named.exr", "another scene, \"./s.pbrt\"", "-o named.exr"]);
    scratch.done(&["render", "other.pbrt", "-o", "named.exr", "-q"]);
    picture::write(&scratch.file("mine.exr"), &Image::new(1, 1, vec![[1.0; 3]]), 0.0).unwrap();
    for name in ["mine.exr", "mine.png"] {
        fs::write(scratch.file("mine.pbrt"), SCENE.replace("named.exr", name)).unwrap();
        picture::write(&scratch.file(name), &Image::new(1, 1, vec![[1.0; 3]]), 0.0).unwrap();
        scratch.refused(&["render", "mine.pbrt"], &[name, "not rendered by wavepath"]);
        scratch.done(&["render", "mine.pbrt", "-o", name, "-q"]);
        scratch.done(&["render", "mine.pbrt", "-q"]);
    }
    // Dots in a name are part of it.
    fs::write(scratch.file("v1.2.pbrt"), SCENE.replace("named.exr", "")).unwrap();
    scratch.done(&["render", "v1.2.pbrt", "-q"]);
    assert!(scratch.file("v1.2.exr").exists());
}

#[test]
fn no_clobber_replaces_nothing() {
    let scratch = Scratch::new("clobber");
    let arguments = ["render", "s.pbrt", "-o", "a.exr", "--report", "a.json", "--no-clobber", "-q"];
    scratch.done(&arguments);
    scratch.refused(&arguments, &["--no-clobber", "a.exr"]);
    fs::remove_file(scratch.file("a.exr")).unwrap();
    scratch.refused(&arguments, &["--no-clobber", "a.json"]);
    scratch.done(&["render", "s.pbrt", "--no-clobber", "-q"]);
    scratch.refused(&["render", "s.pbrt", "--no-clobber", "-q"], &["named.exr"]);
    scratch.refused(&["convert", "named.exr", "named.png", "named.exr", "--no-clobber"], &["input"]);
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_written_straight_into() {
    let scratch = Scratch::new("fifo");
    for name in ["p.exr", "p.json"] {
        assert!(Command::new("mkfifo").arg(scratch.file(name)).status().unwrap().success());
    }
    let readers = ["p.exr", "p.json"].map(|name| {
        let path = scratch.file(name);
        std::thread::spawn(move || fs::read(path).unwrap())
    });
    scratch.done(&["render", "s.pbrt", "-o", "p.exr", "--report", "p.json", "-q"]);
    let [picture, report] = readers.map(|reader| reader.join().unwrap());
    assert!(picture.starts_with(&[0x76, 0x2f, 0x31, 0x01]) && report.starts_with(b"{"));
    scratch.done(&["render", "s.pbrt", "-o", "a.exr", "--report", "/dev/null", "-q"]);
    let output = scratch.done(&["render", "s.pbrt", "-o", "a.exr", "--report", "/dev/stdout", "-q"]);
    assert!(output.stdout.starts_with(b"{"));
    assert_eq!(scratch.names(), ["a.exr", "p.exr", "p.json", "s.pbrt"]);
}

/// What cannot be told costs nothing but the telling.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_standard_error_costs_no_picture() {
    let scratch = Scratch::new("full");
    fs::write(scratch.file("warns.pbrt"), format!("Integrator \"bdpt\"\n{SCENE}")).unwrap();
    let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    let status = |arguments: &[&str]| {
        scratch.command(arguments).stdout(Stdio::null()).stderr(full()).status().unwrap().code()
    };
    assert_eq!(status(&["render", "warns.pbrt", "-o", "a.exr"]), Some(0));
    assert_eq!(picture::read(&scratch.file("a.exr")).unwrap().width, 16);
    assert_eq!(status(&["render", "none.pbrt", "-o", "b.exr"]), Some(2));
    assert_eq!(status(&["paint"]), Some(2));
    // A disk that takes no picture is failed work.
    let output = scratch.command(&["render", "s.pbrt", "-o", "-", "-q"]).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).starts_with("error: "), "{}", text(&output.stderr));
}

#[cfg(target_os = "linux")]
#[test]
fn too_little_memory_is_an_error_with_a_message() {
    let scratch = Scratch::new("memory");
    let limited = |kib: u32, limit: &str, arguments: &str| {
        let binary = env!("CARGO_BIN_EXE_wavepath");
        let script = format!("ulimit {limit} {kib}; exec {binary} {arguments}");
        Command::new("bash").args(["-c", &script]).current_dir(&scratch.0).output().unwrap()
    };
    let large = "render s.pbrt -o big.exr --resolution 4000x4000 --spp 1 --threads 1 -q";
    for limit in ["-v", "-d"] {
        let output = limited(350_000, limit, large);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{limit}: {message}");
        assert!(message.contains("of memory are free"), "{limit}: {message}");
        let output = limited(1_500_000, limit, "render s.pbrt -o small.exr --threads 1 -q");
        assert_eq!(output.status.code(), Some(0), "{limit}: {}", text(&output.stderr));
    }
    // What no estimate foresaw: a mesh generator.
    let output = limited(300_000, "-v", "mesh sphere-flake --levels 6 -o big.ply");
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.starts_with("error: out of memory"), "{message}");
    assert_eq!(scratch.names(), ["s.pbrt", "small.exr"]);
}

// ------------------------------------------------------------------------------------------------- pictures

#[test]
fn a_crop_is_the_same_part_of_the_picture() {
    let scratch = Scratch::new("crop");
    let render = |name: &str, more: &[&str]| {
        scratch.done(&[&["render", "s.pbrt", "-q", "-o", name], more].concat());
        picture::read(&scratch.file(name)).unwrap()
    };
    let full = render("full.exr", &[]);
    let options: [[&str; 2]; 4] = [
        ["--crop", "0.25,0.75,0.5,1"],
        ["--cropwindow", "0.25,0.75,0.5,1"],
        ["--crop", "4,12,6,12"],
        ["--pixelbounds", "4,12,6,12"],
    ];
    for option in options {
        let crop = render("crop.exr", &option);
        assert_eq!((crop.width, crop.height, crop.window.x, crop.window.y), (8, 6, 4, 6), "{option:?}");
        assert_eq!(crop.pixels, full.crop(crop.window, 8, 6).unwrap().pixels, "{option:?}");
    }
    // Over the scene's own, and in the resolution that is asked for.
    let film = "\"float cropwindow\" [ 0 0.5 0 0.5 ] \"string filename\"";
    fs::write(scratch.file("s.pbrt"), SCENE.replace("\"string filename\"", film)).unwrap();
    let crop = render("crop.exr", &["--resolution", "32x24", "--crop", "0,1,0,0.5"]);
    assert_eq!((crop.width, crop.height), (32, 12));
    scratch.refused(&["render", "s.pbrt", "--crop", "0,17,0,12"], &["--crop", "16 x 12"]);
    scratch.refused(&["render", "s.pbrt", "--crop", "0.5,0.5,0,1"], &["--crop", "empty"]);
    let plan = |more: &[&str]| -> serde_json::Value {
        let output = scratch.done(&[&["plan", "s.pbrt", "--json"], more].concat());
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let bytes = |more: &[&str]| plan(more)["film_bytes"].as_u64().unwrap();
    assert_eq!(bytes(&["--resolution", "32x24"]), 4 * bytes(&[]));
    assert_eq!(bytes(&["--crop", "0,1,0,1"]), 4 * bytes(&[]));
    assert!(bytes(&["--spp", "1024"]) > bytes(&[]));
    assert!(
        plan(&["--threads", "3"])["queue_bytes"].as_u64() > plan(&["--threads", "1"])["queue_bytes"].as_u64()
    );
}

#[test]
fn attributes_are_typed_and_half_is_half() {
    let scratch = Scratch::new("attributes");
    scratch.done(&["render", "s.pbrt", "-q", "-o", "a.exr", "--layers"]);
    let image = picture::read_layers(&scratch.file("a.exr")).unwrap();
    let metadata = &image.metadata;
    assert_eq!(metadata.samples_per_pixel, Some(2));
    assert!(
        metadata.render_time_seconds.unwrap() > 0.0 && metadata.capture_date.as_ref().unwrap().len() == 19
    );
    // The camera at z = 5 looks down -z, x to the left: world origin to camera.
    let m = metadata.world_to_camera.unwrap();
    let near = |a: f32, b: f32| (a - b).abs() < 1e-5;
    assert!(near(m[11], 5.0) && near(m[10], -1.0) && near(m[0], -1.0) && near(m[5], 1.0), "{m:?}");
    // A point on the axis is in the middle of the screen: x and y are half of w there.
    let ndc = metadata.world_to_ndc.unwrap();
    assert!(near(ndc[3] / ndc[15], 0.5) && near(ndc[7] / ndc[15], 0.5) && near(ndc[15], 5.0), "{ndc:?}");
    assert!(metadata.comments.as_ref().unwrap().contains("s.pbrt"));
    let names: Vec<&str> = image.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["samples", "stderr.B", "stderr.G", "stderr.R"]);
    let half = |pixel: f32| wavepath_half(pixel);
    for (scene, more) in [(SCENE.to_string(), vec!["--half"]), (with_fp16(true), vec![])] {
        fs::write(scratch.file("s.pbrt"), scene).unwrap();
        scratch
            .done(&[&["render", "s.pbrt", "-q", "-o", "h.exr", "--compression", "piz"], &more[..]].concat());
        let rounded = picture::read(&scratch.file("h.exr")).unwrap();
        for (rounded, exact) in rounded.pixels.iter().zip(&image.pixels) {
            assert_eq!(*rounded, exact.map(half));
        }
    }
    fs::write(scratch.file("s.pbrt"), with_fp16(false)).unwrap();
    scratch.done(&["render", "s.pbrt", "-q", "-o", "h.exr", "--exr-tiles", "16"]);
    assert_eq!(picture::read(&scratch.file("h.exr")).unwrap().pixels, image.pixels);
}

fn with_fp16(value: bool) -> String {
    SCENE.replace("\"string filename\"", &format!("\"bool savefp16\" {value} \"string filename\""))
}

/// To nearest, ties to even, of what is neither tiny nor large.
fn wavepath_half(value: f32) -> f32 {
    if value == 0.0 {
        return 0.0;
    }
    let step = 2.0_f32.powi(value.abs().log2().floor() as i32 - 10);
    (value / step).round_ties_even() * step
}

#[test]
fn convert_makes_other_forms_of_a_picture() {
    let scratch = Scratch::new("convert");
    scratch.done(&["render", "s.pbrt", "-q", "-o", "a.exr", "-o", "a.png", "--layers", "--spp", "16"]);
    let image = picture::read_layers(&scratch.file("a.exr")).unwrap();
    let output = scratch.done(&["convert", "a.exr", "b.png", "b.exr"]);
    assert!(text(&output.stdout).contains("wrote b.png"));
    let shown = |name: &str| picture::read_any(&scratch.file(name)).unwrap();
    assert_eq!(shown("b.png").pixels, shown("a.png").pixels);
    let copy = picture::read_layers(&scratch.file("b.exr")).unwrap();
    // The report and all that is known of the render goes along.
    assert_eq!(copy, image);
    scratch.done(&["convert", "a.exr", "c.png", "--exposure", "-1", "--bits", "16", "-q"]);
    let darker = shown("c.png");
    for (darker, pixel) in darker.pixels.iter().zip(&image.pixels) {
        for (darker, channel) in darker.iter().zip(pixel) {
            assert!((darker - (channel / 2.0).min(1.0)).abs() < 1e-4);
        }
    }
    scratch.done(&[
        "convert",
        "a.exr",
        "c.exr",
        "--exposure",
        "1",
        "--crop",
        "0,0.5,0,1",
        "--drop-layers",
        "-q",
    ]);
    let crop = picture::read_layers(&scratch.file("c.exr")).unwrap();
    assert_eq!((crop.width, crop.height, crop.channels.len()), (8, 12, 0));
    assert_eq!(crop.pixel(3, 2), image.pixel(3, 2).map(|channel| 2.0 * channel));
    // The standard error is of the same light; what the report says is not.
    scratch.done(&["convert", "a.exr", "d.exr", "--exposure", "1", "-q"]);
    let brighter = picture::read_layers(&scratch.file("d.exr")).unwrap();
    for (brighter, channel) in brighter.channels.iter().zip(&image.channels) {
        if let (picture::Samples::Float(brighter), picture::Samples::Float(values)) =
            (&brighter.samples, &channel.samples)
        {
            let doubled: Vec<f32> = values.iter().map(|value| 2.0 * value).collect();
            assert_eq!(*brighter, doubled, "{}", channel.name);
        }
    }
    assert!(brighter.metadata.report.unwrap().contains("\"estimated_relmse\":null"));
    scratch.done(&["convert", "a.exr", "samples.exr", "--layer", "samples", "-q"]);
    assert_eq!(shown("samples.exr").pixel(0, 0), [16.0; 3]);
    scratch.done(&["convert", "a.exr", "agx.png", "--tonemap", "agx", "-q"]);
    assert_ne!(shown("agx.png").pixels, shown("a.png").pixels);
    let piped = scratch.done(&["convert", "a.exr", "png:-"]);
    assert!(piped.stdout.starts_with(b"\x89PNG"));
    scratch.refused(&["convert", "a.exr", "x.png", "--layer", "depth"], &["no layer \"depth\"", "stderr.R"]);
    scratch.refused(&["convert", "c.exr", "x.png", "--crop", "0,16,0,12"], &["not all there"]);
    scratch.refused(&["convert", "s.pbrt", "x.png"], &["not an OpenEXR"]);
    scratch.refused(&["convert", "a.exr", "x.jpg"], &["x.jpg", ".png"]);
}

// ------------------------------------------------------------------------------------------------- terminal

#[test]
fn without_a_terminal_a_line_at_the_start_and_at_the_end() {
    let scratch = Scratch::new("lines");
    let output = scratch.done(&["render", "s.pbrt", "-o", "a.exr"]);
    let told = text(&output.stderr);
    let lines: Vec<&str> = told.lines().collect();
    assert_eq!(lines.len(), 2, "{told}");
    assert!(lines[0].starts_with("rendering: 384 samples") && lines[1].starts_with("rendered in"), "{told}");
    let report = text(&output.stdout);
    for part in ["stopped by        samples", "sum of", "wall clock", "reading", "tree"] {
        assert!(report.contains(part), "no {part:?} in {report}");
    }
    assert!(scratch.done(&["render", "s.pbrt", "-o", "a.exr", "-q"]).stderr.is_empty());
}

/// Carets stand under what they mean, in columns of a terminal: two for wide characters, none for accents of their own.
#[test]
fn carets_count_columns() {
    let scratch = Scratch::new("carets");
    for (before, columns) in [("abc", 3), ("日本", 4), ("e\u{301}", 1)] {
        fs::write(scratch.file("c.pbrt"), format!("WorldBegin\nMaterial \"{before}\" Shape \"spere\"\n"))
            .unwrap();
        let scene = format!(
            "WorldBegin\nMakeNamedMaterial \"{before}\" \"string type\" \"diffuse\" Shape \"spere\"\n"
        );
        fs::write(scratch.file("c.pbrt"), scene).unwrap();
        let message = text(&scratch.run(&["plan", "c.pbrt"]).stderr);
        let caret = message.lines().find(|line| line.contains('^')).unwrap_or_else(|| panic!("{message}"));
        let expected =
            "      | ".len() + "MakeNamedMaterial \"\" \"string type\" \"diffuse\" Shape ".len() + columns;
        assert_eq!(caret.find('^'), Some(expected), "{message}");
        assert!(caret.contains(&"^".repeat("\"spere\"".len())), "{message}");
    }
}

#[test]
fn help_has_sections_and_states_defaults() {
    let scratch = Scratch::new("help");
    let help = text(&scratch.done(&["render", "--help"]).stdout);
    for part in [
        "What to render:",
        "Quality:",
        "Output:",
        "Speed:",
        "Reports:",
        "Examples:",
        "-q, --quiet",
        "default of",
    ] {
        let found =
            help.contains(part) || part == "default of" && help.contains("[default: the name in the scene");
        assert!(found, "no {part:?} in {help}");
    }
    let usage = text(&scratch.done(&["mesh", "--help"]).stdout);
    assert!(usage.contains("-o FILE.ply"), "{usage}");
}

// ------------------------------------------------------------------------------------------------- a mesh alone

const TETRAHEDRON: &str = "ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
100 0 0
0 100 0
0 0 100
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
";

#[test]
fn a_mesh_is_rendered_at_once() {
    let scratch = Scratch::new("mesh");
    fs::write(scratch.file("m.ply"), TETRAHEDRON).unwrap();
    let small = ["--resolution", "64x48", "--spp", "4"];
    let output = scratch.done(&[&["render", "m.ply", "--write-scene", "m.pbrt"], &small[..]].concat());
    assert!(text(&output.stdout).contains("wrote m.pbrt") && text(&output.stdout).contains("wrote m.exr"));
    let image = picture::read(&scratch.file("m.exr")).unwrap();
    assert_eq!((image.width, image.height), (64, 48));
    assert!(image.pixels.iter().flatten().all(|channel| channel.is_finite()));
    // The scene that was made is the same picture.
    scratch.done(&["render", "m.pbrt", "-q", "-o", "again.exr", "--spp", "4"]);
    assert_eq!(picture::read(&scratch.file("again.exr")).unwrap().pixels, image.pixels);
    // The mesh is in the picture: without it the middle looks different.
    let scene = fs::read_to_string(scratch.file("m.pbrt")).unwrap();
    let without: Vec<&str> = scene.lines().filter(|line| !line.contains("plymesh")).collect();
    fs::write(scratch.file("without.pbrt"), without.join("\n")).unwrap();
    scratch.done(&["render", "without.pbrt", "-q", "-o", "without.exr", "--spp", "4"]);
    let empty = picture::read(&scratch.file("without.exr")).unwrap();
    assert_ne!(empty.pixel(32, 24), image.pixel(32, 24));
    // Printed where it is not written; several files, compressed, other axes and materials.
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gz.write_all(TETRAHEDRON.as_bytes()).unwrap();
    fs::write(scratch.file("n.ply.gz"), gz.finish().unwrap()).unwrap();
    let output = scratch
        .done(&[&["render", "n.ply.gz", "m.ply", "--up", "z", "--material", "gold"], &small[..]].concat());
    let told = text(&output.stdout);
    assert!(
        told.contains("LookAt") && told.contains("\"n.ply.gz\"") && told.contains("metal-Au-eta"),
        "{told}"
    );
    assert!(scratch.file("n.exr").exists());
}

#[test]
fn what_is_no_mesh_is_told() {
    let scratch = Scratch::new("no-mesh");
    fs::write(scratch.file("m.ply"), TETRAHEDRON).unwrap();
    fs::write(
        scratch.file("empty.ply"),
        TETRAHEDRON.replace("face 4", "face 0").replace("\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3", ""),
    )
    .unwrap();
    fs::write(scratch.file("cut.ply"), &TETRAHEDRON[..200]).unwrap();
    scratch.refused(&["render", "m.ply", "s.pbrt"], &["s.pbrt", "no mesh"]);
    scratch.refused(&["render", "s.pbrt", "--up", "z"], &["--up", "s.pbrt"]);
    scratch.refused(&["render", "cut.ply"], &["cut.ply"]);
    scratch.refused(&["render", "gone.ply"], &["gone.ply"]);
    scratch.refused(&["render", "empty.ply"], &["empty.ply"]);
}
