//! What a scene gives: textures, which may be made of others, and pictures.

use super::image::{Image, Wrap};
use super::mapping::{Affine, Mapping};
use crate::scene::BuildError;
use crate::shade::parameters::TextureId;
use std::sync::Arc;

/// Cells of two kinds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Checks {
    /// Unit squares of texture coordinates.
    Plane(Mapping),
    /// Unit cubes of the space into which this takes points of the world.
    Solid(Affine),
}

/// A texture that fills space, made of noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// The sum of octaves of noise.
    Fbm {
        /// How many.
        octaves: u32,
        /// How strong each is, over the one before.
        roughness: f32,
    },
    /// The sum of the magnitudes of octaves of noise.
    Wrinkled {
        /// How many.
        octaves: u32,
        /// How strong each is, over the one before.
        roughness: f32,
    },
    /// Waves whose strength varies.
    Windy,
    /// Coloured veins across y, bent by noise.
    Marble {
        /// How many octaves.
        octaves: u32,
        /// How strong each is, over the one before.
        roughness: f32,
        /// How fine the veins are.
        scale: f32,
        /// How much they are bent.
        variation: f32,
        /// From how many of the spline's segments a colour is taken, 1 to 6: the last one goes on. All in pbrt-v4, two in
        /// pbrt-v3.
        segments: u32,
    },
}

/// What a number becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Its square root: pbrt-v4's GGX alpha of a roughness.
    SquareRoot,
    /// pbrt-v3's GGX alpha of a roughness: a polynomial in its logarithm.
    AlphaV3,
    /// The absorption coefficient of the conductor of index 1 that reflects so much at normal incidence.
    AbsorptionOfReflectance,
    /// At most 1 and not negative.
    Unit,
}

/// A picture, looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Where.
    pub mapping: Mapping,
    /// Number of the picture.
    pub image: u32,
    /// What lies beyond its edges.
    pub wrap: Wrap,
    /// The nearest pixel, instead of a mixture of four.
    pub nearest: bool,
    /// One number for all channels: the mean of red, green and blue, or the opacity of a picture that has one.
    pub one_number: bool,
    /// What the value is multiplied by.
    pub scale: f32,
    /// 1 minus that, not below 0.
    pub invert: bool,
}

/// A texture: a colour at each point of a surface. Numbers are colours whose channels are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// The same everywhere.
    Constant([f32; 3]),
    /// A product.
    Product(TextureId, TextureId),
    /// A mixture.
    Mix {
        /// The first.
        first: TextureId,
        /// The second.
        second: TextureId,
        /// Share of the second.
        amount: TextureId,
    },
    /// A mixture by the direction of the normal.
    DirectionMix {
        /// The first, where the normal is along the direction.
        first: TextureId,
        /// The second, where it is across.
        second: TextureId,
        /// Unit vector of the world.
        direction: [f32; 3],
    },
    /// Two textures in turn.
    Checkerboard {
        /// The cells.
        checks: Checks,
        /// In cells whose numbers have an even sum.
        first: TextureId,
        /// In the others.
        second: TextureId,
    },
    /// Dots of one texture in another.
    Dots {
        /// Where.
        mapping: Mapping,
        /// The dots.
        inside: TextureId,
        /// Around them.
        outside: TextureId,
    },
    /// Bilinear between four colours, at (0, 0), (0, 1), (1, 0) and (1, 1).
    Bilerp {
        /// Where.
        mapping: Mapping,
        /// The colours.
        corners: [[f32; 3]; 4],
    },
    /// The fractions of the coordinates as red and green.
    Uv {
        /// Which coordinates.
        mapping: Mapping,
    },
    /// A picture.
    Image(Sampled),
    /// Noise.
    Solid {
        /// Which.
        solid: Solid,
        /// Takes points of the world into the space of the texture.
        texture_from_world: Affine,
    },
    /// A function of another, channel by channel.
    Apply(Function, TextureId),
}

impl Texture {
    /// The textures of which it is made.
    pub fn inputs(&self) -> impl Iterator<Item = TextureId> + use<> {
        let (a, b, c) = match *self {
            Texture::Product(a, b) => (Some(a), Some(b), None),
            Texture::Mix { first, second, amount } => (Some(first), Some(second), Some(amount)),
            Texture::DirectionMix { first, second, .. } | Texture::Checkerboard { first, second, .. } => {
                (Some(first), Some(second), None)
            }
            Texture::Dots { inside, outside, .. } => (Some(inside), Some(outside), None),
            Texture::Apply(_, a) => (Some(a), None, None),
            Texture::Constant(_)
            | Texture::Bilerp { .. }
            | Texture::Uv { .. }
            | Texture::Image(_)
            | Texture::Solid { .. } => (None, None, None),
        };
        [a, b, c].into_iter().flatten()
    }

    /// Its numbers, to be checked.
    fn numbers(&self) -> Vec<f32> {
        match self {
            Texture::Constant(value) => value.to_vec(),
            Texture::DirectionMix { direction, .. } => direction.to_vec(),
            Texture::Checkerboard { checks: Checks::Plane(mapping), .. }
            | Texture::Dots { mapping, .. }
            | Texture::Uv { mapping } => mapping.numbers(),
            Texture::Checkerboard { checks: Checks::Solid(m), .. } => m.as_flattened().to_vec(),
            Texture::Bilerp { mapping, corners } => {
                [mapping.numbers(), corners.as_flattened().to_vec()].concat()
            }
            Texture::Image(sampled) => [sampled.mapping.numbers(), vec![sampled.scale]].concat(),
            Texture::Solid { solid, texture_from_world } => {
                let own = match *solid {
                    Solid::Fbm { roughness, .. } | Solid::Wrinkled { roughness, .. } => vec![roughness],
                    Solid::Windy => Vec::new(),
                    Solid::Marble { roughness, scale, variation, .. } => vec![roughness, scale, variation],
                };
                [texture_from_world.as_flattened(), &own].concat()
            }
            Texture::Product(..) | Texture::Mix { .. } | Texture::Apply(..) => Vec::new(),
        }
    }
}

/// All textures and pictures of a scene. What a texture refers to exists; there are no circles.
#[derive(Clone, Debug, Default)]
pub struct TextureTable {
    textures: Vec<Texture>,
    images: Vec<Arc<Image>>,
}

/// Most octaves of noise: from there on single precision sees only whole numbers, where noise is 0.
pub const MAX_OCTAVES: u32 = 64;

impl TextureTable {
    /// Checks the textures. A texture may be made of those before it.
    ///
    /// # Errors
    /// [`BuildError`] names the first thing that is wrong.
    pub fn new(textures: Vec<Texture>, images: Vec<Arc<Image>>) -> Result<Self, BuildError> {
        for (id, texture) in textures.iter().enumerate() {
            for TextureId(input) in texture.inputs() {
                crate::scene::exists("texture", id, "texture (of those before it)", input as usize, id)?;
            }
            crate::scene::finite("texture", id, "a number", &texture.numbers())?;
            let wrong = |what: String| Err(BuildError::Number { of: "texture", id, what });
            match *texture {
                Texture::Image(Sampled { image, .. }) => {
                    crate::scene::exists("texture", id, "picture", image as usize, images.len())?;
                }
                Texture::Solid { solid, .. } => match solid {
                    Solid::Fbm { octaves, .. }
                    | Solid::Wrinkled { octaves, .. }
                    | Solid::Marble { octaves, .. }
                        if octaves > MAX_OCTAVES =>
                    {
                        return wrong(format!("it has {octaves} octaves; expected at most {MAX_OCTAVES}"));
                    }
                    Solid::Marble { segments, .. } if !(1..=6).contains(&segments) => {
                        return wrong(format!("it has {segments} segments; expected 1 to 6"));
                    }
                    _ => {}
                },
                _ => {}
            }
        }
        Ok(TextureTable { textures, images })
    }

    /// The textures.
    #[inline(always)]
    pub fn textures(&self) -> &[Texture] {
        &self.textures
    }
    /// The pictures.
    #[inline(always)]
    pub fn images(&self) -> &[Arc<Image>] {
        &self.images
    }
    /// Bytes on the heap; pictures count where they are.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.textures[..]) + self.images.iter().map(|image| image.bytes()).sum::<usize>()
    }
}
