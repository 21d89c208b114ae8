//! `wavepath converge` as a user sees it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// A folder that vanishes with the test.
struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Scratch(tempfile::tempdir().unwrap())
    }
    fn path(&self) -> &Path {
        self.0.path()
    }
    fn names(&self) -> Vec<String> {
        let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<_> = fs::read_dir(self.path()).unwrap().map(name).collect();
        names.sort();
        names
    }
}

fn shipped(name: &str) -> String {
    format!("{}/scenes/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn converge(scene: &str, arguments: &[&str], output: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wavepath"));
    command.args(["converge", &shipped(scene), "--threads", "2"]).args(arguments).arg("-o").arg(output);
    command.output().unwrap()
}

/// What a newcomer runs, in short: the files are there, the figures make sense.
#[test]
fn error_falls_with_time_against_a_reference() {
    let scratch = Scratch::new();
    let folder = scratch.path().join("out");
    let reference = shipped("references/two-spheres.exr");
    let arguments = ["--reference", &reference, "--resolution", "64x64", "--budget", "400ms", "--quiet"];
    let output = converge("two-spheres.pbrt", &arguments, &folder);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    for part in ["wavefront/sobol", "megakernel/independent", "131072 spp; its own relMSE", "report.html"] {
        assert!(text.contains(part), "{part} is missing in\n{text}");
    }
    assert!(output.stderr.is_empty());
    for name in ["report.html", "converge.csv", "error.svg"] {
        assert!(fs::metadata(folder.join(name)).unwrap().len() > 1000, "{name}");
    }
    let json: Value = serde_json::from_slice(&fs::read(folder.join("converge.json")).unwrap()).unwrap();
    let variants = json["variants"].as_array().unwrap();
    assert_eq!(variants.len(), 4);
    for variant in variants {
        assert_eq!(variant["error_products"].as_array().unwrap().len(), 3);
        for (index, run) in variant["runs"].as_array().unwrap().iter().enumerate() {
            assert_eq!(run["seed"], index + 1);
            let points = run["points"].as_array().unwrap();
            let column = |name: &str| points.iter().map(|p| p[name].as_f64().unwrap()).collect::<Vec<_>>();
            let (seconds, samples, relmse) = (column("seconds"), column("samples"), column("relmse"));
            assert!(seconds.windows(2).all(|w| w[0] < w[1]) && samples.windows(2).all(|w| w[0] < w[1]));
            assert!(relmse.last() < relmse.first(), "{relmse:?}");
            assert!(points.iter().all(|point| point["invalid_samples"] == 0));
        }
    }
}

/// Without a reference: the errors that are reported are close to those that the films estimate.
#[test]
fn replicates_stand_for_the_reference() {
    let scratch = Scratch::new();
    let arguments = ["--engines", "wavefront", "--budget", "300ms", "--seeds", "4", "--resolution", "96x96"];
    let output = converge("two-spheres.pbrt", &[&arguments[..], &["--adaptive"]].concat(), scratch.path());
    assert!(String::from_utf8_lossy(&output.stdout).contains("wavefront/sobol/adaptive"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8(output.stderr).unwrap().contains("4 variants x 4 seeds x 0.3 s"));
    let json: Value =
        serde_json::from_slice(&fs::read(scratch.path().join("converge.json")).unwrap()).unwrap();
    assert_eq!(json["reference"]["kind"]["replicates"]["count"], 8);
    for variant in json["summaries"][0]["variants"].as_array().unwrap() {
        let ratio = variant["estimated_over_measured"]["value"].as_f64();
        let ratio = ratio.unwrap_or_else(|| panic!("no ratio in {variant}"));
        assert!((0.7..1.4).contains(&ratio), "{variant}");
    }
}

#[test]
fn wrong_arguments_are_told_before_the_work() {
    let scratch = Scratch::new();
    let reference = shipped("references/cornell.exr");
    for (arguments, expected) in [
        (vec!["--reference", &reference], "64 x 64 pixels, the scene 400 x 400; --resolution 64x64"),
        (vec!["--seeds", "1"], "expected --seeds 2 or more"),
        (vec!["--engines", "wavefront,wavefront"], "asked for twice"),
        (vec!["--engines", "gpu"], "wavefront, megakernel"),
        (vec!["--external", "pbrt:soon:a.exr"], "found \"soon\""),
        (vec!["--external", "pbrt:1:none.exr"], "none.exr"),
        (vec!["--budget", "0s"], "more than zero"),
    ] {
        let output = converge("cornell.pbrt", &arguments, scratch.path());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    assert!(scratch.names().is_empty());
    let file = scratch.path().join("file");
    fs::write(&file, "").unwrap();
    let output = converge("cornell.pbrt", &[], &file);
    assert_eq!(output.status.code(), Some(2));
}
