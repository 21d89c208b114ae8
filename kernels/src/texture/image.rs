//! Pictures as textures: kept as they came, decoded where they are looked up.

use super::mapping::floor;
use crate::lanes::{Real, Uint};
use crate::math::Rgb;
use crate::scene::BuildError;
use core::fmt;

/// What the numbers of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    /// Proportional to light; whole numbers over the largest.
    Linear,
    /// The curve of sRGB (IEC 61966-2-1).
    Srgb,
    /// The number to this power.
    Gamma(f32),
}

impl Encoding {
    /// The linear value of a number from 0 to 1.
    fn decode(self, x: f64) -> f64 {
        match self {
            Encoding::Linear => x,
            Encoding::Srgb if x <= 0.04045 => x / 12.92,
            Encoding::Srgb => ((x + 0.055) / 1.055).powf(2.4),
            Encoding::Gamma(power) => x.powf(power as f64),
        }
    }
}

/// The numbers of a picture, channels of a pixel next to each other, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Bytes, encoded.
    U8(Vec<u8>, Encoding),
    /// 16-bit whole numbers, encoded.
    U16(Vec<u16>, Encoding),
    /// Bits of half-precision numbers, linear.
    F16(Vec<u16>),
    /// Single precision, linear.
    F32(Vec<f32>),
}

impl Texels {
    fn len(&self) -> usize {
        match self {
            Texels::U8(x, _) => x.len(),
            Texels::U16(x, _) | Texels::F16(x) => x.len(),
            Texels::F32(x) => x.len(),
        }
    }
}

/// What an [`Image`] is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageParts {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Numbers a pixel: 1 (grey), 3 (red, green, blue) or 4 (and opacity).
    pub channels: u32,
    /// The numbers.
    pub texels: Texels,
}

/// A picture. Its tables fit together.
#[derive(Clone)]
pub struct Image {
    parts: ImageParts,
    /// Values of whole numbers.
    decoded: Vec<f32>,
}

/// Its sizes: the numbers are too many to be read.
impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ImageParts { width, height, channels, .. } = &self.parts;
        write!(f, "Image {{ width: {width}, height: {height}, channels: {channels} }}")
    }
}

impl Image {
    /// Most numbers of a picture.
    pub const MAX_NUMBERS: usize = 1 << 31;

    /// Checks the parts.
    ///
    /// # Errors
    /// If there are no pixels, not as many numbers as there should be, or some that are not finite.
    pub fn new(parts: ImageParts) -> Result<Self, BuildError> {
        let ImageParts { width, height, channels, texels } = &parts;
        let wrong = |what: String| Err(BuildError::Number { of: "picture", id: 0, what });
        if *width == 0 || *height == 0 {
            return wrong(format!("it has {width} x {height} pixels; expected some"));
        }
        if ![1, 3, 4].contains(channels) {
            return wrong(format!("it has {channels} channels; expected 1, 3 or 4"));
        }
        let expected = (*width as usize).saturating_mul(*height as usize).saturating_mul(*channels as usize);
        if expected > Self::MAX_NUMBERS {
            let (what, limit) = ("numbers of a picture", Self::MAX_NUMBERS);
            return Err(BuildError::TooMany { what, found: expected, limit });
        }
        if texels.len() != expected {
            return Err(BuildError::Length { of: "numbers of a picture", found: texels.len(), expected });
        }
        let finite = match texels {
            Texels::F32(x) => x.iter().all(|x| x.is_finite()),
            Texels::F16(x) => x.iter().all(|bits| bits & 0x7c00 != 0x7c00),
            _ => true,
        };
        if !finite {
            return wrong("a number is not finite".into());
        }
        let table = |encoding: Encoding, most: u32| -> Vec<f32> {
            (0..=most).map(|x| encoding.decode(x as f64 / most as f64) as f32).collect()
        };
        let decoded = match texels {
            Texels::U8(_, encoding) => table(*encoding, 255),
            Texels::U16(_, encoding) => table(*encoding, 65535),
            _ => Vec::new(),
        };
        Ok(Image { parts, decoded })
    }

    /// Its parts.
    pub fn parts(&self) -> &ImageParts {
        &self.parts
    }

    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        let texels = match &self.parts.texels {
            Texels::U8(x, _) => size_of_val(&x[..]),
            Texels::U16(x, _) | Texels::F16(x) => size_of_val(&x[..]),
            Texels::F32(x) => size_of_val(&x[..]),
        };
        texels + size_of_val(&self.decoded[..])
    }

    /// Linear values of channel `channel` of some pixels. Numbers of pixels beyond the last count as the last.
    #[inline(always)]
    fn channel<F: Real>(&self, pixel: F::Uint, channel: u32) -> F {
        let channels = self.parts.channels;
        let first = pixel.to_array();
        let mut out = [0.0; 16];
        macro_rules! read {
            ($texels:expr, |$x:ident| $value:expr) => {{
                let last = $texels.len() - 1;
                for i in 0..F::LANES {
                    let $x = $texels[((first[i] * channels + channel) as usize).min(last)];
                    out[i] = $value;
                }
            }};
        }
        match &self.parts.texels {
            Texels::U8(texels, _) => read!(texels, |x| self.decoded[x as usize]),
            Texels::U16(texels, _) => read!(texels, |x| self.decoded[x as usize]),
            Texels::F16(texels) => read!(texels, |x| half_to_single(x)),
            Texels::F32(texels) => read!(texels, |x| x),
        }
        F::load(&out, 0)
    }
}

/// The value of a finite half-precision number: its exponent and mantissa stand where those of a single-precision number
/// 2^112 times as small would.
#[inline(always)]
fn half_to_single(bits: u16) -> f32 {
    let magnitude = f32::from_bits(((bits & 0x7fff) as u32) << 13) * f32::from_bits(0x7780_0000);
    f32::from_bits(magnitude.to_bits() | ((bits & 0x8000) as u32) << 16)
}

/// What lies beyond the edges of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The picture again.
    Repeat,
    /// Black.
    Black,
    /// The pixels of the edge.
    Clamp,
    /// The square is an octahedral map of the sphere: its continuation over the edges.
    OctahedralSphere,
}

/// How a picture is looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lookup {
    pub wrap: Wrap,
    /// The nearest pixel, instead of a mixture of four.
    pub nearest: bool,
    /// One number: the mean of three channels, or the fourth of four.
    pub one_number: bool,
}

/// Whole pixel coordinates, brought into the picture; and where there is one.
#[inline(always)]
fn wrapped<F: Real>(image: &Image, wrap: Wrap, x: F, y: F) -> (F::Uint, F::Mask) {
    let (width, height) = (F::lit(image.parts.width as f64), F::lit(image.parts.height as f64));
    let (zero, one) = (F::zero(), F::one());
    let (right, bottom) = (width - one, height - one);
    let mut inside = zero.eq(zero);
    let (mut x, mut y) = (x, y);
    match wrap {
        Wrap::Repeat => {
            x = floor(x / width).neg_mul_add(width, x);
            y = floor(y / height).neg_mul_add(height, y);
        }
        Wrap::Black => inside = x.ge(zero) & x.le(right) & y.ge(zero) & y.le(bottom),
        Wrap::Clamp => {}
        Wrap::OctahedralSphere => {
            let (left, past) = (x.lt(zero), x.gt(right));
            y = F::select(left | past, bottom - y, y);
            x = F::select(left, -one - x, F::select(past, width + right - x, x));
            let (above, below) = (y.lt(zero), y.gt(bottom));
            x = F::select(above | below, right - x, x);
            y = F::select(above, -one - y, F::select(below, height + bottom - y, y));
        }
    }
    // In any case within the picture: what is computed may be off by rounding, or no number.
    let (x, y) = (x.max(zero).min(right).to_uint(), y.max(zero).min(bottom).to_uint());
    (y * F::Uint::splat(image.parts.width) + x, inside)
}

/// The linear colour of a pixel.
#[inline(always)]
fn pixel<F: Real>(image: &Image, lookup: Lookup, x: F, y: F) -> Rgb<F> {
    let (place, inside) = wrapped(image, lookup.wrap, x, y);
    let channels = image.parts.channels;
    let colour = if channels == 1 {
        Rgb::all(image.channel(place, 0))
    } else if lookup.one_number && channels == 4 {
        Rgb::all(image.channel(place, 3))
    } else {
        let colour = Rgb::new(image.channel(place, 0), image.channel(place, 1), image.channel(place, 2));
        if lookup.one_number { Rgb::all(colour.sum() * F::lit(1.0 / 3.0)) } else { colour }
    };
    Rgb::select(inside, colour, Rgb::zero())
}

/// The picture at (s, t): (0, 0) is its lower left corner, (1, 1) the upper right.
#[inline(always)]
pub(super) fn sample<F: Real>(image: &Image, lookup: Lookup, [s, t]: [F; 2]) -> Rgb<F> {
    let (width, height) = (image.parts.width as f64, image.parts.height as f64);
    let limit = F::lit(8_388_608.0);
    let half = F::lit(0.5);
    // Coordinates that are no number end at one of the limits.
    let x = s.mul_sub(F::lit(width), half).max(-limit).min(limit);
    let y = (F::one() - t).mul_sub(F::lit(height), half).max(-limit).min(limit);
    if lookup.nearest {
        return pixel(image, lookup, floor(x + half), floor(y + half));
    }
    let (x0, y0) = (floor(x), floor(y));
    let (dx, dy) = (x - x0, y - y0);
    let (ex, ey) = (F::one() - dx, F::one() - dy);
    let mut sum = Rgb::zero();
    for corner in 0..4 {
        let (x, wx) = if corner & 1 == 0 { (x0, ex) } else { (x0 + F::one(), dx) };
        let (y, wy) = if corner & 2 == 0 { (y0, ey) } else { (y0 + F::one(), dy) };
        let colour = pixel(image, lookup, x, y);
        let weight = wx * wy;
        sum = Rgb::new(
            colour.r.mul_add(weight, sum.r),
            colour.g.mul_add(weight, sum.g),
            colour.b.mul_add(weight, sum.b),
        );
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOKUP: Lookup = Lookup { wrap: Wrap::Repeat, nearest: false, one_number: false };

    fn grey(width: u32, numbers: Vec<f32>) -> Image {
        let height = numbers.len() as u32 / width;
        Image::new(ImageParts { width, height, channels: 1, texels: Texels::F32(numbers) })
            .expect("a picture")
    }

    #[test]
    fn pixels_are_met_at_their_centres_and_mixed_between() {
        // Upper row 1 2, lower row 3 4.
        let image = grey(2, vec![1.0, 2.0, 3.0, 4.0]);
        let at = |s: f32, t: f32, wrap: Wrap| sample(&image, Lookup { wrap, ..LOOKUP }, [s, t]).r;
        assert_eq!(at(0.25, 0.25, Wrap::Repeat), 3.0);
        assert_eq!(at(0.75, 0.75, Wrap::Repeat), 2.0);
        assert_eq!(at(0.5, 0.5, Wrap::Repeat), 2.5);
        assert_eq!(at(0.0, 0.25, Wrap::Repeat), 3.5);
        assert_eq!(at(0.0, 0.25, Wrap::Clamp), 3.0);
        assert_eq!(at(0.0, 0.25, Wrap::Black), 1.5);
        assert_eq!(at(-6.75, 0.25, Wrap::Repeat), 3.0);
        assert_eq!(at(-9.0, 7.0, Wrap::Black), 0.0);
        // Over the left edge of an octahedral map: the same column, upside down.
        assert_eq!(at(-0.25, 0.25, Wrap::OctahedralSphere), 1.0);
        assert!(at(f32::NAN, f32::INFINITY, Wrap::Repeat).is_finite());
        let nearest = Lookup { nearest: true, ..LOOKUP };
        assert_eq!(sample(&image, nearest, [0.49f32, 0.51]).r, 1.0);
    }

    #[test]
    fn numbers_are_decoded() {
        for (x, want) in [(0u16, 0.0), (0x3c00, 1.0), (0xc000, -2.0), (1, 2f32.powi(-24)), (0x7bff, 65504.0)]
        {
            assert_eq!(half_to_single(x), want);
        }
        let parts = |texels, channels| ImageParts { width: 1, height: 1, channels, texels };
        let bytes = |encoding| {
            let image = Image::new(parts(Texels::U8(vec![188, 255, 0, 51], encoding), 4)).expect("a picture");
            let at = |lookup| sample(&image, lookup, [0.5f32, 0.5]).lane(0);
            (at(LOOKUP), at(Lookup { one_number: true, ..LOOKUP }))
        };
        let (colour, opacity) = bytes(Encoding::Srgb);
        assert!((colour[0] - 0.502_886).abs() < 1e-5 && colour[1] == 1.0 && colour[2] == 0.0, "{colour:?}");
        assert!((opacity[0] - 0.033_104_8).abs() < 1e-6, "{opacity:?}");
        assert!((bytes(Encoding::Gamma(2.0)).1[0] - 0.04).abs() < 1e-6);
        let image =
            Image::new(parts(Texels::U16(vec![65535, 0, 0], Encoding::Linear), 3)).expect("a picture");
        let mean = sample(&image, Lookup { one_number: true, ..LOOKUP }, [0.5f32, 0.5]).r;
        assert!((mean - 1.0 / 3.0).abs() < 1e-6);
        for bad in [
            parts(Texels::F32(vec![f32::NAN]), 1),
            parts(Texels::F16(vec![0x7c00]), 1),
            parts(Texels::F32(vec![0.0; 2]), 2),
            parts(Texels::F32(vec![0.0; 2]), 1),
            ImageParts { width: 0, ..parts(Texels::F32(Vec::new()), 1) },
            ImageParts { width: u32::MAX, height: u32::MAX, ..parts(Texels::F32(Vec::new()), 1) },
        ] {
            assert!(Image::new(bad).is_err());
        }
    }
}
