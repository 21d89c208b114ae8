//! Files that are no pbrt scene: what they are, and the way in.

use super::error::{Place, Problem};
use super::parser::KEYWORDS;

/// How much of a file's beginning is looked at.
pub(crate) const BEGINNING: u64 = 4096;

/// What begins a file of other programs, and what to call it.
const MAGIC: [(&[u8], &str); 12] = [
    (b"glTF", "a binary glTF file"),
    (b"BLENDER", "a Blender file"),
    // Blender compresses its files by Zstandard.
    (b"\x28\xb5\x2f\xfd", "a compressed file, perhaps of Blender"),
    (b"Kaydara FBX", "an FBX file"),
    (b"; FBX", "an FBX file"),
    (b"solid ", "an STL mesh"),
    (b"PXR-USDC", "a USD file"),
    (b"#usda", "a USD file"),
    (b"ply", "a PLY mesh"),
    (b"\x76\x2f\x31\x01", "an OpenEXR picture"),
    (b"\x89PNG", "a PNG picture"),
    (b"\x1f\x8b", "a gzip-compressed file"),
];

/// First words of Wavefront OBJ files.
const OBJ: [&str; 10] = ["v", "vn", "vt", "f", "o", "g", "s", "mtllib", "usemtl", "l"];

/// A complaint about a file that another program's format explains, from its beginning.
pub(crate) fn explain(name: &str, beginning: &[u8]) -> Option<Box<Problem>> {
    let what = recognise(beginning)?;
    let stem = std::path::Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let stem = stem.filter(|stem| stem != "stdin").unwrap_or_else(|| "model".into());
    let way = match what {
        "a PLY mesh" => format!(
            "expected a name that ends in .ply, or a scene with the line: Shape \"plymesh\" \"string filename\" \
             \"{stem}.ply\""
        ),
        "an OpenEXR picture" | "a PNG picture" => "expected a scene; `wavepath compare` compares pictures".into(),
        "a gzip-compressed file" => "expected a name that ends in .gz, or the file decompressed".into(),
        "a Mitsuba scene" => {
            "expected pbrt's format; meshes of the scene can be used as PLY files, materials and lights must be \
             written anew"
                .into()
        }
        "a Blender file" | "a compressed file, perhaps of Blender" => {
            format!("expected pbrt's format: export glTF or OBJ, then `assimp export {stem}.glb {stem}.pbrt`")
        }
        _ => format!("expected pbrt's format: `assimp export FILE {stem}.pbrt` converts it"),
    };
    Some(Problem::new(Place::Other(name.to_string()), format!("this is {what}, not a pbrt scene")).label(way))
}

fn recognise(beginning: &[u8]) -> Option<&'static str> {
    if let Some((_, what)) = MAGIC.iter().find(|(magic, _)| beginning.starts_with(magic)) {
        // Words of a text must end there.
        let ends = |n: usize| beginning.get(n).is_none_or(u8::is_ascii_whitespace);
        return (*what != "a PLY mesh" || ends(3)).then_some(what);
    }
    let text = String::from_utf8_lossy(beginning);
    let first = text.trim_start_matches('\u{feff}').trim_start();
    if first.starts_with('<') {
        return Some(if text.contains("<scene") { "a Mitsuba scene" } else { "an XML file" });
    }
    if first.starts_with('{') {
        return Some(if text.contains("\"asset\"") { "a glTF file" } else { "a JSON file" });
    }
    let lines =
        text.split(['\n', '\r']).map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let words: Vec<&str> = lines.filter_map(|line| line.split_whitespace().next()).take(8).collect();
    let is_obj = !words.is_empty() && words.iter().all(|word| OBJ.contains(word));
    (is_obj && !KEYWORDS.contains(&words[0])).then_some("a Wavefront OBJ mesh")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_others_are_recognised_and_scenes_are_not() {
        for (text, phrase) in [
            ("# Blender\nmtllib a.mtl\no Cube\nv 1 1 1\nv 0 0 0\nf 1 2 3\n", "Wavefront OBJ"),
            ("glTF\u{2}", "binary glTF"),
            ("BLENDER-v300", "Blender"),
            ("<?xml version=\"1.0\"?>\n<scene version=\"3.0.0\">", "Mitsuba"),
            ("{ \"asset\": { \"version\": \"2.0\" } }", "glTF"),
            ("ply\nformat ascii 1.0\n", "PLY"),
            ("solid cube\n", "STL"),
        ] {
            let problem = explain("dir/a.x", text.as_bytes()).unwrap();
            assert!(problem.message.contains(phrase), "{text}: {}", problem.message);
        }
        for text in
            ["", "# only\n", "LookAt 0 0 1", "Shap \"sphere\"", "plya", "1 2 3", "v4 scene\nWorldBegin"]
        {
            assert!(explain("a.pbrt", text.as_bytes()).is_none(), "{text}");
        }
    }
}
