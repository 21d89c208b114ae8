//! What the machine says of itself: its processor and the memory this process used.

use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

/// Threads that a render takes if nothing else is said: one for each processor.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Name of the processor: its brand string where the system tells it, else the architecture.
pub fn cpu_name() -> String {
    brand_from_cpuid().or_else(brand_from_proc).unwrap_or_else(|| std::env::consts::ARCH.into())
}

/// Most memory that this process has had resident so far, in bytes; `None` where only Linux tells.
pub fn peak_memory_bytes() -> Option<u64> {
    peak_from_status(&fs::read_to_string("/proc/self/status").ok()?)
}

/// Date and time, `YYYY:MM:DD hh:mm:ss` in universal time, as OpenEXR has it; `None` if the clock is not set.
pub fn utc_now() -> Option<String> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    Some(utc(now.as_secs()))
}

/// Seconds since 1970, without leap seconds, as date and time (Hinnant, "chrono-compatible low-level date algorithms").
fn utc(seconds: u64) -> String {
    let (day, second) = (seconds / 86_400 + 719_468, seconds % 86_400);
    // Years begin in March here, so that the leap day is the last one.
    let (era, day) = (day / 146_097, day % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, later) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = 400 * era + year + later;
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}:{month:02}:{day:02} {hour:02}:{minute:02}:{second:02}")
}

/// The line `VmHWM:   123456 kB` of `/proc/self/status`, in bytes.
fn peak_from_status(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// Leaves 0x8000_0002 to 0x8000_0004 of CPUID: 48 bytes of text.
#[cfg(target_arch = "x86_64")]
// Newer compilers have the intrinsic as safe; the oldest supported one wants the block.
#[allow(unused_unsafe)]
fn brand_from_cpuid() -> Option<String> {
    use std::arch::x86_64::__cpuid;
    // SAFETY: every x86-64 processor has the CPUID instruction.
    let leaf = |number| unsafe { __cpuid(number) };
    if leaf(0x8000_0000).eax < 0x8000_0004 {
        return None;
    }
    let registers = (0x8000_0002..=0x8000_0004).map(leaf);
    let words = registers.flat_map(|r| [r.eax, r.ebx, r.ecx, r.edx]);
    let bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
    tidy(&String::from_utf8_lossy(&bytes))
}

#[cfg(not(target_arch = "x86_64"))]
fn brand_from_cpuid() -> Option<String> {
    None
}

fn brand_from_proc() -> Option<String> {
    let info = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = info.lines().find(|line| line.starts_with("model name"))?;
    tidy(line.split_once(':')?.1)
}

/// Without padding: up to the first NUL, single spaces; `None` if nothing is left.
fn tidy(brand: &str) -> Option<String> {
    let text = brand.split('\0').next().unwrap_or("");
    let words: Vec<&str> = text.split_whitespace().collect();
    (!words.is_empty()).then(|| words.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_has_a_printable_name() {
        let name = cpu_name();
        assert!(!name.is_empty() && !name.contains('\0') && name.trim() == name, "{name:?}");
    }

    #[test]
    fn dates() {
        assert_eq!(utc(0), "1970:01:01 00:00:00");
        assert_eq!(utc(951_782_399), "2000:02:28 23:59:59");
        assert_eq!(utc(951_868_800), "2000:03:01 00:00:00");
        assert_eq!(utc(1_709_164_800), "2024:02:29 00:00:00");
        assert_eq!(utc(4_102_444_799), "2099:12:31 23:59:59");
    }

    #[test]
    fn padding_is_removed() {
        assert_eq!(tidy("  Intel(R)  Xeon(R) \0\0x").as_deref(), Some("Intel(R) Xeon(R)"));
        assert_eq!(tidy(" \0"), None);
    }

    #[test]
    fn peak_memory_is_read_in_bytes() {
        let status = "Name:\tx\nVmHWM:\t    2048 kB\nVmRSS:\t 1 kB\n";
        assert_eq!(peak_from_status(status), Some(2 << 20));
        assert_eq!(peak_from_status("Name: x"), None);
        if cfg!(target_os = "linux") {
            assert!(peak_memory_bytes().unwrap() > 100_000);
        }
    }
}
