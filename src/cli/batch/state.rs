//! What is kept of a queue: for each job a lock, the log of its last run, its checkpoint, and once it is done a record with
//! hashes of everything that its picture depends on.

use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File, TryLockError};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use xxhash_rust::xxh3::Xxh3;

use super::Job;
use crate::atomic_file::write_whole;
use crate::report::Report;

/// Options that change when a picture is there, and not what it shows.
const SPEED: [&str; 4] = ["--threads", "--batch", "--traversal", "--tev"];

/// What is known of a job that is done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    /// Of the program.
    version: String,
    /// What it was asked for.
    arguments: Vec<String>,
    /// Hashes of the files that were read; empty for one that changed meanwhile.
    inputs: BTreeMap<String, String>,
    /// Hashes of the pictures.
    outputs: BTreeMap<String, String>,
    /// What it cost.
    pub report: Report,
}

/// Size and time of a file, and the hash of what is in it.
type Known = (u64, Option<SystemTime>, String);

/// The folder of a queue.
pub(super) struct State {
    folder: PathBuf,
    /// Where the names of files in jobs begin.
    base: PathBuf,
    /// By name, with size and time of the file: frames share their meshes.
    hashes: RefCell<HashMap<PathBuf, Known>>,
}

impl State {
    /// Makes the folder if it is missing.
    pub(super) fn open(folder: &Path, base: &Path) -> io::Result<State> {
        fs::create_dir_all(folder)?;
        // Jobs run in the folder of the queue.
        let folder = fs::canonicalize(folder)?;
        Ok(State { folder, base: base.to_path_buf(), hashes: RefCell::default() })
    }

    /// A state to look at only.
    pub(super) fn look(folder: &Path, base: &Path) -> State {
        State { folder: folder.to_path_buf(), base: base.to_path_buf(), hashes: RefCell::default() }
    }

    pub(super) fn file(&self, job: &Job, ending: &str) -> PathBuf {
        self.folder.join(format!("{}.{ending}", job.name))
    }

    /// Takes a job for this process, until the file is dropped or the process ends, however it does; none if another one
    /// has it.
    pub(super) fn lock(&self, job: &Job) -> io::Result<Option<File>> {
        let file = File::options().create(true).truncate(false).write(true).open(self.file(job, "lock"))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// The record of a job, if it is done: asked for the same, from the same files, by the same version, and its pictures are
    /// those that were written then.
    pub(super) fn done(&self, job: &Job) -> Option<Record> {
        let text = fs::read(self.file(job, "json")).ok()?;
        let record: Record = serde_json::from_slice(&text).ok()?;
        let is_same = |files: &BTreeMap<String, String>| {
            files.iter().all(|(name, hash)| self.hash(Path::new(name)).is_ok_and(|now| now == *hash))
        };
        let names: Vec<String> = job.outputs.iter().map(|path| path.display().to_string()).collect();
        let is_done = record.version == env!("CARGO_PKG_VERSION")
            && record.arguments == what_counts(job)
            && names.iter().all(|name| record.outputs.contains_key(name))
            && is_same(&record.inputs)
            && is_same(&record.outputs);
        is_done.then_some(record)
    }

    /// Keeps the record of a job that began at `started` and is done now.
    pub(super) fn keep(&self, job: &Job, report: Report, started: SystemTime) -> io::Result<()> {
        let mut inputs = BTreeMap::new();
        for name in &report.inputs {
            let changed = fs::metadata(self.base.join(name)).and_then(|file| file.modified());
            // Nobody knows whether the old or the new one was read.
            let hash = if changed? > started { String::new() } else { self.hash(Path::new(name))? };
            inputs.insert(name.clone(), hash);
        }
        let hashed = |path: &PathBuf| Ok((path.display().to_string(), self.hash(path)?));
        let outputs = job.outputs.iter().map(hashed).collect::<io::Result<_>>()?;
        let version = env!("CARGO_PKG_VERSION").into();
        let record = Record { version, arguments: what_counts(job), inputs, outputs, report };
        let json = serde_json::to_string_pretty(&record).expect("names and numbers");
        write_whole(&self.file(job, "json"), |out| out.write_all(json.as_bytes()))
    }

    fn hash(&self, name: &Path) -> io::Result<String> {
        let path = self.base.join(name);
        let metadata = fs::metadata(&path)?;
        let (size, time) = (metadata.len(), metadata.modified().ok());
        if let Some((known_size, known_time, hash)) = self.hashes.borrow().get(&path)
            && (*known_size, *known_time) == (size, time)
        {
            return Ok(hash.clone());
        }
        let hash = hash_of(&path)?;
        self.hashes.borrow_mut().insert(path, (size, time, hash.clone()));
        Ok(hash)
    }
}

/// The arguments of which the picture is a function, in an order that does not matter.
fn what_counts(job: &Job) -> Vec<String> {
    let is_speed = |word: &str| SPEED.iter().any(|option| word.split('=').next() == Some(option));
    let mut words: Vec<String> = job.arguments.iter().filter(|word| !is_speed(word)).cloned().collect();
    words.sort();
    words
}

/// XXH3 of 128 bits: against mistakes, not against forgers.
fn hash_of(path: &Path) -> io::Result<String> {
    let mut hasher = Xxh3::new();
    let mut file = File::open(path)?;
    let mut buffer = vec![0; 1 << 18];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(format!("{:032x}", hasher.digest128())),
            count => hasher.update(&buffer[..count]),
        }
    }
}
