//! Signals that end a process: the first asks for an orderly end, a second one ends it at once.
//!
//! They are Ctrl-C and a request to terminate, the terminal's end, and those that batch systems send some time before they
//! kill a job. One that was ignored when the process began (`nohup`) stays ignored.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The signal that came first; 0: none yet.
static CAUGHT: AtomicI32 = AtomicI32::new(0);

/// The flag that a signal raises; a second one exits with status 128 + its number, having removed what is half written.
/// One of another kind within a second of the first is not a second one: batch systems send several at once.
///
/// The first call installs the handler, later ones return the same flag.
///
/// # Errors
/// If the system refuses the handler.
pub fn flag() -> io::Result<Arc<AtomicBool>> {
    static FLAG: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);
    let mut installed = FLAG.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(flag) = &*installed {
        return Ok(Arc::clone(flag));
    }
    let flag = Arc::new(AtomicBool::new(false));
    install(Arc::clone(&flag))?;
    *installed = Some(Arc::clone(&flag));
    Ok(flag)
}

/// The signal that raised the flag: its number and its name.
pub fn caught() -> Option<(i32, &'static str)> {
    let signal = CAUGHT.load(Ordering::Relaxed);
    let name = SIGNALS.iter().find(|(number, _)| *number == signal).map(|(_, name)| *name);
    (signal != 0).then_some((signal, name.unwrap_or("a signal")))
}

#[cfg(unix)]
const SIGNALS: [(i32, &str); 6] = {
    use signal_hook::consts::signal::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
    [
        (SIGINT, "SIGINT"),
        (SIGTERM, "SIGTERM"),
        (SIGHUP, "SIGHUP"),
        (SIGUSR1, "SIGUSR1"),
        (SIGUSR2, "SIGUSR2"),
        (nix::libc::SIGXCPU, "SIGXCPU"),
    ]
};

#[cfg(not(unix))]
const SIGNALS: [(i32, &str); 2] =
    [(signal_hook::consts::SIGINT, "SIGINT"), (signal_hook::consts::SIGTERM, "SIGTERM")];

#[cfg(unix)]
fn install(flag: Arc<AtomicBool>) -> io::Result<()> {
    use std::time::{Duration, Instant};
    let wanted = SIGNALS.iter().map(|(signal, _)| *signal).filter(|signal| !is_ignored(*signal));
    let mut signals = signal_hook::iterator::Signals::new(wanted)?;
    // A file that grows beyond a limit (`ulimit -f`) is an error of its writing, not the end of the process.
    let beyond = nix::libc::SIGXFSZ;
    if !is_ignored(beyond) {
        signal_hook::flag::register(beyond, Arc::default())?;
    }
    let handle = move || {
        let mut first = None;
        for signal in signals.forever() {
            match first {
                None => {
                    first = Some((signal, Instant::now()));
                    CAUGHT.store(signal, Ordering::Relaxed);
                    flag.store(true, Ordering::SeqCst);
                }
                Some((other, at)) if other != signal && at.elapsed() < Duration::from_secs(1) => {}
                Some(_) => {
                    crate::atomic_file::abandon();
                    signal_hook::low_level::exit(128 + signal);
                }
            }
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(handle).map(drop)
}

/// Whether the process was started with a signal ignored.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<nix::libc::sigaction>::zeroed();
    // SAFETY: without a new action nothing changes; all bytes of the old one may be zero.
    unsafe {
        nix::libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == nix::libc::SIG_IGN
    }
}

#[cfg(not(unix))]
fn install(flag: Arc<AtomicBool>) -> io::Result<()> {
    for (signal, _) in SIGNALS {
        // In this order: a second one finds the flag raised.
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&flag))?;
        signal_hook::flag::register(signal, Arc::clone(&flag))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_one_flag_and_it_is_down() {
        let (first, second) = (flag().unwrap(), flag().unwrap());
        assert!(Arc::ptr_eq(&first, &second) && !first.load(Ordering::Relaxed));
        assert_eq!(caught(), None);
    }
}
