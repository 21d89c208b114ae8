//! How much memory a scene or a film may take: more is an error, where the system would end the process. And an end
//! with a message where memory runs out all the same.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Where the system does not tell.
const DEFAULT: u64 = 16 << 30;

/// Bytes that one scene may take: three quarters of what was available at first asking.
pub(crate) fn limit() -> u64 {
    static LIMIT: OnceLock<u64> = OnceLock::new();
    *LIMIT.get_or_init(|| available().map_or(DEFAULT, |bytes| bytes / 4 * 3))
}

/// The least of what the machine has free, what the control groups of the process leave it (containers, batch
/// systems), and what its resource limits do (`ulimit -v`, `ulimit -d`).
fn available() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let (groups, status) = (read("/proc/self/cgroup"), read("/proc/self/status"));
    let root = Path::new("/sys/fs/cgroup");
    let [space, data] = resource_limits();
    [
        kibibytes(&read("/proc/meminfo"), "MemAvailable:"),
        in_control_groups(&groups, root),
        left(space, kibibytes(&status, "VmSize:")),
        left(data, kibibytes(&status, "VmData:")),
    ]
    .into_iter()
    .flatten()
    .min()
}

/// The value of the line that begins with `name` in a file of `/proc`, in bytes.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// A limit less what is used of it.
fn left(limit: Option<u64>, used: Option<u64>) -> Option<u64> {
    Some(limit?.saturating_sub(used.unwrap_or(0)))
}

/// Limits of the address space and of the data of this process; none where there is no limit.
fn resource_limits() -> [Option<u64>; 2] {
    #[cfg(target_os = "linux")]
    {
        use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
        [Resource::RLIMIT_AS, Resource::RLIMIT_DATA].map(|resource| {
            let (soft, _) = getrlimit(resource).ok()?;
            (soft != RLIM_INFINITY).then_some(soft)
        })
    }
    #[cfg(not(target_os = "linux"))]
    [None; 2]
}

/// What the memory controllers leave to this process. `groups` is `/proc/self/cgroup`: lines `0::/path` for version 2,
/// `4:cpu,memory:/path` for version 1. Every group above has its own limit; those that are not visible from inside of a
/// container are above its root.
fn in_control_groups(groups: &str, root: &Path) -> Option<u64> {
    let of_line = |line: &str| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, path) = (parts.next()?, parts.next()?);
        if controllers.is_empty() {
            // Some systems mount version 2 beside version 1.
            let unified = least_left(&root.join("unified"), path, &VERSION_2);
            return [least_left(root, path, &VERSION_2), unified].into_iter().flatten().min();
        }
        let mut all = controllers.split(',');
        all.any(|name| name == "memory").then(|| least_left(&root.join("memory"), path, &VERSION_1))?
    };
    groups.lines().filter_map(of_line).min()
}

/// The files of a group: its limit, what is used, and the entry of its statistics for cached files that can be dropped.
struct GroupFiles {
    limit: &'static str,
    used: &'static str,
    reclaimable: &'static str,
}

const VERSION_1: GroupFiles = GroupFiles {
    limit: "memory.limit_in_bytes",
    used: "memory.usage_in_bytes",
    reclaimable: "total_inactive_file",
};
const VERSION_2: GroupFiles =
    GroupFiles { limit: "memory.max", used: "memory.current", reclaimable: "inactive_file" };

/// The least that any group from `path` up to the root of the mount leaves.
fn least_left(mount: &Path, path: &str, files: &GroupFiles) -> Option<u64> {
    let mut group = PathBuf::new();
    let mut folders = vec![mount.to_path_buf()];
    for part in Path::new(path).components() {
        if let Component::Normal(name) = part {
            group.push(name);
            folders.push(mount.join(&group));
        }
    }
    let number =
        |folder: &Path, name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
    let of_group = |folder: PathBuf| {
        // "max", or the largest number of pages: no limit.
        let limit = number(&folder, files.limit).filter(|&limit| limit < 1 << 60)?;
        let statistics = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
        let entries = || statistics.lines().filter_map(|line| line.split_once(' '));
        let reclaimable = entries()
            .find(|(name, _)| *name == files.reclaimable)
            .and_then(|(_, bytes)| bytes.trim().parse::<u64>().ok());
        let used = number(&folder, files.used).unwrap_or(0).saturating_sub(reclaimable.unwrap_or(0));
        Some(limit.saturating_sub(used))
    };
    folders.into_iter().filter_map(of_group).min()
}

/// For messages.
pub(crate) fn in_gib(bytes: u64) -> String {
    let gib = bytes as f64 / f64::from(1 << 30);
    if gib < 0.1 { format!("{gib:.3} GiB") } else { format!("{gib:.1} GiB") }
}

/// The system's allocator for a command: an allocation that fails ends the process with a message and status 1, where
/// the standard library would abort it. Files that are half written are removed.
///
/// Estimates come first (a film, a mesh that is too large is told with its size); this is for what no estimate
/// foresaw.
#[derive(Debug, Clone, Copy, Default)]
pub struct Allocator;

/// Ends the process, if it can be.
#[cold]
fn out_of_memory(bytes: usize) -> ! {
    static ENDING: AtomicBool = AtomicBool::new(false);
    if !ENDING.swap(true, Ordering::SeqCst) {
        // On the stack, and without a lock: whoever holds it may be waiting for memory.
        let mut message = [0; 96];
        let mut rest = &mut message[..];
        let _ = writeln!(rest, "error: out of memory: {bytes} bytes more were refused by the system");
        let unused = rest.len();
        let used = message.len() - unused;
        print_raw(&message[..used]);
        crate::atomic_file::abandon();
    }
    exit_now()
}

#[cfg(unix)]
fn print_raw(message: &[u8]) {
    // SAFETY: descriptor 2 is standard error for as long as the process lives.
    let _ = nix::unistd::write(unsafe { std::os::fd::BorrowedFd::borrow_raw(2) }, message);
}

#[cfg(not(unix))]
fn print_raw(message: &[u8]) {
    let _ = std::io::stderr().write_all(message);
}

#[cfg(unix)]
fn exit_now() -> ! {
    // SAFETY: ends the process; nothing of it is used any more.
    unsafe { nix::libc::_exit(1) }
}

#[cfg(not(unix))]
fn exit_now() -> ! {
    std::process::exit(1)
}

#[inline(always)]
fn checked(pointer: *mut u8, bytes: usize) -> *mut u8 {
    if pointer.is_null() { out_of_memory(bytes) } else { pointer }
}

// SAFETY: everything is passed on to the system's allocator; a null pointer is never returned, which is allowed.
unsafe impl GlobalAlloc for Allocator {
    #[inline]
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised by the caller.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }

    #[inline]
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised by the caller.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    #[inline]
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as promised by the caller.
        checked(unsafe { System.realloc(pointer, layout, size) }, size)
    }

    #[inline]
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as promised by the caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::TestFolder;

    #[test]
    fn files_of_proc_are_read_in_bytes() {
        let text = "Name:\tx\nVmSize:\t    2048 kB\nVmData:\t 1 kB\n";
        assert_eq!(kibibytes(text, "VmSize:"), Some(2 << 20));
        assert_eq!(kibibytes(text, "VmPeak:"), None);
        assert_eq!(left(Some(10), Some(4)), Some(6));
        assert_eq!(left(Some(10), Some(40)), Some(0));
        assert_eq!(left(None, Some(4)), None);
        assert!(limit() > 0);
    }

    #[test]
    fn the_tightest_group_counts() {
        let folder = TestFolder::new("memory-groups");
        let write = |name: &str, text: &str| {
            let path = folder.file(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let root = folder.file("");
        assert_eq!(in_control_groups("0::/a/b\n", &root), None);
        // Version 2: the group's parent has the limit; what is cached can be dropped.
        write("a/b/memory.max", "max\n");
        write("a/memory.max", "1000000\n");
        write("a/memory.current", "600000\n");
        write("a/memory.stat", "anon 1\ninactive_file 100000\n");
        assert_eq!(in_control_groups("0::/a/b\n", &root), Some(500_000));
        write("a/b/memory.max", "300000\n");
        assert_eq!(in_control_groups("0::/a/b\n", &root), Some(300_000));
        // Version 1, seen from inside of a container whose path is not visible.
        write("memory/memory.limit_in_bytes", "70000\n");
        write("memory/memory.usage_in_bytes", "20000\n");
        let groups = "4:cpuset,memory:/docker/0123\n1:name=systemd:/x\n";
        assert_eq!(in_control_groups(groups, &root), Some(50_000));
        write("memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(in_control_groups(groups, &root), None);
        // More is used than allowed.
        write("memory/memory.limit_in_bytes", "10000\n");
        assert_eq!(in_control_groups(groups, &root), Some(0));
    }
}
