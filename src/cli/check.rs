//! `wavepath check`: what in a scene is numerically dangerous, or probably a mistake.

use super::args::CheckArgs;
use super::{Failure, open, output};
use crate::check;
use crate::pbrt::LoadOptions;

/// Prints what was found. Findings are no failure.
pub(super) fn run(args: &CheckArgs) -> Result<(), Failure> {
    let options = LoadOptions { set: args.set.clone(), ..LoadOptions::default() };
    let loaded = open::load(&args.scene, &options, args.json)?;
    let report = check::check(&args.scene.display().to_string(), &loaded);
    if args.json {
        output::say(serde_json::to_string_pretty(&report).expect("numbers and names"))
    } else {
        output::say(report)
    }
}
