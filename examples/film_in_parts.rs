//! Renders in parts, as several machines would, and adds their films: the same bits as in one piece.
//!
//!     cargo run --release --example film_in_parts

use std::error::Error;
use wavepath::film::Film;
use wavepath::scene::SceneOptions;
use wavepath::{Render, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell.pbrt");
    let small = SceneOptions { resolution: Some([48, 48]), ..SceneOptions::default() };
    let scene = Scene::open_with(path, &small)?;
    let whole = Render::new(&scene).samples(0..64).run()?;

    // Each part as bytes, to be sent or kept; in any order.
    let mut parts = Vec::new();
    for part in [40..64, 0..16, 16..40] {
        parts.push(Render::new(&scene).samples(part).run()?.film().to_bytes());
    }
    let sum = Film::from_bytes(&parts[0])?;
    for part in &parts[1..] {
        sum.merge(&Film::from_bytes(part)?)?;
    }
    assert_eq!(sum.develop().pixels, whole.image().pixels);
    assert_eq!(sum.to_bytes(), whole.film().to_bytes());

    // No sample counts twice.
    let error = sum.merge(&Film::from_bytes(&parts[1])?).expect_err("it is in the sum already");
    println!("{} bytes, relMSE {:.2e}; once more: {error}", parts[0].len(), whole.error().relmse());
    Ok(())
}
