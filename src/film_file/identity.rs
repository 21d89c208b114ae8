//! What a picture depends on, so that samples of two scenes are never mixed.

use crate::picture::RasterSamples;
use crate::scene::{Mesh, Scene, SceneDescription, SphericalLights};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::{self, Write};
use std::fs::File;
use std::io;
use std::path::Path;
use wavepath_kernels::texture::{ImageParts, Texels};
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
    pub(crate) fn of(scene: &Scene, meshes: u128, spherical_lights: SphericalLights) -> io::Result<Identity> {
        let mut description = scene.description().clone();
        // What is in the film's header, or changes no sample. (Contents of files that would be long to print can be left out,
        // too: the files are known by their bytes. Meshes are empty here.)
        description.film.filename = None;
        description.film.half = false;
        description.sampler = Default::default();
        let SceneDescription { camera, film, filter, max_depth, shapes, materials, lights, .. } =
            &description;
        let mut parts: BTreeMap<String, String> = [
            ("camera", hash_of(camera)),
            ("film", format!("{:?}, pixels {:?}", film.resolution, film.pixel_bounds)),
            ("filter", format!("{filter:?}")),
            ("maxdepth", max_depth.to_string()),
            ("shapes", hash_of(shapes)),
            ("materials", hash_of(materials)),
            ("lights", hash_of(lights)),
            ("meshes", hex(meshes)),
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

/// Of the vertices and triangles of all meshes, and of the images of lights and textures.
pub(crate) fn hash_of_meshes(description: &SceneDescription) -> u128 {
    let mut hasher = Xxh3::new();
    for Mesh { positions, normals, uvs, triangles } in &description.meshes {
        let arrays: [&[u8]; 4] = [
            bytemuck::cast_slice(positions),
            bytemuck::cast_slice(normals),
            bytemuck::cast_slice(uvs),
            bytemuck::cast_slice(triangles),
        ];
        for array in arrays {
            hasher.update(&(array.len() as u64).to_le_bytes());
            hasher.update(array);
        }
    }
    for image in &description.light_images {
        for size in [image.width(), image.height(), image.channels().into()] {
            hasher.update(&size.to_le_bytes());
        }
        match image.samples() {
            RasterSamples::Bytes(samples) => hasher.update(samples),
            RasterSamples::Words(samples) => hasher.update(bytemuck::cast_slice(samples)),
            RasterSamples::Halves(samples) => {
                samples.iter().for_each(|sample| hasher.update(&sample.to_bits().to_le_bytes()));
            }
            RasterSamples::Floats(samples) => hasher.update(bytemuck::cast_slice(samples)),
        }
    }
    for image in &description.images {
        let ImageParts { width, height, channels, texels } = image.parts();
        for size in [width, height, channels] {
            hasher.update(&size.to_le_bytes());
        }
        match texels {
            Texels::U8(texels, encoding) => {
                hasher.update(format!("{encoding:?}").as_bytes());
                hasher.update(texels);
            }
            Texels::U16(texels, encoding) => {
                hasher.update(format!("{encoding:?}").as_bytes());
                hasher.update(bytemuck::cast_slice(texels));
            }
            Texels::F16(texels) => hasher.update(bytemuck::cast_slice(texels)),
            Texels::F32(texels) => hasher.update(bytemuck::cast_slice(texels)),
        }
    }
    hasher.digest128()
}
