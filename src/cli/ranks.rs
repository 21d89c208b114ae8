//! Renders by the processes that a launcher has started together; in a program without the feature `mpi`, there are none.

use super::args::RenderArgs;
use super::{Failure, render};

#[cfg(feature = "mpi")]
pub(super) use crate::mpi::{Dealer, World};
#[cfg(not(feature = "mpi"))]
pub(super) use without::{Dealer, World};

/// Renders, alone or together.
pub(super) fn run(args: &RenderArgs) -> Result<(), Failure> {
    if let Some(threads) = args.threads {
        // What is not rendering keeps to it, too: reading, and compressing pictures. If the system does not give them,
        // the render will say so.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    }
    #[cfg(feature = "mpi")]
    if let Some(world) = World::join().map_err(Failure::Work)? {
        let ended = match world.rank() {
            0 => render::run(args, Some(&world)),
            _ => render::help(args, &world),
        };
        // All have come to an end in order.
        if let Err(failure @ Failure::Interrupted(..)) = ended {
            return Err(failure);
        }
        if let Err(failure) = ended {
            // What is wrong with the command line or a file is the same for all: rank 0 says so, and ends the others.
            if world.rank() > 0 {
                std::thread::sleep(std::time::Duration::from_secs(5));
                super::output::note(format_args!("rank {}: {}", world.rank(), failure.to_diagnostic()));
            } else {
                super::output::note(failure.to_diagnostic());
            }
            world.abort(failure.exit_code());
        }
        return Ok(());
    }
    render::run(args, None)
}

/// What stands for MPI in a program without it.
#[cfg(not(feature = "mpi"))]
mod without {
    use crate::engine::Done;
    use crate::engine::schedule::Schedule;
    use crate::engine::stats::Stats;
    use crate::engine::team::Helpers;
    use crate::film::Film;
    use crate::render::Render;
    use crate::report::Rank;
    use std::time::Duration;

    /// There is none.
    pub enum World {}

    /// There is none.
    pub enum Dealer {}

    impl Dealer {
        pub(in super::super) fn new(world: &World, _: &Render, _: Option<Duration>) -> Result<Self, String> {
            match *world {}
        }
        pub(in super::super) fn finish(&self, _: Duration, _: f64, _: u64) -> Vec<Rank> {
            match *self {}
        }
    }

    impl Helpers for Dealer {
        fn workers(&self) -> usize {
            match *self {}
        }
        fn work(&self, _: &Schedule, _: &Film, _: &Done) -> Stats {
            match *self {}
        }
    }
}
