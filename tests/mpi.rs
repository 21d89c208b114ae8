//! Several processes: the bits of one, whoever renders what; and how it ends where something is wrong.
#![cfg(all(feature = "mpi", unix))]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = r#"LookAt 0 1 5  0 0 0  0 1 0
Camera "perspective" "float fov" 40
Film "rgb" "integer xresolution" 70 "integer yresolution" 45
Sampler "sobol" "integer pixelsamples" 64
PixelFilter "mitchell"
WorldBegin
LightSource "infinite" "rgb L" [ 0.1 0.2 0.3 ]
AttributeBegin
AreaLightSource "diffuse" "rgb L" [ 20 15 10 ]
Translate 2 3 1
Shape "sphere" "float radius" 0.3
AttributeEnd
Material "diffuse" "rgb reflectance" [ 0.8 0.4 0.2 ]
Shape "sphere"
Translate 0 -1 0
Rotate 90 1 0 0
Shape "disk" "float radius" 5
"#;

struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-mpi-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        fs::write(path.join("s.pbrt"), SCENE).unwrap();
        Scratch(path)
    }
    /// `wavepath render s.pbrt` by so many ranks of two threads; 0 is without a launcher.
    fn command(&self, ranks: usize, arguments: &[&str]) -> Command {
        let program = env!("CARGO_BIN_EXE_wavepath");
        let mut command = match ranks {
            0 => Command::new(program),
            _ => {
                let mut command = Command::new("mpirun");
                command.args(["--oversubscribe", "--bind-to", "none", "-n", &ranks.to_string(), program]);
                command
            }
        };
        for (name, value) in [
            ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
            ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
            ("OMPI_MCA_btl_vader_single_copy_mechanism", "none"),
        ] {
            command.env(name, value);
        }
        command.args(["render", "s.pbrt", "--threads", "2"]).args(arguments).current_dir(&self.0);
        command
    }
    fn run(&self, ranks: usize, arguments: &[&str]) -> Output {
        self.command(ranks, arguments).output().expect("mpirun is installed")
    }
    fn bits(&self, ranks: usize, arguments: &[&str]) -> Vec<[u32; 3]> {
        let name = format!("{ranks}.exr");
        let report = format!("{ranks}.json");
        let output = self.run(ranks, &[arguments, &["-q", "-o", &name, "--report", &report]].concat());
        assert!(output.status.success(), "{ranks}: {}", text(&output));
        let image = wavepath::picture::read(&self.0.join(name)).unwrap();
        image.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
    }
    fn report(&self, ranks: usize) -> serde_json::Value {
        serde_json::from_slice(&fs::read(self.0.join(format!("{ranks}.json"))).unwrap()).unwrap()
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
fn any_number_of_ranks_gives_the_same_bits() {
    for (name, arguments) in [
        ("plain", &["--spp", "40"][..]),
        ("adaptive", &["--spp", "96", "--adaptive"]),
        ("error", &["--error", "0.003"]),
        ("megakernel", &["--spp", "8", "--engine", "megakernel", "--aov", "depth"]),
    ] {
        let scratch = Scratch::new(name);
        let alone = scratch.bits(0, arguments);
        for ranks in [1, 2, 4] {
            assert!(scratch.bits(ranks, arguments) == alone, "{name}, {ranks} ranks");
            let (one, all) = (scratch.report(0), scratch.report(ranks));
            for figure in ["samples", "rays", "spp", "estimated_relmse", "stopped_by"] {
                assert_eq!(one[figure], all[figure], "{name}, {ranks} ranks");
            }
            if ranks > 1 {
                let of_ranks = all["ranks"].as_array().unwrap();
                assert_eq!(of_ranks.len(), ranks);
                let samples: u64 = of_ranks.iter().map(|rank| rank["samples"].as_u64().unwrap()).sum();
                assert_eq!(samples, all["samples"].as_u64().unwrap());
                assert!((0.0..=1.0).contains(&all["imbalance"].as_f64().unwrap()));
            }
        }
    }
}

#[test]
fn any_number_goes_on_from_a_checkpoint() {
    for (name, arguments) in
        [("goes-on", &["--spp", "6000"][..]), ("goes-on-adaptive", &["--spp", "4000", "--adaptive"])]
    {
        let scratch = Scratch::new(name);
        let film = ["--checkpoint", "a.film", "--checkpoint-every", "50ms", "--resume-if-there"];
        let arguments = [arguments, &film].concat();
        let mut job = scratch.command(3, &[&arguments[..], &["-q", "-o", "a.exr"]].concat());
        let job = job.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let began = Instant::now();
        while !scratch.0.join("a.film").exists() && began.elapsed() < Duration::from_secs(30) {
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(100));
        assert!(Command::new("kill").args(["-USR1", &job.id().to_string()]).status().unwrap().success());
        let output = job.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(128 + 10), "{}", text(&output));
        let part = fs::read(scratch.0.join("a.film")).unwrap();
        let bits: Vec<_> = [2, 0, 4]
            .into_iter()
            .map(|ranks| {
                fs::write(scratch.0.join("a.film"), &part).unwrap();
                scratch.bits(ranks, &arguments)
            })
            .collect();
        fs::remove_file(scratch.0.join("a.film")).unwrap();
        let whole = scratch.bits(1, &arguments);
        assert!(bits.iter().all(|bits| *bits == whole), "{name}");
        // What ranks did is counted without what was there before.
        let report = scratch.report(4);
        let of_ranks = report["ranks"].as_array().unwrap();
        let samples: u64 = of_ranks.iter().map(|rank| rank["samples"].as_u64().unwrap()).sum();
        assert!(samples < report["samples"].as_u64().unwrap(), "{report}");
    }
}

#[test]
fn ranks_stop_together_at_a_time() {
    let scratch = Scratch::new("time");
    scratch.bits(3, &["--time", "1s"]);
    let report = scratch.report(3);
    assert_eq!(report["stopped_by"], "time");
    assert!(report["seconds"].as_f64().unwrap() < 3.0, "{report}");
    assert!(report["ranks"].as_array().unwrap().iter().all(|rank| rank["samples"].as_u64().unwrap() > 0));
}

#[test]
fn what_is_wrong_is_said_once_and_ends_all() {
    let scratch = Scratch::new("wrong");
    let output = scratch.run(3, &["-o", "a.exr", "--set", "camera.fow=3"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert_eq!(text(&output).matches("unknown parameter").count(), 1, "{}", text(&output));
}

#[test]
fn a_rank_that_dies_ends_the_job() {
    let scratch = Scratch::new("dies");
    let film = ["--checkpoint", "a.film", "--checkpoint-every", "100ms"];
    let mut job = scratch.command(2, &[&["--spp", "1000000", "-o", "a.exr"], &film[..]].concat());
    let job = job.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // Rank 1 is the child with that number.
    let began = Instant::now();
    let victim = loop {
        let found = children(job.id()).into_iter().find(|child| {
            let environment = fs::read(format!("/proc/{child}/environ")).unwrap_or_default();
            environment.split(|&byte| byte == 0).any(|entry| entry == b"OMPI_COMM_WORLD_RANK=1")
        });
        match found {
            Some(child) => break child,
            None => assert!(began.elapsed() < Duration::from_secs(20)),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    while !scratch.0.join("a.film").exists() && began.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(Command::new("kill").args(["-KILL", &victim.to_string()]).status().unwrap().success());
    let output = job.wait_with_output().unwrap();
    assert!(!output.status.success());
    assert!(text(&output).contains("signal 9"), "{}", text(&output));
    assert!(!scratch.0.join("a.exr").exists());
    // The last checkpoint is good.
    let info = Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .args(["info", "a.film"])
        .current_dir(&scratch.0)
        .output();
    assert!(info.unwrap().status.success());
}

/// Processes below one, by what the system says of parents.
fn children(of: u32) -> Vec<u32> {
    let parent = |id: u32| -> Option<u32> {
        let status = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        status.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()
    };
    let all: Vec<u32> = fs::read_dir("/proc")
        .unwrap()
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
        .collect();
    let below = |mut id: u32| {
        while let Some(up) = parent(id).filter(|&up| up > 1) {
            if up == of {
                return true;
            }
            id = up;
        }
        false
    };
    all.into_iter().filter(|&id| below(id)).collect()
}
