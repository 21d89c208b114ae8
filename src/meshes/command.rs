//! The command `wavepath mesh`: one subcommand per generator.

use super::error::bad;
use super::*;
use crate::atomic_file::{check_writable, is_standard_output};
use std::path::PathBuf;

/// Arguments of `wavepath mesh KIND [options] -o FILE.ply`.
#[derive(Clone, Debug, clap::Args)]
pub struct MeshArgs {
    /// What to make
    #[command(subcommand)]
    pub kind: MeshKind,
    /// PLY file to write; - is standard output
    #[arg(short, long, global = true, value_name = "FILE.ply")]
    pub output: Option<PathBuf>,
}

/// What `wavepath mesh` can make.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum MeshKind {
    /// A tube along a torus knot
    TorusKnot(TorusKnot),
    /// A planet, a moon or a rock: a sphere displaced by noise and craters
    DisplacedSphere(DisplacedSphere),
    /// Mountains: a heightfield of ridged multifractal noise
    Terrain(Terrain),
    /// Spheres that carry spheres that carry spheres
    SphereFlake(SphereFlake),
    /// A Menger sponge
    Menger(Menger),
    /// A quaternion Julia set
    Julia(Julia),
    /// A turned body: wine glass, vase, chess pawn
    Lathe(Lathe),
    /// A spur gear
    Gear(Gear),
    /// Between box, ball, cylinder and octahedron
    Superellipsoid(Superellipsoid),
    /// A box with sharp or rounded edges
    Box(Block),
}

/// Makes a mesh.
pub fn generate(kind: &MeshKind) -> Result<Mesh, MeshError> {
    match kind {
        MeshKind::TorusKnot(generator) => generator.build(),
        MeshKind::DisplacedSphere(generator) => generator.build(),
        MeshKind::Terrain(generator) => generator.build(),
        MeshKind::SphereFlake(generator) => generator.build(),
        MeshKind::Menger(generator) => generator.build(),
        MeshKind::Julia(generator) => generator.build(),
        MeshKind::Lathe(generator) => generator.build(),
        MeshKind::Gear(generator) => generator.build(),
        MeshKind::Superellipsoid(generator) => generator.build(),
        MeshKind::Box(generator) => generator.build(),
    }
}

/// Makes the mesh that the arguments ask for and writes it. Returns a line with its size.
pub fn run(args: &MeshArgs) -> Result<String, MeshError> {
    let path = args
        .output
        .as_ref()
        .ok_or_else(|| bad("output", "none", "the PLY file to write, as in -o FILE.ply"))?;
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("");
    if !is_standard_output(path) && !ending.eq_ignore_ascii_case("ply") {
        return Err(bad("output", path.display(), "a name ending in .ply, the format that is written"));
    }
    let failed = |source| MeshError::Write { path: path.clone(), source };
    check_writable(path).map_err(failed)?;
    let mesh = generate(&args.kind)?;
    ply::write(path, &mesh).map_err(failed)?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    Ok(format!("{}: {vertices} vertices, {triangles} triangles", path.display()))
}

#[cfg(all(test, feature = "cli"))]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        mesh: MeshArgs,
    }

    fn parse(words: &[&str]) -> MeshArgs {
        Command::try_parse_from(std::iter::once(&"mesh").chain(words)).unwrap().mesh
    }

    fn close<T: Copy + Into<f64>>(a: &[[T; 3]], b: &[[T; 3]], tolerance: f64) -> bool {
        let near = |(x, y): (&T, &T)| ((*x).into() - (*y).into()).abs() <= tolerance;
        a.len() == b.len() && a.as_flattened().iter().zip(b.as_flattened()).all(near)
    }

    #[test]
    fn every_kind_has_defaults_that_work() {
        let kinds = [
            "torus-knot",
            "displaced-sphere",
            "terrain",
            "sphere-flake",
            "menger",
            "julia",
            "lathe",
            "gear",
            "superellipsoid",
            "box",
        ];
        for kind in kinds {
            let mesh = generate(&parse(&[kind]).kind).unwrap();
            assert!(mesh.triangles.len() > 100, "{kind}");
        }
    }

    #[test]
    fn a_missing_file_name_is_an_error_before_anything_is_made() {
        let error = run(&parse(&["menger", "--levels", "5"])).unwrap_err();
        assert!(error.is_usage() && error.to_string().contains("--output"), "{error}");
    }

    #[test]
    fn only_ply_is_written() {
        for name in ["a.obj", "a", "a.ply.gz"] {
            let error = run(&parse(&["box", "-o", name])).unwrap_err();
            assert!(error.is_usage() && error.to_string().contains(".ply"), "{error}");
        }
    }

    #[test]
    fn options_reach_the_generators() {
        let words = ["julia", "--c", "-0.5", "0.25", "0", "-1", "--cells", "20", "-o", "j.ply"];
        let args = parse(&words);
        assert_eq!(args.output, Some(PathBuf::from("j.ply")));
        let MeshKind::Julia(julia) = args.kind else { panic!("{:?}", args.kind) };
        assert_eq!((julia.c, julia.cells), (vec![-0.5, 0.25, 0.0, -1.0], 20));
    }

    /// The committed meshes are what `scenes/make-meshes.sh` makes. Rounding of `sin` and its kin may differ between
    /// machines, so positions may be off by 1e-6 and normals by 1e-5.
    #[test]
    fn committed_meshes_are_what_the_script_makes() {
        let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
        let script = std::fs::read_to_string(scenes.join("make-meshes.sh")).unwrap();
        let mut committed = Vec::new();
        let mut bytes = 0;
        for line in script.lines().map(str::trim).filter(|l| l.starts_with("mesh ")) {
            let args = parse(&line.split_whitespace().skip(1).collect::<Vec<_>>());
            let file = args.output.expect("every line names its file");
            if file.starts_with("meshes/generated") {
                continue;
            }
            let found = std::fs::read(scenes.join(&file)).unwrap();
            assert!(found.len() < 400_000, "{file:?} has {} bytes", found.len());
            bytes += found.len();
            let (found, made) = (ply::decode(&found), generate(&args.kind).unwrap());
            assert_eq!(found.triangles, made.triangles, "{file:?}");
            assert!(close(&found.positions, &made.positions, 1e-6), "{file:?}");
            assert!(close(&found.normals, &made.normals, 1e-5), "{file:?}");
            committed.push(file.file_name().unwrap().to_owned());
        }
        assert!(bytes < 2_000_000, "{bytes} bytes of meshes");

        // And there is no mesh of unknown origin.
        let mut there: Vec<_> = std::fs::read_dir(scenes.join("meshes"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.is_file())
            .map(|path| path.file_name().unwrap().to_owned())
            .collect();
        there.sort();
        committed.sort();
        assert_eq!(there, committed);
    }
}
