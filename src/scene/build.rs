//! From a [`SceneDescription`] to the tables that the kernels read.

use super::check::check;
use super::description as d;
use super::light_images;
use super::origin;
use crate::picture::{Raster, RasterSamples};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;
use wavepath_kernels::scene::lights::{
    CylinderRow, DistantRow, Emitter, FlatPictureRow, FlatRow, GoniometricRow, Light, LightList, LightTable,
    PictureMapping, PicturePointRow, PointRow, SphereRow, StretchedSpotRow, fade, goniometric, kind,
};
use wavepath_kernels::scene::shapes::{Cylinder, Disk, Quadric, QuadricForm, SpherePart, polar_angle};
use wavepath_kernels::scene::{Along, Parametrization};
use wavepath_kernels::scene::{
    Camera, CameraParts, Filter, FilterAxis, Geometry, GeometryParts, Lens, MaterialHandle, MaterialTable,
    NoRow, PrimitiveTag, Projection, Scene, SceneParts,
};
use wavepath_kernels::shade::coated::{MOST_ORDERS, Passage};
use wavepath_kernels::shade::materials as m;
use wavepath_kernels::texture::TextureTable;

/// How the light of spheres is sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SphericalLights {
    /// Uniformly in the cone of directions that the sphere fills; from inside in all directions.
    #[default]
    Cone,
    /// Uniformly over the surface: for comparison.
    Area,
}

/// Why a description cannot be turned into a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BuildError {
    /// The material has a feature that no kernel has.
    #[error("material {material}: {what} is not supported")]
    Material {
        /// Number of the material.
        material: u32,
        /// What was found.
        what: String,
    },
    /// A parameter of a material is not what it may be.
    #[error("material {material}: {problem}")]
    Parameter {
        /// Number of the material.
        material: u32,
        /// Which parameter, and why.
        problem: m::MaterialError,
    },
    /// Something in the description that cannot be.
    #[error("{of} {id}: {what}")]
    Wrong {
        /// Of what: "shape", "mesh", "light"; "camera", "film", "filter", "sampler".
        of: &'static str,
        /// Its number among them; 0 where there is one.
        id: usize,
        /// What is wrong with it.
        what: String,
    },
    /// What comes out is no scene.
    #[error(transparent)]
    Tables(#[from] wavepath_kernels::scene::BuildError),
    /// The scene holds more of something than can be numbered.
    #[error("the scene has {found} {what}; at most {limit} are supported")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many there may be.
        limit: usize,
    },
}

/// Most primitives of a scene.
const MAX_PRIMITIVES: usize = 1 << 27;

/// Builds the tables.
///
/// # Errors
/// [`BuildError`] names what is not supported.
pub fn build(description: &d::SceneDescription, spherical: SphericalLights) -> Result<Scene, BuildError> {
    let moved = origin::moved(description);
    let description = moved.as_ref().unwrap_or(description);
    let mut builder = Builder {
        description,
        spherical,
        materials: MaterialTable::default(),
        built: Vec::new(),
        geometry: GeometryParts::default(),
        lights: LightList::default(),
        pictures: Vec::new(),
        lamp_power: 0.0,
        textured: Vec::new(),
        cutouts: false,
    };
    check(description)?;
    builder.check_size()?;
    builder.materials()?;
    builder.meshes()?;
    builder.spheres();
    builder.quadrics()?;
    let geometry = Geometry::new(std::mem::take(&mut builder.geometry))?;
    builder.lights_without_surface()?;
    let environment = description.lights.iter().fold([0.0; 3], |sum, light| match light {
        d::Light::Infinite { radiance } => core::array::from_fn(|k| sum[k] + radiance[k]),
        _ => sum,
    });
    Ok(Scene::new(SceneParts {
        camera: camera(description)?,
        geometry,
        materials: builder.materials,
        textures: TextureTable::new(description.textures.clone(), description.images.clone())?,
        lights: LightTable::new(builder.lights)?,
        environment,
        max_depth: description.max_depth,
    })?)
}

/// Empties the meshes and pictures of a description once the tables are built, which hold all of them: a large scene is
/// not held twice. Their handles stay.
pub fn release_meshes(description: &mut d::SceneDescription) {
    description.meshes.iter_mut().for_each(|mesh| *mesh = d::Mesh::default());
    if let Some(black) = Raster::new(1, 1, 1, RasterSamples::Bytes(vec![0])).map(Arc::new) {
        description.light_images.iter_mut().for_each(|image| *image = black.clone());
    }
}

/// Sets another resolution: the crop keeps its share of the image, the field of view that of the shorter axis.
pub fn set_resolution(description: &mut d::SceneDescription, width: u32, height: u32) {
    let film = &mut description.film;
    let old = film.resolution;
    if width == 0 || height == 0 {
        // No image: `build` will say so.
        film.resolution = [width, height];
        return;
    }
    let scale = |x: u32, axis: usize, new: u32| {
        (x as f64 * new as f64 / old[axis] as f64).round().min(new as f64) as u32
    };
    let [x0, x1, y0, y1] = film.pixel_bounds;
    let (x0, x1) = (scale(x0, 0, width), scale(x1, 0, width));
    let (y0, y1) = (scale(y0, 1, height), scale(y1, 1, height));
    film.pixel_bounds = [
        x0.min(width - 1),
        x1.max(x0.min(width - 1) + 1),
        y0.min(height - 1),
        y1.max(y0.min(height - 1) + 1),
    ];
    film.resolution = [width, height];
}

fn camera(description: &d::SceneDescription) -> Result<Camera, BuildError> {
    let (c, film) = (&description.camera, &description.film);
    let [width, height] = film.resolution.map(f64::from);
    let aspect = c.frame_aspect_ratio.unwrap_or(width / height);
    let [x0, x1, y0, y1] = c.screen_window.unwrap_or(if aspect > 1.0 {
        [-aspect, aspect, -1.0, 1.0]
    } else {
        [-1.0, 1.0, -1.0 / aspect, 1.0 / aspect]
    });
    // Of an orthographic camera with a lens the points of the image are those in focus.
    let orthographic = c.kind == d::CameraKind::Orthographic;
    let tan = match orthographic {
        true if c.lens_radius > 0.0 => c.focal_distance.recip(),
        true => 1.0,
        false => (c.fov.to_radians() / 2.0).tan(),
    };
    let depth = if orthographic && c.lens_radius <= 0.0 { 0.0 } else { 1.0 };
    let world = |x: f64, y: f64, z: f64| c.world_from_camera.transform_vector3(DVec3::new(x, y, z)).as_vec3();
    let unit =
        |v: DVec3| -> [f32; 3] { c.world_from_camera.transform_vector3(v).normalize().as_vec3().into() };
    let projection = match c.kind {
        d::CameraKind::Orthographic if c.lens_radius <= 0.0 => {
            Projection::Orthographic { axis: unit(DVec3::Z) }
        }
        d::CameraKind::Perspective | d::CameraKind::Orthographic => Projection::Perspective,
        d::CameraKind::Spherical(mapping) => Projection::Sphere {
            mapping,
            axes: [unit(DVec3::X), unit(DVec3::Z), unit(DVec3::Y)],
            axis: unit(DVec3::Z),
            pixel: [width, height].map(|n| n.recip() as f32),
        },
    };
    let has_lens = c.lens_radius > 0.0 && !matches!(c.kind, d::CameraKind::Spherical(_));
    let camera = Camera::new(CameraParts {
        origin: c.world_from_camera.translation.as_vec3().into(),
        corner: world(x0 * tan, y1 * tan, depth).into(),
        right: world((x1 - x0) / width * tan, 0.0, 0.0).into(),
        down: world(0.0, -(y1 - y0) / height * tan, 0.0).into(),
        lens: has_lens.then(|| Lens {
            x: world(c.lens_radius, 0.0, 0.0).into(),
            y: world(0.0, c.lens_radius, 0.0).into(),
            focal_distance: c.focal_distance as f32,
        }),
        filter: filter(description.filter)?,
    })?;
    Ok(camera.with_projection(projection)?)
}

fn filter(filter: d::Filter) -> Result<Filter, BuildError> {
    let axes =
        |radius: [f64; 2], f: &dyn Fn(f64, f64) -> f64| radius.map(|r| FilterAxis::tabulate(r, |x| f(x, r)));
    let axes = match filter {
        d::Filter::Box { radius } => radius.map(FilterAxis::constant),
        d::Filter::Triangle { radius } => axes(radius, &|x, r| r - x.abs()),
        d::Filter::Gaussian { radius, sigma } => {
            let gauss = move |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
            axes(radius, &move |x, r| (gauss(x) - gauss(r)).max(0.0))
        }
        d::Filter::Mitchell { radius, b, c } => axes(radius, &move |x, r| mitchell(2.0 * x / r, b, c)),
    };
    Ok(Filter::new(axes)?)
}

/// Mitchell and Netravali's cubic for `|x|` up to 2.
fn mitchell(x: f64, b: f64, c: f64) -> f64 {
    let x = x.abs();
    let cubic = if x <= 1.0 {
        (12.0 - 9.0 * b - 6.0 * c) * x.powi(3) + (-18.0 + 12.0 * b + 6.0 * c) * x * x + (6.0 - 2.0 * b)
    } else if x <= 2.0 {
        (-b - 6.0 * c) * x.powi(3)
            + (6.0 * b + 30.0 * c) * x * x
            + (-12.0 * b - 48.0 * c) * x
            + (8.0 * b + 24.0 * c)
    } else {
        0.0
    };
    cubic / 6.0
}

struct Builder<'a> {
    description: &'a d::SceneDescription,
    spherical: SphericalLights,
    materials: MaterialTable,
    built: Vec<MaterialHandle>,
    geometry: GeometryParts,
    lights: LightList,
    /// The pictures of `lights`, which are made once however many lights show them.
    pictures: Vec<(d::LightImage, PictureMapping)>,
    /// Of the lights so far that can be sampled and have a power.
    lamp_power: f64,
    /// For each material, whether it is textured; empty if none is.
    textured: Vec<bool>,
    /// Some shapes are not everywhere there.
    cutouts: bool,
}

/// The scale of a transform that keeps angles, if it is one.
fn uniform_scale(m: &DAffine3) -> Option<f64> {
    let gram = m.matrix3.transpose() * m.matrix3;
    let s2 = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let off = gram - DMat3::from_diagonal(DVec3::splat(s2));
    let largest = off.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    (largest <= 1e-6 * s2).then(|| s2.sqrt())
}

/// Does it matter which way the coordinates of a surface of this material run?
fn is_stretched(material: &d::Material) -> bool {
    match material {
        d::Material::Conductor { alpha, .. }
        | d::Material::Dielectric { alpha, .. }
        | d::Material::Coated { alpha, .. }
        | d::Material::Uber { alpha, .. } => alpha[0] != alpha[1],
        _ => false,
    }
}

/// Does a transform keep what is round around the z axis so?
fn is_round(m: &DAffine3) -> bool {
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = m.matrix3;
    let square = |a: DVec3, b: DVec3| a.dot(b).abs() <= 1e-6 * a.length() * b.length();
    square(x, y) && square(y, z) && square(z, x) && (x.length() - y.length()).abs() <= 1e-6 * x.length()
}

/// What a light's colour counts for when lights are chosen. Not its luminance: errors are measured channel by channel,
/// and a blue lamp would be chosen ten times too rarely.
fn brightness(rgb: d::Rgb) -> f64 {
    rgb.iter().map(|&x| x as f64).sum::<f64>() / 3.0
}

impl Builder<'_> {
    fn check_size(&self) -> Result<(), BuildError> {
        let d = self.description;
        let count = |shape: &d::Shape| match shape.geometry {
            d::Geometry::Mesh(id) => d.meshes[id.0 as usize].triangles.len(),
            _ => 1,
        };
        let primitives: usize = d.shapes.iter().map(count).sum();
        let emitters: usize = d.shapes.iter().filter(|s| Self::emission(s).is_some()).map(count).sum();
        let check = |what, found, limit| {
            if found > limit { Err(BuildError::TooMany { what, found, limit }) } else { Ok(()) }
        };
        check("primitives", primitives, MAX_PRIMITIVES)?;
        check("lights", emitters + d.lights.len(), LightTable::MAX)?;
        let vertices = d.meshes.iter().map(|m| m.positions.len()).sum();
        check("vertices", vertices, u32::MAX as usize / 4)
    }

    fn materials(&mut self) -> Result<(), BuildError> {
        for (number, material) in self.description.materials.iter().enumerate() {
            let handle = self.material(number as u32, *material)?;
            self.built.push(handle);
        }
        for (material, relief) in &self.description.reliefs {
            if let Some(handle) = self.built.get(material.0 as usize) {
                self.materials.set_relief(*handle, *relief);
            }
        }
        let textured: Vec<MaterialHandle> = self
            .materials
            .textured()
            .filter(|(_, columns)| !columns.is_empty())
            .map(|(handle, _)| handle)
            .chain(self.materials.reliefs().iter().map(|(handle, _)| *handle))
            .collect();
        self.cutouts = self.description.shapes.iter().any(|shape| shape.opacity.is_some());
        let mut needed: Vec<bool> = Vec::with_capacity(self.built.len());
        for (material, handle) in self.description.materials.iter().zip(&self.built) {
            let part = match material {
                d::Material::Mixture { materials, .. } => {
                    materials.iter().any(|part| needed.get(part.0 as usize) == Some(&true))
                }
                _ => false,
            };
            needed.push(part || is_stretched(material) || textured.contains(handle));
        }
        if needed.contains(&true) || self.cutouts {
            self.textured = needed;
            // Number 0: triangles without coordinates of their own.
            self.parametrization(Parametrization::Corners, None);
        }
        Ok(())
    }

    /// Are there textures, or materials that are rougher along a coordinate? Then every primitive has coordinates.
    fn has_textures(&self) -> bool {
        !self.textured.is_empty()
    }

    /// Adds where coordinates come from, and how much is there of what has them.
    fn parametrization(&mut self, parametrization: Parametrization, opacity: Option<d::Opacity>) -> u32 {
        self.geometry.parametrizations.push(parametrization);
        if self.cutouts {
            self.geometry.opacities.push(opacity);
        }
        self.geometry.parametrizations.len() as u32 - 1
    }

    /// Coordinates of something round: `turns` once around, and v from 0 to 1 as what it measures goes between these.
    fn round(
        &mut self,
        shape: &d::Shape,
        world: &DAffine3,
        phi_max: f64,
        along: Along,
        [zero, one]: [f64; 2],
    ) {
        if !self.has_textures() || !shape.visible {
            return;
        }
        let inverse = world.inverse();
        let rows = inverse.matrix3.transpose();
        let t = inverse.translation;
        let row = |r: DVec3, t: f64| [r.x, r.y, r.z, t].map(|x| x as f32);
        let parametrization = Parametrization::Round {
            object_from_world: [row(rows.x_axis, t.x), row(rows.y_axis, t.y), row(rows.z_axis, t.z)],
            turns: (phi_max / 360.0) as f32,
            along,
            zero: zero as f32,
            one: one as f32,
        };
        let number = self.parametrization(parametrization, shape.opacity);
        self.geometry.parametrization_of.push(number);
    }

    /// Adds a material to the table: the simplest one that does what the description says.
    fn material(&mut self, number: u32, material: d::Material) -> Result<MaterialHandle, BuildError> {
        const BLACK: d::Parameter<d::Rgb> = d::Parameter::Constant([0.0; 3]);
        const ZERO: d::Parameter<f32> = d::Parameter::Constant(0.0);
        const ONE: d::Parameter<f32> = d::Parameter::Constant(1.0);
        let table = &mut self.materials;
        match material {
            d::Material::Diffuse { reflectance: BLACK, .. }
            | d::Material::DiffuseTransmission { reflectance: BLACK, transmittance: BLACK }
            | d::Material::Mirror { reflectance: BLACK } => Ok(MaterialHandle::ABSORBER),
            d::Material::Diffuse { reflectance, sigma: ZERO } => table.add(&m::Lambert { reflectance }),
            d::Material::Diffuse { reflectance, sigma } => table.add(&m::OrenNayar { reflectance, sigma }),
            d::Material::DiffuseTransmission { reflectance, transmittance } => {
                table.add(&m::DiffuseTransmission { reflectance, transmittance })
            }
            d::Material::Mirror { reflectance } => table.add(&m::Mirror { reflectance }),
            d::Material::Conductor { eta, k, alpha: [ZERO, ZERO] } => table.add(&m::Conductor { eta, k }),
            d::Material::Conductor { eta, k, alpha: [alpha, along_v] } if alpha == along_v => {
                table.add(&m::RoughConductor { eta, k, alpha })
            }
            d::Material::Conductor { eta, k, alpha: [alpha_u, alpha_v] } => {
                table.add(&m::AnisotropicConductor { eta, k, alpha_u, alpha_v })
            }
            // Of index 1 nothing is bent, however rough.
            d::Material::Dielectric { eta, reflectance, transmittance, alpha: [ZERO, ZERO] }
            | d::Material::Dielectric { eta: eta @ ONE, reflectance, transmittance, .. } => {
                table.add(&m::Dielectric { eta, reflectance, transmittance })
            }
            d::Material::Dielectric { eta, reflectance, transmittance, alpha: [alpha_u, alpha_v] } => {
                table.add(&m::RoughDielectric { eta, reflectance, transmittance, alpha_u, alpha_v })
            }
            d::Material::Coated {
                coat,
                reflectance,
                specular,
                eta,
                alpha: [alpha_u, alpha_v],
                thickness,
                max_depth,
            } => {
                // Of a walk, every other step is a reflection at the base.
                let orders = (max_depth.div_ceil(2) as f32).clamp(1.0, MOST_ORDERS).into();
                // Where the roughness is a texture, the base sees one in the middle.
                let value =
                    |parameter: d::Parameter<f32>, else_: f64| parameter.constant().map_or(else_, f64::from);
                let alpha = [value(alpha_u, 0.3), value(alpha_v, 0.3)];
                let passage = Passage::new(coat, value(eta, 1.5), alpha, f64::from(thickness));
                let (coat, passage) = (coat.number().into(), passage.columns().into());
                table.add(&m::Coated { reflectance, specular, eta, alpha_u, alpha_v, orders, coat, passage })
            }
            d::Material::Uber {
                diffuse,
                glossy,
                mirrored,
                refracted,
                opacity,
                reflect,
                transmit,
                eta,
                alpha: [alpha_u, alpha_v],
            } => table.add(&m::Uber {
                diffuse,
                glossy,
                mirrored,
                refracted,
                opacity,
                reflect,
                transmit,
                eta,
                alpha_u,
                alpha_v,
            }),
            d::Material::CoatedConductor { layers } => {
                let numbers = [layers.eta, layers.alpha, layers.thickness, layers.conductor_alpha];
                let [eta, k] = [layers.conductor_eta, layers.conductor_k];
                if numbers.iter().chain(&eta).chain(&k).any(|x| !(0.0..=1e12).contains(x))
                    || layers.eta == 0.0
                {
                    let what = format!("a number of a coated conductor outside of 0 to 1e12: {layers:?}");
                    return Err(BuildError::Material { material: number, what });
                }
                let [once, more] = layers.columns().map(d::Parameter::Constant);
                let (eta, alpha) = ((layers.eta as f32).into(), (layers.alpha as f32).into());
                table.add(&m::CoatedConductor { eta, alpha, once, more })
            }
            d::Material::Mixture { materials, amount } => {
                let found = materials.map(|part| self.built.get(part.0 as usize).copied());
                let [Some(first), Some(second)] = found else {
                    let what = "a mixture of materials that do not come before it".into();
                    return Err(BuildError::Material { material: number, what });
                };
                table.add_mixture([first, second], amount)
            }
            d::Material::ThinDielectric { eta } => table.add(&m::ThinDielectric { eta }),
        }
        .map_err(|problem| BuildError::Parameter { material: number, problem })
    }

    /// The tag of a primitive that does not emit.
    fn tag(&self, shape: &d::Shape) -> PrimitiveTag {
        PrimitiveTag::material(self.built[shape.material.0 as usize])
    }

    /// Adds a light for an emitting primitive of a certain area and returns the primitive's tag.
    fn emitter(&mut self, shape: &d::Shape, emission: d::Emission, area: f64, light: Light) -> PrimitiveTag {
        self.coloured_emitter(shape, emission, area, light, [1.0; 3])
    }

    /// The same for one that shows a picture of this mean colour.
    fn coloured_emitter(
        &mut self,
        shape: &d::Shape,
        emission: d::Emission,
        area: f64,
        light: Light,
        shown: [f64; 3],
    ) -> PrimitiveTag {
        let sides = if emission.two_sided { 2.0 } else { 1.0 };
        let scale = emission.power.map_or(1.0, |p| p as f64 / (std::f64::consts::PI * area * sides));
        let radiance = emission.radiance.map(|x| (x as f64 * scale) as f32);
        let material = self.built[shape.material.0 as usize];
        let emitter = Emitter {
            radiance,
            two_sided: emission.two_sided,
            material: material.row,
            power: brightness(core::array::from_fn(|k| radiance[k] * shown[k] as f32))
                * area
                * sides
                * std::f64::consts::PI,
        };
        if light.kind().bit() & kind::SAMPLED != 0 {
            self.lamp_power += emitter.power;
        }
        let id = self.lights.push(emitter, light);
        if !shape.visible {
            self.lights.hide(id);
        }
        PrimitiveTag::light(material.class, id)
    }

    /// The emission of a shape, if it is not black.
    fn emission(shape: &d::Shape) -> Option<d::Emission> {
        shape.emission.filter(|e| e.radiance != [0.0; 3] && e.power != Some(0.0))
    }

    /// The number of a picture among those of lights.
    fn picture(&mut self, image: d::LightImage, mapping: PictureMapping) -> Result<u32, BuildError> {
        if let Some(number) = self.pictures.iter().position(|known| *known == (image, mapping)) {
            return Ok(number as u32);
        }
        let raster = &self.description.light_images[image.image.0 as usize];
        let picture = light_images::light_picture(raster, image.transfer, mapping)?;
        self.pictures.push((image, mapping));
        Ok(self.lights.push_picture(picture))
    }

    fn meshes(&mut self) -> Result<(), BuildError> {
        let description = self.description;
        let shapes = |smooth: bool| {
            description.shapes.iter().filter_map(move |s| match s.geometry {
                d::Geometry::Mesh(id) => {
                    let mesh = &description.meshes[id.0 as usize];
                    (mesh.normals.is_empty() != smooth).then_some((s, id.0 as usize))
                }
                _ => None,
            })
        };
        let ordered: Vec<_> = shapes(true).chain(shapes(false)).collect();
        // Vertices and normals are stored once a mesh, however many shapes show it.
        let mut first_vertex: Vec<Option<u32>> = vec![None; description.meshes.len()];
        let mut first_normal = vec![0u32; description.meshes.len()];
        // And coordinates, of those that a textured shape shows.
        let mut first_uv: Vec<Option<u32>> = vec![None; description.meshes.len()];
        let mut numbers = std::collections::HashMap::new();
        for (shape, id) in ordered {
            let mesh = &description.meshes[id];
            let first = *first_vertex[id].get_or_insert_with(|| {
                first_normal[id] = self.geometry.normals.len() as u32;
                self.geometry.normals.extend(&mesh.normals);
                let first = self.geometry.vertices.len() as u32;
                let rounded = |p: &[f64; 3]| p.map(|x| x as f32);
                self.geometry.vertices.extend(mesh.positions.iter().map(rounded));
                first
            });
            if self.has_textures() {
                let textured = self.textured[shape.material.0 as usize] || shape.opacity.is_some();
                let offset = (!mesh.uvs.is_empty() && textured).then(|| {
                    let first_uv = *first_uv[id].get_or_insert_with(|| {
                        let first_uv = self.geometry.uvs.len() as u32;
                        self.geometry.uvs.extend(&mesh.uvs);
                        first_uv
                    });
                    first_uv.wrapping_sub(first)
                });
                let number = match (offset, shape.opacity) {
                    (None, None) => 0,
                    key => *numbers.entry(key).or_insert_with(|| {
                        let parametrization = match offset {
                            None => Parametrization::Corners,
                            Some(offset) => Parametrization::Vertices { offset },
                        };
                        self.parametrization(parametrization, shape.opacity)
                    }),
                };
                let of = &mut self.geometry.parametrization_of;
                of.resize(of.len() + if shape.visible { mesh.triangles.len() } else { 0 }, number);
            }
            for triangle in &mesh.triangles {
                self.triangle(shape, mesh, *triangle, first, first_normal[id])?;
            }
        }
        Ok(())
    }

    fn triangle(
        &mut self,
        shape: &d::Shape,
        mesh: &d::Mesh,
        corners: [u32; 3],
        first: u32,
        first_normal: u32,
    ) -> Result<(), BuildError> {
        // As rounded: the plane goes through the corners that rays meet.
        let p = corners.map(|k| DVec3::from(mesh.positions[k as usize].map(|x| x as f32 as f64)));
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        if cross == DVec3::ZERO {
            // Nothing is left of it in single precision.
            return Ok(());
        }
        let area = 0.5 * cross.length();
        let mut normal = if area > 0.0 { cross / (2.0 * area) } else { DVec3::Z };
        let turned = if mesh.normals.is_empty() {
            shape.flip_normal
        } else {
            // Vertex normals say which side is out, as in pbrt.
            let n: DVec3 =
                corners.iter().map(|&k| DVec3::from(mesh.normals[k as usize].map(f64::from))).sum();
            if shape.visible {
                self.geometry.triangle_normals.push(corners.map(|k| first_normal + k));
            }
            n.dot(normal) < 0.0
        };
        if turned {
            normal = -normal;
        }
        let n = normal.as_vec3();
        // With the rounded normal, so that the plane goes through the triangle.
        let distance = p.iter().map(|p| p.dot(n.as_dvec3())).sum::<f64>() / 3.0;
        let tag = match Self::emission(shape) {
            Some(emission) if area > 0.0 => {
                let row = FlatRow {
                    corner: p[0].as_vec3().into(),
                    first: (p[1] - p[0]).as_vec3().into(),
                    second: (p[2] - p[0]).as_vec3().into(),
                    area: area as f32,
                    normal: n.into(),
                };
                match emission.image {
                    None => self.emitter(shape, emission, area, Light::Triangle(row)),
                    Some(image) => {
                        let uvs = corners.map(|k| mesh.uvs[k as usize].map(f64::from));
                        self.picture_triangle(shape, emission, image, row, p, uvs)?
                    }
                }
            }
            _ => self.tag(shape),
        };
        // A light that no ray meets is not among the primitives.
        if shape.visible {
            self.geometry.triangles.push(corners.map(|k| first + k));
            self.geometry.planes.push([n.x, n.y, n.z, distance as f32]);
            self.geometry.tags.push(tag.0);
        }
        Ok(())
    }

    /// A triangle of these corners and texture coordinates that shows a picture, otherwise as `row` says.
    fn picture_triangle(
        &mut self,
        shape: &d::Shape,
        emission: d::Emission,
        image: d::LightImage,
        row: FlatRow,
        p: [DVec3; 3],
        uvs: [[f64; 2]; 3],
    ) -> Result<PrimitiveTag, BuildError> {
        let number = self.picture(image, PictureMapping::Surface)?;
        // The two vectors whose products with a place, from the first corner, are its coordinates along the edges.
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let normal = e1.cross(e2);
        let [first, second] = [e2.cross(normal), normal.cross(e1)].map(|v| v / normal.length_squared());
        let along = |k: usize| first * (uvs[1][k] - uvs[0][k]) + second * (uvs[2][k] - uvs[0][k]);
        let FlatRow { corner, first, second, area, normal } = row;
        let light = Light::PictureTriangle(FlatPictureRow {
            corner,
            first,
            second,
            area,
            normal,
            along_u: along(0).as_vec3().into(),
            along_v: along(1).as_vec3().into(),
            u: uvs[0][0] as f32,
            v: uvs[0][1] as f32,
            number: number as f32,
        });
        let shown = match self.lights.picture(number) {
            Some(picture) => light_images::mean_over_triangle(&picture.picture, uvs),
            None => [1.0; 3],
        };
        Ok(self.coloured_emitter(shape, emission, f64::from(area), light, shown))
    }

    /// A shape that is a whole, round sphere in the world: centre and radius.
    fn whole_sphere(geometry: &d::Geometry) -> Option<(DVec3, f64)> {
        match *geometry {
            d::Geometry::Sphere { world_from_object, radius, z_min, z_max, phi_max }
                if z_min <= -radius && z_max >= radius && phi_max >= 360.0 =>
            {
                uniform_scale(&world_from_object).map(|s| (world_from_object.translation, s * radius))
            }
            _ => None,
        }
    }

    fn spheres(&mut self) {
        for shape in &self.description.shapes {
            let Some((centre, radius)) = Self::whole_sphere(&shape.geometry) else { continue };
            if let d::Geometry::Sphere { world_from_object, .. } = &shape.geometry {
                self.round(shape, world_from_object, 360.0, Along::Polar, [std::f64::consts::PI, 0.0]);
            }
            let signed = if shape.flip_normal { -radius } else { radius };
            let c = centre.as_vec3();
            let sphere = [c.x, c.y, c.z, signed as f32];
            let tag = match Self::emission(shape) {
                Some(emission) => {
                    let row = SphereRow { centre: c.into(), radius: signed as f32 };
                    let light = match self.spherical {
                        // From inside, the cone leaves the light to the rays that meet it.
                        SphericalLights::Cone if shape.visible => Light::Sphere(row),
                        _ => Light::SphereArea(row),
                    };
                    let area = 4.0 * std::f64::consts::PI * radius * radius;
                    self.emitter(shape, emission, area, light)
                }
                None => self.tag(shape),
            };
            if shape.visible {
                self.geometry.spheres.push(sphere);
                self.geometry.tags.push(tag.0);
            }
        }
    }

    fn quadrics(&mut self) -> Result<(), BuildError> {
        for shape in &self.description.shapes {
            let (world_from_object, form) = match shape.geometry {
                d::Geometry::Mesh(_) => continue,
                d::Geometry::Sphere { .. } if Self::whole_sphere(&shape.geometry).is_some() => continue,
                d::Geometry::Sphere { world_from_object, radius, z_min, z_max, phi_max } => {
                    let range = [z_min, z_max].map(|z| polar_angle(z, radius));
                    self.round(shape, &world_from_object, phi_max, Along::Polar, range);
                    let phi_max = phi_max.to_radians();
                    let [radius, z_min, z_max, phi_max] = [radius, z_min, z_max, phi_max].map(|x| x as f32);
                    (world_from_object, QuadricForm::Sphere(SpherePart { radius, z_min, z_max, phi_max }))
                }
                d::Geometry::Disk { world_from_object, height, radius, inner_radius, phi_max } => {
                    let range = [radius, inner_radius];
                    self.round(shape, &world_from_object, phi_max, Along::Radius, range);
                    let phi_max = phi_max.to_radians();
                    let [height, radius, inner_radius, phi_max] =
                        [height, radius, inner_radius, phi_max].map(|x| x as f32);
                    (world_from_object, QuadricForm::Disk(Disk { height, radius, inner_radius, phi_max }))
                }
                d::Geometry::Cylinder { world_from_object, radius, z_min, z_max, phi_max } => {
                    self.round(shape, &world_from_object, phi_max, Along::Height, [z_min, z_max]);
                    let phi_max = phi_max.to_radians();
                    let [radius, z_min, z_max, phi_max] = [radius, z_min, z_max, phi_max].map(|x| x as f32);
                    (world_from_object, QuadricForm::Cylinder(Cylinder { radius, z_min, z_max, phi_max }))
                }
            };
            let quadric = Quadric::new(form, &world_from_object, shape.flip_normal)?;
            let tag = match Self::emission(shape) {
                Some(emission) => self.quadric_light(shape, emission, &world_from_object, form),
                None => self.tag(shape),
            };
            if shape.visible {
                self.geometry.quadrics.push(quadric);
                self.geometry.tags.push(tag.0);
            }
        }
        Ok(())
    }

    /// Whole disks and round cylinders are sampled; everything else that is clipped or stretched is found by chance.
    fn quadric_light(
        &mut self,
        shape: &d::Shape,
        emission: d::Emission,
        world: &DAffine3,
        form: QuadricForm,
    ) -> PrimitiveTag {
        match shape.geometry {
            d::Geometry::Disk { height, radius, inner_radius: 0.0, phi_max, .. } if phi_max >= 360.0 => {
                let centre = world.transform_point3(DVec3::new(0.0, 0.0, height)).as_vec3();
                let x = world.transform_vector3(DVec3::X * radius);
                let y = world.transform_vector3(DVec3::Y * radius);
                let side = if shape.flip_normal { -1.0 } else { 1.0 };
                let normal = (world.matrix3.inverse().transpose() * DVec3::Z).normalize() * side;
                let area = std::f64::consts::PI * x.cross(y).length();
                let row = FlatRow {
                    corner: centre.into(),
                    first: x.as_vec3().into(),
                    second: y.as_vec3().into(),
                    area: area as f32,
                    normal: normal.as_vec3().into(),
                };
                self.emitter(shape, emission, area, Light::Disk(row))
            }
            d::Geometry::Cylinder { radius, z_min, z_max, phi_max, .. } if is_round(world) => {
                let axis = world.transform_vector3(DVec3::Z * (z_max - z_min));
                let x = world.transform_vector3(DVec3::X * radius);
                let y = world.transform_vector3(DVec3::Y * radius);
                let turns = (phi_max / 360.0).min(1.0);
                let area = std::f64::consts::TAU * x.length() * turns * axis.length();
                let row = CylinderRow {
                    base: world.transform_point3(DVec3::Z * z_min).as_vec3().into(),
                    axis: axis.as_vec3().into(),
                    first: x.as_vec3().into(),
                    turns: if axis.cross(x).dot(y) < 0.0 { -turns } else { turns } as f32,
                    side: if shape.flip_normal { -1.0 } else { 1.0 },
                };
                self.emitter(shape, emission, area, Light::Cylinder(row))
            }
            _ => self.emitter(shape, emission, form.area(world), Light::Unsampled(NoRow)),
        }
    }

    /// Lights without a surface.
    ///
    /// A distant light has no power: how much of it there is depends on how far the floor goes on, seen or not. Beside
    /// lamps, the distant lights together are chosen half of the time, in the ratio of their brightness: no more than
    /// twice as rarely as they should be, nor the lamps. Pictures of the sky count among them, by the irradiance that
    /// half a sky of their mean radiance brings.
    fn lights_without_surface(&mut self) -> Result<(), BuildError> {
        let mut lights = Vec::new();
        let mut maps = Vec::new();
        for light in &self.description.lights {
            let (radiance, power, light) = match *light {
                d::Light::Infinite { .. } => continue,
                d::Light::EnvironmentMap { radiance, image, mapping, light_from_world, portal } => {
                    let raster = &self.description.light_images[image.image.0 as usize];
                    let map = light_images::environment_map(
                        raster,
                        image.transfer,
                        radiance,
                        mapping,
                        &light_from_world,
                        portal,
                    )?;
                    maps.extend(map.map(|map| {
                        let power = brightness(map.mean().map(|x| x as f32)) * std::f64::consts::PI;
                        (map, power)
                    }));
                    continue;
                }
                d::Light::PicturePoint {
                    intensity,
                    position,
                    image,
                    mapping,
                    light_from_world,
                    half_size,
                } => {
                    let number = self.picture(image, mapping)?;
                    let integral = self
                        .lights
                        .picture(number)
                        .map_or([0.0; 3], |picture| light_images::integral(picture, half_size));
                    let power = brightness(core::array::from_fn(|k| intensity[k] * integral[k] as f32));
                    let rows = light_from_world.transpose();
                    let [x, y, z] = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().into());
                    let [half_width, half_height] = half_size.map(|x| x as f32);
                    let (position, number) = (position.as_vec3().into(), number as f32);
                    let row = PicturePointRow { position, x, y, z, half_width, half_height, number };
                    (intensity, power, Light::PicturePoint(row))
                }
                d::Light::Point { intensity, position } => {
                    let row = PointRow { position: position.as_vec3().into(), ..PointRow::default() };
                    (intensity, brightness(intensity) * 4.0 * std::f64::consts::PI, Light::Point(row))
                }
                d::Light::Spot {
                    intensity,
                    position,
                    direction,
                    cos_falloff_start,
                    cos_total_width,
                    fade: how,
                    light_from_world,
                } => {
                    let (position, axis) = (position.as_vec3().into(), direction.as_vec3().into());
                    // Behind, the integral of the profile over directions.
                    let (fade, cap) = match how {
                        d::Fade::Smoothstep => {
                            (fade::SMOOTHSTEP, 1.0 - 0.5 * (cos_falloff_start + cos_total_width))
                        }
                        d::Fade::FourthPower => (
                            fade::FOURTH_POWER,
                            1.0 - cos_falloff_start + 0.2 * (cos_falloff_start - cos_total_width),
                        ),
                    };
                    let (cos_falloff_start, cos_total_width) =
                        (cos_falloff_start as f32, cos_total_width as f32);
                    let light = match light_from_world {
                        None => {
                            Light::Spot(PointRow { position, axis, cos_falloff_start, cos_total_width, fade })
                        }
                        Some(matrix) => {
                            let rows = matrix.transpose();
                            let [x, y, z] =
                                [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().into());
                            Light::StretchedSpot(StretchedSpotRow {
                                position,
                                x,
                                y,
                                z,
                                axis,
                                cos_falloff_start,
                                cos_total_width,
                                fade,
                            })
                        }
                    };
                    (intensity, brightness(intensity) * 2.0 * std::f64::consts::PI * cap, light)
                }
                d::Light::Goniometric { intensity, position, axis } => {
                    let row =
                        GoniometricRow { position: position.as_vec3().into(), axis: axis.as_vec3().into() };
                    (intensity, brightness(intensity) * goniometric::INTEGRAL, Light::Goniometric(row))
                }
                d::Light::Distant { radiance, direction } => {
                    let row = DistantRow { direction: (-direction).as_vec3().into() };
                    (radiance, brightness(radiance), Light::Distant(row))
                }
            };
            if radiance != [0.0; 3] {
                lights.push((Emitter { radiance, two_sided: false, material: 0, power }, light));
            }
        }
        let mut brightness = 0.0;
        for (emitter, light) in &lights {
            match light {
                Light::Distant(_) => brightness += emitter.power,
                _ => self.lamp_power += emitter.power,
            }
        }
        brightness += maps.iter().map(|(_, power)| power).sum::<f64>();
        let share = self.lamp_power / brightness;
        let share = if share > 0.0 && share.is_finite() { share } else { 1.0 };
        for (mut emitter, light) in lights {
            if matches!(light, Light::Distant(_)) {
                emitter.power *= share;
            }
            self.lights.push(emitter, light);
        }
        for (map, power) in maps {
            self.lights.push_map(map, power * share);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(material: d::Material) -> String {
        let fine = d::Material::Diffuse { reflectance: [0.5; 3].into(), sigma: 0.0.into() };
        let description =
            d::SceneDescription { materials: vec![fine, material], ..d::SceneDescription::default() };
        build(&description, SphericalLights::Cone).expect_err("refused").to_string()
    }

    #[test]
    fn a_bad_material_is_named() {
        let diffuse = |x: f32| d::Material::Diffuse { reflectance: [0.5, x, 0.5].into(), sigma: 0.0.into() };
        for (x, found) in [(-1.0, "-1"), (f32::NAN, "NaN"), (2.0, "2"), (f32::INFINITY, "inf")] {
            let want = format!("material 1: lambert: reflectance is {found}, expected numbers from 0 to 1");
            assert_eq!(error_of(diffuse(x)), want);
        }
        let rough = |alpha: [f32; 2]| d::Material::Conductor {
            eta: [1.0; 3].into(),
            k: [1.0; 3].into(),
            alpha: alpha.map(d::Parameter::Constant),
        };
        assert_eq!(
            error_of(rough([f32::INFINITY; 2])),
            "material 1: rough_conductor: alpha is inf, expected numbers at least 0.001"
        );
        let brushed = error_of(rough([0.1, f32::NAN]));
        assert!(brushed.starts_with("material 1: anisotropic_conductor: alpha_v is NaN"), "{brushed}");
        let textured = d::Material::ThinDielectric { eta: d::Parameter::Texture(d::TextureId(0)) };
        assert!(error_of(textured).contains("refers to texture 0, but there are 0"));
    }

    #[test]
    fn endless_paths_are_refused() {
        let endless = d::SceneDescription { max_depth: u32::MAX, ..d::SceneDescription::default() };
        let error = build(&endless, SphericalLights::Cone).expect_err("refused");
        assert_eq!(error.to_string(), "4294967295 bounces; at most 16382 are supported");
    }
}
