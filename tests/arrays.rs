//! The scripts for job arrays: with a stand-in for the scheduler, and GNU parallel on this machine alone.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const SCENE: &str = r#"LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" 30
Film "rgb" "integer xresolution" 64 "integer yresolution" 48
WorldBegin
LightSource "infinite" "rgb L" [ 0.5 1 2 ]
Shape "sphere"
"#;

struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-arrays-{name}-{}", std::process::id()));
        fs::create_dir_all(path.join("bin")).unwrap();
        fs::write(path.join("s.pbrt"), SCENE).unwrap();
        Scratch(path)
    }
    /// A script, with what stands in for others before it in the path.
    fn script(&self, name: &str) -> Command {
        let mut command = Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts").join(name));
        let path = std::env::var("PATH").unwrap_or_default();
        command.env("PATH", format!("{}:{path}", self.0.join("bin").display()));
        command.env("WAVEPATH", env!("CARGO_BIN_EXE_wavepath")).current_dir(&self.0);
        command
    }
    fn wavepath(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_wavepath")).args(arguments).current_dir(&self.0).output().unwrap()
    }
    fn bits(&self, name: &str) -> Vec<[u32; 3]> {
        let image = wavepath::picture::read(&self.0.join(name)).unwrap();
        image.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    }
    /// The merged parts are the render in one piece.
    fn check_merged(&self, spp: &str) {
        let parts: Vec<String> = fs::read_dir(self.0.join("out"))
            .unwrap()
            .map(|entry| format!("out/{}", entry.unwrap().file_name().into_string().unwrap()))
            .filter(|name| name.starts_with("out/part-"))
            .collect();
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        let merged = self.wavepath(&[&["merge", "-o", "merged.exr"], &parts[..]].concat());
        assert!(merged.status.success(), "{parts:?}: {}", text(&merged));
        let whole = self.wavepath(&["render", "s.pbrt", "-q", "--spp", spp, "-o", "whole.exr"]);
        assert!(whole.status.success());
        assert!(self.bits("merged.exr") == self.bits("whole.exr"));
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

#[test]
fn a_slurm_array_with_a_task_that_is_preempted() {
    let scratch = Scratch::new("slurm");
    let scheduler = scratch.0.join("bin/scontrol");
    fs::write(&scheduler, "#!/bin/sh\necho \"$@\" >> requeued\n").unwrap();
    fs::set_permissions(&scheduler, fs::Permissions::from_mode(0o755)).unwrap();
    let spp = "6000";
    let task = |part: u32| {
        let mut command = scratch.script("slurm-array.sh");
        command.args(["s.pbrt", "out", "--spp", spp, "--quiet"]);
        for (name, value) in [
            ("SLURM_ARRAY_TASK_ID", part.to_string().as_str()),
            ("SLURM_ARRAY_TASK_COUNT", "3"),
            ("SLURM_ARRAY_JOB_ID", "77"),
            ("SLURM_CPUS_PER_TASK", "1"),
        ] {
            command.env(name, value);
        }
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    // The second is preempted until it happens in the middle of its render.
    let film = scratch.0.join("out/part-2.film");
    for wait in [200, 100, 50, 25] {
        let task = task(2).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        assert!(Command::new("kill").args(["-USR1", &task.id().to_string()]).status().unwrap().success());
        let output = task.wait_with_output().unwrap();
        if !film.exists() && output.status.success() {
            assert_eq!(fs::read_to_string(scratch.0.join("requeued")).unwrap(), "requeue 77_2\n");
            break;
        }
        let _ = (fs::remove_dir_all(scratch.0.join("out")), fs::remove_file(scratch.0.join("requeued")));
    }
    for part in [3, 2, 1] {
        let output = task(part).output().unwrap();
        assert!(output.status.success(), "{part}: {}", text(&output));
    }
    // Once more, and nothing is done.
    assert!(text(&task(1).output().unwrap()).contains("is there"));
    scratch.check_merged(spp);
}

#[test]
fn parts_by_gnu_parallel() {
    if Command::new("parallel").arg("--version").output().is_err() {
        println!("no GNU parallel here: not looked at");
        return;
    }
    let scratch = Scratch::new("parallel");
    fs::write(scratch.0.join("hosts"), "1/:\n").unwrap();
    let run = || {
        let mut command = scratch.script("parallel-ssh.sh");
        command.args(["hosts", "s.pbrt", "out", "3", "--spp", "60", "--set", "camera.fov = 30"]);
        command.output().unwrap()
    };
    let output = run();
    assert!(output.status.success(), "{}", text(&output));
    fs::remove_file(scratch.0.join("out/part-2.film")).unwrap();
    assert!(run().status.success());
    scratch.check_merged("60");
}
