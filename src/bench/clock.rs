//! Clocks: wall, processor time of the process, and the time-stamp counter.

use std::time::{Duration, Instant};

/// Measures from its start on.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    wall: Instant,
    processor: Option<Duration>,
}

impl Clock {
    /// Starts now.
    pub fn start() -> Self {
        Clock { wall: Instant::now(), processor: processor_time() }
    }
    /// Seconds of wall clock since the start.
    pub fn wall(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }
    /// Seconds of processor time of all threads since the start; of wall clock where the system does not tell.
    pub fn processor(&self) -> f64 {
        match (self.processor, processor_time()) {
            (Some(from), Some(to)) => to.saturating_sub(from).as_secs_f64(),
            _ => self.wall(),
        }
    }
}

/// Processor time of this process so far.
#[cfg(unix)]
pub(super) fn processor_time() -> Option<Duration> {
    nix::time::clock_gettime(nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID).ok().map(Duration::from)
}

/// Processor time of this process so far.
#[cfg(not(unix))]
pub(super) fn processor_time() -> Option<Duration> {
    None
}

/// Ticks of the time-stamp counter in a second. It runs at a constant rate near the nominal frequency of the processor.
#[cfg(target_arch = "x86_64")]
pub(super) fn tsc_hertz() -> Option<f64> {
    // SAFETY: every x86-64 processor has the instruction.
    let ticks = || unsafe { core::arch::x86_64::_rdtsc() };
    let (from, wall) = (ticks(), Instant::now());
    std::thread::sleep(Duration::from_millis(50));
    Some((ticks() - from) as f64 / wall.elapsed().as_secs_f64())
}

/// No such counter here.
#[cfg(not(target_arch = "x86_64"))]
pub(super) fn tsc_hertz() -> Option<f64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_takes_wall_clock_but_no_processor() {
        let clock = Clock::start();
        std::thread::sleep(Duration::from_millis(20));
        assert!(clock.wall() >= 0.02);
        if cfg!(target_os = "linux") {
            assert!(clock.processor.is_some() && clock.processor() <= clock.wall() * 64.0);
        }
    }
}
