//! What a picture depends on, so that samples of two scenes are never mixed.

use crate::picture::RasterSamples;
use crate::scene::{Mesh, Scene, SceneDescription, SphericalLights};
use half::slice::HalfFloatSliceExt;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::{self, Write};
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;
use wavepath_kernels::texture::{Image, ImageParts, Texels};
use xxhash_rust::xxh3::Xxh3;

/// What a picture depends on beside what the film's header says: the scene as it was understood, and the files that it was
/// read from.
///
/// Text of scene files counts by what it means: another comment, name of the picture or number of samples is no other
/// scene. Other files count by their bytes. The hashes are XXH3 of 128 bits: against mistakes, not against forgers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// What must be the same: name and hash, or the value itself.
    parts: BTreeMap<String, String>,
    /// Hashes of scene files by name, to tell what changed.
    scene_files: BTreeMap<String, String>,
}

impl Identity {
    /// Of a scene. Reads its files, which takes a while if they are large; [`Scene::identity`] does so once.
    pub(crate) fn of(
        scene: &Scene,
        contents: Contents,
        spherical_lights: SphericalLights,
    ) -> io::Result<Identity> {
        let mut description = scene.description().clone();
        // Known by their texels, which would be long to print.
        let images = std::mem::take(&mut description.images);
        // What is in the film's header, or changes no sample.
        description.film.filename = None;
        description.film.half = false;
        description.sampler = Default::default();
        let SceneDescription {
            camera,
            film,
            filter,
            max_depth,
            shapes,
            materials,
            textures,
            reliefs,
            lights,
            ..
        } = &description;
        let mut parts: BTreeMap<String, String> = [
            ("camera", hash_of(camera)),
            ("film", format!("{:?}, pixels {:?}", film.resolution, film.pixel_bounds)),
            ("filter", format!("{filter:?}")),
            ("maxdepth", max_depth.to_string()),
            ("shapes", hash_of(shapes)),
            ("materials", hash_of(materials)),
            ("lights", hash_of(lights)),
            ("meshes", hex(contents.meshes)),
            ("pictures of lights", hex(contents.pictures)),
            ("pictures of textures", hash_of_images(&images)),
            ("textures", hash_of(textures)),
            ("reliefs", hash_of(reliefs)),
            ("spherical lights", format!("{spherical_lights:?}").to_lowercase()),
            // Whatever else there is.
            ("scene", hash_of(&description)),
        ]
        .map(|(name, value)| (name.to_string(), value))
        .into();
        let mut scene_files = BTreeMap::new();
        let folder = scene.inputs().first().and_then(|path| path.parent()).unwrap_or(Path::new(""));
        for path in scene.inputs() {
            let name = path.strip_prefix(folder).unwrap_or(path).display().to_string();
            let lower = name.to_lowercase();
            let hash = hash_of_file(path)
                .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))?;
            match lower.ends_with(".pbrt") || lower.ends_with(".pbrt.gz") {
                true => scene_files.insert(name, hash),
                false => parts.insert(format!("file {name}"), hash),
            };
        }
        Ok(Identity { parts, scene_files })
    }

    /// What is another one in `other`, in words; nothing if it is the same scene.
    pub fn changes(&self, other: &Identity) -> Vec<String> {
        let mut changes = differences(&self.parts, &other.parts);
        if changes.len() > 1 {
            changes.retain(|name| name != "scene");
        }
        if !changes.is_empty() {
            changes.extend(differences(&self.scene_files, &other.scene_files));
        }
        changes
    }

    /// Names and hashes or values, to be shown.
    pub fn entries(&self) -> impl Iterator<Item = (&str, &str)> {
        let all = self.parts.iter().chain(&self.scene_files);
        all.map(|(name, value)| (name.as_str(), value.as_str()))
    }
}

/// Names of what differs.
fn differences(own: &BTreeMap<String, String>, other: &BTreeMap<String, String>) -> Vec<String> {
    let mut names: Vec<&String> = own.keys().chain(other.keys()).collect();
    names.sort();
    names.dedup();
    names.retain(|name| own.get(*name) != other.get(*name));
    names.into_iter().cloned().collect()
}

/// Of what is printed of a value: exact for numbers, and complete by itself when fields are added.
fn hash_of(value: &impl fmt::Debug) -> String {
    struct Into(Xxh3);
    impl Write for Into {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text.as_bytes());
            Ok(())
        }
    }
    let mut into = Into(Xxh3::new());
    let _ = write!(into, "{value:?}");
    hex(into.0.digest128())
}

fn hash_of_file(path: &Path) -> io::Result<String> {
    let mut hasher = Xxh3::new();
    let mut file = File::open(path)?;
    let mut buffer = vec![0; 1 << 18];
    loop {
        match io::Read::read(&mut file, &mut buffer)? {
            0 => return Ok(hex(hasher.digest128())),
            count => hasher.update(&buffer[..count]),
        }
    }
}

fn hex(hash: u128) -> String {
    format!("{hash:032x}")
}

/// Hashes of what is long in a description, and is let go of when the tables are built.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contents {
    meshes: u128,
    pictures: u128,
}

impl Contents {
    pub(crate) fn of(description: &SceneDescription) -> Contents {
        // Fields that are added are to be thought of here: what is let go of does not show in what is left.
        let SceneDescription {
            meshes,
            light_images,
            camera: _,
            film: _,
            filter: _,
            sampler: _,
            max_depth: _,
            shapes: _,
            materials: _,
            lights: _,
            // Is in what is left.
            textures: _,
            reliefs: _,
            images: _,
        } = description;
        let mut of_meshes = Xxh3::new();
        for Mesh { positions, normals, uvs, triangles } in meshes {
            add(&mut of_meshes, bytemuck::cast_slice(positions));
            add(&mut of_meshes, bytemuck::cast_slice(normals));
            add(&mut of_meshes, bytemuck::cast_slice(uvs));
            add(&mut of_meshes, bytemuck::cast_slice(triangles));
        }
        let mut of_pictures = Xxh3::new();
        for picture in light_images {
            let size = [picture.width(), picture.height(), picture.channels().into()];
            add(&mut of_pictures, bytemuck::cast_slice(&size));
            match picture.samples() {
                RasterSamples::Bytes(samples) => add(&mut of_pictures, samples),
                RasterSamples::Words(samples) => add(&mut of_pictures, bytemuck::cast_slice(samples)),
                RasterSamples::Halves(samples) => {
                    add(&mut of_pictures, bytemuck::cast_slice(samples.reinterpret_cast()));
                }
                RasterSamples::Floats(samples) => add(&mut of_pictures, bytemuck::cast_slice(samples)),
            }
        }
        Contents { meshes: of_meshes.digest128(), pictures: of_pictures.digest128() }
    }
}

/// Of the pictures of textures.
fn hash_of_images(images: &[Arc<Image>]) -> String {
    let mut hasher = Xxh3::new();
    for image in images {
        let ImageParts { width, height, channels, texels } = image.parts();
        add(&mut hasher, bytemuck::cast_slice(&[*width, *height, *channels]));
        match texels {
            Texels::U8(texels, encoding) => {
                add(&mut hasher, format!("8 {encoding:?}").as_bytes());
                add(&mut hasher, texels);
            }
            Texels::U16(texels, encoding) => {
                add(&mut hasher, format!("16 {encoding:?}").as_bytes());
                add(&mut hasher, bytemuck::cast_slice(texels));
            }
            Texels::F16(texels) => add(&mut hasher, bytemuck::cast_slice(texels)),
            Texels::F32(texels) => add(&mut hasher, bytemuck::cast_slice(texels)),
        }
    }
    hex(hasher.digest128())
}

fn add(hasher: &mut Xxh3, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}
