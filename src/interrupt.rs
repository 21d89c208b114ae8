//! Ctrl-C: the first asks for an orderly end, the second ends the process.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Exit status of a process ended by an interrupt: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

/// The flag that Ctrl-C (or a request to terminate) raises; a second one exits with status 130.
///
/// The first call installs the handler, later ones return the same flag.
///
/// # Errors
/// If the system refuses the handler, or another one is installed already.
pub fn flag() -> io::Result<Arc<AtomicBool>> {
    static FLAG: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);
    let mut installed = FLAG.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(flag) = &*installed {
        return Ok(Arc::clone(flag));
    }
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            crate::atomic_file::abandon();
            std::process::exit(INTERRUPTED);
        }
    })
    .map_err(io::Error::other)?;
    *installed = Some(Arc::clone(&flag));
    Ok(flag)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_one_flag_and_it_is_down() {
        let (first, second) = (flag().unwrap(), flag().unwrap());
        assert!(Arc::ptr_eq(&first, &second) && !first.load(Ordering::Relaxed));
    }
}
