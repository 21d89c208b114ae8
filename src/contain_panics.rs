//! Panics of foreign decoders on damaged input, turned into ordinary failures.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// The result of `work`, or `None` if it panicked; nothing is printed in that case.
///
/// Only for code of others that decodes untrusted bytes on this thread: a panic of our own is a
/// bug and has to be seen.
pub fn contain_panics<T>(work: impl FnOnce() -> T) -> Option<T> {
    install_hook();
    let outer = CONTAINED.replace(true);
    // Unwind safety: nothing that `work` captured is used after a panic.
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    CONTAINED.set(outer);
    result.ok()
}

/// Puts a hook before the present one that is silent on threads inside [`contain_panics`].
fn install_hook() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !CONTAINED.get() {
                previous(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_none_and_the_rest_goes_on() {
        assert_eq!(contain_panics(|| 3), Some(3));
        let empty: &[i32] = std::hint::black_box(&[]);
        assert_eq!(contain_panics(|| empty[1]), None);
        assert!(!CONTAINED.get());
    }
}
