//! `wavepath plan`: what a scene needs, and what is left out.

use super::args::PlanArgs;
use super::{Failure, output, render};
use crate::plan::Plan;
use crate::scene::SphericalLights;

/// Prints the plan.
pub(super) fn run(args: &PlanArgs) -> Result<(), Failure> {
    let (_, scene) = render::load(&args.scene, SphericalLights::Cone, None, args.json)?;
    let plan = Plan::new(&scene);
    if args.json { output::say(format_args!("{:#}", plan.to_json())) } else { output::say(plan) }
}
