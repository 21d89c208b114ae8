//! `wavepath convert`: a picture that is there, in another form.

use std::path::Path;

use super::Failure;
use super::args::{ConvertArgs, Crop};
use super::output::{self, Voice};
use crate::picture::{self, DataWindow, Image, ImageFormat, Samples};

/// Reads, changes and writes.
pub(super) fn run(args: &ConvertArgs) -> Result<(), Failure> {
    let outputs: Vec<&Path> = args.outputs.iter().map(|path| path.as_path()).collect();
    output::check_images(&outputs, "OUT")?;
    let named: Vec<(&str, &Path)> = outputs.iter().map(|path| ("OUT", *path)).collect();
    output::check_distinct(&named, &[&args.input])?;
    output::check_clobber(&named, args.no_clobber)?;
    let mut image = picture::read_layers(&args.input)?;
    let failed = |what: String| Failure::Input(format!("\"{}\": {what}", args.input.display()));
    if let Some(name) = &args.layer {
        show_layer(&mut image, name).map_err(failed)?;
        forget_error(&mut image);
    }
    if args.drop_layers {
        image.channels.clear();
    }
    if let Some(crop) = args.crop {
        image = cut(image, crop).map_err(|what| Failure::Usage(format!("--crop: {what}")))?;
    }
    // PNG files get their exposure when they are written.
    let mut brighter = image.clone();
    if args.encoding.exposure != 0.0 {
        let gain = args.encoding.exposure.exp2();
        brighter.pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(|channel| channel * gain));
        // Errors are brighter by the same factor; the relative one has a constant that is not.
        for channel in brighter.channels.iter_mut().filter(|channel| channel.name.starts_with("stderr.")) {
            if let Samples::Float(values) = &mut channel.samples {
                values.iter_mut().for_each(|value| *value *= gain);
            }
        }
        forget_error(&mut brighter);
    }
    let encoding = args.encoding.encoding(false);
    let voice = Voice::new(args.quiet, &outputs);
    for path in outputs {
        let image = match ImageFormat::from_path(path)? {
            ImageFormat::Exr => &brighter,
            ImageFormat::Png => &image,
        };
        picture::write_encoded(path, image, &encoding)?;
        voice.wrote(path)?;
    }
    Ok(())
}

/// Makes a layer the colours, and the colours no layer: what shows noise must not lose its neighbours.
fn show_layer(image: &mut Image, name: &str) -> Result<(), String> {
    let find = |name: &str| image.channels.iter().find(|channel| channel.name == name);
    let floats = |samples: &Samples| -> Vec<f32> {
        match samples {
            Samples::Float(values) => values.clone(),
            Samples::Uint(values) => values.iter().map(|&value| value as f32).collect(),
        }
    };
    let components = ["R", "G", "B"].map(|component| find(&format!("{name}.{component}")));
    let planes = match (components, find(name)) {
        ([Some(red), Some(green), Some(blue)], _) => {
            [red, green, blue].map(|channel| floats(&channel.samples))
        }
        (_, Some(grey)) => [(); 3].map(|()| floats(&grey.samples)),
        _ => {
            let names: Vec<&str> = image.channels.iter().map(|channel| channel.name.as_str()).collect();
            let there = if names.is_empty() { "none".into() } else { names.join(", ") };
            return Err(format!("it has no layer \"{name}\"; expected one of its channels: {there}"));
        }
    };
    image.pixels = (0..image.pixels.len()).map(|i| [0, 1, 2].map(|c| planes[c][i])).collect();
    Ok(())
}

/// The estimate of the error in the report is not that of other values.
fn forget_error(image: &mut Image) {
    let Some(report) = &mut image.metadata.report else { return };
    if let Ok(serde_json::Value::Object(mut record)) = serde_json::from_str(report) {
        for key in ["estimated_relmse", "estimated_relmse_interval"] {
            record.insert(key.into(), serde_json::Value::Null);
        }
        *report = serde_json::Value::Object(record).to_string();
    }
}

/// The part of the full frame that `crop` names, with all layers and what is known of the whole.
fn cut(image: Image, crop: Crop) -> Result<Image, String> {
    let DataWindow { full_width, full_height, .. } = image.window;
    let [x0, x1, y0, y1] = crop.bounds([full_width, full_height])?;
    let window = DataWindow { x: x0 as i32, y: y0 as i32, ..image.window };
    let part = image.crop(window, x1 - x0, y1 - y0).ok_or_else(|| {
        let DataWindow { x, y, .. } = image.window;
        let (right, lower) = (x + image.width as i32, y + image.height as i32);
        format!("{x0},{x1},{y0},{y1} is not all there: the picture holds {x},{right},{y},{lower}")
    })?;
    Ok(Image { metadata: image.metadata, ..part })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Channel;

    #[test]
    fn layers_are_shown_by_name() {
        let mut image = Image::new(2, 1, vec![[1.0; 3]; 2]);
        for (name, value) in [("n.R", 1.0), ("n.G", 2.0), ("n.B", 3.0)] {
            image.channels.push(Channel { name: name.into(), samples: Samples::Float(vec![value; 2]) });
        }
        image.channels.push(Channel { name: "samples".into(), samples: Samples::Uint(vec![7, 8]) });
        show_layer(&mut image, "n").unwrap();
        assert_eq!(image.pixels, [[1.0, 2.0, 3.0]; 2]);
        show_layer(&mut image, "samples").unwrap();
        assert_eq!(image.pixels, [[7.0; 3], [8.0; 3]]);
        assert!(show_layer(&mut image, "depth").unwrap_err().contains("n.R, n.G, n.B, samples"));
    }

    #[test]
    fn an_error_of_other_values_is_forgotten() {
        let mut image = Image::new(1, 1, vec![[1.0; 3]]);
        image.metadata.report = Some("{\"scene\":\"a\",\"estimated_relmse\":0.5}".into());
        forget_error(&mut image);
        let report: serde_json::Value = serde_json::from_str(&image.metadata.report.unwrap()).unwrap();
        assert!(report["estimated_relmse"].is_null() && report["scene"] == "a");
    }

    #[test]
    fn crops_are_parts_of_the_full_frame() {
        let full = Image::new(8, 4, (0..32).map(|i| [i as f32; 3]).collect());
        let part = cut(full, Crop::Fractions([0.5, 1.0, 0.0, 0.5])).unwrap();
        assert_eq!((part.width, part.height, part.pixel(0, 0)), (4, 2, [4.0; 3]));
        let again = cut(part.clone(), Crop::Pixels([5, 6, 1, 2])).unwrap();
        assert_eq!(again.pixels, [[13.0; 3]]);
        let error = cut(part, Crop::Pixels([0, 2, 0, 2])).unwrap_err();
        assert!(error.contains("holds 4,8,0,2"), "{error}");
    }
}
