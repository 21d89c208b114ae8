//! Ctrl-C, as a process sees it.
#![cfg(unix)]

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Not a test by itself: what the test below starts and interrupts.
#[test]
#[ignore = "started by the test below"]
fn child() {
    let flag = wavepath::interrupt::flag().unwrap();
    println!("\nready");
    let patience = Instant::now() + Duration::from_secs(20);
    while !flag.load(Ordering::Relaxed) && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(1));
    }
    println!("\nraised");
    std::thread::sleep(patience.saturating_duration_since(Instant::now()));
}

#[test]
fn the_first_raises_the_flag_and_the_second_exits() {
    let arguments = ["--exact", "child", "--ignored", "--nocapture"];
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(arguments)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let id = child.id().to_string();
    let interrupt = || Command::new("kill").args(["-INT", &id]).status().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line == "ready"));
    interrupt();
    assert!(lines.any(|line| line == "raised"));
    interrupt();
    assert_eq!(child.wait().unwrap().code(), Some(130));
}
