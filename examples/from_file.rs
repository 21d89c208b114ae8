//! Renders a scene file, and says how good the picture is.
//!
//!     cargo run --release --example from_file -- scenes/cornell.pbrt cornell.exr
//!
//! Without arguments it renders a small Cornell box into the folder for temporary files.

use std::error::Error;
use wavepath::scene::SceneOptions;
use wavepath::{Render, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (scene, output) = match (arguments.next(), arguments.next()) {
        (Some(scene), Some(output)) => (Scene::open(scene)?, output.into()),
        _ => {
            let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell.pbrt");
            let small = SceneOptions { resolution: Some([64, 64]), ..SceneOptions::default() };
            (Scene::open_with(path, &small)?, std::env::temp_dir().join("wavepath-cornell.exr"))
        }
    };
    for warning in scene.warnings() {
        eprintln!("{warning}");
    }
    let picture = Render::new(&scene).spp(64).seed(1).run()?;
    picture.save(&output)?;
    let [low, high] = picture.error().interval();
    println!("{}: relMSE {:.2e} ({low:.2e} to {high:.2e})", output.display(), picture.error().relmse());
    Ok(())
}
