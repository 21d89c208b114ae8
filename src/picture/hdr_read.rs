//! Radiance's RGBE pictures (`.hdr`, `.pic`): Ward, "Real Pixels", Graphics Gems II, 1991.

use std::io::{BufRead, Read};

use super::check_size;
use super::raster::Raster;

/// First bytes of every file.
pub(super) const MAGIC: [u8; 2] = *b"#?";

/// Longest line of a header.
const MOST_LINE: u64 = 4096;

/// Most lines of a header.
const MOST_LINES: usize = 10_000;

/// Reads a file of `length` bytes.
pub(super) fn decode(mut file: impl BufRead, length: u64) -> Result<Raster, String> {
    let (mut exposure, mut lines) = (1.0, 0);
    loop {
        let line = line(&mut file)?;
        if line.is_empty() {
            break;
        }
        if let Some(format) = line.strip_prefix("FORMAT=")
            && format.trim() != "32-bit_rle_rgbe"
        {
            return Err(format!("its format is \"{}\"; expected 32-bit_rle_rgbe", format.trim()));
        }
        // Several factors multiply.
        if let Some(factor) = line.strip_prefix("EXPOSURE=") {
            let factor: f64 = factor.trim().parse().map_err(|_| "it is damaged: EXPOSURE is no number")?;
            exposure *= factor;
        }
        lines += 1;
        if lines > MOST_LINES {
            return Err("it is damaged: its header has no end".into());
        }
    }
    if !(exposure > 0.0 && exposure.is_finite()) {
        return Err("it is damaged: EXPOSURE is not above 0".into());
    }
    let resolution = line(&mut file)?;
    let words: Vec<&str> = resolution.split_whitespace().collect();
    let &["-Y", height, "+X", width] = words.as_slice() else {
        return Err(format!("its resolution is \"{resolution}\"; expected -Y HEIGHT +X WIDTH"));
    };
    let side = |text: &str| text.parse::<u32>().ok().filter(|&side| side > 0);
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(format!("its resolution is \"{resolution}\"; expected -Y HEIGHT +X WIDTH"));
    };
    // Runs of at most 127 samples in two bytes, four samples a pixel.
    check_size(width.into(), height.into(), length, 16)?;
    let pixels = width as usize * height as usize;
    let mut samples = Vec::with_capacity(pixels * 3);
    let mut row = vec![[0; 4]; width as usize];
    for _ in 0..height {
        read_row(&mut file, &mut row)?;
        samples.extend(row.iter().flat_map(|&rgbe| colour(rgbe, exposure)));
    }
    Ok(Raster::of_floats(width, height, 3, samples))
}

fn line(file: &mut impl BufRead) -> Result<String, String> {
    let mut bytes = Vec::new();
    file.take(MOST_LINE).read_until(b'\n', &mut bytes).map_err(|error| error.to_string())?;
    if bytes.pop() != Some(b'\n') {
        return Err("it is truncated or damaged: its header has no end".into());
    }
    Ok(String::from_utf8_lossy(&bytes).trim_end().to_string())
}

/// The mantissas share an exponent; half a step is not added, as Radiance does today.
fn colour([r, g, b, e]: [u8; 4], exposure: f64) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    let scale = f64::from(i32::from(e) - 136).exp2() / exposure;
    [r, g, b].map(|mantissa| (f64::from(mantissa) * scale) as f32)
}

fn four(file: &mut impl Read) -> Result<[u8; 4], String> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes).map_err(|_| "it is truncated")?;
    Ok(bytes)
}

fn read_row(file: &mut impl Read, row: &mut [[u8; 4]]) -> Result<(), String> {
    let first = four(file)?;
    let width = row.len();
    let is_run_length = first[0] == 2 && first[1] == 2 && first[2] < 128 && (8..32_768).contains(&width);
    if !is_run_length {
        return read_old_row(file, row, first);
    }
    if usize::from(u16::from_be_bytes([first[2], first[3]])) != width {
        return Err("it is damaged: a row has another width than the picture".into());
    }
    for component in 0..4 {
        let mut x = 0;
        while x < width {
            let mut byte = || {
                let mut byte = [0];
                file.read_exact(&mut byte).map_err(|_| "it is truncated".to_string()).map(|()| byte[0])
            };
            let count = byte()?;
            let (run, count) = if count > 128 { (true, count - 128) } else { (false, count) };
            let count = usize::from(count);
            if count == 0 || x + count > width {
                return Err("it is damaged: a run does not end with its row".into());
            }
            let value = if run { byte()? } else { 0 };
            for pixel in &mut row[x..x + count] {
                pixel[component] = if run { value } else { byte()? };
            }
            x += count;
        }
    }
    Ok(())
}

/// Flat pixels, with runs in the old manner: 1 1 1 N repeats the pixel before N times, followed by another, N * 256.
fn read_old_row(file: &mut impl Read, row: &mut [[u8; 4]], first: [u8; 4]) -> Result<(), String> {
    let (mut x, mut shift, mut next) = (0, 0, Some(first));
    while x < row.len() {
        let pixel = match next.take() {
            Some(pixel) => pixel,
            None => four(file)?,
        };
        if pixel[..3] != [1, 1, 1] {
            row[x] = pixel;
            (x, shift) = (x + 1, 0);
            continue;
        }
        let count = usize::from(pixel[3]) << shift;
        if x == 0 || shift > 16 || x + count > row.len() {
            return Err("it is damaged: a run does not end with its row".into());
        }
        let before = row[x - 1];
        row[x..x + count].fill(before);
        (x, shift) = (x + count, shift + 8);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{Image, Transfer};

    fn decode_bytes(header: &str, body: &[u8]) -> Result<Image, String> {
        let bytes = [header.as_bytes(), body].concat();
        let raster = decode(std::io::Cursor::new(&bytes), bytes.len() as u64)?;
        raster.into_image(Transfer::Linear)
    }

    const HEADER: &str = "#?RADIANCE\n# made by a test\nFORMAT=32-bit_rle_rgbe\n\n";

    #[test]
    fn flat_and_run_length_rows() {
        // 128 with exponent 129 is 1; with 128, 0.5.
        let flat = decode_bytes(&format!("{HEADER}-Y 1 +X 3\n"), &[128, 64, 0, 129, 1, 1, 1, 1, 0, 0, 0, 0]);
        assert_eq!(flat.unwrap().pixels, [[1.0, 0.5, 0.0], [1.0, 0.5, 0.0], [0.0; 3]]);
        let mut body = vec![2, 2, 0, 10];
        body.extend([128 + 10, 128, 128 + 9, 64, 1, 128, 4, 1, 2, 3, 4, 128 + 6, 0, 128 + 10, 129]);
        let runs = decode_bytes(&format!("{HEADER}-Y 1 +X 10\n"), &body).unwrap();
        assert_eq!((runs.pixel(0, 0), runs.pixel(9, 0)), ([1.0, 0.5, 1.0 / 128.0], [1.0, 1.0, 0.0]));
    }

    #[test]
    fn exposure_is_taken_back() {
        let header = "#?RADIANCE\nEXPOSURE=2\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n";
        assert_eq!(decode_bytes(header, &[128, 128, 128, 131]).unwrap().pixels, [[1.0; 3]]);
    }

    #[test]
    fn damaged_files_are_errors() {
        for (header, body, expected) in [
            (format!("{HEADER}-Y 1 +X 3\n"), vec![1; 8], "run"),
            (format!("{HEADER}-Y 1 +X 3\n"), vec![7; 8], "truncated"),
            (format!("{HEADER}-Y 1 +X 9\n"), vec![2, 2, 0, 8], "another width"),
            (format!("{HEADER}-Y 1 +X 8\n"), vec![2, 2, 0, 8, 255, 1], "run"),
            (format!("{HEADER}-Y 65536 +X 65536\n"), vec![], "beyond the limit"),
            (format!("{HEADER}-Y 16384 +X 16384\n"), vec![0; 100], "cannot be in"),
            (format!("{HEADER}+Y 1 +X 3\n"), vec![], "resolution"),
            (format!("{HEADER}-Y 0 +X 3\n"), vec![], "resolution"),
            ("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n".into(), vec![], "xyze"),
            ("#?RADIANCE\nEXPOSURE=0\n\n".into(), vec![], "EXPOSURE"),
            ("#?RADIANCE\n".into(), vec![], "no end"),
        ] {
            let error = decode_bytes(&header, &body).unwrap_err();
            assert!(error.contains(expected), "{header}: {error}");
        }
    }
}
