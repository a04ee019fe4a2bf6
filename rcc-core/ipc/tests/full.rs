//! The janitor with a full shared memory. Run by the test program's threads, in a mount namespace with a small
//! `/dev/shm` of its own, and by child processes of it.

mod common;

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::Command;

use common::{Peer, TestCell, part, refused, run_janitor};
use rcc_ipc::Session;
use rcc_protocol::Role;

/// The child process: announced, with more shared memory than the janitor needs to join, until it is killed.
#[test]
fn peer() {
    let Some((_, cell, label)) = part() else {
        return;
    };
    let session = Session::join(&cell, Role::Driver, &label).unwrap();
    let board = |number: u32| session.create_board::<[u64; 8 << 10]>(&format!("board{number}"));
    // As many as there is room for: how much memory a board takes depends on the kernel's tmpfs.
    let _boards: Vec<_> = (0..24).map_while(|number| board(number).ok()).collect();
    let _announced = cell.announce(&session.announcement()).unwrap();
    loop {
        std::thread::park();
    }
}

/// Runs one of these tests with a small `/dev/shm` of its own, in a mount namespace; needs root.
fn in_small_shared_memory(test: &str) {
    let script = "mount -t tmpfs -o size=4m,mode=1777 tmpfs /dev/shm && exec \"$0\" --exact \"$1\" --nocapture";
    let program = std::env::current_exe().unwrap();
    let may = Command::new("unshare")
        .args(["-m", "mount", "-t", "tmpfs", "tmpfs", "/mnt"])
        .output();
    let may = may.is_ok_and(|output| output.status.success());
    if !may {
        println!("skipped: a mount namespace needs `unshare` and root");
        return;
    }
    let output = Command::new("unshare")
        .args(["-m", "sh", "-c", script])
        .arg(program)
        .arg(test)
        .env(SMALL, "1")
        .output()
        .unwrap();
    let output_text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (output_text(&output.stdout), output_text(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    assert!(out.contains("1 passed"), "{out}{err}");
}

const SMALL: &str = "RCC_IPC_TEST_SMALL";

/// Fills `/dev/shm` to the last byte.
fn fill() -> PathBuf {
    let path = PathBuf::from("/dev/shm/filler");
    let mut file = File::create(&path).unwrap();
    for size in [1 << 16, 4096, 1] {
        while std::io::Write::write_all(&mut file, &vec![1; size]).is_ok() {}
    }
    path
}

#[test]
fn the_janitor_cleans_a_full_shared_memory() {
    if std::env::var_os(SMALL).is_none() {
        return in_small_shared_memory("the_janitor_cleans_a_full_shared_memory");
    }
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let _board = session.create_board::<u64>("board").unwrap();
    run_janitor(&cell).unwrap();
    let before = cell.files();
    let (peer, _) = Peer::announced(&cell, "large", "lwr");
    peer.kill();
    fill();
    let report = run_janitor(&cell).unwrap();
    assert_eq!(cell.files(), before, "{report:?}");
    assert!(report.reaped > 0 && report.dead_nodes > 0, "{report:?}");
    // The cell continues to work.
    session.create_board::<u64>("another").unwrap();
}

#[test]
fn the_janitor_says_that_a_shared_memory_is_full_of_others_files() {
    if std::env::var_os(SMALL).is_none() {
        return in_small_shared_memory(
            "the_janitor_says_that_a_shared_memory_is_full_of_others_files",
        );
    }
    let cell = TestCell::new();
    let _session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let filler = fill();
    let error = refused(run_janitor(&cell)).to_string();
    assert!(
        error.contains("bytes free") && error.contains("doctor --clean"),
        "{error}"
    );
    fs::remove_file(filler).unwrap();
    run_janitor(&cell).unwrap();
}
