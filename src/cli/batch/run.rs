//! Does what of a queue is not done: a process for each job, some at once, with one display for all.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, IsTerminal, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::super::args::BatchArgs;
use super::super::{Failure, output};
use super::state::State;
use super::{Job, Queue};
use crate::machine;
use crate::memory;
use crate::report::Report;
use crate::time_span::clock;

/// What became of a job.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Outcome {
    /// Its pictures are there, from this run.
    Done(Box<Report>),
    /// Its pictures were there, from an earlier run or another one at the same time.
    Skipped(Box<Report>),
    /// Why not.
    Failed(String),
    /// It was not begun, or did not come to its end.
    Interrupted,
}

/// A job and what became of it.
pub(super) struct Finished {
    pub job: Job,
    pub outcome: Outcome,
}

/// A job at work.
struct Running {
    index: usize,
    child: Child,
    began: SystemTime,
    clock: Instant,
    memory: u64,
    /// There was a checkpoint.
    goes_on: bool,
    /// Held as long as it runs.
    _lock: File,
}

/// Between two looks at the processes.
const PAUSE: Duration = Duration::from_millis(50);
/// Between two looks at jobs that another run of the queue has.
const PATIENCE: Duration = Duration::from_secs(1);

/// Does the queue; results are in its order.
pub(super) fn run(queue: &Queue, args: &BatchArgs) -> Result<Vec<Finished>, Failure> {
    let work = |what: &str, error: io::Error| Failure::Work(format!("{what}: {error}"));
    let state = State::open(&queue.state, &queue.folder)
        .map_err(|error| work(&format!("cannot keep the state in {}", queue.state.display()), error))?;
    let interrupted = crate::interrupt::flag().map_err(|error| work("cannot watch for Ctrl-C", error))?;
    let program = std::env::current_exe().map_err(|error| work("cannot find the program", error))?;
    let display = Display::new(queue.jobs.len(), args.quiet);
    let runner = Runner { queue, args, state, program, display, plans: RefCell::default() };
    let mut outcomes: Vec<Option<Outcome>> = vec![None; queue.jobs.len()];
    let mut pending: std::collections::VecDeque<usize> = (0..queue.jobs.len()).collect();
    let mut running: Vec<Running> = Vec::new();
    let mut told = false;
    // Jobs of other runs, in a row: if all that is left is theirs, there is time.
    let mut elsewhere = 0;
    loop {
        let is_interrupted = interrupted.load(Ordering::Relaxed);
        if is_interrupted && !std::mem::replace(&mut told, true) {
            running.iter().for_each(|job| terminate(&job.child));
        }
        let mut at = 0;
        while at < running.len() {
            match running[at].child.try_wait().map_err(|error| work("cannot wait for a job", error))? {
                None => at += 1,
                Some(status) => {
                    let mut job = running.swap_remove(at);
                    let index = job.index;
                    let outcome = runner.ended(&job, status);
                    if matches!(outcome, Outcome::Failed(_)) && runner.is_outdated(&job, status) {
                        // Once more, from the beginning.
                        match runner.start(&queue.jobs[index]) {
                            Ok(child) => {
                                job.child = child;
                                job.began = SystemTime::now();
                                job.goes_on = false;
                                running.push(job);
                                continue;
                            }
                            Err(error) => {
                                output::note(format_args!("warning: cannot start it again: {error}"))
                            }
                        }
                    }
                    runner.display.ended(&queue.jobs[index], &outcome, job.clock.elapsed());
                    outcomes[index] = Some(outcome);
                }
            }
        }
        let is_free = running.len() < args.jobs && !is_interrupted;
        let next = if is_free || is_interrupted { pending.pop_front() } else { None };
        match next {
            Some(index) if is_interrupted => outcomes[index] = Some(Outcome::Interrupted),
            Some(index) => match runner.begin(index, &running) {
                Begun::Runs(job) => {
                    running.push(*job);
                    elsewhere = 0;
                }
                Begun::Ended(outcome) => {
                    runner.display.ended(&queue.jobs[index], &outcome, Duration::ZERO);
                    outcomes[index] = Some(outcome);
                    elsewhere = 0;
                }
                Begun::Elsewhere => {
                    pending.push_back(index);
                    elsewhere += 1;
                    if elsewhere >= pending.len() {
                        std::thread::sleep(if running.is_empty() { PATIENCE } else { PAUSE });
                        elsewhere = 0;
                    }
                }
                Begun::NoRoom => {
                    pending.push_front(index);
                    std::thread::sleep(PAUSE);
                }
            },
            None if running.is_empty() && pending.is_empty() => break,
            None => std::thread::sleep(PAUSE),
        }
        runner.display.update(queue, &running, &outcomes);
    }
    runner.display.finish();
    let outcomes = outcomes.into_iter().map(|outcome| outcome.unwrap_or(Outcome::Interrupted));
    Ok(queue.jobs.iter().cloned().zip(outcomes).map(|(job, outcome)| Finished { job, outcome }).collect())
}

/// What the command says about all of it.
pub(super) fn verdict(results: &[Finished]) -> Result<(), Failure> {
    let count = |is: fn(&Outcome) -> bool| results.iter().filter(|result| is(&result.outcome)).count();
    let failed = count(|outcome| matches!(outcome, Outcome::Failed(_)));
    let left = count(|outcome| matches!(outcome, Outcome::Interrupted));
    let mut text = Vec::new();
    if failed > 0 {
        let mut lines = vec![format!("{failed} of {} jobs failed", results.len())];
        for result in results {
            if let Outcome::Failed(why) = &result.outcome {
                lines.push(format!("  {}: {}", result.job.name, why.trim_end().replace('\n', "\n    ")));
            }
        }
        text.push(lines.join("\n"));
    }
    if left > 0 {
        text.push(format!(
            "interrupted: {left} of {} jobs are not done; run it again to go on",
            results.len()
        ));
    }
    match crate::interrupt::caught() {
        _ if text.is_empty() => Ok(()),
        Some((signal, _)) if left > 0 => Err(Failure::Interrupted(signal, text.join("\n"))),
        _ => Err(Failure::Work(text.join("\n"))),
    }
}

/// What comes of beginning a job.
enum Begun {
    Runs(Box<Running>),
    Ended(Outcome),
    /// Another run of the queue has it.
    Elsewhere,
    /// Those at work take the memory.
    NoRoom,
}

struct Runner<'a> {
    queue: &'a Queue,
    args: &'a BatchArgs,
    state: State,
    program: PathBuf,
    display: Display,
    /// Memory of jobs, by number.
    plans: RefCell<HashMap<usize, u64>>,
}

impl Runner<'_> {
    fn begin(&self, index: usize, running: &[Running]) -> Begun {
        let job = &self.queue.jobs[index];
        let failed = |what: &str, error: &dyn std::fmt::Display| {
            Begun::Ended(Outcome::Failed(format!("{what}: {error}")))
        };
        let lock = match self.state.lock(job) {
            Ok(Some(lock)) => lock,
            Ok(None) => return Begun::Elsewhere,
            Err(error) => return failed("cannot lock it", &error),
        };
        if !self.args.again
            && let Some(record) = self.state.done(job)
        {
            return Begun::Ended(Outcome::Skipped(Box::new(record.report)));
        }
        let memory = if self.args.jobs > 1 {
            *self.plans.borrow_mut().entry(index).or_insert_with(|| self.memory_of(job))
        } else {
            0
        };
        let taken: u64 = running.iter().map(|job| job.memory).sum();
        let limit = self.args.memory.unwrap_or_else(|| memory::limit() / 10 * 9);
        // One alone may try.
        if !running.is_empty() && taken.saturating_add(memory) > limit {
            return Begun::NoRoom;
        }
        // A record of something else, or of pictures that are gone.
        let _ = fs::remove_file(self.state.file(job, "json"));
        let goes_on = self.state.file(job, "film").exists();
        match self.start(job) {
            Ok(child) => Begun::Runs(Box::new(Running {
                index,
                child,
                began: SystemTime::now(),
                clock: Instant::now(),
                memory,
                goes_on,
                _lock: lock,
            })),
            Err(error) => failed("cannot start it", &error),
        }
    }

    /// The command of a job, as a person would type it.
    fn words(&self, job: &Job) -> Vec<String> {
        let mut words = job.arguments.clone();
        words.extend(job.outputs.iter().map(|output| format!("--output={}", output.display())));
        if !words.iter().any(|word| word.starts_with("--threads")) && self.args.jobs > 1 {
            words.push(format!("--threads={}", (machine::threads() / self.args.jobs).max(1)));
        }
        words
    }

    fn start(&self, job: &Job) -> io::Result<Child> {
        let folder = &self.queue.folder;
        for output in &job.outputs {
            if let Some(parent) = output.parent() {
                fs::create_dir_all(folder.join(parent))?;
            }
        }
        let log = File::create(self.state.file(job, "log"))?;
        let report = self.state.file(job, "report");
        let _ = fs::remove_file(&report);
        let mut command = Command::new(&self.program);
        command.args(self.words(job)).arg("--report").arg(&report);
        command.arg("--checkpoint").arg(self.state.file(job, "film"));
        command.args(["--checkpoint-until-done", "--resume-if-there"]);
        command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
        if !folder.as_os_str().is_empty() {
            command.current_dir(folder);
        }
        // Ctrl-C in a terminal goes to all of a group: who hears of it twice ends at once.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command.spawn()
    }

    /// What a job will take, as its plan says. Nothing is known of one that cannot be planned: it will fail soon.
    fn memory_of(&self, job: &Job) -> u64 {
        let words = self.words(job);
        let takes = |word: &&String| {
            let name = word.split('=').next().unwrap_or_default();
            const PLAN: [&str; 10] = [
                "--lenient",
                "--set",
                "--resolution",
                "--crop",
                "--cropwindow",
                "--pixelbounds",
                "--spp",
                "--threads",
                "--batch",
                "--spherical-lights",
            ];
            PLAN.contains(&name)
        };
        let mut command = Command::new(&self.program);
        command.arg("plan").arg(&job.arguments[1]).arg("--json").args(words.iter().filter(takes));
        if !self.queue.folder.as_os_str().is_empty() {
            command.current_dir(&self.queue.folder);
        }
        let Ok(plan) = command.stdin(Stdio::null()).output() else { return 0 };
        let plan: serde_json::Value = serde_json::from_slice(&plan.stdout).unwrap_or_default();
        let bytes = |name: &str| plan[name].as_u64().unwrap_or(0);
        // The tree and what its build needs is about as large as the geometry again, twice.
        const PROGRAM: u64 = 64 << 20;
        PROGRAM + bytes("film_bytes") + bytes("queue_bytes") + 3 * bytes("geometry_bytes")
    }

    /// Whether a job failed because the checkpoint is of something else, as it is after a change of scene or settings; then
    /// the checkpoint is gone.
    fn is_outdated(&self, running: &Running, status: std::process::ExitStatus) -> bool {
        running.goes_on
            && status.code() == Some(2)
            && fs::remove_file(self.state.file(&self.queue.jobs[running.index], "film")).is_ok()
    }

    fn ended(&self, running: &Running, status: std::process::ExitStatus) -> Outcome {
        let job = &self.queue.jobs[running.index];
        let report = self.state.file(job, "report");
        let read = fs::read(&report).ok().and_then(|text| serde_json::from_slice::<Report>(&text).ok());
        let _ = fs::remove_file(&report);
        match (status.success(), read) {
            (_, Some(report)) if report.stopped_by.as_deref() == Some("interrupt") => Outcome::Interrupted,
            (true, Some(report)) => match self.state.keep(job, report.clone(), running.began) {
                Ok(()) => {
                    let _ = fs::remove_file(self.state.file(job, "log"));
                    Outcome::Done(Box::new(report))
                }
                Err(error) => Outcome::Failed(format!("its pictures are there, but not its record: {error}")),
            },
            (true, None) => Outcome::Failed("it left no report".into()),
            _ if status.code().is_some_and(|code| code > 128) => Outcome::Interrupted,
            _ if crate::interrupt::flag().is_ok_and(|flag| flag.load(Ordering::Relaxed)) => {
                Outcome::Interrupted
            }
            _ => Outcome::Failed(reason(status, &self.state.file(job, "log"))),
        }
    }
}

/// Why a job failed: the end of what it said.
fn reason(status: std::process::ExitStatus, log: &Path) -> String {
    let said = last_lines(log).unwrap_or_default();
    let from = said.find("error: ").unwrap_or(0);
    let said = said[from..].trim();
    if status.code().is_some_and(|code| code <= 2) && !said.is_empty() {
        return said.trim_start_matches("error: ").to_string();
    }
    format!("{status}; its words are in {}", log.display())
}

fn last_lines(path: &Path) -> io::Result<String> {
    const ROOM: u64 = 4096;
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(ROOM)))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Asks a process to end in order.
fn terminate(child: &Child) {
    #[cfg(unix)]
    {
        use nix::sys::signal::{Signal, kill};
        let _ = kill(nix::unistd::Pid::from_raw(child.id() as i32), Signal::SIGTERM);
    }
    #[cfg(not(unix))]
    let _ = child;
}

/// One display for all jobs: a bar on a terminal, elsewhere a line for each job that ends.
enum Display {
    Hidden,
    Bar(ProgressBar),
    Lines,
}

impl Display {
    fn new(jobs: usize, quiet: bool) -> Self {
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        if quiet {
            return Display::Hidden;
        }
        if is_dumb || !io::stderr().is_terminal() {
            return Display::Lines;
        }
        let style = ProgressStyle::with_template("{bar:12} {wide_msg}").expect("the template is valid");
        let bar = ProgressBar::with_draw_target(Some(jobs as u64), ProgressDrawTarget::stderr_with_hz(10));
        bar.set_style(style.progress_chars("=> "));
        Display::Bar(bar)
    }

    fn ended(&self, job: &Job, outcome: &Outcome, elapsed: Duration) {
        let line = match outcome {
            Outcome::Done(report) => {
                let error = report.estimated_relmse.map(|e| format!(", relMSE {e:.3e}")).unwrap_or_default();
                format!("{}: done in {}{error}", job.name, clock(elapsed))
            }
            Outcome::Skipped(_) => format!("{}: was done", job.name),
            Outcome::Failed(why) => {
                format!("{}: failed: {}", job.name, why.lines().next().unwrap_or_default())
            }
            Outcome::Interrupted => format!("{}: interrupted", job.name),
        };
        match self {
            Display::Hidden => {}
            Display::Bar(bar) => bar.println(line),
            Display::Lines => output::note(line),
        }
    }

    fn update(&self, queue: &Queue, running: &[Running], outcomes: &[Option<Outcome>]) {
        let Display::Bar(bar) = self else { return };
        let ended = outcomes.iter().flatten().count();
        let at_work: Vec<String> = running
            .iter()
            .map(|job| format!("{} ({})", queue.jobs[job.index].name, clock(job.clock.elapsed())))
            .collect();
        bar.set_position(ended as u64);
        bar.set_message(format!("{ended} of {}, at work: {}", outcomes.len(), at_work.join(", ")));
    }

    fn finish(&self) {
        if let Display::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}
