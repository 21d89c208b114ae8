//! The command as a user sees it: files, reports, exit status, messages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// A folder that vanishes with the test.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-render-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Scratch(path)
    }
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
    fn write(&self, name: &str, text: &str) -> PathBuf {
        fs::write(self.file(name), text).unwrap();
        self.file(name)
    }
    /// Names of all files, sorted.
    fn names(&self) -> Vec<String> {
        let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<_> = fs::read_dir(&self.0).unwrap().map(name).collect();
        names.sort();
        names
    }
    /// The command, started in this folder.
    fn wavepath(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
        command.args(arguments).current_dir(&self.0);
        command
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn shipped(name: &str) -> String {
    format!("{}/scenes/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[track_caller]
fn assert_done(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn a_render_writes_its_image_and_says_what_it_cost() {
    let scratch = Scratch::new("image");
    let scene = shipped("cornell.pbrt");
    for name in ["a.exr", "a.png"] {
        let output = scratch.wavepath(&["render", &scene, "-o", name, "--spp", "2", "--resolution", "40x30"]);
        assert_done(&output);
        let told = text(&output.stdout);
        assert!(told.contains("40 x 30, 2 spp") && told.contains(&format!("wrote {name}")), "{told}");
    }
    let image = wavepath::picture::read(&scratch.file("a.exr")).unwrap();
    assert_eq!((image.width, image.height), (40, 30));
    assert!(image.pixels.iter().any(|pixel| pixel[0] > 0.1));
    let report: Value = serde_json::from_str(&image.metadata.report.unwrap()).unwrap();
    assert_eq!(report["samples"], 2400, "the image carries its report");
    assert!(fs::read(scratch.file("a.png")).unwrap().starts_with(b"\x89PNG"));
    assert_eq!(scratch.names(), ["a.exr", "a.png"], "nothing else is left behind");
}

#[test]
fn the_report_has_all_keys_and_adds_up() {
    let scratch = Scratch::new("report");
    let scene = shipped("cornell.pbrt");
    for engine in ["wavefront", "megakernel"] {
        let arguments = ["--engine", engine, "--spp", "8", "--resolution", "50x20", "--threads", "2"];
        let files = ["render", &scene, "-o", "a.exr", "--report", "a.json", "--quiet"];
        assert_done(&scratch.wavepath(&[&files[..], &arguments[..]].concat()));
        let report = json(&scratch.file("a.json"));
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
            "version",
        ] {
            assert!(report.get(key).is_some(), "{engine}: no {key}");
        }
        let number = |key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key}: {}", report[key]));
        assert_eq!(report["engine"], engine);
        assert_eq!(report["scene"], scene.as_str());
        assert_eq!((number("width"), number("height"), number("spp")), (50.0, 20.0, 8.0));
        assert_eq!((number("samples"), number("threads")), (8000.0, 2.0));
        assert_eq!(report["rays"]["camera"], 8000);
        for class in ["bounce", "shadow"] {
            assert!(report["rays"][class].as_u64().unwrap() > 8000, "{class}");
        }
        let stages = report["stages"].as_object().unwrap();
        let sum: f64 = stages.values().map(|seconds| seconds.as_f64().unwrap()).sum();
        assert!(sum > 0.0 && sum <= 1.05 * 2.0 * number("seconds") + 0.01, "{sum}");
        assert_eq!(stages.contains_key("megakernel"), engine == "megakernel");
        assert_eq!(report["batch"].is_null(), engine == "megakernel");
        assert_eq!(number("invalid_samples"), 0.0);
        assert!(number("estimated_relmse") > 0.0 && number("setup_seconds") > 0.0);
        assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
        assert!(!report["cpu"].as_str().unwrap().is_empty());
    }
}

#[test]
fn the_report_says_what_adaptive_sampling_did() {
    let scratch = Scratch::new("adaptive");
    let report = |scene: &str, more: &[&str]| {
        let base =
            ["render", &shipped(scene), "-o", "a.exr", "--report", "a.json", "--resolution", "128x128"];
        let output = scratch.wavepath(&[&base[..], more].concat());
        assert_done(&output);
        (json(&scratch.file("a.json")), text(&output.stdout))
    };
    let (plain, told) = report("two-spheres.pbrt", &["--spp", "64"]);
    assert!(plain["adaptive"].is_null() && !told.contains("\nadaptive"));
    let (few, told) = report("two-spheres.pbrt", &["--spp", "2", "--adaptive"]);
    assert!(few["adaptive"]["used"] == false && few["adaptive"]["predicted_gain"].is_null());
    assert!(told.contains("too few of them to decide"), "{told}");
    let ends: [&[&str]; 2] = [&["--spp", "64"], &["--error", "2e-5", "--spp", "1000", "--time", "60s"]];
    for end in ends {
        let (used, told) = report("two-spheres.pbrt", &[end, &["--adaptive", "--layers"]].concat());
        let adaptive = &used["adaptive"];
        let spp = |key: &str| adaptive[key].as_u64().unwrap();
        assert!(adaptive["used"] == true && adaptive["predicted_gain"].as_f64().unwrap() > 1.0);
        assert!(spp("least_spp") < spp("most_spp") && told.contains("predicted gain"), "{told}");
    }
    let (even, told) = report("cornell.pbrt", &["--spp", "64", "--adaptive"]);
    assert_eq!((&even["adaptive"]["used"], &even["adaptive"]["least_spp"]), (&false.into(), &64.into()));
    assert!(told.contains("too little to pay"), "{told}");
}

#[test]
fn quiet_prints_nothing() {
    let scratch = Scratch::new("quiet");
    let scene = shipped("two-spheres.pbrt");
    let arguments = ["render", &scene, "--quiet", "--spp", "1", "--resolution", "8x8", "-o", "a.exr"];
    let output = scratch.wavepath(&arguments);
    assert_done(&output);
    assert_eq!((text(&output.stdout), text(&output.stderr)), (String::new(), String::new()));
}

#[test]
fn the_default_name_is_the_scenes() {
    let scratch = Scratch::new("name");
    let small = ["--spp", "1", "--resolution", "8x8", "--quiet"];
    let scene = shipped("two-spheres.pbrt");
    assert_done(&scratch.wavepath(&[&["render", &scene], &small[..]].concat()));
    scratch.write("nameless.pbrt", "WorldBegin Shape \"sphere\"");
    assert_done(&scratch.wavepath(&[&["render", "nameless.pbrt"], &small[..]].concat()));
    assert_eq!(scratch.names(), ["nameless.exr", "nameless.pbrt", "two-spheres.exr"]);
}

#[test]
fn threads_and_engines_make_the_same_file_contents() {
    let scratch = Scratch::new("same");
    let scene = shipped("cornell.pbrt");
    let pixels = |more: &[&str]| {
        let base = [
            "render",
            &scene,
            "-o",
            "a.exr",
            "--spp",
            "4",
            "--resolution",
            "30x30",
            "--quiet",
            "--seed",
            "5",
        ];
        assert_done(&scratch.wavepath(&[&base[..], more].concat()));
        wavepath::picture::read(&scratch.file("a.exr")).unwrap().pixels
    };
    let expected = pixels(&["--threads", "1"]);
    assert_eq!(pixels(&["--threads", "3", "--batch", "200"]), expected);
    assert_eq!(pixels(&["--engine", "megakernel"]), expected);
    assert_ne!(pixels(&["--sampler", "independent"]), expected);
}

#[test]
fn a_time_limit_ends_the_render() {
    let scratch = Scratch::new("time");
    let scene = shipped("cornell.pbrt");
    let arguments =
        ["render", &scene, "-o", "a.exr", "--time", "200ms", "--resolution", "64x64", "--report", "a.json"];
    assert_done(&scratch.wavepath(&arguments));
    let report = json(&scratch.file("a.json"));
    assert!(report["seconds"].as_f64().unwrap() >= 0.2);
    let samples = report["samples"].as_u64().unwrap();
    assert!(samples >= 64 * 64 && report["rays"]["camera"] == samples);
    let spp = report["spp"].as_f64().unwrap();
    assert!((spp - samples as f64 / 4096.0).abs() < 1e-9);
}

/// Exit status 2, nothing on standard output, a message with all of `expected`, no file but those from before.
#[track_caller]
fn assert_refused(scratch: &Scratch, arguments: &[&str], expected: &[&str]) {
    let before = scratch.names();
    let output = scratch.wavepath(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?}: {}", text(&output.stdout));
    for part in expected {
        assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
    }
    assert_eq!(scratch.names(), before, "{arguments:?} left files");
}

#[test]
fn what_cannot_be_done_is_refused_with_status_2() {
    let scratch = Scratch::new("wrong");
    let scene = &shipped("two-spheres.pbrt");
    scratch.write("broken.pbrt", "WorldBegin\n  Shape \"sphere\" \"float radius\" [ 1 2 ]\n");
    scratch.write("unknown.pbrt", "WorldBegin\nMaterial \"difuse\"\n");
    scratch.write("coated.pbrt", "WorldBegin\nMaterial \"subsurface\"\nShape \"sphere\"\n");
    scratch.write("mesh.pbrt", "WorldBegin\nShape \"plymesh\" \"string filename\" \"gone.ply\"\n");
    for (arguments, expected) in [
        (vec!["render", "gone.pbrt", "-o", "a.exr"], vec!["gone.pbrt"]),
        (vec!["render", "broken.pbrt", "-o", "a.exr"], vec!["broken.pbrt:2:", "radius"]),
        (
            vec!["render", "unknown.pbrt", "-o", "a.exr"],
            vec!["unknown.pbrt:2:10", "did you mean \"diffuse\""],
        ),
        (vec!["render", "coated.pbrt", "-o", "a.exr"], vec!["coated.pbrt:2:10", "not supported"]),
        (vec!["render", "mesh.pbrt", "-o", "a.exr"], vec!["mesh.pbrt:2:", "gone.ply"]),
        (vec!["render", scene, "-o", "none/a.exr"], vec!["none/a.exr"]),
        (vec!["render", scene, "-o", "a.jpg"], vec!["a.jpg", ".exr"]),
        (vec!["render", scene, "-o", "a"], vec![".exr"]),
        (vec!["render", scene, "-o", "a.exr", "--report", "none/a.json"], vec!["none/a.json"]),
        (vec!["render", scene, "--frobnicate"], vec!["--frobnicate"]),
        (vec!["render", scene, "--spp", "0"], vec!["--spp"]),
        (vec!["render", scene, "--spp", "1e9"], vec!["--spp"]),
        (vec!["render", scene, "--time", "soon"], vec!["--time"]),
        (vec!["render", scene, "--resolution", "0x9"], vec!["--resolution"]),
        (vec!["render", scene, "--resolution", "99999x99999"], vec!["--resolution"]),
        (vec!["render", scene, "--threads", "0"], vec!["--threads"]),
        (vec!["render", scene, "--batch", "3"], vec!["--batch"]),
        (vec!["render", scene, "--engine", "gpu"], vec!["wavefront"]),
        (vec!["render", scene, "--aov", "depht"], vec!["--aov", "depth"]),
        (vec!["render", scene, "-o", "a.png", "--aov", "depth"], vec!["--aov", "a.png", ".exr"]),
        (vec!["render"], vec!["SCENE.pbrt"]),
        (vec!["paint"], vec!["paint"]),
        (vec!["plan", "broken.pbrt"], vec!["broken.pbrt:2:"]),
        (vec!["plan", "gone.pbrt", "--json"], vec!["gone.pbrt"]),
    ] {
        assert_refused(&scratch, &arguments, &expected);
    }
}

/// The line of the file is shown under the message.
#[test]
fn an_error_shows_its_line() {
    let scratch = Scratch::new("line");
    scratch.write("a.pbrt", "WorldBegin\n  Shape \"spere\" \"float radius\" 2\n");
    let message = text(&scratch.wavepath(&["render", "a.pbrt"]).stderr);
    assert!(message.contains("a.pbrt:2:9") && message.contains("Shape \"spere\""), "{message}");
    assert!(message.contains("did you mean \"sphere\"") && message.contains('^'), "{message}");
}

/// Ctrl-C in the middle of a render that would take hours.
#[cfg(unix)]
#[test]
fn an_interrupt_writes_what_is_done() {
    use std::process::Stdio;
    use std::time::{Duration, Instant};

    let scratch = Scratch::new("interrupt");
    let scene = shipped("two-spheres.pbrt");
    for engine in ["wavefront", "megakernel"] {
        let arguments = ["--spp", "1000000000", "--resolution", "64x64", "--report", "a.json"];
        let files = ["render", &scene, "-o", "a.exr", "--engine", engine];
        let mut child = scratch
            .command(&[&files[..], &arguments[..]].concat())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Long enough for the handler to be there even on a busy machine; a signal before that would end the process.
        std::thread::sleep(Duration::from_secs(2));
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let patience = Instant::now() + Duration::from_secs(60);
        while child.try_wait().unwrap().is_none() {
            if Instant::now() > patience {
                child.kill().unwrap();
                panic!("{engine}: still running a minute after the interrupt");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = child.wait_with_output().unwrap();
        // 128 + SIGINT: a script can tell it from a finished one.
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("interrupted by SIGINT"), "{}", text(&output.stderr));
        assert_eq!(wavepath::picture::read(&scratch.file("a.exr")).unwrap().width, 64);
        let report = json(&scratch.file("a.json"));
        assert!(report["samples"].as_u64().unwrap() >= 64 * 64);
        assert_eq!(report["rays"]["camera"], report["samples"]);
        assert_eq!(scratch.names(), ["a.exr", "a.json"]);
    }
}

// ------------------------------------------------------------------------------------------------------------ plan

/// Does the stage (or kernel) of this name run?
fn runs(plan: &Value, name: &str) -> bool {
    let stages = plan["stages"].as_array().unwrap();
    let stage = stages.iter().find(|stage| stage["name"] == name).unwrap_or_else(|| panic!("no {name}"));
    assert!(!stage["why"].as_str().unwrap().is_empty(), "{name} without a reason");
    stage["runs"].as_bool().unwrap()
}

#[test]
fn the_plan_leaves_out_what_the_scene_lacks() {
    let scratch = Scratch::new("plan");
    let plan = |scene: &str| -> Value {
        let output = scratch.wavepath(&["plan", scene, "--json"]);
        assert_done(&output);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let spheres = plan(&shipped("two-spheres.pbrt"));
    for (name, expected) in [
        ("generate", true),
        ("generate: lens", false),
        ("generate: filter weights", false),
        ("intersect: triangles", false),
        ("intersect: spheres", true),
        ("intersect: quadrics", false),
        ("shade: emission", true),
        ("shade: environment", false),
        ("light_sample", true),
        ("roulette_compact", true),
        ("channel: depth", false),
    ] {
        assert_eq!(runs(&spheres, name), expected, "two-spheres: {name}");
    }
    assert_eq!(spheres["primitives"]["triangles"], 0);
    let sky = plan(&shipped("sky-only.pbrt"));
    assert!(!runs(&sky, "light_sample") && runs(&sky, "shade: environment"));
    let cornell = plan(&shipped("cornell.pbrt"));
    assert!(runs(&cornell, "intersect: triangles") && runs(&cornell, "light_sample"));
    assert!(!runs(&cornell, "shade: environment"));
    let blurred = plan(&shipped("depth-of-field.pbrt"));
    assert!(runs(&blurred, "generate: lens"));
    // What is left out costs no memory either.
    let bytes = |plan: &Value| plan["bytes_per_path"].as_u64().unwrap();
    assert!(bytes(&spheres) < bytes(&cornell) && bytes(&sky) < bytes(&cornell));
    assert!(sky["shadow_queue_bytes"] == 0 && cornell["shadow_queue_bytes"].as_u64().unwrap() > 0);
    assert!(bytes(&spheres) < 128, "scenes without extras stay below two cache lines a path");
    for plan in [&spheres, &sky, &cornell] {
        let columns = plan["columns"].as_array().unwrap();
        let present = columns.iter().filter(|column| column["present"] == true);
        // Queues that paths move between are there twice, and say so; that of shadow rays has some places a worker.
        let copies = |column: &Value| match column["name"].as_str().unwrap() {
            name if name.contains("(twice)") => 2,
            name if name.contains("(some)") => 0,
            _ => 1,
        };
        let sum: u64 = present.map(|column| copies(column) * column["bytes"].as_u64().unwrap()).sum();
        assert_eq!(sum, bytes(plan), "the columns add up");
    }
    // A lamp that nothing reflects is not sampled, and a mirror cannot be.
    let lamp = "WorldBegin AttributeBegin Material \"diffuse\" \"rgb reflectance\" [ 0 0 0 ] \
        AreaLightSource \"diffuse\" Shape \"sphere\" AttributeEnd";
    let mirror = scratch.write("mirror.pbrt", &format!("{lamp} Material \"conductor\" Shape \"disk\""));
    assert!(!runs(&plan(mirror.to_str().unwrap()), "light_sample"));
    let nothing = scratch.write("nothing.pbrt", "WorldBegin");
    assert!(!runs(&plan(nothing.to_str().unwrap()), "intersect: spheres"));
}

#[test]
fn the_plan_is_readable() {
    let scratch = Scratch::new("plan-text");
    let output = scratch.wavepath(&["plan", &shipped("two-spheres.pbrt")]);
    assert_done(&output);
    let told = text(&output.stdout);
    for line in ["left out  intersect: triangles", "runs      intersect: spheres", "bytes a path"] {
        assert!(told.contains(line), "{told}");
    }
}

/// A channel that is asked for is in the file under its layer's name, beside the colours; without, there is none.
#[test]
fn channels_are_layers_of_the_file() {
    let scratch = Scratch::new("aov");
    let names = |more: &[&str]| -> Vec<String> {
        let scene = shipped("two-spheres.pbrt");
        let arguments = ["render", &scene, "-o", "a.exr", "--spp", "4", "--resolution", "9x7", "--quiet"];
        assert_done(&scratch.wavepath(&[&arguments, more].concat()));
        let image = exr::image::read::read_first_flat_layer_from_file(scratch.file("a.exr")).unwrap();
        image.layer_data.channel_data.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    assert_eq!(names(&[]), ["B", "G", "R"]);
    assert_eq!(names(&["--aov", "depth"]), ["B", "G", "R", "depth.Z"]);
    let all = ["B", "G", "R", "depth.Z", "samples", "stderr.B", "stderr.G", "stderr.R"];
    assert_eq!(names(&["--aov", "all", "--layers"]), all);
}

/// A reader that stops reading ends nothing with a panic or an error.
#[test]
#[cfg(unix)]
fn a_closed_pipe_is_no_failure() {
    use std::process::{Command, Stdio};
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell.pbrt");
    let mut child = Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .args(["plan", scene])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
}
