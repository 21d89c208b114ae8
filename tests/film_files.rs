//! Films as files: parts, merging, going on; what is damaged; what does not belong together.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use wavepath::engine::EngineKind;
use wavepath::engine::session::Ended;
use wavepath::film_file::{Checkpoint, FilmFile, FilmFileError, Gap, Holding};
use wavepath::kernels::channels::ChannelSet;
use wavepath::{Picture, Render, RenderError, Scene};

/// A lamp over a floor, and a ball, through a filter; 40 x 24 pixels, so that some blocks are cut.
fn scene(filter: &str) -> Scene {
    let text = format!(
        r#"LookAt 0 2 6  0 0.5 0  0 1 0
           Camera "perspective" "float fov" 40
           Film "rgb" "integer xresolution" 40 "integer yresolution" 24
           Sampler "sobol" "integer pixelsamples" 32
           PixelFilter "{filter}"
           WorldBegin
           LightSource "infinite" "rgb L" [ 0.1 0.15 0.2 ]
           AttributeBegin
             AreaLightSource "diffuse" "rgb L" [ 8 7 5 ]
             Translate 1 4 1
             Shape "sphere" "float radius" 0.5
           AttributeEnd
           Material "diffuse" "rgb reflectance" [ 0.6 0.4 0.3 ]
           Shape "sphere" "float radius" 1
           Shape "bilinearmesh" "point3 P" [ -9 -1 -9  9 -1 -9  -9 -1 9  9 -1 9 ]"#
    );
    Scene::parse(&text).unwrap()
}

/// A lamp and a ball at the edge of an even sky: samples are best spread unevenly.
fn uneven() -> Scene {
    let text = r#"LookAt 8 2 14  8 0 0  0 1 0
        Camera "perspective" "float fov" 40
        Film "rgb" "integer xresolution" 96 "integer yresolution" 40
        PixelFilter "mitchell"
        WorldBegin
        LightSource "infinite" "rgb L" [ 0.1 0.15 0.2 ]
        AttributeBegin
          AreaLightSource "diffuse" "rgb L" [ 8 7 5 ]
          Translate 1 4 1
          Shape "sphere" "float radius" 0.5
        AttributeEnd
        Material "diffuse" "rgb reflectance" [ 0.6 0.4 0.3 ]
        Shape "sphere" "float radius" 2"#;
    Scene::parse(text).unwrap()
}

fn render(scene: &Scene) -> Render<'_> {
    Render::new(scene).threads(2).seed(5).channels(ChannelSet::all())
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-films-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Numbers that look random.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
    fn shuffle<T>(&mut self, items: &mut [T]) {
        for k in (1..items.len()).rev() {
            items.swap(k, self.below(k + 1));
        }
    }
}

/// The same picture, the same error, and the same film, to the bit.
#[track_caller]
fn assert_same(own: &Picture, other: &Picture) {
    assert!(own.film().to_bytes() == other.film().to_bytes(), "the films differ");
    assert_eq!(own.image().pixels, other.image().pixels);
    assert_eq!(own.image().channels, other.image().channels);
    assert_eq!(own.error(), other.error());
    assert_eq!(own.report().samples, other.report().samples);
}

#[test]
fn parts_in_any_order_and_grouping_are_the_whole() {
    let folder = Folder::new("parts");
    let mut random = Random(7);
    for filter in ["box", "gaussian", "mitchell"] {
        let scene = scene(filter);
        let whole = render(&scene).run().unwrap();
        for (count, tiles) in [(2, false), (3, false), (7, false), (3, true)] {
            let mut parts = Vec::new();
            for number in 0..count {
                let file = folder.file(&format!("{number}.film"));
                let part = render(&scene).threads(1 + number as usize % 3);
                let engine = [EngineKind::Wavefront, EngineKind::Megakernel][number as usize % 2];
                let part = match tiles {
                    true => part.tile(number, count),
                    false => part.samples(32 * number / count..32 * (number + 1) / count),
                };
                part.engine(engine).run().unwrap().save_film(&scene, &file).unwrap();
                parts.push(file);
            }
            random.shuffle(&mut parts);
            // Some of them first, and what they come to with the others.
            let some = 1 + random.below(parts.len() - 1);
            let merged = folder.file("some.film");
            FilmFile::merge(&parts[..some]).unwrap().write(&merged).unwrap();
            parts.drain(..some);
            parts.insert(random.below(parts.len() + 1), merged);
            let merged = FilmFile::merge(&parts).unwrap();
            assert!(Gap::of(&merged.film, Some(32)).is_empty());
            assert_same(&merged.into_picture(), &whole);
        }
    }
}

/// Renders with interruptions, each run with other threads, and as often as `until` says; then to the end.
fn in_pieces<'s>(
    scene: &'s Scene,
    folder: &Folder,
    most: usize,
    choose: impl Fn(Render<'s>) -> Render<'s>,
) -> (Picture, usize) {
    let file = folder.file("pieces.film");
    let _ = fs::remove_file(&file);
    let mut random = Random(3);
    for piece in 0.. {
        let stop = Arc::new(AtomicBool::new(false));
        let mut render = choose(render(scene)).threads(1 + random.below(4)).stop_on(Arc::clone(&stop));
        if file.exists() {
            render = render.resume(FilmFile::read(&file).unwrap());
        }
        let delay = Duration::from_micros(500 + random.below(20_000) as u64);
        if piece < most {
            std::thread::spawn(move || {
                std::thread::sleep(delay);
                stop.store(true, Ordering::Relaxed);
            });
        }
        let picture = render.run().unwrap();
        if picture.ended() != Ended::Interrupt {
            return (picture, piece);
        }
        picture.save_film(scene, &file).unwrap();
    }
    unreachable!()
}

#[test]
fn a_render_in_pieces_is_the_whole() {
    let folder = Folder::new("pieces");
    let scene = scene("gaussian");
    let (picture, pieces) = in_pieces(&scene, &folder, 12, |render| render.spp(1024));
    assert!(pieces > 0);
    assert_same(&picture, &render(&scene).spp(1024).run().unwrap());
}

#[test]
fn an_adaptive_render_in_pieces_is_the_whole() {
    let folder = Folder::new("adaptive");
    let scene = uneven();
    let (picture, pieces) = in_pieces(&scene, &folder, 12, |render| render.adaptive(true).spp(512));
    let whole = render(&scene).adaptive(true).spp(512).run().unwrap();
    assert!(pieces > 0 && whole.report().adaptive.unwrap().used, "{:?}", whole.report().adaptive);
    assert_same(&picture, &whole);
    assert_eq!(picture.report().adaptive, whole.report().adaptive);
}

#[test]
fn a_render_to_an_error_in_pieces_is_the_whole() {
    let folder = Folder::new("error");
    for adaptive in [false, true] {
        let scene = if adaptive { uneven() } else { scene("gaussian") };
        let (picture, _) = in_pieces(&scene, &folder, 12, |render| render.adaptive(adaptive).error(2e-5));
        let whole = render(&scene).adaptive(adaptive).error(2e-5).run().unwrap();
        assert_eq!((picture.ended(), whole.ended()), (Ended::Error, Ended::Error));
        assert_same(&picture, &whole);
    }
}

#[test]
fn a_finished_render_gets_more_samples() {
    let folder = Folder::new("more");
    let (scene, file) = (scene("mitchell"), folder.file("a.film"));
    render(&scene).spp(20).run().unwrap().save_film(&scene, &file).unwrap();
    let more = render(&scene).spp(200).resume(FilmFile::read(&file).unwrap()).run().unwrap();
    assert_same(&more, &render(&scene).spp(200).run().unwrap());
    // Nothing is left to do.
    let same = render(&scene).spp(20).resume(FilmFile::read(&file).unwrap()).run().unwrap();
    assert_same(&same, &render(&scene).spp(20).run().unwrap());
    // All that it cost, in both runs.
    assert_eq!(more.report().rays.camera, more.report().samples);
    // A target of the scene's own counts, too.
    let text = r#"Film "rgb" "integer xresolution" 8 "integer yresolution" 8 Camera "perspective"
        Sampler "sobol" "integer pixelsamples" SPP WorldBegin LightSource "infinite" Shape "sphere""#;
    let [few, many] = ["4", "40"].map(|spp| Scene::parse(&text.replace("SPP", spp)).unwrap());
    Render::new(&few).run().unwrap().save_film(&few, &file).unwrap();
    let more = Render::new(&many).resume(FilmFile::read(&file).unwrap()).run().unwrap();
    assert_same(&more, &Render::new(&many).run().unwrap());
    assert_eq!(more.report().spp, 40.0);
}

#[test]
fn checkpoints_of_a_running_render_can_be_gone_on_with() {
    let folder = Folder::new("running");
    for adaptive in [false, true] {
        let scene = if adaptive { uneven() } else { scene("gaussian") };
        let file = folder.file("running.film");
        let (copies, written) = (std::sync::Mutex::new(Vec::new()), AtomicBool::new(false));
        let checkpoint = Checkpoint::new(&file).every(Duration::from_millis(1)).on_written(|result| {
            result.as_ref().unwrap();
            written.store(true, Ordering::Relaxed);
            copies.lock().unwrap().push(fs::read(&file).unwrap());
        });
        let spp = if adaptive { 512 } else { 2048 };
        let whole = render(&scene).adaptive(adaptive).spp(spp).checkpoint(checkpoint).run().unwrap();
        let copies = copies.into_inner().unwrap();
        assert!(copies.len() > 1, "only the last checkpoint was written");
        for copy in copies.iter().step_by((copies.len() / 4).max(1)) {
            fs::write(&file, copy).unwrap();
            let file = FilmFile::read(&file).unwrap();
            let again = render(&scene).adaptive(adaptive).spp(spp).threads(3).resume(file).run().unwrap();
            assert_same(&again, &whole);
        }
    }
}

fn changed(result: Result<Picture, RenderError>) -> String {
    match result {
        Err(RenderError::Changed { what }) => what,
        other => panic!("{other:?}"),
    }
}

#[test]
fn another_scene_or_setting_is_named() {
    let folder = Folder::new("changed");
    let file = folder.file("a.film");
    let text = r#"Camera "perspective" "float fov" 40
        Film "rgb" "integer xresolution" 8 "integer yresolution" 8 "string filename" "a.exr"
        WorldBegin LightSource "infinite" Material "diffuse" "rgb reflectance" [ 0.5 0.5 0.5 ]
        Shape "sphere" Shape "trianglemesh" "point3 P" [ 0 0 0  1 0 0  0 1 0 ] "integer indices" [ 0 1 2 ]"#;
    let scene = Scene::parse(text).unwrap();
    fn first(scene: &Scene) -> Render<'_> {
        Render::new(scene).spp(4).seed(1)
    }
    first(&scene).run().unwrap().save_film(&scene, &file).unwrap();
    let film = || FilmFile::read(&file).unwrap();
    for (from, to, expected) in [
        ("\"float fov\" 40", "\"float fov\" 41", "camera"),
        ("[ 0.5 0.5 0.5 ]", "[ 0.5 0.5 0.50001 ]", "materials"),
        ("0 1 0 ]", "0 1 0.001 ]", "meshes"),
        ("\"infinite\"", "\"infinite\" \"float scale\" 2", "lights"),
        ("Shape \"sphere\"", "Shape \"sphere\" \"float radius\" 2", "shapes"),
        ("\"xresolution\" 8", "\"xresolution\" 9", "film"),
        ("WorldBegin", "PixelFilter \"triangle\" WorldBegin", "filter"),
        ("WorldBegin", "Integrator \"path\" \"integer maxdepth\" 3 WorldBegin", "maxdepth"),
    ] {
        let from = from.replace("\"xres", "\"integer xres");
        let other = Scene::parse(&text.replace(&from, &to.replace("\"xres", "\"integer xres"))).unwrap();
        let what = changed(first(&other).resume(film()).run());
        assert!(what.contains(expected), "{expected}: {what}");
    }
    // What changes no sample is no other scene.
    let same = text.replace("a.exr", "b.exr").replace("WorldBegin", "WorldBegin # a comment\n");
    let same = Scene::parse(&same).unwrap();
    first(&same).resume(film()).run().unwrap();
    let what = changed(first(&scene).seed(2).resume(film()).run());
    assert!(what.contains("the seed was 1, and is 2 now"), "{what}");
    let what = changed(first(&scene).adaptive(true).resume(film()).run());
    assert!(what.contains("adaptive"), "{what}");
    let what = changed(first(&scene).channels(ChannelSet::all()).resume(film()).run());
    assert!(what.contains("channels"), "{what}");
    let what =
        changed(first(&scene).sampler(wavepath::engine::SamplerKind::Independent).resume(film()).run());
    assert!(what.contains("sampler"), "{what}");
}

#[test]
fn files_of_the_scene_are_known_by_their_bytes() {
    let folder = Folder::new("inputs");
    let (main, part, mesh) = (folder.file("a.pbrt"), folder.file("part.pbrt"), folder.file("m.ply"));
    let ply = |x: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n{x} 0 0\n0 1 0\n3 0 1 2\n"
        )
    };
    fs::write(&mesh, ply("1")).unwrap();
    fs::write(&part, "Shape \"plymesh\" \"string filename\" \"m.ply\"\n").unwrap();
    let text = "Camera \"perspective\" Film \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 8\n\
                WorldBegin LightSource \"infinite\" Include \"part.pbrt\"\n";
    fs::write(&main, text).unwrap();
    let film = folder.file("a.film");
    let scene = Scene::open(&main).unwrap();
    Render::new(&scene).spp(2).run().unwrap().save_film(&scene, &film).unwrap();
    let resume = || {
        let scene = Scene::open(&main).unwrap();
        Render::new(&scene).spp(2).resume(FilmFile::read(&film).unwrap()).run()
    };
    resume().unwrap();
    fs::write(&mesh, ply("2")).unwrap();
    let what = changed(resume());
    assert!(what.contains("file m.ply") && what.contains("meshes"), "{what}");
    fs::write(&mesh, ply("1")).unwrap();
    fs::write(&part, "Translate 0 0 1 Shape \"plymesh\" \"string filename\" \"m.ply\"\n").unwrap();
    let what = changed(resume());
    assert!(what.contains("part.pbrt"), "{what}");
}

/// Pictures made in code have no file: they are known by their texels.
#[test]
fn pictures_are_known_by_their_texels() {
    use wavepath::picture::{Raster, RasterSamples};
    use wavepath::scene::SceneDescription;
    let scene = |light: u8| {
        let film = wavepath::scene::Film::whole(8, 8);
        let mut description = SceneDescription { film, ..SceneDescription::default() };
        let picture = Raster::new(1, 1, 1, RasterSamples::Bytes(vec![light])).unwrap();
        description.add_light_image(Arc::new(picture));
        Scene::new("made", description).unwrap()
    };
    let [a, b, again] = [scene(1), scene(2), scene(1)];
    let identity = |scene: &Scene| scene.identity().unwrap().clone();
    assert_eq!(identity(&a).changes(&identity(&b)), ["pictures of lights"]);
    assert!(identity(&a).changes(&identity(&again)).is_empty());
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let folder = Folder::new("refused");
    let scene = scene("box");
    let save = |name: &str, render: Render| {
        let file = folder.file(name);
        render.run().unwrap().save_film(&scene, &file).unwrap();
        file
    };
    let [a, b, c] = [
        save("a.film", render(&scene).samples(0..8)),
        save("b.film", render(&scene).samples(6..12)),
        save("c.film", render(&scene).samples(12..16)),
    ];
    let error = FilmFile::merge(&[&a, &b]).unwrap_err();
    assert!(matches!(&error, FilmFileError::Overlap { file, .. } if file.contains("b.film")), "{error}");
    assert!(matches!(FilmFile::merge(&[&a, &a]), Err(FilmFileError::Overlap { .. })));
    let with_gap = FilmFile::merge(&[&c, &a]).unwrap();
    let gaps = Gap::of(&with_gap.film, None);
    assert_eq!(gaps, [Gap { samples: 8..12, blocks: (0..6).collect() }]);
    let held = Holding::of(&with_gap.film);
    assert_eq!((held.len(), &held[0].samples), (1, &vec![0..8, 12..16]));
    let independent = render(&scene).sampler(wavepath::engine::SamplerKind::Independent);
    let d = save("d.film", independent.samples(12..16));
    let error = FilmFile::merge(&[&a, &d]).unwrap_err().to_string();
    assert!(error.contains("sampler sobol and independent"), "{error}");
    let other = self::scene("triangle");
    let e = folder.file("e.film");
    render(&other).samples(12..16).run().unwrap().save_film(&other, &e).unwrap();
    let error = FilmFile::merge(&[&a, &e]).unwrap_err().to_string();
    assert!(error.contains("different scenes (filter)"), "{error}");
}

/// Renders of other seeds are averaged by their samples; none of them counts twice.
#[test]
fn independent_renders_are_averaged() {
    let folder = Folder::new("seeds");
    let scene = scene("box");
    let mut files = Vec::new();
    let mut pictures = Vec::new();
    for (seed, spp) in [(9, 64), (2, 64), (5, 192)] {
        let file = folder.file(&format!("{seed}.film"));
        let picture = render(&scene).seed(seed).spp(spp).run().unwrap();
        picture.save_film(&scene, &file).unwrap();
        files.push(file);
        pictures.push((picture, f64::from(spp)));
    }
    let all = FilmFile::merge(&files).unwrap();
    assert_eq!(all.film.header().seeds().collect::<Vec<_>>(), [2, 5, 9]);
    let bytes = all.film.to_bytes();
    let merged = all.into_picture();
    assert_eq!(merged.report().spp, 320.0);
    for (k, pixel) in merged.image().pixels.iter().enumerate() {
        for (c, value) in pixel.iter().enumerate() {
            let sum: f64 = pictures.iter().map(|(p, spp)| spp * f64::from(p.image().pixels[k][c])).sum();
            assert!((f64::from(*value) - sum / 320.0).abs() < 1e-6 * (1.0 + sum / 320.0));
        }
    }
    // The estimate of the error holds: against many samples, and within the factor that one picture of 960 pixels allows.
    let reference = render(&scene).seed(77).spp(1 << 14).run().unwrap();
    let squared = |(own, other): (&[f32; 3], &[f32; 3])| -> f64 {
        let of = |c: usize| f64::from(own[c] - other[c]).powi(2) / (f64::from(other[c]).powi(2) + 0.01);
        (of(0) + of(1) + of(2)) / 3.0
    };
    let pairs = merged.image().pixels.iter().zip(&reference.image().pixels);
    let error = pairs.map(squared).sum::<f64>() / merged.image().pixels.len() as f64;
    let ratio = merged.error().relmse() / error;
    assert!((0.6..1.7).contains(&ratio), "{ratio}");
    // In any order and grouping.
    let pair = folder.file("pair.film");
    FilmFile::merge(&[&files[2], &files[0]]).unwrap().write(&pair).unwrap();
    let again = FilmFile::merge(&[&files[1], &pair]).unwrap();
    assert!(again.film.to_bytes() == bytes);
    assert!(matches!(FilmFile::merge(&[&pair, &files[0]]), Err(FilmFileError::Overlap { .. })));
    // One of several seeds cannot be gone on with.
    let what = changed(render(&scene).seed(5).resume(FilmFile::read(&pair).unwrap()).run());
    assert!(what.contains("seed was 5, 9"), "{what}");
}

/// A film file of a few pixels, with all that one can have.
fn small(folder: &Folder) -> PathBuf {
    let text = r#"Film "rgb" "integer xresolution" 5 "integer yresolution" 3 Camera "perspective"
        PixelFilter "mitchell" WorldBegin LightSource "infinite" Shape "sphere""#;
    let scene = Scene::parse(text).unwrap();
    let picture = render(&scene).adaptive(true).spp(6).run().unwrap();
    let file = folder.file("small.film");
    picture.save_film(&scene, &file).unwrap();
    file
}

fn read(path: &Path) -> Result<FilmFile, FilmFileError> {
    FilmFile::read(path)
}

#[test]
fn every_flipped_bit_and_every_cut_is_found() {
    let folder = Folder::new("damaged");
    let bytes = fs::read(small(&folder)).unwrap();
    let damaged = folder.file("damaged.film");
    let mut random = Random(11);
    for at in 0..bytes.len() {
        let mut copy = bytes.clone();
        copy[at] ^= 1 << random.below(8);
        fs::write(&damaged, &copy).unwrap();
        let error = read(&damaged).err().unwrap_or_else(|| panic!("byte {at} of {}", bytes.len()));
        assert!(error.to_string().contains("damaged.film"), "{error}");
    }
    for length in 0..bytes.len() {
        fs::write(&damaged, &bytes[..length]).unwrap();
        assert!(matches!(read(&damaged), Err(FilmFileError::Format { .. })), "cut at {length}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    fs::write(&damaged, &longer).unwrap();
    assert!(read(&damaged).unwrap_err().to_string().contains("behind its end"));
    // A newer version says so.
    let mut newer = bytes;
    newer[16] = 2;
    fs::write(&damaged, &newer).unwrap();
    assert!(read(&damaged).unwrap_err().to_string().contains("newer program"));
    assert!(matches!(read(&folder.file("none.film")), Err(FilmFileError::Read { .. })));
    assert!(matches!(read(&folder.0), Err(FilmFileError::Read { .. })));
}
