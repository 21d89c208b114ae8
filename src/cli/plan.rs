//! `wavepath plan`: what a scene needs, and what is left out.

use super::args::PlanArgs;
use super::open::{load, open};
use super::{Failure, output};
use crate::engine::wavefront;
use crate::film::Film;
use crate::machine;
use crate::memory;
use crate::pbrt::LoadOptions;
use crate::scene::SceneOptions;

/// Prints the plan.
pub(super) fn run(args: &PlanArgs) -> Result<(), Failure> {
    if args.names {
        return names(args);
    }
    let options = SceneOptions {
        spherical_lights: args.spherical_lights.into(),
        lenient: args.lenient,
        set: args.frame.set.clone(),
        ..SceneOptions::default()
    };
    let scene = open(&args.scene, &options, &args.frame, args.json)?;
    let (description, plan) = (scene.description(), scene.plan());
    let film = &description.film;
    let spp = args.spp.unwrap_or(description.sampler.pixel_samples);
    let [x0, x1, y0, y1] = film.pixel_bounds;
    let pixels = (x1 - x0) as u64 * (y1 - y0) as u64;
    let bytes = Film::bytes_for_render(film.frame(), plan.requirements(), Some(spp));
    let threads = args.threads.unwrap_or_else(machine::threads);
    let batch = args.batch.unwrap_or(wavefront::DEFAULT_BATCH);
    let queues =
        threads as u64 * (batch as u64 * plan.bytes_per_path as u64 + plan.shadow_queue_bytes as u64);
    let (scene_bytes, free) = (plan.geometry_bytes as u64, memory::limit());
    let all = bytes + scene_bytes + queues;
    if args.json {
        let mut json = plan.to_json();
        json["film_bytes"] = bytes.into();
        json["queue_bytes"] = queues.into();
        json["checkpoint_bytes"] = bytes.into();
        json["free_bytes"] = free.into();
        return output::say(format_args!("{json:#}"));
    }
    let replicates = Film::replicates_for_render(film.frame(), plan.requirements(), Some(spp));
    output::say(format_args!(
        "{plan}\nfilm            {pixels} pixels, {replicates} replicates at {spp} spp: {bytes} bytes\n\
         queues          {threads} threads x {batch} paths: {queues} bytes\n\
         checkpoint      at most {bytes} bytes on disk, and as many while the next one is written\n\
         memory          {all} bytes for film, primitives and queues, and the tree beside them; {free} are free{}",
        if all > free { ": it does not fit" } else { "" }
    ))
}

/// Prints what `--set` can change.
fn names(args: &PlanArgs) -> Result<(), Failure> {
    let options = LoadOptions { lenient: args.lenient, set: args.frame.set.clone(), list: true };
    let loaded = load(&args.scene, &options, args.json)?;
    if args.json {
        let names: serde_json::Map<_, _> =
            loaded.names.into_iter().map(|(name, value)| (name, value.into())).collect();
        return output::say(format_args!("{:#}", serde_json::Value::Object(names)));
    }
    let lines: Vec<String> = loaded.names.iter().map(|(name, value)| format!("{name}={value}")).collect();
    output::say(lines.join("\n"))
}
