//! The scene description: everything that a reader found, in world space, before the plan and the kernels see it.
//!
//! A reader (see [`crate::pbrt`]) produces a [`SceneDescription`]; [`crate::scene::build`] turns it into the
//! tables that the kernels walk. Transforms are kept in double precision up to here, so that a chain of them
//! costs no accuracy; vertices are rounded to `f32` once, in world space.

use crate::pbrt::transform;
use crate::picture::{Raster, Transfer};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;
use wavepath_engine::SamplerKind;
use wavepath_engine::film::Frame;
pub use wavepath_kernels::scene::Opacity;
pub use wavepath_kernels::scene::lights::{PictureMapping, SkyMapping};
pub use wavepath_kernels::shade::coated::Coat;
pub use wavepath_kernels::shade::coated_conductor::Layers;
pub use wavepath_kernels::shade::materials::Relief;
pub use wavepath_kernels::shade::parameters::{Parameter, TextureId};
use wavepath_kernels::texture::{Image, Texture};

/// Linear RGB, not clamped. Radiance in W/(m^2 sr) where it is emitted light, dimensionless where it is a reflectance.
pub type Rgb = [f32; 3];

/// Handle of a [`Material`] in [`SceneDescription::materials`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u32);

/// Handle of a [`Mesh`] in [`SceneDescription::meshes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MeshId(pub u32);

/// Handle of a picture in [`SceneDescription::images`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ImageId(pub u32);

/// A picture, and what its samples mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightImage {
    /// The picture.
    pub image: ImageId,
    /// What integer samples stand for.
    pub transfer: Transfer,
}

/// A scene in world space.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// Where the rays start.
    pub camera: Camera,
    /// Resolution and crop of the image.
    pub film: Film,
    /// Reconstruction filter, sampled by importance.
    pub filter: Filter,
    /// Which random numbers, and how many samples a pixel.
    pub sampler: Sampler,
    /// Longest path, in scattering vertices (pbrt's `maxdepth`).
    pub max_depth: u32,
    /// Triangle meshes, world space.
    pub meshes: Vec<Mesh>,
    /// Things with a surface.
    pub shapes: Vec<Shape>,
    /// Materials that [`Shape::material`] refers to.
    pub materials: Vec<Material>,
    /// Textures that parameters of materials refer to, and each other: to those before them.
    pub textures: Vec<Texture>,
    /// Pictures that textures refer to.
    pub images: Vec<Arc<Image>>,
    /// What turns the normals of some of the materials.
    pub reliefs: Vec<(MaterialId, Relief)>,
    /// Lights without a surface. Emitting surfaces are [`Shape::emission`].
    pub lights: Vec<Light>,
    /// Pictures that lights refer to. Where a sample is negative it counts as 0; all must be finite.
    pub light_images: Vec<Arc<Raster>>,
}

impl Default for SceneDescription {
    /// Nothing, seen as pbrt does without options: five scattering vertices.
    fn default() -> Self {
        SceneDescription {
            camera: Camera::default(),
            film: Film::default(),
            filter: Filter::default(),
            sampler: Sampler::default(),
            max_depth: 5,
            meshes: Vec::new(),
            shapes: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            images: Vec::new(),
            reliefs: Vec::new(),
            lights: Vec::new(),
            light_images: Vec::new(),
        }
    }
}

impl SceneDescription {
    /// Adds a material.
    pub fn add_material(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Adds a mesh: a form for shapes.
    pub fn add_mesh(&mut self, mesh: Mesh) -> Geometry {
        self.meshes.push(mesh);
        Geometry::Mesh(MeshId(self.meshes.len() as u32 - 1))
    }

    /// Adds a picture for lights.
    pub fn add_light_image(&mut self, image: Arc<Raster>) -> ImageId {
        self.light_images.push(image);
        ImageId(self.light_images.len() as u32 - 1)
    }

    /// Adds a surface that reflects.
    pub fn add_shape(&mut self, geometry: Geometry, material: MaterialId) {
        let (opacity, visible) = (None, true);
        self.shapes.push(Shape { geometry, material, emission: None, flip_normal: false, opacity, visible });
    }

    /// Adds a surface that emits `radiance` on the side of its normal.
    pub fn add_lamp(&mut self, geometry: Geometry, material: MaterialId, radiance: Rgb) {
        let emission = Some(Emission { radiance, power: None, two_sided: false, image: None });
        let (opacity, visible) = (None, true);
        self.shapes.push(Shape { geometry, material, emission, flip_normal: false, opacity, visible });
    }
}

/// How the rays of a [`Camera`] go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraKind {
    /// Through points of the image, from the pinhole or the lens.
    #[default]
    Perspective,
    /// All in one direction, from points of the screen window in the plane z = 0, of units of camera space. With a lens, as
    /// in pbrt, from points of the lens to those of the plane in focus.
    Orthographic,
    /// In all directions, of which the image is a map whose +z is y of camera space.
    Spherical(SkyMapping),
}

/// A camera with an optional thin lens.
#[derive(Clone, Debug)]
pub struct Camera {
    /// How its rays go.
    pub kind: CameraKind,
    /// Camera space (x right, y up, z into the scene, left-handed as in pbrt) to world space.
    pub world_from_camera: DAffine3,
    /// Full field of view of the shorter image axis, in degrees, in (0, 180).
    pub fov: f64,
    /// Screen window `[x0, x1, y0, y1]` on the plane z = 1 in units of tan(fov/2), of an orthographic camera in camera space.
    /// `None`: the shorter axis spans [-1, 1] and the other follows from the aspect ratio of the full image.
    pub screen_window: Option<[f64; 4]>,
    /// Width over height used for the default screen window. `None`: that of the resolution.
    pub frame_aspect_ratio: Option<f64>,
    /// Radius of the lens; 0 is a pinhole.
    pub lens_radius: f64,
    /// Distance of the plane in focus, along z of camera space.
    pub focal_distance: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Camera {
            kind: CameraKind::Perspective,
            world_from_camera: DAffine3::IDENTITY,
            fov: 90.0,
            screen_window: None,
            frame_aspect_ratio: None,
            lens_radius: 0.0,
            focal_distance: 1e6,
        }
    }
}

impl Camera {
    /// A pinhole at `eye` that looks at a point, with `up` upwards in the image, and a field of view of `fov` degrees along
    /// the shorter axis. `None` if the two points coincide or `up` is parallel to the view.
    pub fn look_at(eye: DVec3, look: DVec3, up: DVec3, fov: f64) -> Option<Camera> {
        let camera_from_world = transform::look_at(eye.into(), look.into(), up.into())?;
        Some(Camera { world_from_camera: camera_from_world.inverse(), fov, ..Camera::default() })
    }
}

/// Resolution and crop of the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Full resolution `[width, height]` in pixels.
    pub resolution: [u32; 2],
    /// Pixels to render: `[x0, x1, y0, y1]`, half open, inside the resolution, not empty.
    pub pixel_bounds: [u32; 4],
    /// File name that the scene asks for, as written.
    pub filename: Option<String>,
    /// Whether the scene asks in so many words for 16-bit floating point in its file (pbrt's `savefp16`).
    pub half: bool,
}

impl Film {
    /// All of an image of this size.
    pub fn whole(width: u32, height: u32) -> Self {
        let (resolution, pixel_bounds) = ([width, height], [0, width, 0, height]);
        Film { resolution, pixel_bounds, ..Film::default() }
    }

    /// The pixels to render, and their place in the image.
    pub fn frame(&self) -> Frame {
        let [image_width, image_height] = self.resolution;
        Frame { image_width, image_height, bounds: self.pixel_bounds }
    }
}

impl Default for Film {
    fn default() -> Self {
        Film { resolution: [1280, 720], pixel_bounds: [0, 1280, 0, 720], filename: None, half: false }
    }
}

/// Reconstruction filter. Radii in pixels, from the pixel's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// Constant over the rectangle.
    Box {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// Product of two tents.
    Triangle {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// Product of two Gaussians of standard deviation `sigma`, lowered so that each reaches 0 at its radius.
    Gaussian {
        /// Half width and half height.
        radius: [f64; 2],
        /// Standard deviation in pixels.
        sigma: f64,
    },
    /// Mitchell and Netravali (1988), with negative lobes.
    Mitchell {
        /// Half width and half height.
        radius: [f64; 2],
        /// Parameter B.
        b: f64,
        /// Parameter C.
        c: f64,
    },
}

impl Default for Filter {
    fn default() -> Self {
        Filter::Gaussian { radius: [1.5, 1.5], sigma: 0.5 }
    }
}

/// Random numbers and samples a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampler {
    /// Which numbers.
    pub kind: SamplerKind,
    /// Samples a pixel, at least 1.
    pub pixel_samples: u32,
    /// Seed that the scene asks for.
    pub seed: u64,
}

impl Default for Sampler {
    fn default() -> Self {
        Sampler { kind: SamplerKind::Sobol, pixel_samples: 16, seed: 0 }
    }
}

/// A triangle mesh in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f64; 3]>,
    /// Vertex normals, unit length, already turned by `ReverseOrientation` and transforms as pbrt does it;
    /// empty, or one for each position.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates; empty, or one for each position.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertex indices a triangle, each below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
}

/// The form of a [`Shape`].
#[derive(Clone, Debug)]
pub enum Geometry {
    /// All triangles of a mesh.
    Mesh(MeshId),
    /// A sphere around the origin of object space, perhaps clipped.
    Sphere {
        /// Object space to world space.
        world_from_object: DAffine3,
        /// Radius in object space, above 0.
        radius: f64,
        /// Only z in `[z_min, z_max]` of object space is there; `[-radius, radius]` is all.
        z_min: f64,
        /// See `z_min`.
        z_max: f64,
        /// Only azimuths in `[0, phi_max]` degrees are there; 360 is all.
        phi_max: f64,
    },
    /// A disk in the plane z = `height` of object space with normal +z, perhaps a part of a ring.
    Disk {
        /// Object space to world space.
        world_from_object: DAffine3,
        /// Height over the plane z = 0.
        height: f64,
        /// Outer radius, above 0.
        radius: f64,
        /// Inner radius, 0 for a full disk.
        inner_radius: f64,
        /// Only azimuths in `[0, phi_max]` degrees are there; 360 is all.
        phi_max: f64,
    },
    /// A cylinder around the z axis of object space, open at both ends, perhaps a part of one.
    Cylinder {
        /// Object space to world space.
        world_from_object: DAffine3,
        /// Radius, above 0.
        radius: f64,
        /// z in `[z_min, z_max]` is there; `z_min` is below `z_max`.
        z_min: f64,
        /// See `z_min`.
        z_max: f64,
        /// Only azimuths in `[0, phi_max]` degrees are there; 360 is all.
        phi_max: f64,
    },
}

impl Geometry {
    /// A whole sphere in the world.
    pub fn sphere(centre: DVec3, radius: f64) -> Self {
        let world_from_object = DAffine3::from_translation(centre);
        Geometry::Sphere { world_from_object, radius, z_min: -radius, z_max: radius, phi_max: 360.0 }
    }
}

/// A surface: its form, what it is made of, whether it emits.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Form.
    pub geometry: Geometry,
    /// Material of the surface.
    pub material: MaterialId,
    /// Emitted light, if it is a lamp.
    pub emission: Option<Emission>,
    /// `ReverseOrientation` XOR "the transform swaps handedness". The geometric normal (out of the sphere, away from
    /// the axis of the cylinder; +z of the disk; `cross(p1 - p0, p2 - p0)` of world-space triangles without vertex normals) is negated when set.
    /// For a mesh, the reader has already applied the transform's handedness to the winding's meaning: the normal
    /// is `cross(p1 - p0, p2 - p0)` of the world-space positions, negated when this is set.
    pub flip_normal: bool,
    /// How much of it is there, if not everything.
    pub opacity: Option<Opacity>,
    /// Do rays meet it? A lamp that they do not meet (pbrt's `alpha` of 0) still shines.
    pub visible: bool,
}

/// Light emitted by a surface, the same in all directions on the side of its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Emitted radiance, `scale` and any unit conversion applied.
    pub radiance: Rgb,
    /// pbrt's `power`: if set, `radiance` is still to be multiplied by
    /// power / (pi * area * (2 if two-sided)), with the area of the emitting shape (of each triangle of a mesh).
    pub power: Option<f32>,
    /// Emits on both sides.
    pub two_sided: bool,
    /// A picture over the surface, by which `radiance` is multiplied: its lower edge is where v is 0. On meshes with
    /// texture coordinates only.
    pub image: Option<LightImage>,
}

/// What a surface is made of. Each parameter is a constant or a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// Lambert, or Oren-Nayar (qualitative model, 1994) where `sigma` is not 0.
    Diffuse {
        /// Albedo, each channel in [0, 1].
        reflectance: Parameter<Rgb>,
        /// Standard deviation of the facets' slope, in degrees.
        sigma: Parameter<f32>,
    },
    /// Diffuse reflection and diffuse transmission.
    DiffuseTransmission {
        /// Share of the light that is reflected, each channel in [0, 1].
        reflectance: Parameter<Rgb>,
        /// Share of the light that passes, each channel in [0, 1].
        transmittance: Parameter<Rgb>,
    },
    /// Conductor with complex index of refraction; GGX where rough.
    Conductor {
        /// Real part of the index.
        eta: Parameter<Rgb>,
        /// Absorption coefficient.
        k: Parameter<Rgb>,
        /// GGX alpha along u and v, remapping applied; `[0, 0]` is smooth.
        alpha: [Parameter<f32>; 2],
    },
    /// Ideal mirror.
    Mirror {
        /// What it reflects at every angle, each channel in [0, 1].
        reflectance: Parameter<Rgb>,
    },
    /// Dielectric with Fresnel reflection and refraction; GGX where rough.
    Dielectric {
        /// Index inside over index outside (outside: where the normal points).
        eta: Parameter<f32>,
        /// Tint of reflected light (v3 `Kr`), 1 in pbrt-v4.
        reflectance: Parameter<Rgb>,
        /// Tint of transmitted light (v3 `Kt`), 1 in pbrt-v4.
        transmittance: Parameter<Rgb>,
        /// GGX alpha along u and v, remapping applied; `[0, 0]` is smooth.
        alpha: [Parameter<f32>; 2],
    },
    /// Thin pane of a smooth dielectric: all interreflections, no bend.
    ThinDielectric {
        /// Index of the pane over the index around it.
        eta: Parameter<f32>,
    },
    /// A diffuse base under a coat ([`coated`](wavepath_kernels::shade::coated)).
    Coated {
        /// How coat and base go together.
        coat: Coat,
        /// Albedo of the base, each channel in [0, 1].
        reflectance: Parameter<Rgb>,
        /// Tint of what the coat reflects (v3 `Ks`), 1 in pbrt-v4.
        specular: Parameter<Rgb>,
        /// Index behind the coat's surface over the index before it.
        eta: Parameter<f32>,
        /// GGX alpha of the coat along u and v, remapping applied; `[0, 0]` is smooth.
        alpha: [Parameter<f32>; 2],
        /// Optical thickness, of a layered coat.
        thickness: f32,
        /// Longest walk between the interfaces of a layered coat (pbrt's `maxdepth` of the material), at least 1.
        max_depth: u32,
    },
    /// A conductor under a dielectric coat ([`coated_conductor`](wavepath_kernels::shade::coated_conductor)).
    CoatedConductor {
        /// Both; indices and absorption of the conductor are relative to the coat.
        layers: Layers,
    },
    /// One of two materials, at random.
    Mixture {
        /// Which: they come before this one in [`SceneDescription::materials`].
        materials: [MaterialId; 2],
        /// Share of the second, each channel in [0, 1].
        amount: Parameter<Rgb>,
    },
    /// pbrt-v3's `uber` and `translucent`: all at once ([`uber`](wavepath_kernels::shade::uber)).
    Uber {
        /// Diffuse share, `Kd`.
        diffuse: Parameter<Rgb>,
        /// Glossy share, `Ks`.
        glossy: Parameter<Rgb>,
        /// Share of the mirror reflection, `Kr`.
        mirrored: Parameter<Rgb>,
        /// Share of the refraction, `Kt`.
        refracted: Parameter<Rgb>,
        /// How much of the surface is there.
        opacity: Parameter<Rgb>,
        /// Share of the diffuse and glossy light that is reflected.
        reflect: Parameter<Rgb>,
        /// Share of the diffuse and glossy light that passes.
        transmit: Parameter<Rgb>,
        /// Index inside over index outside.
        eta: Parameter<f32>,
        /// GGX alpha along u and v, remapping applied.
        alpha: [Parameter<f32>; 2],
    },
}

/// How a spot light fades between its two cosines: x in \[0, 1\] is the way from the dark one to the bright.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fade {
    /// x^2 (3 - 2 x), as pbrt-v4 has it.
    #[default]
    Smoothstep,
    /// x^4, as pbrt-v3 has it.
    FourthPower,
}

/// A light without a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same radiance from all directions at infinity.
    Infinite {
        /// Radiance.
        radiance: Rgb,
    },
    /// Radiance from infinity by direction.
    EnvironmentMap {
        /// By what the colours of the picture are multiplied.
        radiance: Rgb,
        /// The picture.
        image: LightImage,
        /// How it covers the sphere.
        mapping: SkyMapping,
        /// Takes directions of the world to those of the picture; their length does not count.
        light_from_world: DMat3,
        /// Corner and two edges of an opening through which alone the sky is seen, by rays that go the way of the edges'
        /// vector product.
        portal: Option<[DVec3; 3]>,
    },
    /// Point light that shines through a picture.
    PicturePoint {
        /// By what the colours of the picture are multiplied: radiant intensity.
        intensity: Rgb,
        /// World position.
        position: DVec3,
        /// The picture.
        image: LightImage,
        /// How it is looked up: not on a surface.
        mapping: PictureMapping,
        /// Takes directions of the world to the light's space; their length does not count.
        light_from_world: DMat3,
        /// Half width and half height of a projection, at distance 1.
        half_size: [f64; 2],
    },
    /// Isotropic point light.
    Point {
        /// Radiant intensity (per steradian).
        intensity: Rgb,
        /// World position.
        position: DVec3,
    },
    /// Point light in a cone that fades between `cos_falloff_start` and `cos_total_width`.
    Spot {
        /// Radiant intensity on the axis.
        intensity: Rgb,
        /// World position.
        position: DVec3,
        /// Direction in which it shines, unit length, in the world or in the space of `light_from_world`.
        direction: DVec3,
        /// Cosine of the angle where the light begins to fade.
        cos_falloff_start: f64,
        /// Cosine of the angle where it is dark, at most `cos_falloff_start`.
        cos_total_width: f64,
        /// How it fades.
        fade: Fade,
        /// For a light under a transform that does not keep angles: takes directions of the world into the space in
        /// which `direction` and the angles are meant.
        light_from_world: Option<DMat3>,
    },
    /// Point light with the pattern of a batwing luminaire around its axis
    /// ([`goniometric`](wavepath_kernels::scene::lights::goniometric)).
    Goniometric {
        /// Largest radiant intensity.
        intensity: Rgb,
        /// World position.
        position: DVec3,
        /// World direction of the axis, away from the light, unit length.
        axis: DVec3,
    },
    /// Parallel light.
    Distant {
        /// Irradiance on a surface that faces it (pbrt's `L`).
        radiance: Rgb,
        /// World direction in which the light travels, unit length.
        direction: DVec3,
    },
}

impl Light {
    /// Its radiance, intensity or irradiance.
    pub fn colour(&self) -> Rgb {
        *{ *self }.colour_mut()
    }

    /// See [`Light::colour`].
    pub fn colour_mut(&mut self) -> &mut Rgb {
        match self {
            Light::Infinite { radiance }
            | Light::Distant { radiance, .. }
            | Light::EnvironmentMap { radiance, .. } => radiance,
            Light::Point { intensity, .. }
            | Light::PicturePoint { intensity, .. }
            | Light::Spot { intensity, .. }
            | Light::Goniometric { intensity, .. } => intensity,
        }
    }
}
