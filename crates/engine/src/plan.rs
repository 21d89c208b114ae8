//! The plan: what a scene needs, decided once. Engines are instantiated from it, so that what a scene lacks costs
//! nothing: no stage, no kernel, no queue column, no branch.

use crate::film::Film;
use serde::Serialize;
use std::fmt;
use wavepath_kernels::channels::{Channel, ChannelSet, ChannelTable};
use wavepath_kernels::queue::{Requirements, bytes_per_path, columns};
use wavepath_kernels::scene::lights::kind;
use wavepath_kernels::scene::{MaterialClass, MaterialHandle, PrimitiveTag, Scene, SceneId};

/// A stage or kernel that runs or is left out, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    /// Name of the stage, or of the kernel of the shade stage.
    pub name: String,
    /// Does it run?
    pub runs: bool,
    /// Why, or why not.
    pub why: String,
}

/// A queue column that is there or left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PlannedColumn {
    /// Queue and column.
    pub name: String,
    /// Bytes a path.
    pub bytes: usize,
    /// Is it allocated?
    pub present: bool,
    /// What it holds.
    pub holds: &'static str,
}

/// How many primitives of each kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Primitives {
    /// Triangles.
    pub triangles: usize,
    /// Those of them with vertex normals.
    pub smooth_triangles: usize,
    /// Spheres.
    pub spheres: usize,
    /// Disks, and clipped or stretched spheres.
    pub quadrics: usize,
}

/// What a scene needs.
#[derive(Clone, Debug)]
pub struct Plan {
    scene: SceneId,
    requirements: Requirements,
    shade_kernels: Vec<MaterialClass>,
    has_environment: bool,
    environment_maps: usize,
    light_kinds: u32,
    /// Lights, by what they are.
    pub lights: Vec<(&'static str, usize)>,
    /// Primitives.
    pub primitives: Primitives,
    /// Stages and kernels.
    pub parts: Vec<Part>,
    /// Queue columns.
    pub columns: Vec<PlannedColumn>,
    /// Bytes of all queues together, a path.
    pub bytes_per_path: usize,
    /// Bytes of the queue of shadow rays, a worker.
    pub shadow_queue_bytes: usize,
    /// Bytes of geometry, without a tree.
    pub geometry_bytes: usize,
    /// Bytes of the film, a pixel and replicate.
    pub film_bytes_per_pixel: u64,
}

const NOT_ASKED_FOR: &str = "not asked for";

/// The columns of all channels: their channel, name, and what they hold.
fn all_channel_columns() -> impl Iterator<Item = (Channel, String, &'static str)> {
    Channel::FIRST_HIT.iter().flat_map(|&channel| {
        let columns = ChannelTable::columns(ChannelSet::default().with(channel));
        columns.map(move |(name, holds)| (channel, name, holds))
    })
}

/// The name of the kernel that fills a channel.
fn part_name(channel: Channel) -> String {
    format!("channel: {}", channel.row().name)
}

impl Plan {
    /// The scene that it is the plan of.
    pub fn scene(&self) -> SceneId {
        self.scene
    }
    /// Features of queues.
    pub fn requirements(&self) -> Requirements {
        self.requirements
    }
    /// Shade kernels that run, in order.
    pub fn shade_kernels(&self) -> &[MaterialClass] {
        &self.shade_kernels
    }
    /// Is there light from the sky?
    pub fn has_environment(&self) -> bool {
        self.has_environment
    }
    /// Are there pictures of the sky?
    pub fn has_environment_maps(&self) -> bool {
        self.environment_maps > 0
    }
    /// Kinds of lights to sample ([`kind`]).
    pub fn light_kinds(&self) -> u32 {
        self.light_kinds
    }

    /// Makes the plan of a scene.
    pub fn new(scene: &Scene) -> Plan {
        let geometry = scene.geometry();
        let mut of_class = [0usize; MaterialClass::COUNT];
        for &tag in geometry.tags() {
            let tag = PrimitiveTag(tag);
            of_class[tag.class() as usize] += 1;
            if tag.class() == MaterialClass::Mixture as u32 {
                let id = tag.0 & PrimitiveTag::ID_MASK;
                let row = if tag.emits() { scene.lights().material_of(id as usize) } else { id };
                let material = MaterialHandle { class: MaterialClass::Mixture, row };
                for class in scene.materials().classes(material) {
                    of_class[class as usize] += 1;
                }
            }
        }
        let used = |class: MaterialClass| of_class[class as usize] > 0;
        let scatters = scene.max_depth() > 0;
        let shade_kernels: Vec<_> =
            MaterialClass::scattering().filter(|&class| used(class) && scatters).collect();
        let lit = shade_kernels.iter().any(|c| c.samples_lights());
        let light_kinds = if lit { scene.lights().sampled_kinds() } else { 0 };
        let requirements = Requirements {
            transmission: shade_kernels.iter().any(|c| c.scales_radiance()),
            smooth_normals: geometry.smooth_triangles() > 0,
            cutouts: !geometry.opacities().is_empty(),
            textures: shade_kernels.iter().any(|&class| scene.programs().has_class(class))
                || used(MaterialClass::Mixture) && scene.programs().has_class(MaterialClass::Mixture),
            light_sampling: light_kinds != 0,
            filter_weights: scene.camera().filter().has_negative_lobes(),
            mixtures: used(MaterialClass::Mixture),
            instances: false,
            channels: ChannelSet::default(),
        };
        let primitives = Primitives {
            triangles: geometry.triangles().len(),
            smooth_triangles: geometry.smooth_triangles(),
            spheres: geometry.spheres().len(),
            quadrics: geometry.quadrics().len(),
        };
        let has_environment = scene.environment() != [0.0; 3];
        let (path_bytes, shadow_queue_bytes) = bytes_per_path(requirements);
        let mut plan = Plan {
            scene: scene.id(),
            requirements,
            shade_kernels,
            has_environment,
            environment_maps: scene.lights().maps().len(),
            light_kinds,
            lights: scene.lights().census().into_iter().map(|(kind, n)| (kind.name(), n)).collect(),
            primitives,
            parts: Vec::new(),
            columns: columns()
                .map(|c| PlannedColumn {
                    name: format!("{}.{}", c.queue, c.name),
                    bytes: c.bytes,
                    present: requirements.have(c.needs),
                    holds: c.holds,
                })
                .chain([PlannedColumn {
                    name: "row (some).parameters".into(),
                    bytes: size_of::<f32>() * scene.programs().widest(),
                    present: requirements.textures,
                    holds: "parameters of a textured material at the point",
                }])
                .chain([PlannedColumn {
                    name: "row (some).normal".into(),
                    bytes: 3 * size_of::<f32>(),
                    present: requirements.textures && scene.programs().have_reliefs(),
                    holds: "shading normal, where textures turn some",
                }])
                .chain(all_channel_columns().map(|(_, name, holds)| PlannedColumn {
                    name,
                    bytes: size_of::<f32>(),
                    present: false,
                    holds,
                }))
                .collect(),
            bytes_per_path: path_bytes,
            shadow_queue_bytes,
            geometry_bytes: geometry.bytes(),
            film_bytes_per_pixel: Film::bytes(1, 1, 1, requirements),
        };
        plan.parts = plan.list_parts(scene, &of_class, lit);
        plan
    }

    /// The same with what the film shall hold beside radiance.
    pub fn with_channels(mut self, channels: ChannelSet) -> Plan {
        self.requirements.channels = channels;
        (self.bytes_per_path, self.shadow_queue_bytes) = bytes_per_path(self.requirements);
        self.film_bytes_per_pixel = Film::bytes(1, 1, 1, self.requirements);
        for column in &mut self.columns {
            if let Some(channel) = all_channel_columns().find(|(_, name, _)| *name == column.name) {
                column.present = channels.has(channel.0);
            }
        }
        for part in &mut self.parts {
            if let Some(channel) = Channel::FIRST_HIT.iter().find(|channel| part.name == part_name(**channel))
            {
                part.runs = channels.has(*channel);
                part.why = if part.runs { channel.row().holds } else { NOT_ASKED_FOR }.into();
            }
        }
        self
    }

    /// A plan for the scene with everything switched on that can be: what leaving out saves is the difference.
    pub fn everything(scene: &Scene) -> Plan {
        let mut plan = Plan::new(scene);
        // Without a light there is nothing to choose from.
        let lit = scene.lights().sampled_kinds() != 0;
        plan.requirements = Requirements {
            transmission: true,
            smooth_normals: true,
            textures: plan.requirements.textures,
            cutouts: plan.requirements.cutouts,
            light_sampling: lit,
            filter_weights: true,
            mixtures: plan.requirements.mixtures,
            instances: false,
            channels: ChannelSet::default(),
        };
        plan.light_kinds = if lit { kind::ALL } else { 0 };
        plan.shade_kernels = MaterialClass::scattering().collect();
        plan.has_environment = true;
        (plan.bytes_per_path, plan.shadow_queue_bytes) = bytes_per_path(plan.requirements);
        plan
    }

    fn list_parts(&self, scene: &Scene, of_class: &[usize], lit: bool) -> Vec<Part> {
        let part = |name: &str, runs: bool, why: String| Part { name: name.to_string(), runs, why };
        let p = self.primitives;
        let counted = |n: usize, what: &str| match n {
            0 => format!("no {what}"),
            n => format!("{n} {what}"),
        };
        let camera = scene.camera();
        let mut parts = vec![
            part("generate", true, "camera rays".into()),
            part(
                "generate: lens",
                camera.lens().is_some(),
                (if camera.lens().is_some() { "the lens has a radius" } else { "pinhole camera" }).into(),
            ),
            part(
                "generate: filter weights",
                self.requirements.filter_weights,
                (if self.requirements.filter_weights {
                    "the filter has negative lobes"
                } else {
                    "the filter is nowhere negative"
                })
                .into(),
            ),
            part("intersect: triangles", p.triangles > 0, counted(p.triangles, "triangles")),
            part("intersect: spheres", p.spheres > 0, counted(p.spheres, "spheres")),
            part(
                "intersect: quadrics",
                p.quadrics > 0,
                counted(p.quadrics, "disks, clipped or stretched spheres"),
            ),
            part(
                "cutout",
                self.requirements.cutouts,
                (if self.requirements.cutouts { "shapes with an opacity" } else { "everything is there" })
                    .into(),
            ),
            part(
                "mixture",
                self.requirements.mixtures,
                counted(of_class[MaterialClass::Mixture as usize], "primitives with a mixture of materials"),
            ),
            part("material_sort", true, format!("{} lists", self.shade_kernels.len() + 2)),
            part("texture", self.requirements.textures, {
                let textured = scene.materials().textured().filter(|(_, columns)| !columns.is_empty());
                let materials = textured.count().max(scene.materials().reliefs().len());
                match (materials, scene.textures().images().len()) {
                    (0, _) => "no textured materials".into(),
                    (n, pictures) => format!("{n} textured materials, {}", counted(pictures, "pictures")),
                }
            }),
        ];
        for class in MaterialClass::scattering() {
            let n = of_class[class as usize];
            let runs = self.shade_kernels.contains(&class);
            let why = if n > 0 && !runs { "maxdepth is 0".into() } else { counted(n, "primitives") };
            parts.push(part(&format!("shade: {}", class.name()), runs, why));
        }
        let emitting = scene.geometry().tags().iter().filter(|&&t| PrimitiveTag(t).emits()).count();
        parts.push(part("shade: emission", emitting > 0, counted(emitting, "emitting primitives")));
        parts.push(part(
            "shade: environment",
            self.has_environment,
            (if self.has_environment { "the sky shines" } else { "the sky is black" }).into(),
        ));
        let maps = self.environment_maps;
        parts.push(part("shade: environment maps", maps > 0, counted(maps, "environment maps")));
        parts.push(part(
            "light_sample",
            self.light_kinds != 0,
            match (lit, scene.lights().sampled_kinds()) {
                (_, 0) => "no lights to sample".into(),
                (false, _) => "no material that light sampling serves".into(),
                (true, _) => format!("{} lights", scene.lights().len()),
            },
        ));
        parts.push(part("roulette_compact", true, "Russian roulette".into()));
        for &channel in Channel::FIRST_HIT {
            parts.push(part(&part_name(channel), false, NOT_ASKED_FOR.into()));
        }
        parts
    }

    /// The plan as JSON.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::json!({
            "primitives": self.primitives,
            "lights": self.lights.iter().map(|(name, n)| (name.to_string(), n)).collect::<std::collections::BTreeMap<_, _>>(),
            "stages": self.parts,
            "columns": self.columns,
            "bytes_per_path": self.bytes_per_path,
            "shadow_queue_bytes": self.shadow_queue_bytes,
            "geometry_bytes": self.geometry_bytes,
            "film_bytes_per_pixel_and_replicate": self.film_bytes_per_pixel,
        })
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let p = self.primitives;
        writeln!(
            f,
            "primitives      {} triangles ({} with vertex normals), {} spheres, {} quadrics: {} bytes",
            p.triangles, p.smooth_triangles, p.spheres, p.quadrics, self.geometry_bytes
        )?;
        let lights: Vec<_> = self.lights.iter().map(|(name, n)| format!("{n} {name}")).collect();
        writeln!(f, "lights          {}", if lights.is_empty() { "none".into() } else { lights.join(", ") })?;
        writeln!(f, "\nstages")?;
        for part in &self.parts {
            let mark = if part.runs { "runs    " } else { "left out" };
            writeln!(f, "  {mark}  {:<28}{}", part.name, part.why)?;
        }
        writeln!(
            f,
            "\nqueue columns ({} bytes a path, and {} for the shadow rays of a worker)",
            self.bytes_per_path, self.shadow_queue_bytes
        )?;
        for column in &self.columns {
            let mark = if column.present { "there   " } else { "left out" };
            writeln!(f, "  {mark}  {:<28}{:>2} bytes  {}", column.name, column.bytes, column.holds)?;
        }
        write!(f, "\nfilm            {} bytes a pixel and replicate", self.film_bytes_per_pixel)
    }
}
