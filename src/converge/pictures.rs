//! The pictures of a report: for people as PNG, for the viewer as numbers.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use half::f16;

use crate::colour_map::heat;
use crate::compare::{SizeMismatch, compare, relative_error_map};
use crate::picture::{self, Image, to_srgb8};

/// A picture to show.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    /// What it is called; that of its variant or external picture.
    pub name: &'a str,
    /// What else there is to say of it, such as `8.0 s, 512 spp, seed 1`; may be empty.
    pub caption: &'a str,
    /// The picture: it shows the same part of the frame as all the others, and its size is theirs.
    pub image: &'a Image,
}

/// Why pictures cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// A picture does not show what the reference shows.
    #[error("cannot compare the picture of {name} with the reference: {mismatch}")]
    Size {
        /// Name of the picture.
        name: String,
        /// How they differ.
        mismatch: SizeMismatch,
    },
    /// The pictures do not all have the same size.
    #[error("the picture of {name} has {} x {} pixels, that of {first} {} x {}", found.0, found.1, expected.0, expected.1)]
    Unlike {
        /// Name of the picture.
        name: String,
        /// Its width and height.
        found: (u32, u32),
        /// Name of the first picture.
        first: String,
        /// The width and height of that.
        expected: (u32, u32),
    },
    /// A PNG could not be encoded.
    #[error("cannot encode a picture as PNG: {0}")]
    Png(String),
}

/// Most pixels of a PNG in the page; larger pictures are made smaller.
const STILL_PIXELS: u64 = 1 << 18;

/// Most pixels of all the pictures in the viewer together, at 8 bytes each in the page.
const VIEWER_PIXELS: u64 = 5 << 20;

/// Decades that the scale of an error map spans at most.
const MOST_DECADES: i32 = 8;

/// Reference and pictures, ready for the page.
pub struct Gallery {
    /// The reference first, then the pictures.
    pub entries: Vec<Entry>,
    /// Decimal logarithms of the ends of the scale of all error maps.
    pub scale: (i32, i32),
    /// Size of the pictures in the viewer.
    pub viewer_size: (u32, u32),
    /// Pixels of a picture that became one in the viewer, in each direction.
    pub viewer_factor: u32,
    /// The same for the PNGs.
    pub still_factor: u32,
}

/// One picture in the page.
pub struct Entry {
    pub name: String,
    pub caption: String,
    /// PNG at exposure 0, in base 64.
    pub still: String,
    /// PNG of its error map, in base 64; none for the reference.
    pub error_map: Option<String>,
    /// relMSE against the reference; none for the reference.
    pub relmse: Option<f64>,
    /// Rows from top to bottom, three 16-bit floating-point numbers for each pixel, little-endian, in base 64.
    pub halves: String,
}

impl Gallery {
    /// Encodes all the pictures; `None` if there are none.
    ///
    /// # Errors
    /// [`PictureError`]
    pub fn of(reference: &Image, pictures: &[Picture]) -> Result<Option<Self>, PictureError> {
        let Some(first) = pictures.first() else { return Ok(None) };
        let expected = (first.image.width, first.image.height);
        let mut maps = Vec::new();
        for picture in pictures {
            let (name, found) = (picture.name.to_string(), (picture.image.width, picture.image.height));
            if found != expected {
                return Err(PictureError::Unlike { name, found, first: first.name.into(), expected });
            }
            let mismatch = |mismatch| PictureError::Size { name, mismatch };
            let comparison = compare(picture.image, reference).map_err(mismatch.clone())?;
            let errors = relative_error_map(picture.image, reference).map_err(mismatch)?;
            maps.push((comparison.relmse, errors));
        }
        let scale = decades(maps.iter().flat_map(|map| &map.1).copied());
        let part = reference.crop(first.image.window, expected.0, expected.1);
        let same_size = (reference.width, reference.height) == expected;
        let reference = if same_size { reference } else { part.as_ref().unwrap_or(reference) };

        let pixels = u64::from(expected.0) * u64::from(expected.1);
        let still_factor = factor(pixels, STILL_PIXELS);
        let viewer_factor = factor(pixels * (pictures.len() as u64 + 1), VIEWER_PIXELS);
        let small = shrunk(reference, viewer_factor);
        let mut entries = vec![Entry {
            name: "reference".into(),
            caption: String::new(),
            still: png(&shrunk(reference, still_factor))?,
            error_map: None,
            relmse: None,
            halves: halves(&small),
        }];
        for (picture, (relmse, errors)) in pictures.iter().zip(maps) {
            let grey = Image::new(expected.0, expected.1, errors.iter().map(|&error| [error; 3]).collect());
            let mut map = shrunk(&grey, still_factor);
            map.pixels.iter_mut().for_each(|pixel| *pixel = error_colour(pixel[0], scale));
            entries.push(Entry {
                name: picture.name.into(),
                caption: picture.caption.into(),
                still: png(&shrunk(picture.image, still_factor))?,
                error_map: Some(png(&map)?),
                relmse: Some(relmse),
                halves: halves(&shrunk(picture.image, viewer_factor)),
            });
        }
        let viewer_size = (small.width, small.height);
        Ok(Some(Self { entries, scale, viewer_size, viewer_factor, still_factor }))
    }
}

/// The colours of the scale of error maps from its low to its high end, as 8-bit sRGB.
pub fn ramp(steps: u32) -> impl Iterator<Item = [u8; 3]> {
    (0..steps).map(move |step| to_srgb8(heat(step as f32 / (steps - 1) as f32)))
}

/// Equal steps for equal factors; NaN, an invalid pixel, stays NaN.
fn error_colour(error: f32, (low, high): (i32, i32)) -> [f32; 3] {
    if error.is_nan() {
        return [f32::NAN; 3];
    }
    heat((error.max(1e-30).log10() - low as f32) / (high - low) as f32)
}

/// Whole decades around most of the errors: the lowest 5 % may fall out, and the highest 0.5 %.
fn decades(errors: impl Iterator<Item = f32>) -> (i32, i32) {
    let mut logarithms: Vec<f32> = errors.map(f32::log10).filter(|value| value.is_finite()).collect();
    if logarithms.is_empty() {
        return (-4, 2);
    }
    let mut at = |share: f64| {
        let index = (share * (logarithms.len() - 1) as f64) as usize;
        *logarithms.select_nth_unstable_by(index, f32::total_cmp).1
    };
    let (low, high) = (at(0.05).floor() as i32, at(0.995).ceil() as i32);
    let high = high.max(low + 1);
    (low.max(high - MOST_DECADES), high)
}

/// The smallest whole number by which both sides have to be divided.
fn factor(pixels: u64, most: u64) -> u32 {
    (pixels as f64 / most as f64).sqrt().ceil().max(1.0) as u32
}

/// Means over blocks of `factor * factor` pixels, smaller ones at the right and lower border.
fn shrunk(image: &Image, factor: u32) -> Image {
    if factor <= 1 {
        return image.clone();
    }
    let (width, height) = (image.width.div_ceil(factor), image.height.div_ceil(factor));
    let block = |x: u32, y: u32| {
        let mut sum = [0.0_f64; 3];
        let columns = x * factor..((x + 1) * factor).min(image.width);
        let rows = y * factor..((y + 1) * factor).min(image.height);
        let count = (columns.len() * rows.len()) as f64;
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let pixel = image.pixel(column, row);
            (0..3).for_each(|channel| sum[channel] += f64::from(pixel[channel]));
        }
        sum.map(|sum| (sum / count) as f32)
    };
    let blocks = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Image::new(width, height, blocks.map(|(x, y)| block(x, y)).collect())
}

fn png(image: &Image) -> Result<String, PictureError> {
    Ok(STANDARD.encode(picture::png_bytes(image, 0.0).map_err(PictureError::Png)?))
}

/// See [`Entry::halves`]. What is finite stays finite: larger values than the format holds become its largest.
fn halves(image: &Image) -> String {
    let half = |value: f32| {
        let limit = f32::from(f16::MAX);
        f16::from_f32(if value.is_finite() { value.clamp(-limit, limit) } else { value })
    };
    let bytes: Vec<u8> = image.pixels.iter().flatten().flat_map(|value| half(*value).to_le_bytes()).collect();
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::DataWindow;

    fn picture<'a>(name: &'a str, image: &'a Image) -> Picture<'a> {
        Picture { name, caption: "", image }
    }

    #[test]
    fn halves_are_little_endian_and_stay_finite() {
        let image = Image::new(1, 1, vec![[1.0, 1e9, f32::NAN]]);
        let bytes = STANDARD.decode(halves(&image)).unwrap();
        assert_eq!(bytes[..4], [0x00, 0x3c, 0xff, 0x7b]);
        assert!(f16::from_le_bytes([bytes[4], bytes[5]]).is_nan());
    }

    #[test]
    fn shrinking_averages_whole_and_partial_blocks() {
        let image = Image::new(3, 2, [0.0, 1.0, 4.0, 2.0, 3.0, 6.0].map(|v| [v; 3]).to_vec());
        let small = shrunk(&image, 2);
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.pixels, [[1.5; 3], [5.0; 3]]);
        assert_eq!((factor(100, 100), factor(101, 100), factor(1 << 20, 1 << 18)), (1, 2, 2));
    }

    #[test]
    fn the_scale_holds_most_errors() {
        assert_eq!(decades([].into_iter()), (-4, 2));
        assert_eq!(decades([0.0, f32::NAN].into_iter()), (-4, 2));
        assert_eq!(decades((0..100).map(|_| 2e-3)), (-3, -2));
        let outliers = (0..1000).map(|i| if i == 0 { 1e9 } else { 10_f32.powf(-4.5 + 0.001 * i as f32) });
        assert_eq!(decades(outliers), (-5, -3));
        let (low, high) = decades([1e-30, 1e30].into_iter());
        assert!(high - low <= MOST_DECADES && high > low);
    }

    #[test]
    fn a_crop_is_shown_beside_its_part_of_the_reference() {
        let reference = Image::new(4, 4, (0..16).map(|i| [i as f32; 3]).collect());
        let window = DataWindow { x: 1, y: 2, ..reference.window };
        let image = reference.crop(window, 2, 2).unwrap();
        let gallery = Gallery::of(&reference, &[picture("a", &image)]).unwrap().unwrap();
        assert_eq!(gallery.entries[0].halves, gallery.entries[1].halves);
        assert_eq!((gallery.entries[1].relmse, gallery.viewer_size), (Some(0.0), (2, 2)));
        assert!(Gallery::of(&reference, &[]).unwrap().is_none());
    }

    #[test]
    fn pictures_of_other_sizes_are_refused_by_name() {
        let (reference, other) = (Image::new(2, 1, vec![[0.0; 3]; 2]), Image::new(1, 2, vec![[0.0; 3]; 2]));
        let message = |pictures: &[Picture]| Gallery::of(&reference, pictures).err().unwrap().to_string();
        let expected = "cannot compare the picture of a with the reference: \
            the image has 1 x 2 pixels, the reference 2 x 1";
        assert_eq!(message(&[picture("a", &other)]), expected);
        let expected = "the picture of b has 1 x 2 pixels, that of a 2 x 1";
        assert_eq!(message(&[picture("a", &reference), picture("b", &other)]), expected);
    }
}
