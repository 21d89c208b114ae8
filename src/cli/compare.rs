//! `wavepath compare`: error measures of an image against a reference, or where its own estimate sees its error.

use std::io;
use std::path::Path;

use super::args::CompareArgs;
use super::output::{self, Voice};
use super::{Failure, legend};
use crate::compare::{
    OwnError, align, compare, flip, own_error, own_error_map, own_relmse, relative_error_map,
};
use crate::picture::{self, Image, ImageFormat};
use crate::report::Report;

/// Reads the images, prints the measures and writes the map if one is asked for.
pub(super) fn run(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(path) = &args.map {
        output::check_image(path)?;
        let mut inputs = vec![&args.image];
        inputs.extend(&args.reference);
        output::check_distinct(&[("--map", path)], &inputs)?;
    }
    match &args.reference {
        Some(reference) => with_reference(args, reference),
        None => with_itself(args),
    }
}

/// What a picture says of its own error.
fn with_itself(args: &CompareArgs) -> Result<(), Failure> {
    let image = picture::read_layers(&args.image)?;
    let map = own_error_map(&image);
    let own = map.as_deref().and_then(|map| own_error(&image, map));
    let (Some(own), Some(map)) = (own, map) else {
        return Err(Failure::Input(format!(
            "\"{}\" does not say what its error is: it has no layers stderr.R, .G, .B with values; expected an EXR file \
             of `wavepath render --layers`, or a reference to compare with",
            args.image.display()
        )));
    };
    if let Some(path) = &args.map {
        write_map(path, &image, &map)?;
    }
    let voice = Voice::new(false, args.map.iter().map(|path| path.as_path()).collect::<Vec<_>>().as_slice());
    if args.json {
        voice.tell(serde_json::to_value(&own).map_err(io::Error::from)?)?;
    } else {
        voice.tell(own_table(&own))?;
        if let Some(path) = &args.map {
            voice.tell(format_args!("{:<16}  {}: {}", "map", path.display(), SCALE))?;
        }
    }
    match args.fail_above {
        Some(limit) if own.relmse > limit => {
            Err(Failure::Work(format!("estimated relMSE of {:.6e} is above {limit}", own.relmse)))
        }
        _ => Ok(()),
    }
}

/// One pixel in a thousand with more than this share of the error: outliers.
const OUTLIERS: f64 = 0.25;

fn own_table(own: &OwnError) -> String {
    let mut lines = vec![format!("{:<16}  {:>12.6e}  (estimated)", "relMSE", own.relmse)];
    let [per_mille, percent, tenth] = own.shares.map(|share| 100.0 * share);
    lines.push(format!(
        "{:<16}  {per_mille:.1} % of it in the worst 0.1 % of the pixels, {percent:.1} % in 1 %, {tenth:.1} % in 10 %",
        "where"
    ));
    if own.shares[0] > OUTLIERS {
        lines.push(format!(
            "{:<16}  few bright samples: light that is found by chance, as caustics, lamps behind glass or in mirrors",
            "why"
        ));
    }
    for (number, block) in own.worst.iter().enumerate() {
        let [x0, x1, y0, y1] = block.crop;
        let crop = format!("--crop {x0},{x1},{y0},{y1}");
        lines.push(format!(
            "{:<16}  {crop:<28} {:>5.1} % of it, relMSE {:.3e}, mean {:.3e}",
            if number == 0 { "worst blocks" } else { "" },
            100.0 * block.share,
            block.relmse,
            block.mean
        ));
    }
    if own.invalid_pixels > 0 {
        lines.push(format!("{:<16}  {:>12}", "invalid pixels", own.invalid_pixels));
    }
    lines.join("\n")
}

fn with_reference(args: &CompareArgs, path: &Path) -> Result<(), Failure> {
    let image = picture::read_any(&args.image)?;
    let reference = picture::read_layers(path)?;
    let (part, reference_part) = align(&image, &reference).map_err(|mismatch| {
        let (image, reference) = (args.image.display(), path.display());
        Failure::Input(format!("cannot compare \"{image}\" with \"{reference}\": {mismatch}"))
    })?;
    let comparison = compare(&part, &reference_part)?;
    // A screen shows PNG files as they are; what is linear may have any range.
    let shown = [&args.image, path].map(is_png);
    let own = if shown[1] {
        // What its report says is true of the light that it was made from, not of what is shown.
        ReferenceError { known: None, less: None }
    } else {
        ReferenceError::of(&image, &reference, &reference_part, comparison.relmse)
    };
    let flip = match shown {
        [true, true] => flip::of_shown(&part, &reference_part),
        _ => flip::of_light(&part, &reference_part),
    };
    if let Some(path) = &args.map {
        write_map(path, &part, &relative_error_map(&part, &reference_part)?)?;
    }
    let voice = Voice::new(false, args.map.iter().map(|path| path.as_path()).collect::<Vec<_>>().as_slice());
    if args.json {
        let mut json = serde_json::to_value(&comparison).map_err(io::Error::from)?;
        json["flip"] = flip.mean.into();
        json["reference_relmse"] = own.known.into();
        json["relmse_less_reference"] = own.less.into();
        voice.tell(json)?;
    } else {
        voice.tell(table(&comparison.to_string(), &own, flip.mean))?;
        if let Some(path) = &args.map {
            voice.tell(format_args!("{:<16}  {}: {}", "map", path.display(), SCALE))?;
        }
    }
    match args.fail_above {
        Some(limit) => own.judge(comparison.relmse, limit, comparison.invalid_pixels),
        None => Ok(()),
    }
}

/// What is shown of the scale of a map.
const SCALE: &str =
    "relative squared error, from 1e-4 (black) to 1e2 (pale yellow), logarithmic; linear in EXR";

/// What the reference is off itself.
struct ReferenceError {
    /// Its own relMSE, where its file states it.
    known: Option<f64>,
    /// The relMSE less that.
    less: Option<f64>,
}

impl ReferenceError {
    /// The errors of two renders with the same random numbers are no longer independent: nothing is subtracted then.
    fn of(image: &Image, reference: &Image, part: &Image, relmse: f64) -> Self {
        let report = |image: &Image| -> Option<Report> {
            serde_json::from_str(image.metadata.report.as_deref()?).ok()
        };
        let same_numbers = match (report(image), report(reference)) {
            (Some(a), Some(b)) => a.seed == b.seed && a.sampler == b.sampler && a.scene == b.scene,
            _ => false,
        };
        let known = own_relmse(reference, part).filter(|_| !same_numbers);
        ReferenceError { known, less: known.map(|own| (relmse - own).max(0.0)) }
    }

    fn judge(&self, relmse: f64, limit: f64, invalid: u64) -> Result<(), Failure> {
        let (value, what) = match self.less {
            Some(less) => (less, "relMSE, less the reference's own,"),
            None => (relmse, "relMSE"),
        };
        if value <= limit {
            return Ok(());
        }
        Err(Failure::Work(if value.is_nan() {
            format!(
                "no pixel is valid in both ({invalid} are not): the error is not known to be below {limit}"
            )
        } else {
            format!("{what} of {value:.6e} is above {limit}")
        }))
    }
}

/// The measures, with what belongs to relMSE behind it.
fn table(measures: &str, own: &ReferenceError, flip: f64) -> String {
    let mut lines = Vec::new();
    for line in measures.lines() {
        lines.push(line.to_string());
        if line.starts_with("relMSE ")
            && let (Some(known), Some(less)) = (own.known, own.less)
        {
            lines.push(format!("{:<16}  {known:>12.6e}  (the reference's own)", ""));
            lines.push(format!("{:<16}  {less:>12.6e}  (less the reference's own)", ""));
        }
        if line.starts_with("SMAPE") {
            lines.push(format!("{:<16}  {flip:>12.6e}", "FLIP"));
        }
    }
    lines.join("\n")
}

fn is_png(path: &Path) -> bool {
    let mut start = [0; 4];
    std::fs::File::open(path).and_then(|mut file| io::Read::read_exact(&mut file, &mut start)).is_ok()
        && start == *b"\x89PNG"
}

/// Writes the errors as grey values to an EXR file, as colours with their scale to a PNG file.
fn write_map(path: &Path, image: &Image, errors: &[f32]) -> Result<(), Failure> {
    match ImageFormat::from_path(path)? {
        ImageFormat::Exr => {
            let pixels = errors.iter().map(|&error| [error; 3]).collect();
            let map = Image { window: image.window, ..Image::new(image.width, image.height, pixels) };
            Ok(picture::write(path, &map, 0.0)?)
        }
        ImageFormat::Png => {
            let pixels = errors.iter().map(|&error| legend::error_colour(error)).collect();
            let map = legend::with_scale(Image::new(image.width, image.height, pixels));
            Ok(picture::write(path, &map, 0.0)?)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_references_own_error_is_subtracted_before_judging() {
        let own = ReferenceError { known: Some(1e-3), less: Some(0.5e-3) };
        own.judge(1.5e-3, 1e-3, 0).unwrap();
        let failure = own.judge(1.5e-3, 1e-4, 0).unwrap_err();
        assert!(
            failure.exit_code() == 1 && failure.to_string().contains("5.000000e-4 is above 0.0001"),
            "{failure}"
        );
        let unknown = ReferenceError { known: None, less: None };
        unknown.judge(1e-3, 1e-3, 0).unwrap();
        assert!(unknown.judge(1.5e-3, 1e-3, 0).is_err() && unknown.judge(f64::NAN, 1.0, 4).is_err());
    }

    #[test]
    fn what_belongs_to_a_measure_stands_beside_it() {
        let own = ReferenceError { known: Some(0.25), less: Some(0.5) };
        let table = table("MSE  1\nrelMSE            2\nrelMSE, trimmed  3\nSMAPE  4", &own, 0.125);
        let lines: Vec<&str> = table.lines().collect();
        assert!(lines[2].contains("2.500000e-1  (the reference's own)"), "{table}");
        assert!(lines[3].contains("5.000000e-1") && lines[4].starts_with("relMSE, trimmed"), "{table}");
        assert!(lines[6].starts_with("FLIP") && lines[6].contains("1.250000e-1"), "{table}");
    }
}
