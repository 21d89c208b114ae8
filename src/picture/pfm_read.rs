//! Portable float maps (`.pfm`): a header of three lines, then rows of 32-bit numbers from bottom to top.

use std::io::{BufRead, Read};

use super::check_size;
use super::raster::Raster;

/// Longest word of a header.
const MOST_WORD: u64 = 64;

/// Reads a file of `length` bytes.
pub(super) fn decode(mut file: impl BufRead, length: u64) -> Result<Raster, String> {
    let channels = match word(&mut file)?.as_str() {
        "PF" => 3usize,
        "Pf" => 1,
        other => return Err(format!("its first word is \"{other}\"; expected PF or Pf")),
    };
    let mut side = |what: &str| {
        let text = word(&mut file)?;
        let side = text.parse::<u32>().ok().filter(|&side| side > 0);
        side.ok_or_else(|| format!("its {what} is \"{text}\"; expected a whole number above 0"))
    };
    let (width, height) = (side("width")?, side("height")?);
    let text = word(&mut file)?;
    // Below 0: the smaller end of each number comes first. What is not 1 is a factor.
    let scale = text.parse::<f32>().ok().filter(|scale| *scale != 0.0 && scale.is_finite());
    let scale = scale.ok_or_else(|| format!("its scale is \"{text}\"; expected a number that is not 0"))?;
    check_size(width.into(), height.into(), length / (4 * channels as u64), 1)?;
    let row_length = width as usize * channels;
    let mut samples = vec![0.0f32; row_length * height as usize];
    let mut bytes = vec![0u8; row_length * 4];
    for row in samples.chunks_exact_mut(row_length).rev() {
        file.read_exact(&mut bytes).map_err(|_| "it is truncated")?;
        for (sample, &four) in row.iter_mut().zip(bytes.as_chunks::<4>().0) {
            let number = if scale < 0.0 { f32::from_le_bytes(four) } else { f32::from_be_bytes(four) };
            *sample = number * scale.abs();
        }
    }
    Ok(Raster::of_floats(width, height, channels as u8, samples))
}

/// The next word, and the one byte of white space behind it.
fn word(file: &mut impl BufRead) -> Result<String, String> {
    let mut word = Vec::new();
    for byte in file.take(MOST_WORD).bytes() {
        let byte = byte.map_err(|error| error.to_string())?;
        if !byte.is_ascii_whitespace() {
            word.push(byte);
        } else if !word.is_empty() {
            return Ok(String::from_utf8_lossy(&word).into_owned());
        }
    }
    Err("it is truncated or damaged: its header has no end".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Transfer;

    fn decode_bytes(header: &str, numbers: &[[u8; 4]]) -> Result<Raster, String> {
        let bytes = [header.as_bytes(), numbers.as_flattened()].concat();
        decode(std::io::Cursor::new(&bytes), bytes.len() as u64)
    }

    #[test]
    fn rows_bytes_and_factors() {
        let little = [1.0f32, 2.0, 3.0, 4.0].map(f32::to_le_bytes);
        let grey = decode_bytes("Pf\n2 2\n-1.0\n", &little).unwrap();
        let row = |y| [0, 1].map(|x| grey.linear(x, y, Transfer::Linear)[0]);
        assert_eq!((row(0), row(1)), ([3.0, 4.0], [1.0, 2.0]));
        let big = [1.0f32, 2.0, 1e-30].map(f32::to_be_bytes);
        let colour = decode_bytes("PF 1 1 2 ", &big).unwrap();
        assert_eq!(colour.linear(0, 0, Transfer::Linear), [2.0, 4.0, 2e-30, 1.0]);
    }

    #[test]
    fn damaged_files_are_errors() {
        for (header, expected) in [
            ("PF\n3 3\n-1\n", "cannot be in"),
            ("PF\n30000 30000\n-1\n", "beyond the limit"),
            ("PF\n0 3\n-1\n", "width"),
            ("PF\n3 x\n-1\n", "height"),
            ("PF\n3 3\n0\n", "scale"),
            ("PF\n3", "no end"),
            ("PG\n3 3\n-1\n", "PF or Pf"),
        ] {
            let error = decode_bytes(header, &[[0; 4]]).unwrap_err();
            assert!(error.contains(expected), "{header}: {error}");
        }
    }
}
