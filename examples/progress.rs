//! Watches a render, and ends it before all samples are taken.
//!
//!     cargo run --release --example progress

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Duration;
use wavepath::scene::SceneOptions;
use wavepath::{Render, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/two-spheres.pbrt");
    let options = SceneOptions { resolution: Some([128, 128]), ..SceneOptions::default() };
    let scene = Scene::open_with(path, &options)?;
    let picture = Render::new(&scene)
        .spp(1 << 20)
        .on_update(|update| {
            let error = update.error().map_or("not known yet".into(), |error| format!("{error:.1e}"));
            println!("{} samples, {} rays, relMSE {error}", update.samples, update.rays);
            if update.elapsed < Duration::from_millis(500) {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        })
        .run()?;
    println!("ended by {} after {:.0} spp", picture.ended().name(), picture.report().spp);
    Ok(())
}
