//! Long renders as the command has them: killed, told to end, with a full disk, in parts.
#![cfg(unix)]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use wavepath::picture;

#[path = "support/scratch.rs"]
mod scratch;
use scratch::Scratch;

/// Most pixels have no noise: samples are best spread unevenly.
const SCENE: &str = r#"LookAt 8 2 14  8 0 0  0 1 0
Camera "perspective" "float fov" 40
Film "rgb" "integer xresolution" 96 "integer yresolution" 40
Sampler "sobol" "integer pixelsamples" 64
WorldBegin
LightSource "infinite" "rgb L" [ 0.1 0.15 0.2 ]
AttributeBegin
  AreaLightSource "diffuse" "rgb L" [ 8 7 5 ]
  Translate 1 4 1
  Shape "sphere" "float radius" 0.5
AttributeEnd
Material "diffuse" "rgb reflectance" [ 0.6 0.4 0.3 ]
Shape "sphere" "float radius" 2
"#;

impl Scratch {
    fn new(name: &str) -> Self {
        Scratch::with_scene(&format!("long-{name}"), SCENE)
    }
    fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
        command.args(words.split_whitespace()).current_dir(&self.0);
        command
    }
    fn start(&self, words: &str) -> Child {
        self.command(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }
    #[track_caller]
    fn done(&self, words: &str) -> Output {
        let output = self.command(words).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{words}: {}", text(&output.stderr));
        output
    }
    #[track_caller]
    fn refused(&self, words: &str, expected: &[&str]) {
        let before = self.names();
        let output = self.command(words).output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words}: {message}");
        for part in expected {
            assert!(message.contains(part), "{words}: no \"{part}\" in {message}");
        }
        assert_eq!(self.names(), before, "{words}");
    }
    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.file(name)).unwrap()).unwrap()
    }
    /// What `info` says.
    #[track_caller]
    fn info(&self, name: &str) -> Value {
        serde_json::from_slice(&self.done(&format!("info {name} --json")).stdout).unwrap()
    }
    fn pixels(&self, name: &str) -> Vec<[f32; 3]> {
        picture::read(&self.file(name)).unwrap().pixels
    }
    fn wait_for(&self, name: &str) {
        let patience = Instant::now() + Duration::from_secs(30);
        while !self.file(name).exists() {
            assert!(Instant::now() < patience, "{name} does not come");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap();
    assert!(status.success());
}

/// Killed twenty times, mostly while a checkpoint is being written, and gone on with each time.
#[test]
fn killed_renders_come_to_the_same_bits() {
    let scratch = Scratch::new("kill");
    for options in ["", "--adaptive"] {
        for name in ["a.film", ".a.film.part"] {
            let _ = fs::remove_file(scratch.file(name));
        }
        // As many samples as take some seconds here.
        scratch.done("render s.pbrt --time 300ms -o a.exr --report a.json -q");
        let report = scratch.json("a.json");
        let spp =
            (report["samples"].as_f64().unwrap() / report["seconds"].as_f64().unwrap() * 2.0 / 3840.0) as u32;
        let spp = spp.max(128);
        scratch.done(&format!("render s.pbrt --spp {spp} {options} -o whole.exr -q"));
        let start = format!(
            "render s.pbrt --spp {spp} {options} -o a.exr -q --checkpoint a.film --checkpoint-every 1ms --resume-if-there"
        );
        let (mut random, mut killed, mut torn) = (12345u64, 0, 0);
        for _ in 0..20 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let threads = 1 + (random >> 60) % 3;
            let mut child = scratch.start(&format!("{start} --threads {threads}"));
            std::thread::sleep(Duration::from_millis(5 + (random >> 33) % 60));
            child.kill().unwrap();
            let status = child.wait().unwrap();
            assert!(status.signal() == Some(9) || status.success(), "{status}");
            killed += usize::from(status.signal() == Some(9));
            torn += usize::from(scratch.file(".a.film.part").exists());
            if scratch.file("a.film").exists() {
                scratch.info("a.film");
            }
        }
        assert!(killed >= 15, "{killed} were killed before they were done");
        assert!(torn > 0, "none was killed while a checkpoint was written");
        assert!(scratch.info("a.film")["samples"].as_u64() > Some(0), "no checkpoint was written");
        scratch.done(&format!("{start} --report a.json"));
        assert!(options.is_empty() || scratch.json("a.json")["adaptive"]["used"] == true);
        assert!(scratch.pixels("a.exr") == scratch.pixels("whole.exr"), "{options}");
        assert!(!scratch.file(".a.film.part").exists());
    }
}

#[test]
fn signals_leave_a_checkpoint_and_a_picture() {
    let scratch = Scratch::new("signals");
    for (name, number) in [("INT", 2), ("TERM", 15), ("HUP", 1), ("USR1", 10), ("USR2", 12), ("XCPU", 24)] {
        let film = format!("{name}.film");
        let child = scratch.start(&format!(
            "render s.pbrt --time 60s -o {name}.exr --checkpoint {film} --checkpoint-every 10ms"
        ));
        scratch.wait_for(&film);
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(128 + number), "{name}: {message}");
        assert!(message.contains(&format!("interrupted by SIG{name}")), "{message}");
        // The last checkpoint is the picture.
        let report: Value =
            serde_json::from_slice(&scratch.done(&format!("info {name}.exr --json")).stdout).unwrap();
        assert_eq!(scratch.info(&film)["samples"], report["samples"]);
        assert_eq!(report["stopped_by"], "interrupt");
        // `--time` is the time of all runs.
        scratch.done(&format!("render s.pbrt --time 1ms --resume {film} -o b.exr -q"));
        assert_eq!(scratch.pixels("b.exr"), scratch.pixels(&format!("{name}.exr")));
    }
}

#[test]
fn what_was_ignored_stays_ignored() {
    let scratch = Scratch::new("nohup");
    let words = "render s.pbrt --time 60s -o a.exr --checkpoint a.film --checkpoint-every 10ms";
    let script = format!("trap '' HUP; exec \"{}\" {words}", env!("CARGO_BIN_EXE_wavepath"));
    let mut child = Command::new("sh")
        .args(["-c", &script])
        .current_dir(&scratch.0)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    scratch.wait_for("a.film");
    signal(&child, "HUP");
    std::thread::sleep(Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none());
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(143));
}

/// A checkpoint that finds no room is not the end, and the one before stays.
#[test]
fn a_full_disk_costs_no_more_than_a_checkpoint() {
    let scratch = Scratch::new("full");
    scratch.done("render s.pbrt --spp 2 --checkpoint a.film -o few.exr -q");
    let good = fs::read(scratch.file("a.film")).unwrap();
    // Twice what there is, in blocks of 512 bytes: less than the film will be with more samples.
    let limit = 2 * good.len() / 512;
    let words = "render s.pbrt --spp 128 --checkpoint a.film --resume-if-there -o many.exr";
    let script = format!("ulimit -f {limit}; exec \"{}\" {words}", env!("CARGO_BIN_EXE_wavepath"));
    let output = Command::new("sh").args(["-c", &script]).current_dir(&scratch.0).output().unwrap();
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(message.contains("cannot write checkpoint \"a.film\""), "{message}");
    assert!(fs::read(scratch.file("a.film")).unwrap() == good);
    assert_eq!(scratch.names(), ["a.film", "few.exr", "many.exr", "s.pbrt"]);
    scratch.done("render s.pbrt --spp 128 -o whole.exr -q");
    assert_eq!(scratch.pixels("many.exr"), scratch.pixels("whole.exr"));
}

#[test]
fn printed_commands_render_the_parts() {
    let scratch = Scratch::new("split");
    for options in ["", "--tiles"] {
        let commands = text(
            &scratch.done(&format!("split s.pbrt --parts 3 {options} -o w.exr -- --spp 50 --seed 4")).stdout,
        );
        let lines: Vec<&str> = commands.lines().map(|line| line.strip_prefix("wavepath ").unwrap()).collect();
        assert_eq!(lines.len(), 4);
        scratch.done("render s.pbrt --spp 50 --seed 4 -o whole.exr -q");
        // One is missing: its command is printed.
        for line in [lines[2], lines[0]] {
            scratch.done(line);
        }
        let output = scratch.done("merge -o some.film -o some.exr w-1.film w-3.film --report some.json");
        let message = text(&output.stderr);
        assert!(message.contains("samples are missing"), "{message}");
        assert!(scratch.pixels("some.exr") != scratch.pixels("whole.exr"));
        let output = scratch.command("merge -o c.exr w-1.film w-3.film --complete").output().unwrap();
        assert!(output.status.code() == Some(1) && !scratch.file("c.exr").exists());
        let command = message.lines().find_map(|line| line.trim().strip_prefix("wavepath ")).unwrap();
        scratch.done(command);
        let output = scratch.done("merge -o w.exr missing-1.film some.film --report merged.json --complete");
        assert_eq!(text(&output.stderr), "");
        assert_eq!(scratch.pixels("w.exr"), scratch.pixels("whole.exr"));
        let (merged, report) = (scratch.json("merged.json"), scratch.info("missing-1.film"));
        assert_eq!(merged["spp"], 50);
        assert_eq!(merged["rays"]["camera"], 50 * 3840);
        assert!(merged["seconds"].as_f64() >= report["report"]["seconds"].as_f64());
        // As they came.
        scratch.done(lines[1]);
        scratch.done(lines[3]);
        assert_eq!(scratch.pixels("w.exr"), scratch.pixels("whole.exr"));
        scratch.refused("merge -o x.exr w-1.film some.film", &["some.film", "an earlier part has, too"]);
        // The merged film gets what is missing, and more.
        scratch.done("render s.pbrt --spp 60 --seed 4 --resume some.film -o more.exr -q");
        scratch.done("render s.pbrt --spp 60 --seed 4 -o whole.exr -q");
        assert_eq!(scratch.pixels("more.exr"), scratch.pixels("whole.exr"));
    }
}

#[test]
fn what_a_file_holds_is_told() {
    let scratch = Scratch::new("info");
    scratch.done("render s.pbrt --samples 3..9 -o a.film -o a.exr --seed 8 -q");
    let info = scratch.info("a.film");
    assert_eq!(info["holds"], serde_json::json!([{ "seed": 8, "samples": [[3, 9]], "blocks": 18 }]));
    assert_eq!(info["missing"], serde_json::json!([{ "samples": [0, 3], "blocks": 18 }]));
    assert_eq!((&info["least_spp"], &info["most_spp"]), (&6.into(), &6.into()));
    assert_eq!(info["report"]["scene"], "s.pbrt");
    let text_of = |name: &str| text(&scratch.done(&format!("info {name}")).stdout);
    assert!(text_of("a.film").contains("3..9: 18 of 18 blocks"), "{}", text_of("a.film"));
    assert!(text_of("a.exr").contains("96 x 40, 6 spp"), "{}", text_of("a.exr"));
    scratch.refused("info s.pbrt", &["s.pbrt", "no film file"]);
    scratch.refused("info none.film", &["none.film"]);
    fs::write(scratch.file("b.film"), &fs::read(scratch.file("a.film")).unwrap()[..5000]).unwrap();
    scratch.refused("info b.film", &["b.film", "ends early"]);
}

#[test]
fn command_lines_that_cannot_be_are_refused() {
    let scratch = Scratch::new("refused");
    for (words, expected) in [
        ("render s.pbrt --part 1/2 --adaptive -o a.film", "--adaptive"),
        ("render s.pbrt --samples 0..4 --error 0.1 -o a.film", "--error"),
        ("render s.pbrt --part 1/2 --tiles --time 1s -o a.film", "--time"),
        ("render s.pbrt --part 70/70 --spp 3 -o a.film --part 1/70", "cannot be used multiple times"),
        ("render s.pbrt --part 1/70 --spp 3 -o a.film", "at most as many parts as samples"),
        ("render s.pbrt --tiles -o a.film", "--part"),
        ("render s.pbrt --checkpoint-every 1s", "--checkpoint"),
        ("render s.pbrt --resume-if-there", "expected --resume or --checkpoint"),
        ("render s.pbrt --resume none.film", "none.film"),
        ("render s.pbrt --resume s.pbrt", "no film file"),
        ("render s.pbrt --checkpoint none/a.film", "does not exist"),
        ("render s.pbrt --checkpoint /dev/null", "cannot be replaced"),
        ("merge -o a.exr none.film", "none.film"),
        ("merge -o a.tif s.pbrt", "a.tif"),
        ("split s.pbrt --parts 0", "--parts"),
        ("split s.pbrt --parts 2 -- --adaptive", "parts cannot have it"),
    ] {
        scratch.refused(words, &[expected]);
    }
    scratch.done("render s.pbrt --spp 2 --checkpoint a.film -o a.exr -q");
    scratch.refused("render s.pbrt --spp 2 --checkpoint a.film -o a.exr", &["--resume-if-there", "a.film"]);
    scratch.refused("render s.pbrt --spp 4 --seed 3 --resume a.film -o a.exr", &["seed was 0, and is 3 now"]);
    scratch.refused("merge -o a.film a.film", &["a.film"]);
    // The same command line starts and restarts.
    for spp in [3, 9] {
        let words = format!("render s.pbrt --spp {spp} --checkpoint b.film --resume-if-there -o b.exr -q");
        scratch.done(&words);
        assert_eq!(scratch.info("b.film")["most_spp"], spp);
    }
}

#[test]
fn long_renders_can_be_watched() {
    let scratch = Scratch::new("watch");
    let child = scratch
        .start("render s.pbrt --time 1500ms --spp 100000000 -o a.exr --save-every 200ms --progress json");
    scratch.wait_for("a.exr");
    // While it goes on: a picture with a report.
    assert_eq!(scratch.pixels("a.exr").len(), 3840);
    scratch.done("info a.exr --json");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let lines = text(&output.stderr);
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.len() >= 2, "{lines:?}");
    assert_eq!(lines[0]["total_samples"], 384_000_000_000u64);
    let last = &lines[lines.len() - 1];
    assert!(last["samples"].as_u64() > Some(0) && last["seconds_left"].is_f64(), "{last}");
    // Gone on with, what was there is not counted as speed.
    scratch.done("render s.pbrt --spp 8 -o a.film -q");
    let output = scratch.done("render s.pbrt --spp 9 --resume a.film -o b.exr --progress json");
    for line in text(&output.stderr).lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        assert!(line["samples"].as_u64() >= Some(8 * 3840), "{line}");
    }
}
