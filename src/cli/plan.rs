//! `wavepath plan`: what a scene needs, and what is left out.

use super::args::PlanArgs;
use super::{Failure, output, render};
use crate::film::Film;
use crate::plan::Plan;
use crate::scene::SphericalLights;

/// Prints the plan.
pub(super) fn run(args: &PlanArgs) -> Result<(), Failure> {
    let (description, scene) = render::load(&args.scene, SphericalLights::Cone, None, args.json)?;
    let plan = Plan::new(&scene);
    let (film, spp) = (&description.film, description.sampler.pixel_samples);
    let [x0, x1, y0, y1] = film.pixel_bounds;
    let pixels = (x1 - x0) as u64 * (y1 - y0) as u64;
    let bytes = Film::bytes_for_render(film.frame(), plan.requirements, Some(spp));
    if args.json {
        let mut json = plan.to_json();
        json["film_bytes"] = bytes.into();
        return output::say(format_args!("{json:#}"));
    }
    let replicates = Film::replicates_for_render(film.frame(), plan.requirements, Some(spp));
    output::say(format_args!(
        "{plan}\nfilm            {pixels} pixels, {replicates} replicates at {spp} spp: {bytes} bytes"
    ))
}
