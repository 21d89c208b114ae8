//! Film files whose checksums are right and whose contents lie.

use super::container::{Kind, SectionReader, SectionWriter};
use super::*;
use crate::atomic_file::TestFolder;
use crate::{Render, Scene};
use std::fs;

type Sections = Vec<(Kind, Vec<u8>)>;

/// All that a film file can have.
fn sections(folder: &TestFolder) -> Sections {
    let text = r#"Film "rgb" "integer xresolution" 20 "integer yresolution" 18 Camera "perspective"
        PixelFilter "mitchell" WorldBegin LightSource "infinite" Shape "sphere""#;
    let scene = Scene::parse(text).unwrap();
    let path = folder.file("a.film");
    let picture = Render::new(&scene).adaptive(true).threads(1).spp(20).run().unwrap();
    picture.save_film(&scene, &path).unwrap();
    let mut reader = SectionReader::open(&path).unwrap();
    let kinds: Vec<_> = reader.kinds().collect();
    let contents = |(number, kind)| (kind, reader.read(number).unwrap());
    kinds.into_iter().map(contents).filter(|(kind, _)| *kind != Kind::End).collect()
}

fn read(folder: &TestFolder, sections: &Sections) -> Result<FilmFile, FilmFileError> {
    let path = folder.file("b.film");
    let mut bytes = Vec::new();
    let mut writer = SectionWriter::new(&mut bytes).unwrap();
    sections.iter().for_each(|(kind, contents)| writer.write(*kind, contents).unwrap());
    writer.end().unwrap();
    fs::write(&path, bytes).unwrap();
    FilmFile::read(&path)
}

/// Whatever is in the sections: an error, or a film that is one.
#[test]
fn contents_that_lie_are_errors_or_films() {
    let refused = lie(&TestFolder::new("film-lies"), 99, 3000);
    assert!(refused > 1000, "{refused}");
}

/// The same for ten minutes, with other lies each time.
#[test]
#[ignore = "takes ten minutes"]
fn contents_that_lie_for_ten_minutes() {
    let folder = TestFolder::new("film-more-lies");
    let started = std::time::Instant::now();
    let mut seed = u64::from(std::process::id()) << 32;
    while started.elapsed().as_secs() < 600 {
        seed += 1;
        println!("seed {seed}");
        lie(&folder, seed, 3000);
    }
}

/// How many of so many lies were refused.
fn lie(folder: &TestFolder, seed: u64, count: usize) -> usize {
    let whole = sections(folder);
    read(folder, &whole).unwrap();
    let mut state = seed;
    let mut random = |end: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % end
    };
    let mut refused = 0;
    for _ in 0..count {
        let mut lies = whole.clone();
        let number = random(lies.len());
        let contents = &mut lies[number].1;
        match random(4) {
            0 => contents.truncate(random(contents.len())),
            1 => {
                let (at, more) = (random(contents.len()), random(9));
                contents.splice(at..at, vec![0xFF; more]);
            }
            2 => {
                // A number of four bytes, extreme or random.
                let at = random(contents.len().saturating_sub(4).max(1));
                let value = [0, 1, 0x7FFF_FFFF, u32::MAX, random(1 << 31) as u32][random(5)];
                let end = (at + 4).min(contents.len());
                contents[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            }
            _ => {
                let at = random(contents.len());
                contents[at] ^= 1 << random(8);
            }
        }
        match read(folder, &lies) {
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains("b.film"), "{error}");
            }
            Ok(file) => {
                // It can be shown, and written.
                file.write(folder.file("c.film")).unwrap();
                file.into_picture();
            }
        }
    }
    refused
}

#[test]
fn sections_that_lack_or_repeat_are_told() {
    let folder = TestFolder::new("film-sections");
    let whole = sections(&folder);
    for (number, (kind, _)) in whole.iter().enumerate() {
        let mut without = whole.clone();
        let section = without.remove(number);
        match kind {
            // Only renders that decide by what they see have one.
            Kind::Round => drop(read(&folder, &without).unwrap()),
            _ => drop(read(&folder, &without).unwrap_err()),
        }
        let mut twice = whole.clone();
        twice.insert(number, section);
        read(&folder, &twice).unwrap_err();
    }
}

/// A head that promises 2^32 pixels costs no memory.
#[test]
fn no_memory_is_taken_on_a_heads_word() {
    let folder = TestFolder::new("film-large");
    let mut lies = sections(&folder);
    let head = &mut lies[0].1;
    for (at, side) in [(20, 1u32 << 16), (24, 1 << 16), (32, 1 << 16), (40, 1 << 16)] {
        head[at..at + 4].copy_from_slice(&side.to_le_bytes());
    }
    let error = read(&folder, &lies).unwrap_err().to_string();
    assert!(error.contains("not enough bytes"), "{error}");
}
