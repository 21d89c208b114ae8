//! The scale of an error map, drawn below it.

use crate::colour_map::heat;
use crate::picture::Image;

/// Powers of ten at both ends of the scale.
const LEAST: i32 = -4;
const MOST: i32 = 2;

/// Rows of the bar, and of everything below the map.
const BAR: u32 = 6;
const MARGIN: u32 = 3;
const GLYPH: [u32; 2] = [3, 5];
const HEIGHT: u32 = MARGIN + BAR + 2 + GLYPH[1] + MARGIN;

/// Narrower maps have no room for numbers: they get the bar alone.
const WIDTH_FOR_NUMBERS: u32 = 140;

/// Least width of a map with a bar.
const WIDTH_FOR_BAR: u32 = 32;

/// The colour of a relative squared error: black below 1e-4, through purple and orange to pale
/// yellow from 1e2 on, equal steps for equal factors. NaN, an invalid pixel, stays NaN.
pub(super) fn error_colour(error: f32) -> [f32; 3] {
    if error.is_nan() {
        return [f32::NAN; 3];
    }
    heat((error.max(1e-30).log10() - LEAST as f32) / (MOST - LEAST) as f32)
}

/// The map with its scale below it, if it is wide enough for one.
pub(super) fn with_scale(map: Image) -> Image {
    if map.width < WIDTH_FOR_BAR {
        return map;
    }
    let (width, height) = (map.width, map.height);
    let mut pixels = map.pixels;
    pixels.resize((width * (height + HEIGHT)) as usize, [0.02; 3]);
    let mut scale = Image::new(width, height + HEIGHT, pixels);
    let (left, right) = (MARGIN, width - MARGIN);
    let top = height + MARGIN;
    for x in left..right {
        let colour = heat((x - left) as f32 / (right - left - 1) as f32);
        for y in top..top + BAR {
            set(&mut scale, x, y, colour);
        }
    }
    if width < WIDTH_FOR_NUMBERS {
        return scale;
    }
    for power in LEAST..=MOST {
        let share = (power - LEAST) as f32 / (MOST - LEAST) as f32;
        let tick = left + (share * (right - left - 1) as f32).round() as u32;
        set(&mut scale, tick, top + BAR, [0.8; 3]);
        let text = format!("1e{power}");
        let length = text.len() as u32 * (GLYPH[0] + 1) - 1;
        let start = tick.saturating_sub(length / 2).clamp(left, right - length);
        for (index, character) in text.chars().enumerate() {
            let x = start + index as u32 * (GLYPH[0] + 1);
            draw(&mut scale, character, x, top + BAR + 2);
        }
    }
    scale
}

fn set(image: &mut Image, x: u32, y: u32, colour: [f32; 3]) {
    image.pixels[(y * image.width + x) as usize] = colour;
}

/// Three by five dots.
fn draw(image: &mut Image, character: char, left: u32, top: u32) {
    let rows: [&str; 5] = match character {
        '0' => ["###", "# #", "# #", "# #", "###"],
        '1' => [" # ", "## ", " # ", " # ", "###"],
        '2' => ["###", "  #", "###", "#  ", "###"],
        '3' => ["###", "  #", "###", "  #", "###"],
        '4' => ["# #", "# #", "###", "  #", "  #"],
        'e' => ["   ", "###", "###", "#  ", "###"],
        '-' => ["   ", "   ", "###", "   ", "   "],
        _ => ["   "; 5],
    };
    for (y, row) in rows.into_iter().enumerate() {
        for (x, dot) in row.chars().enumerate() {
            if dot == '#' {
                set(image, left + x as u32, top + y as u32, [0.8; 3]);
            }
        }
    }
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

    #[test]
    fn the_scale_is_below_the_map_and_has_its_colours() {
        let map = Image::new(200, 10, vec![[0.5; 3]; 2000]);
        let scale = with_scale(map.clone());
        assert_eq!((scale.width, scale.height), (200, 10 + HEIGHT));
        assert_eq!(scale.pixels[..2000], map.pixels[..]);
        let bar = |x: u32| scale.pixel(x, 10 + MARGIN);
        assert_eq!((bar(MARGIN), bar(200 - MARGIN - 1)), (heat(0.0), heat(1.0)));
        // 1e-1 is in the middle.
        assert!(scale.pixels[2000..].iter().filter(|pixel| **pixel == [0.8; 3]).count() > 7 * 8);
        let narrow = Image::new(40, 2, vec![[0.5; 3]; 80]);
        assert_eq!(with_scale(narrow).height, 2 + HEIGHT);
        let tiny = Image::new(4, 2, vec![[0.5; 3]; 8]);
        assert_eq!(with_scale(tiny).height, 2);
    }
}
