//! How much memory a scene or a film may take: more is an error, where the system would end the process.

use std::sync::OnceLock;

/// Where the system does not tell.
const DEFAULT: u64 = 16 << 30;

/// Bytes that one scene may take: three quarters of what was available at first asking.
pub(crate) fn limit() -> u64 {
    static LIMIT: OnceLock<u64> = OnceLock::new();
    *LIMIT.get_or_init(|| available().map_or(DEFAULT, |bytes| bytes / 4 * 3))
}

/// Linux only.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("MemAvailable:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok()?.checked_mul(1024)
}

/// For messages.
pub(crate) fn in_gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30))
}
