//! `wavepath bench`: what it prints is complete, and of the shape that it promises.

use serde_json::Value;
use std::process::Command;

const SCENE: &str = r#"
    Camera "perspective" "float fov" 40
    Film "rgb" "integer xresolution" 16 "integer yresolution" 12
    WorldBegin
    AttributeBegin AreaLightSource "diffuse" "rgb L" [ 9 8 7 ]
        Translate 0 3 4 Shape "sphere" "float radius" .5 AttributeEnd
    Material "diffuse" Translate 0 0 4 Shape "sphere"
"#;

fn bench(arguments: &[&str]) -> std::process::Output {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.pbrt"), SCENE).unwrap();
    Command::new(env!("CARGO_BIN_EXE_wavepath"))
        .arg("bench")
        .args(arguments)
        .current_dir(&folder)
        .output()
        .unwrap()
}

#[test]
fn all_figures_are_there() {
    let output = bench(&["scene.pbrt", "--rounds", "1", "--each", "1ms", "--threads", "2", "--json"]);
    assert!(output.status.success(), "{output:?}");
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    let scene = &figures["scenes"][0];
    let rows = |name: &str| scene[name].as_array().unwrap_or_else(|| panic!("no {name}"));
    let names: Vec<_> = rows("ablation").iter().map(|step| step["name"].as_str().unwrap()).collect();
    assert_eq!(names[0], "megakernel");
    assert_eq!(names[..names.len() / 2], names[names.len() / 2..], "the same steps with both samplers");
    for step in rows("ablation") {
        for figure in ["samples_per_second", "over_naive", "over_wide"] {
            let [median, min, max] = ["median", "min", "max"].map(|k| step[figure][k].as_f64().unwrap());
            assert!(0.0 < min && min <= median && median <= max, "{step}");
        }
    }
    let stages: Vec<_> = rows("stages").iter().map(|stage| stage["name"].as_str().unwrap()).collect();
    let expected =
        ["generate", "intersect", "material_sort", "shade", "light_sample", "roulette_compact", "film"];
    assert_eq!(stages, expected);
    let shares: f64 = rows("stages").iter().map(|stage| stage["share"].as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "{shares}");
    assert_eq!(rows("rays").len(), 4);
    let numbers = |name: &str| rows(name).iter().map(|r| r["number"].as_u64().unwrap()).collect::<Vec<_>>();
    assert_eq!(numbers("batches"), [64, 256, 1024, 4096, 16384, 65536, 262144]);
    assert_eq!(numbers("threads"), [1, 2]);
    assert!(scene["plan_over_everything"]["median"].as_f64().unwrap() > 0.0);
    assert_eq!(rows("samplers").len(), 2);
}

#[test]
fn scenes_are_looked_for_before_anything_is_measured() {
    for (arguments, told) in [
        (&[][..], "no scenes/cornell.pbrt in the current folder"),
        (&["scene.pbrt", "none.pbrt"], "none.pbrt"),
        (&["--rounds", "0"], "--rounds"),
        (&["--each", "soon"], "--each"),
    ] {
        let output = bench(arguments);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(output.stdout.is_empty());
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(error.contains(told), "{error}");
    }
}
