//! A mesh alone: the scene that is made around it.
//!
//! The scene is a text in pbrt's format, read like any other, so that people can go on from it.

use std::fmt::Write;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Failure;
use super::args::{ModelArgs, ModelMaterial};
use super::output;
use crate::atomic_file::{is_standard_output, write_whole};
use crate::pbrt::{self, LoadOptions, Loaded, Override};

/// Full angle of view of the shorter axis, in degrees: about a normal lens.
const FIELD_OF_VIEW: f64 = 35.0;
/// The camera stands to the right of the front, and above.
const AZIMUTH: f64 = 35.0;
const ELEVATION: f64 = 22.0;
/// Share of the image that the mesh may fill.
const FILLED: f64 = 0.8;
/// Size of the image that is made without `--resolution`.
const RESOLUTION: [u32; 2] = [960, 720];

/// Whether the file is a mesh: by its name, or by its first bytes where the name says nothing.
pub(super) fn is_mesh(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    if name.ends_with(".ply") || name.ends_with(".ply.gz") {
        return true;
    }
    // Pipes are read once, by the reader.
    if name.ends_with(".pbrt") || !path.is_file() {
        return false;
    }
    let mut start = [0; 4];
    let Ok(mut file) = File::open(path) else { return false };
    file.read_exact(&mut start).is_ok() && (start == *b"ply\n" || start == *b"ply\r")
}

/// Makes the scene around the meshes and reads it; says what was made unless `quiet`.
pub(super) fn load(
    paths: &[PathBuf],
    args: &ModelArgs,
    resolution: Option<[u32; 2]>,
    set: &[Override],
    voice: &output::Voice,
) -> Result<Loaded, Failure> {
    let input = |error: pbrt::Error| Failure::Input(error.to_string());
    let here = Path::new("");
    let mut meshes = String::new();
    for path in paths {
        mesh_line(&mut meshes, path)?;
    }
    let alone =
        pbrt::load_str(&format!("WorldBegin\n{meshes}"), "the scene around the mesh", here).map_err(input)?;
    let bounds = bounds(&alone).ok_or_else(|| {
        let names: Vec<String> = paths.iter().map(|path| format!("\"{}\"", path.display())).collect();
        Failure::Input(format!("{}: no triangles to show", names.join(", ")))
    })?;
    // All of it is described by the text from here on.
    drop(alone);
    let [width, height] = resolution.unwrap_or(RESOLUTION);
    let around =
        Set { bounds, up: DVec3::from(args.up.unwrap_or([0.0, 1.0, 0.0])), resolution: [width, height] };
    let text = around.text(args.material.unwrap_or_default(), &meshes);
    if let Some(file) = &args.write_scene {
        // File names in a scene are relative to the scene.
        let mut lines = String::new();
        let is_here = file.parent().is_none_or(|folder| folder.as_os_str().is_empty());
        for path in paths {
            let absolute = if is_here { None } else { std::fs::canonicalize(path).ok() };
            mesh_line(&mut lines, absolute.as_deref().unwrap_or(path))?;
        }
        let text = around.text(args.material.unwrap_or_default(), &lines);
        write_whole::<std::io::Error>(file, |out| out.write_all(text.as_bytes()))
            .map_err(|error| Failure::Work(format!("cannot write scene \"{}\": {error}", file.display())))?;
        if !is_standard_output(file) {
            voice.wrote(file)?;
        }
    } else {
        voice.tell(format_args!("# The scene around the mesh; --write-scene FILE.pbrt keeps it.\n{text}"))?;
    }
    let options = LoadOptions { set: set.to_vec(), ..LoadOptions::default() };
    pbrt::load_text(text.as_bytes(), "the scene around the mesh", here, &options).map_err(input)
}

/// Appends the shape of a mesh file.
fn mesh_line(text: &mut String, path: &Path) -> Result<(), Failure> {
    let name = path.to_str().ok_or_else(|| {
        Failure::Input(format!("\"{}\": the name is not UTF-8, which a scene file needs", path.display()))
    })?;
    let name = name.replace('\\', "\\\\").replace('"', "\\\"");
    writeln!(text, "Shape \"plymesh\" \"string filename\" \"{name}\"").expect("a string takes everything");
    Ok(())
}

/// Corners of the box around all triangles; none if there are none.
fn bounds(loaded: &Loaded) -> Option<[DVec3; 2]> {
    let meshes = loaded.scene.meshes.iter();
    let corners = meshes.flat_map(|mesh| {
        let corners = mesh.triangles.iter().flatten();
        corners.map(|&corner| DVec3::from(mesh.positions[corner as usize]))
    });
    corners.filter(|point| point.is_finite()).fold(None, |bounds, point| match bounds {
        None => Some([point, point]),
        Some([low, high]) => Some([point.min(low), point.max(high)]),
    })
}

/// What the camera, the floor and the lights follow from.
struct Set {
    bounds: [DVec3; 2],
    /// An axis.
    up: DVec3,
    resolution: [u32; 2],
}

impl Set {
    fn centre(&self) -> DVec3 {
        (self.bounds[0] + self.bounds[1]) / 2.0
    }

    /// Half of the box's diagonal; never nothing.
    fn radius(&self) -> f64 {
        let radius = (self.bounds[1] - self.bounds[0]).length() / 2.0;
        radius.max(1e-6 * self.centre().length()).max(1e-30)
    }

    /// Directions to the right and to the front, seen from the front: of a mesh whose up is y, the front is +z.
    fn axes(&self) -> [DVec3; 2] {
        let front = if self.up.y.abs() > 0.5 { DVec3::Z } else { -DVec3::Y };
        // With up at the front's own axis pointing down, right is still to the right.
        let front = if self.up.x.abs() > 0.5 { DVec3::Z } else { front };
        [self.up.cross(front), front]
    }

    /// From the middle to the camera.
    fn towards_camera(&self) -> DVec3 {
        let [right, front] = self.axes();
        let (azimuth, elevation) = (AZIMUTH.to_radians(), ELEVATION.to_radians());
        let level = azimuth.sin() * right + azimuth.cos() * front;
        elevation.cos() * level + elevation.sin() * self.up
    }

    /// The nearest place from which the box is inside of the image.
    fn camera(&self) -> DVec3 {
        let (centre, back) = (self.centre(), self.towards_camera());
        let right = self.up.cross(back).normalize();
        let above = back.cross(right);
        let [width, height] = self.resolution.map(f64::from);
        let shorter = FILLED * (FIELD_OF_VIEW.to_radians() / 2.0).tan();
        let (across, up) = (shorter * (width / height).max(1.0), shorter * (height / width).max(1.0));
        let distance = (0..8).map(|corner| {
            let side = |axis: usize| self.bounds[corner >> axis & 1][axis];
            let from_centre = DVec3::new(side(0), side(1), side(2)) - centre;
            let needed = (from_centre.dot(right).abs() / across).max(from_centre.dot(above).abs() / up);
            needed + from_centre.dot(back)
        });
        centre + distance.fold(2.0 * self.radius(), f64::max) * back
    }

    fn text(&self, material: ModelMaterial, meshes: &str) -> String {
        let (camera, centre, up, radius) = (self.camera(), self.centre(), self.up, self.radius());
        let [width, height] = self.resolution;
        // Five digits: people are to read and change them.
        let step = 10.0_f64.powi(radius.log10().floor() as i32 - 4);
        let v = |p: DVec3| {
            let [x, y, z] = p.to_array().map(|x| Rounded(x, step));
            format!("{x} {y} {z}")
        };
        let [right, front] = self.axes();
        let lowest =
            (0..3).map(|axis| (self.bounds[0][axis] * up[axis]).min(self.bounds[1][axis] * up[axis]));
        // Just below, so that a flat base does not lie in the floor.
        let height_of_floor = lowest.sum::<f64>() - 1e-4 * radius;
        let floor = centre - centre.dot(up) * up + height_of_floor * up;
        let side = 60.0 * radius;
        let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]
            .map(|[x, y]| v(floor + x * side * right + y * side * front));
        let sun = self.towards_camera() - 1.4 * right + 0.9 * up;
        let material = match material {
            ModelMaterial::Neutral => "Material \"diffuse\" \"rgb reflectance\" [ 0.55 0.55 0.55 ]",
            ModelMaterial::Clay => {
                "Material \"diffuse\" \"rgb reflectance\" [ 0.6 0.33 0.22 ] \"float sigma\" 25"
            }
            ModelMaterial::Gold => {
                "Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\" \"spectrum k\" \"metal-Au-k\" \
                 \"float roughness\" 0.1"
            }
            ModelMaterial::Copper => {
                "Material \"conductor\" \"spectrum eta\" \"metal-Cu-eta\" \"spectrum k\" \"metal-Cu-k\" \
                 \"float roughness\" 0.1"
            }
            ModelMaterial::Mirror => {
                "Material \"conductor\" \"spectrum eta\" \"metal-Al-eta\" \"spectrum k\" \"metal-Al-k\" \
                 \"float roughness\" 0"
            }
            ModelMaterial::Glass => "Material \"dielectric\" \"float eta\" 1.5",
        };
        format!(
            "# Most programs have right-handed axes, pbrt left-handed ones: without this the mesh would be mirrored.\n\
             Scale -1 1 1\n\
             LookAt {}  {}  {}\n\
             Camera \"perspective\" \"float fov\" {FIELD_OF_VIEW}\n\
             Film \"rgb\" \"integer xresolution\" {width} \"integer yresolution\" {height}\n\
             Sampler \"sobol\" \"integer pixelsamples\" 64\n\
             Integrator \"volpath\" \"integer maxdepth\" 12\n\
             WorldBegin\n\
             LightSource \"infinite\" \"rgb L\" [ 0.5 0.6 0.75 ]\n\
             LightSource \"distant\" \"point3 from\" [ {} ] \"point3 to\" [ 0 0 0 ] \"rgb L\" [ 1.6 1.45 1.2 ]\n\
             AttributeBegin\n  \
             Material \"diffuse\" \"rgb reflectance\" [ 0.4 0.4 0.4 ]\n  \
             Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ]\n    \
             \"point3 P\" [ {} ]\n\
             AttributeEnd\n\
             {material}\n\
             {meshes}",
            v(camera),
            v(centre),
            v(up),
            Rounded::direction(sun),
            corners.join("  "),
        )
    }
}

/// A number as a multiple of a power of ten, without a tail of digits.
struct Rounded(f64, f64);

impl Rounded {
    fn direction(p: DVec3) -> String {
        p.to_array().map(|x| Rounded(x, 1e-3).to_string()).join(" ")
    }
}

impl std::fmt::Display for Rounded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Rounded(value, step) = *self;
        let digits = (-step.log10()).round().clamp(0.0, 40.0) as usize;
        // Of zero without a sign.
        let value = (value / step).round() * step + 0.0;
        let text = format!("{value:.digits$}");
        f.write_str(if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every corner of the box is inside of the image, and the box fills most of one side.
    #[test]
    fn the_box_fills_the_image_from_every_axis() {
        for up in ["x", "y", "z", "-x", "-y", "-z"] {
            for resolution in [[960, 720], [300, 900]] {
                let up = DVec3::from(super::super::parse::axis(up).unwrap());
                let bounds = [DVec3::new(-3.0, 10.0, 1.0), DVec3::new(5.0, 11.0, 1.5)];
                let around = Set { bounds, up, resolution };
                let scene =
                    pbrt::load_str(&around.text(ModelMaterial::Neutral, ""), "test", Path::new("")).unwrap();
                let camera = scene.scene.camera;
                let [width, height] = resolution.map(f64::from);
                let (across, high) = ((width / height).max(1.0), (height / width).max(1.0));
                let tan = (camera.fov.to_radians() / 2.0).tan();
                let mut most = 0.0_f64;
                for corner in 0..8 {
                    let side = |axis: usize| bounds[corner >> axis & 1][axis];
                    let p = DVec3::new(side(0), side(1), side(2));
                    let p = camera.world_from_camera.inverse().transform_point3(p);
                    let (x, y) = ((p.x / p.z / tan / across).abs(), (p.y / p.z / tan / high).abs());
                    assert!(p.z > 0.0 && x <= FILLED + 1e-3 && y <= FILLED + 1e-3, "{up}: {x} {y}");
                    most = most.max(x).max(y);
                }
                assert!(most > 0.5, "{up}: {most}");
                // Up is up, and the camera is above the floor.
                let above = camera.world_from_camera.inverse().transform_vector3(up);
                assert!(above.y > 0.5, "{up}: {above}");
                let floor = &scene.scene.meshes[0];
                let eye = camera.world_from_camera.translation;
                for &p in &floor.positions {
                    let p = DVec3::from(p);
                    assert!((p.dot(up) - bounds[0].dot(up).min(bounds[1].dot(up))).abs() < 0.01);
                    assert!(eye.dot(up) > p.dot(up));
                }
            }
        }
    }

    #[test]
    fn numbers_are_short() {
        for (value, step, expected) in
            [(1.234_567, 1e-3, "1.235"), (-0.000_01, 1e-3, "0"), (12_345.6, 10.0, "12350"), (2.0, 1e-3, "2")]
        {
            assert_eq!(Rounded(value, step).to_string(), expected);
        }
    }

    /// Seen from the front, +x of a mesh with y up is to the right.
    #[test]
    fn nothing_is_mirrored() {
        let around =
            Set { bounds: [DVec3::splat(-1.0), DVec3::splat(1.0)], up: DVec3::Y, resolution: [100, 100] };
        let scene = pbrt::load_str(&around.text(ModelMaterial::Neutral, ""), "test", Path::new("")).unwrap();
        let inverse = scene.scene.camera.world_from_camera.inverse();
        assert!(inverse.transform_vector3(DVec3::X).x > 0.5);
    }

    #[test]
    fn every_material_is_read() {
        let around =
            Set { bounds: [DVec3::splat(-1.0), DVec3::splat(1.0)], up: DVec3::Z, resolution: [100, 100] };
        use clap::ValueEnum;
        for material in ModelMaterial::value_variants() {
            let text = around.text(*material, "Shape \"sphere\"\n");
            let loaded = pbrt::load_str(&text, "test", Path::new("")).unwrap();
            assert!(loaded.warnings.is_empty(), "{material}: {:?}", loaded.warnings);
        }
    }
}
