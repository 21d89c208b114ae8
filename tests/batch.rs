//! Queues: what they do, what they do not do again, how they fail and how runs share them.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

const SCENE: &str = r#"LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" 30
Film "rgb" "integer xresolution" 16 "integer yresolution" 12
Sampler "sobol" "integer pixelsamples" 2
WorldBegin
LightSource "infinite" "rgb L" [ 0.5 1 2 ]
Include "shape.pbrt"
"#;

struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-batch-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        let scratch = Scratch(path);
        scratch.write("s.pbrt", SCENE);
        scratch.write("shape.pbrt", "Shape \"sphere\"\n");
        scratch
    }
    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.join(name), text).unwrap();
    }
    fn has(&self, name: &str) -> bool {
        self.0.join(name).exists()
    }
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
        command.arg("batch").args(arguments).current_dir(&self.0);
        command
    }
    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
    /// States of the jobs.
    #[track_caller]
    fn states(&self, arguments: &[&str], status: i32) -> Vec<String> {
        let output = self.run(&[&["--json", "-q"], arguments].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
        let jobs: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {said}"));
        jobs.as_array().unwrap().iter().map(|job| job["state"].as_str().unwrap().to_string()).collect()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

const FRAMES: &str = r#"
[defaults]
spp = 4
[[job]]
scene = "s.pbrt"
output = "frames/f.###.exr"
sweep.camera.orbit = { from = 0, to = 360, frames = 3, loop = true }
[[job]]
name = "wide"
scene = "s.pbrt"
output = "wide.png"
set.camera.fov = 60
"#;

#[test]
fn frames_are_done_once_and_again_where_something_changed() {
    let scratch = Scratch::new("frames");
    scratch.write("q.toml", FRAMES);
    let dry = text(&scratch.run(&["q.toml", "--dry-run"]).stdout);
    assert_eq!(dry.lines().count(), 4);
    assert!(dry.contains("s.0002: to do: wavepath render s.pbrt --spp=4 --set=camera.orbit=120"), "{dry}");
    assert!(!scratch.has("frames") && !scratch.has("q.batch"));

    let output = scratch.run(&["q.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.starts_with("job") && table.contains("frames/f.002.exr"), "{table}");
    assert!(scratch.has("frames/f.001.exr") && scratch.has("frames/f.003.exr") && scratch.has("wide.png"));
    let image = wavepath::picture::read(&scratch.0.join("frames/f.002.exr")).unwrap();
    assert!(image.metadata.report.unwrap().contains("\"set\":{\"camera.orbit\":\"120\"}"));
    // A single render gives the same picture.
    let one = Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .args(["render", "s.pbrt", "-q", "--spp", "4", "--set", "camera.orbit=120", "-o", "one.exr"])
        .current_dir(&scratch.0)
        .status();
    assert!(one.unwrap().success());
    assert_eq!(wavepath::picture::read(&scratch.0.join("one.exr")).unwrap().pixels, image.pixels);

    assert_eq!(scratch.states(&["q.toml"], 0), ["was done"; 4]);
    // The date is nothing, what is in a file is.
    scratch.write("shape.pbrt", "Shape \"sphere\"\n");
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done"; 4]);
    fs::remove_file(scratch.0.join("frames/f.002.exr")).unwrap();
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done", "done", "was done", "was done"]);
    scratch.write("frames/f.003.exr", "not the picture");
    scratch.write("q.toml", &FRAMES.replace("fov = 60", "fov = 50"));
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done", "was done", "done", "done"]);
    // Neither are threads anything.
    scratch
        .write("q.toml", &FRAMES.replace("fov = 60", "fov = 50").replace("spp = 4", "spp = 4\nthreads = 1"));
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done"; 4]);
    scratch.write("shape.pbrt", "Shape \"sphere\" \"float radius\" 0.5\n");
    assert_eq!(scratch.states(&["q.toml"], 0), ["done"; 4]);
    assert_eq!(scratch.states(&["q.toml", "--again"], 0), ["done"; 4]);
}

#[test]
fn failures_are_kept_apart() {
    let scratch = Scratch::new("failures");
    scratch.write("broken.pbrt", &SCENE.replace("\"infinite\"", "\"infinit\""));
    scratch.write(
        "q.toml",
        r#"
        [[job]]
        scene = "broken.pbrt"
        [[job]]
        scene = "s.pbrt"
        set.camera.fow = 3
        [[job]]
        name = "good"
        scene = "s.pbrt"
        output = "good.exr"
        "#,
    );
    let output = scratch.run(&["q.toml", "-q"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("2 of 3 jobs failed") && said.contains("broken.pbrt:6:13"), "{said}");
    assert!(said.contains("did you mean \"fov\"?") && scratch.has("good.exr"), "{said}");
    assert_eq!(scratch.states(&["q.toml"], 1), ["failed", "failed", "was done"]);
    // Repaired, they are done.
    scratch.write("broken.pbrt", SCENE);
    assert_eq!(scratch.states(&["q.toml"], 1), ["done", "failed", "was done"]);
}

#[test]
fn wrong_queues_are_refused_before_the_work() {
    let scratch = Scratch::new("wrong");
    let refused = |queue: &str, arguments: &[&str], expected: &str| {
        scratch.write("q.toml", queue);
        let output = scratch.run(arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected) && said.matches("error: ").count() == 1, "{expected}: {said}");
        assert!(!scratch.has("q.batch"));
    };
    refused("[[job]]\nscene = 's.pbrt'\nspp = none", &["q.toml"], "q.toml:3:");
    refused("[[job]]\nscene = 's.pbrt'\nsspp = 3", &["q.toml"], "q.toml:3:1");
    refused("[[job]]\nscene = 's.pbrt'", &["q.toml", "-o", "a.exr"], "-o is for scenes");
    refused("[[job]]\nscene = 's.pbrt'", &["q.toml", "s.pbrt"], "expected one queue");
    refused("", &["q.toml", "--", "--sppp", "3"], "no jobs");
    refused("[[job]]\nscene = 's.pbrt'", &["q.toml", "--", "--sppp", "3"], "--sppp");
    refused("", &["none.toml"], "cannot read none.toml");
    refused("", &["none/*.pbrt"], "no scenes there");
    refused("", &["nothing"], "cannot read nothing");
}

#[test]
fn scenes_folders_and_patterns() {
    let scratch = Scratch::new("scenes");
    scratch.write("t.pbrt", &SCENE.replace("30", "40"));
    let arguments = [".", "-o", "out/{scene}.##.exr", "--", "--spp", "1"];
    // What other files include is no scene.
    assert_eq!(scratch.states(&arguments, 0).len(), 2);
    assert!(
        scratch.has("out/s.01.exr") && scratch.has("out/t.02.exr") && scratch.has("wavepath.batch/s.json")
    );
    let states = scratch.states(&["?.pbrt", "-o", "out/{scene}.exr", "--state", "st"], 0);
    assert_eq!(states, ["done", "done"]);
    assert!(scratch.has("out/t.exr") && scratch.has("st/t.json"));
}

#[test]
fn several_at_once_and_runs_that_share_a_queue() {
    let scratch = Scratch::new("share");
    let queue = FRAMES.replace("frames = 3", "frames = 8").replace("spp = 4", "spp = 256");
    scratch.write("q.toml", &queue);
    let start = || {
        let mut command = scratch.command(&["q.toml", "--jobs", "2", "--memory", "1G", "--json", "-q"]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let runs = [start(), start()];
    let mut done = 0;
    for run in runs {
        let output = run.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let jobs: Value = serde_json::from_slice(&output.stdout).unwrap();
        let jobs = jobs.as_array().unwrap().clone();
        assert!(jobs.iter().all(|job| job["state"] == "done" || job["state"] == "was done"));
        done += jobs.iter().filter(|job| job["state"] == "done").count();
    }
    // Each of them once.
    assert_eq!(done, 9);
}

#[cfg(unix)]
#[test]
fn an_interrupted_queue_goes_on() {
    let scratch = Scratch::new("interrupt");
    scratch.write(
        "q.toml",
        "[[job]]\nscene = 's.pbrt'\noutput = 'a.exr'\n[[job]]\nname = 'long'\nscene = 's.pbrt'\ntime = '5m'\noutput = 'b.exr'",
    );
    let mut run = scratch.command(&["q.toml"]).stderr(Stdio::piped()).spawn().unwrap();
    let began = std::time::Instant::now();
    while !scratch.has("q.batch/a.json") && !scratch.has("q.batch/s.json") {
        assert!(began.elapsed().as_secs() < 60);
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    while !scratch.has("q.batch/long.log") {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(Command::new("kill").args(["-TERM", &run.id().to_string()]).status().unwrap().success());
    let status = run.wait().unwrap();
    assert_eq!(status.code(), Some(128 + 15));
    // What is done of it is kept, and gone on with; of other settings it is given up.
    assert!(!scratch.has("q.batch/long.json") && scratch.has("q.batch/long.film"));
    let info = Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .args(["info", "--json", "q.batch/long.film"])
        .current_dir(&scratch.0)
        .output()
        .unwrap();
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    let before = info["samples"].as_u64().unwrap();
    assert!(before > 192, "{info}");
    let queue = fs::read_to_string(scratch.0.join("q.toml")).unwrap();
    let spp = before / 192 + 9;
    scratch.write("q.toml", &queue.replace("time = '5m'", &format!("spp = {spp}")));
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done", "done"]);
    assert!(!scratch.has("q.batch/long.film"));
    fs::write(scratch.0.join("q.batch/long.film"), "no film").unwrap();
    scratch.write("q.toml", &queue.replace("time = '5m'", "spp = 8"));
    assert_eq!(scratch.states(&["q.toml"], 0), ["was done", "done"]);
}
