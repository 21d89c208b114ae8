//! Files that appear whole or not at all.
//!
//! Contents go to a temporary file beside the target, which takes the target's name only when
//! everything is on disk. A reader therefore never meets half a file, and an earlier file of that
//! name stays as it was when the writing fails.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Cursor, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// What an encoder writes to: formats such as OpenEXR go back to fill in tables.
pub trait WriteSeek: Write + Seek {}
impl<T: Write + Seek> WriteSeek for T {}

/// Writes the file `path` with what `encode` produces; on any error nothing is left behind.
///
/// A target that exists and is no regular file (`/dev/stdout`, a pipe) is written to directly, for
/// replacing it would be wrong.
///
/// # Errors
/// Those of `encode`, and those of the file system.
pub fn write_whole<E: From<io::Error>>(
    path: &Path,
    encode: impl FnOnce(&mut dyn WriteSeek) -> Result<(), E>,
) -> Result<(), E> {
    if is_special(path) {
        let mut bytes = Cursor::new(Vec::new());
        encode(&mut bytes)?;
        let mut device = OpenOptions::new().write(true).open(path)?;
        device.write_all(bytes.get_ref())?;
        return Ok(device.flush()?);
    }
    let (temporary, file) = Temporary::beside(path)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    encode(&mut writer)?;
    let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.sync_all()?;
    drop(file);
    Ok(temporary.rename_to(path)?)
}

/// Checks that [`write_whole`] could write `path`: its folder exists and takes new files.
///
/// To be called before hours of work, not after.
///
/// # Errors
/// An error whose message says what is in the way.
pub fn check_writable(path: &Path) -> io::Result<()> {
    if is_special(path) {
        return OpenOptions::new().write(true).open(path).map(drop);
    }
    let folder = folder_of(path);
    match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => {}
        Ok(_) => return Err(describe(folder, "is not a folder")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(describe(folder, "does not exist; create the folder first"));
        }
        Err(error) => return Err(error),
    }
    if path.is_dir() {
        return Err(describe(path, "is a folder"));
    }
    Temporary::beside(path).map(drop)
}

/// A temporary file that is removed when dropped, unless it was renamed.
struct Temporary {
    path: PathBuf,
    renamed: bool,
}

impl Temporary {
    /// Creates an empty file with a name of its own in the folder of `target`.
    fn beside(target: &Path) -> io::Result<(Self, File)> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().ok_or_else(|| describe(target, "names no file"))?;
        loop {
            let mut hidden = OsString::from(".");
            hidden.push(name);
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            hidden.push(format!(".{}-{number}.tmp", std::process::id()));
            let path = folder_of(target).join(hidden);
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => {
                    return Ok((Self { path, renamed: false }, file));
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn rename_to(mut self, target: &Path) -> io::Result<()> {
        fs::rename(&self.path, target)?;
        self.renamed = true;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.renamed {
            // Nothing more can be done when this fails: the error that led here is the one to tell.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir())
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
}
