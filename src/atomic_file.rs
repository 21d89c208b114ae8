//! Files that appear whole or not at all.
//!
//! Contents go to a temporary file beside the target, which takes the target's name only when
//! everything is on disk. A reader therefore never meets half a file, and an earlier file of that
//! name stays as it was when the writing fails.
//!
//! What has the target's name already decides how:
//!
//! | there is | the contents |
//! |---|---|
//! | nothing | appear whole, under the rights that the system gives to new files |
//! | a file | appear whole, under the earlier file's rights; a file without write permission is refused |
//! | a symbolic link | go where it points to, as above; the link stays |
//! | a file with several names (hard links), or in a folder that takes no new files | replace its contents in place |
//! | a pipe, a device, an open descriptor (`/dev/stdout`, `/dev/fd/3`) | are written straight into it |
//!
//! The name `-` is standard output.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufWriter, Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// What an encoder writes to: formats such as OpenEXR go back to fill in tables.
pub trait WriteSeek: Write + Seek {}
impl<T: Write + Seek> WriteSeek for T {}

/// How long a pipe may be without a reader before it is given up.
const PATIENCE: Duration = Duration::from_secs(10);

/// Most links that are followed, as on Linux.
const MOST_LINKS: usize = 40;

/// Whether `path` stands for standard output: `-`, or `exr:-` and `png:-`, which name the format, too.
pub fn is_standard_output(path: &Path) -> bool {
    matches!(path.to_str(), Some("-" | "exr:-" | "png:-"))
}

/// Writes the file `path` with what `encode` produces; on any error nothing is left behind.
///
/// # Errors
/// Those of `encode`, and those of the file system.
pub fn write_whole<E: From<io::Error>>(
    path: &Path,
    encode: impl FnOnce(&mut dyn WriteSeek) -> Result<(), E>,
) -> Result<(), E> {
    let target = Target::of(path)?;
    let (path, earlier) = match &target {
        Target::File { path, earlier } if !target.is_shared() => match Temporary::beside(path) {
            Ok(temporary) => {
                write_and_rename(temporary, path, earlier.as_ref(), encode)?;
                return Ok(());
            }
            // The folder takes no new files, but this file can be written.
            Err(error) if earlier.is_none() => return Err(error.into()),
            Err(_) => (path, earlier),
        },
        Target::File { path, earlier } => (path, earlier),
        Target::Stream(path) => return to_stream(encode, || open_stream(path)),
        Target::StandardOutput => return to_stream(encode, || Ok(io::stdout().lock())),
    };
    debug_assert!(earlier.is_some());
    let mut bytes = Cursor::new(Vec::new());
    encode(&mut bytes)?;
    bytes.set_position(0);
    Ok(overwrite(path, &mut bytes)?)
}

/// As [`write_whole`], for files that must outlive a crash of the machine: the folder is brought to disk, too. The contents are
/// in one file of a name of their own until then, `.NAME.part`, which the next writing uses again if the process
/// is killed; two processes that write the same file at a time are told apart.
///
/// # Errors
/// Those of `encode`, and those of the file system; an earlier file is then as before. Pipes and devices are none.
pub fn write_durably<E: From<io::Error>>(
    path: &Path,
    encode: impl FnOnce(&mut dyn Write) -> Result<(), E>,
) -> Result<(), E> {
    let (path, earlier) = durable_target(path)?;
    let (temporary, file) = Temporary::of(&path)?;
    let mut writer = BufWriter::with_capacity(1 << 18, file);
    encode(&mut writer)?;
    let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
    if let Some(earlier) = &earlier {
        keep_rights(&file, earlier)?;
    }
    file.sync_all()?;
    temporary.rename_to(&path).map_err(|(_, error)| error)?;
    // The lock is held until the file has its name.
    drop(file);
    #[cfg(unix)]
    File::open(folder_of(&path))?.sync_all()?;
    Ok(())
}

/// Checks that [`write_durably`] could write `path`.
///
/// # Errors
/// As [`check_writable`].
pub fn check_durable(path: &Path) -> io::Result<()> {
    let (path, _) = durable_target(path)?;
    Temporary::of(&path).map(drop)
}

fn durable_target(path: &Path) -> io::Result<(PathBuf, Option<Metadata>)> {
    match Target::of(path)? {
        Target::File { path, earlier } => Ok((path, earlier)),
        _ => Err(describe(path, "is a pipe or a device, which cannot be replaced; expected a file")),
    }
}

fn write_and_rename<E: From<io::Error>>(
    (temporary, file): (Temporary, File),
    target: &Path,
    earlier: Option<&Metadata>,
    encode: impl FnOnce(&mut dyn WriteSeek) -> Result<(), E>,
) -> Result<(), E> {
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    encode(&mut writer)?;
    let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
    if let Some(earlier) = earlier {
        keep_rights(&file, earlier)?;
    }
    file.sync_all()?;
    drop(file);
    match temporary.rename_to(target) {
        // The target is a mount of its own, as containers have them.
        Err((temporary, error))
            if earlier.is_some()
                && matches!(error.kind(), io::ErrorKind::ResourceBusy | io::ErrorKind::CrossesDevices) =>
        {
            Ok(overwrite(target, &mut File::open(&temporary.path)?)?)
        }
        Err((_, error)) => Err(error.into()),
        Ok(()) => Ok(()),
    }
}

/// Replaces the contents of a file that stays where it is.
fn overwrite(path: &Path, contents: &mut impl Read) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).truncate(true).open(path)?;
    io::copy(contents, &mut file)?;
    file.sync_all()
}

/// Writes to what takes bytes in their order only.
fn to_stream<E: From<io::Error>, W: Write>(
    encode: impl FnOnce(&mut dyn WriteSeek) -> Result<(), E>,
    open: impl FnOnce() -> io::Result<W>,
) -> Result<(), E> {
    let mut bytes = Cursor::new(Vec::new());
    encode(&mut bytes)?;
    let mut stream = open()?;
    stream.write_all(bytes.get_ref())?;
    Ok(stream.flush()?)
}

/// Opens a pipe, a device or a descriptor. A pipe that nobody reads would block for ever: it gets [`PATIENCE`].
#[cfg(unix)]
fn open_stream(path: &Path) -> io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let append = is_descriptor(path);
    let open = |flags: i32| OpenOptions::new().write(true).append(append).custom_flags(flags).open(path);
    if !fs::metadata(path).is_ok_and(|metadata| is_fifo(&metadata)) {
        return open(0);
    }
    let started = Instant::now();
    loop {
        match open(nix::libc::O_NONBLOCK) {
            // Someone reads; from here on a slow reader is waited for.
            Ok(_nonblocking) => return open(0),
            Err(error) if error.raw_os_error() == Some(nix::libc::ENXIO) => {
                if started.elapsed() > PATIENCE {
                    return Err(io::Error::other("nobody reads from this pipe"));
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(error) => return Err(error),
        }
    }
}

#[cfg(not(unix))]
fn open_stream(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).open(path)
}

/// Checks that [`write_whole`] could write `path`: its folder exists and takes new files, a file that is there may be
/// written. A pipe or a device is not opened: its reader would take that for the end.
///
/// To be called before hours of work, not after.
///
/// # Errors
/// An error whose message says what is in the way.
pub fn check_writable(path: &Path) -> io::Result<()> {
    let target = Target::of(path)?;
    match &target {
        Target::StandardOutput => Ok(()),
        Target::Stream(path) if is_descriptor(path) => Ok(()),
        Target::Stream(path) => check_access(path),
        Target::File { path, earlier } => match Temporary::beside(path) {
            Err(error) if earlier.is_none() => Err(error),
            // It will be written in place.
            _ => Ok(()),
        },
    }
}

#[cfg(unix)]
fn check_access(path: &Path) -> io::Result<()> {
    Ok(nix::unistd::access(path, nix::unistd::AccessFlags::W_OK)?)
}

#[cfg(not(unix))]
fn check_access(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Whether both names stand for the same file, through links, too. Devices and pipes are never the same: nothing is
/// lost there.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    if is_standard_output(a) || is_standard_output(b) {
        return is_standard_output(a) && is_standard_output(b);
    }
    let (Ok(Target::File { path: a, earlier }), Ok(Target::File { path: b, earlier: other })) =
        (Target::of_any(a), Target::of_any(b))
    else {
        return false;
    };
    let folder = |path: &Path| fs::canonicalize(folder_of(path)).ok();
    a.file_name() == b.file_name() && folder(&a).is_some() && folder(&a) == folder(&b)
        || matches!((&earlier, &other), (Some(a), Some(b)) if same_inode(a, b))
}

/// Whether something has that name already that would lose its contents.
pub fn is_taken(path: &Path) -> bool {
    !is_standard_output(path) && matches!(Target::of_any(path), Ok(Target::File { earlier: Some(_), .. }))
}

/// What is written to.
enum Target {
    /// Standard output, called `-`.
    StandardOutput,
    /// A pipe, a device, or an open descriptor.
    Stream(PathBuf),
    /// A regular file: where all links have been followed, and what is there so far.
    File { path: PathBuf, earlier: Option<Metadata> },
}

impl Target {
    /// What `path` stands for, if it may be written.
    fn of(path: &Path) -> io::Result<Target> {
        let target = Target::of_any(path)?;
        if let Target::File { path, earlier } = &target {
            match earlier {
                // Root may write everything; a file that nobody may write is left alone all the same.
                Some(earlier) if earlier.permissions().readonly() => {
                    return Err(describe(path, "is write-protected"));
                }
                Some(_) => OpenOptions::new().write(true).open(path).map(drop)?,
                None => {}
            }
        }
        Ok(target)
    }

    /// The same without a look at permissions.
    fn of_any(path: &Path) -> io::Result<Target> {
        if is_standard_output(path) {
            return Ok(Target::StandardOutput);
        }
        let followed = follow_links(path)?;
        if is_descriptor(&followed) {
            // Descriptor 1 may be a file that the shell opened: what was printed before stays in front.
            let is_one = followed.file_name() == Some(OsStr::new("1"));
            return Ok(if is_one { Target::StandardOutput } else { Target::Stream(followed) });
        }
        let path = followed;
        match fs::metadata(&path) {
            Ok(metadata) if metadata.is_dir() => Err(describe(&path, "is a folder")),
            Ok(metadata) if metadata.is_file() => Ok(Target::File { path, earlier: Some(metadata) }),
            Ok(_) => Ok(Target::Stream(path)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                check_folder(folder_of(&path))?;
                Ok(Target::File { path, earlier: None })
            }
            Err(error) => Err(error),
        }
    }

    /// Whether the file has other names, which would keep the earlier contents if this one got a new file.
    fn is_shared(&self) -> bool {
        matches!(self, Target::File { earlier: Some(earlier), .. } if names(earlier) > 1)
    }
}

/// The end of a chain of symbolic links; it need not exist.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        if is_descriptor(&path) || !fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_symlink()) {
            return Ok(path);
        }
        let link = fs::read_link(&path)?;
        // A link that names an absolute path replaces all of it.
        path = folder_of(&path).join(link);
    }
    Err(describe(&path, "is behind too many links"))
}

/// Whether `path` is an entry of the list of open descriptors: a link that leads to no name.
fn is_descriptor(path: &Path) -> bool {
    let number = |name: &OsStr| name.to_str().is_some_and(|name| name.parse::<u32>().is_ok());
    cfg!(unix)
        && path.file_name().is_some_and(number)
        && fs::canonicalize(folder_of(path)).is_ok_and(|folder| {
            folder == Path::new("/dev/fd") || folder.starts_with("/proc") && folder.ends_with("fd")
        })
}

fn check_folder(folder: &Path) -> io::Result<()> {
    match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => Ok(()),
        Ok(_) => Err(describe(folder, "is not a folder")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Err(describe(folder, "does not exist; create the folder first"))
        }
        Err(error) => Err(error),
    }
}

#[cfg(unix)]
fn is_fifo(metadata: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_fifo()
}

#[cfg(unix)]
fn names(metadata: &Metadata) -> u64 {
    use std::os::unix::fs::MetadataExt;
    metadata.nlink()
}

#[cfg(not(unix))]
fn names(_: &Metadata) -> u64 {
    1
}

#[cfg(unix)]
fn same_inode(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn same_inode(_: &Metadata, _: &Metadata) -> bool {
    false
}

/// Gives the new file the rights of the earlier one; its owner, too, as far as the system allows that.
fn keep_rights(file: &File, earlier: &Metadata) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, fchown};
        let new = file.metadata()?;
        if (new.uid(), new.gid()) != (earlier.uid(), earlier.gid()) {
            // Only root may give files away: the group alone is often allowed.
            let _ = fchown(file, Some(earlier.uid()), Some(earlier.gid()))
                .or_else(|_| fchown(file, None, Some(earlier.gid())));
        }
    }
    // After the owner, whose change takes away the bits for running as that owner.
    file.set_permissions(earlier.permissions())
}

/// Temporary files that are there: to be removed if the process must end at once.
static PENDING: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files of all that is being written: before a process ends on the spot.
pub fn abandon() {
    // Whoever holds the list at this moment leaves a file behind; waiting could last for ever.
    if let Ok(mut pending) = PENDING.try_lock() {
        for path in pending.drain(..) {
            let _ = fs::remove_file(path);
        }
    }
}

fn pending() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    PENDING.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A temporary file that is removed when dropped, unless it was renamed.
struct Temporary {
    path: PathBuf,
    renamed: bool,
}

impl Temporary {
    /// Creates an empty file with a name of its own in the folder of `target`. The name is short, whatever the
    /// target's: that may have all the bytes that a name can have.
    fn beside(target: &Path) -> io::Result<(Self, File)> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        if target.file_name().is_none() {
            return Err(describe(target, "names no file"));
        }
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let path = folder_of(target).join(format!(".wavepath-{}-{number}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => {
                    pending().push(path.clone());
                    return Ok((Self { path, renamed: false }, file));
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// The one file of `target` that is being written, empty, and locked.
    fn of(target: &Path) -> io::Result<(Self, File)> {
        let Some(name) = target.file_name() else { return Err(describe(target, "names no file")) };
        let mut hidden = OsString::from(".");
        // A name has at most 255 bytes.
        hidden.push(match name.len() {
            ..=248 => name.to_os_string(),
            _ => format!("{:016x}", xxhash_rust::xxh3::xxh3_64(name.as_encoded_bytes())).into(),
        });
        hidden.push(".part");
        let path = folder_of(target).join(hidden);
        loop {
            let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path)?;
            match file.try_lock() {
                Err(fs::TryLockError::WouldBlock) => {
                    return Err(describe(target, "is being written by another process"));
                }
                // Not every file system has locks.
                Err(fs::TryLockError::Error(_)) | Ok(()) => {}
            }
            // Whoever had the lock may have given the file its name, and what is open here is no part any more.
            #[cfg(unix)]
            if !fs::metadata(&path).is_ok_and(|now| file.metadata().is_ok_and(|own| same_inode(&own, &now))) {
                continue;
            }
            file.set_len(0)?;
            pending().push(path.clone());
            return Ok((Self { path, renamed: false }, file));
        }
    }

    fn rename_to(mut self, target: &Path) -> Result<(), (Self, io::Error)> {
        match fs::rename(&self.path, target) {
            Ok(()) => {
                self.renamed = true;
                Ok(())
            }
            Err(error) => Err((self, error)),
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        pending().retain(|path| *path != self.path);
        if !self.renamed {
            // Nothing more can be done when this fails: the error that led here is the one to tell.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn describe(path: &Path, problem: &str) -> io::Error {
    io::Error::other(format!("{} {problem}", path.display()))
}

/// A folder of its own for a test, removed at the end.
#[cfg(test)]
pub(crate) struct TestFolder(PathBuf);

#[cfg(test)]
impl TestFolder {
    pub(crate) fn new(test: &str) -> Self {
        let path = std::env::temp_dir().join(format!("wavepath-{test}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub(crate) fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }
}

#[cfg(test)]
impl Drop for TestFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_an_earlier_file_whole() {
        let folder = TestFolder::new("atomic-replace");
        let path = folder.file("a.txt");
        fs::write(&path, "a long earlier text").unwrap();
        write_whole::<io::Error>(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(folder.names(), ["a.txt"]);
    }

    #[test]
    fn a_failure_keeps_the_earlier_file_and_leaves_nothing_else() {
        let folder = TestFolder::new("atomic-failure");
        let path = folder.file("a.txt");
        fs::write(&path, "earlier").unwrap();
        let result = write_whole::<io::Error>(&path, |file| {
            file.write_all(&[0; 100_000])?;
            Err(io::Error::other("disk full"))
        });
        assert_eq!(result.unwrap_err().to_string(), "disk full");
        assert_eq!(fs::read(&path).unwrap(), b"earlier");
        assert_eq!(folder.names(), ["a.txt"]);
    }

    #[test]
    fn check_leaves_nothing_and_names_what_is_missing() {
        let folder = TestFolder::new("atomic-check");
        check_writable(&folder.file("new.exr")).unwrap();
        assert!(folder.names().is_empty());
        let error = check_writable(&folder.file("none/new.exr")).unwrap_err().to_string();
        assert!(error.contains("none does not exist"), "{error}");
        let error = check_writable(&folder.file("")).unwrap_err().to_string();
        assert!(error.contains("folder"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let null = Path::new("/dev/null");
        check_writable(null).unwrap();
        write_whole::<io::Error>(null, |file| file.write_all(b"gone")).unwrap();
        assert!(fs::metadata(null).unwrap().file_type().is_char_device());
    }

    #[cfg(unix)]
    #[test]
    fn links_rights_and_other_names_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = TestFolder::new("atomic-links");
        let mode = |name: &str| fs::metadata(folder.file(name)).unwrap().permissions().mode() & 0o777;
        fs::create_dir(folder.file("disk")).unwrap();
        fs::write(folder.file("disk/a"), "earlier").unwrap();
        fs::set_permissions(folder.file("disk/a"), fs::Permissions::from_mode(0o600)).unwrap();
        symlink("disk/a", folder.file("one")).unwrap();
        symlink("one", folder.file("two")).unwrap();
        symlink("disk/new", folder.file("dangling")).unwrap();
        fs::hard_link(folder.file("disk/a"), folder.file("hard")).unwrap();
        let write = |name: &str, text: &'static str| {
            write_whole::<io::Error>(&folder.file(name), |file| file.write_all(text.as_bytes())).unwrap();
        };
        write("two", "through both");
        assert_eq!(fs::read(folder.file("disk/a")).unwrap(), b"through both");
        assert_eq!(fs::read(folder.file("hard")).unwrap(), b"through both");
        fs::remove_file(folder.file("hard")).unwrap();
        write("one", "again");
        assert_eq!((fs::read(folder.file("disk/a")).unwrap(), mode("disk/a")), (b"again".to_vec(), 0o600));
        write("dangling", "new");
        assert_eq!(fs::read(folder.file("disk/new")).unwrap(), b"new");
        for link in ["one", "two", "dangling"] {
            assert!(fs::symlink_metadata(folder.file(link)).unwrap().is_symlink(), "{link}");
        }
        assert!(is_same_file(&folder.file("two"), &folder.file("disk/a")));
        assert!(is_same_file(&folder.file("dangling"), &folder.file("disk/../disk/new")));
        assert!(!is_same_file(&folder.file("one"), &folder.file("dangling")));
        symlink("loop", folder.file("loop")).unwrap();
        let error = check_writable(&folder.file("loop")).unwrap_err().to_string();
        assert!(error.contains("too many links"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_nobody_may_write_is_refused() {
        use std::os::unix::fs::PermissionsExt;
        let folder = TestFolder::new("atomic-protected");
        let path = folder.file("a");
        fs::write(&path, "earlier").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).unwrap();
        for result in [check_writable(&path), write_whole(&path, |file| file.write_all(b"new"))] {
            assert!(result.unwrap_err().to_string().contains("is write-protected"));
        }
        assert_eq!(fs::read(&path).unwrap(), b"earlier");
    }

    #[test]
    fn the_longest_name_is_no_trouble() {
        let folder = TestFolder::new("atomic-long");
        let path = folder.file(&"n".repeat(255));
        check_writable(&path).unwrap();
        write_whole::<io::Error>(&path, |file| file.write_all(b"long")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"long");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_gets_the_bytes_and_its_reader_one_end() {
        let folder = TestFolder::new("atomic-fifo");
        let path = folder.file("pipe");
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::from_bits_truncate(0o600)).unwrap();
        let from = path.clone();
        let reader = std::thread::spawn(move || fs::read(from).unwrap());
        check_writable(&path).unwrap();
        // Also what has to be sought in.
        write_whole::<io::Error>(&path, |file| {
            file.write_all(b"xyz")?;
            file.seek(io::SeekFrom::Start(0))?;
            file.write_all(b"a")
        })
        .unwrap();
        assert_eq!(reader.join().unwrap(), b"ayz");
        assert_eq!(folder.names(), ["pipe"]);
    }

    #[test]
    fn what_is_abandoned_leaves_nothing() {
        let folder = TestFolder::new("atomic-abandon");
        let (temporary, _file) = Temporary::beside(&folder.file("a")).unwrap();
        assert_eq!(folder.names().len(), 1);
        // As `abandon` does it, without the files of other tests.
        let mine = pending().iter().position(|path| *path == temporary.path).unwrap();
        let path = pending().swap_remove(mine);
        fs::remove_file(path).unwrap();
        assert!(folder.names().is_empty());
    }
}
