//! `wavepath compare`: error measures of an image against a reference.

use std::io;
use std::path::Path;

use super::args::CompareArgs;
use super::{Failure, output};
use crate::colour_map::heat;
use crate::compare::{compare, relative_error_map};
use crate::picture::{self, Image, ImageFormat};

/// Reads both images, prints the measures and writes the map if one is asked for.
pub(super) fn run(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(path) = &args.map {
        output::check_image(path)?;
    }
    let image = picture::read(&args.image)?;
    let reference = picture::read(&args.reference)?;
    let comparison = compare(&image, &reference).map_err(|mismatch| {
        let (image, reference) = (args.image.display(), args.reference.display());
        Failure::Input(format!("cannot compare \"{image}\" with \"{reference}\": {mismatch}"))
    })?;
    if let Some(path) = &args.map {
        write_map(path, &image, &relative_error_map(&image, &reference)?)?;
    }
    let text = if args.json {
        serde_json::to_string(&comparison).map_err(io::Error::from)?
    } else {
        comparison.to_string()
    };
    output::say(text)
}

/// Writes the errors as grey values to an EXR file, as colours to a PNG file.
fn write_map(path: &Path, image: &Image, errors: &[f32]) -> Result<(), Failure> {
    let pixel: fn(f32) -> [f32; 3] = match ImageFormat::from_path(path)? {
        ImageFormat::Exr => |error| [error; 3],
        ImageFormat::Png => error_colour,
    };
    let pixels = errors.iter().map(|&error| pixel(error)).collect();
    let map = Image { window: image.window, ..Image::new(image.width, image.height, pixels) };
    Ok(picture::write(path, &map, 0.0)?)
}

/// The colour of a relative squared error: black below 1e-4, through purple and orange to pale
/// yellow from 1e2 on, equal steps for equal factors. NaN, an invalid pixel, stays NaN.
fn error_colour(error: f32) -> [f32; 3] {
    if error.is_nan() {
        return [f32::NAN; 3];
    }
    heat((error.max(1e-30).log10() + 4.0) / 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_errors_are_brighter() {
        let brightness = |error: f32| error_colour(error).iter().sum::<f32>();
        let errors = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0];
        assert!(errors.windows(2).all(|pair| brightness(pair[0]) < brightness(pair[1])));
        assert_eq!(error_colour(1e-9), error_colour(0.0));
        assert_eq!(error_colour(f32::INFINITY), error_colour(1e2));
        assert!(error_colour(f32::NAN)[0].is_nan());
    }
}
