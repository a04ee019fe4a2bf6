//! A cell has exactly one supervisor, however many are started at the same moment, and whatever an earlier one left
//! behind. Each test has a cell of its own.

use std::fs::{self, File};
use std::process::{Child, Stdio};

use nix::sys::signal::Signal;
use rcc_protocol::{Announcement, Role};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::{ends_with_test, signal, with_runtime_dir};
use rcc_tests::{TestCell, await_some, nets, repository};

/// Number of supervisors that are started at the same moment.
const MANY: usize = 8;

fn place() -> CellFixture {
    CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| text)
}

/// Starts [`MANY`] `rcc-cli up` at once, each with a log of its own.
fn many(place: &CellFixture) -> Vec<(Child, String)> {
    let start = |number: usize| {
        let log = place.folder().join(format!("up-{number}.log"));
        let file = File::create(&log).expect("a log");
        let mut command = place.program("rcc-cli");
        command
            .arg("up")
            .arg(place.config())
            .stdout(file.try_clone().expect("a handle"))
            .stderr(file);
        let child = ends_with_test(&mut command).spawn();
        (child.expect("rcc-cli starts"), log.display().to_string())
    };
    (0..MANY).map(start).collect()
}

/// Waits until all but one supervisor have ended, and returns that one. Asserts that each of the others was refused
/// with a message that names it.
fn one_of(place: &CellFixture, many: Vec<(Child, String)>) -> Child {
    let words = |log: &str| std::fs::read_to_string(log).unwrap_or_default();
    let mut running = many;
    let mut refused = Vec::new();
    await_some("all but one to be refused", || {
        let mut still = Vec::new();
        for (mut child, log) in running.drain(..) {
            match child.try_wait().expect("the child is ours") {
                Some(status) => refused.push((status, log)),
                None => still.push((child, log)),
            }
        }
        running = still;
        (running.len() <= 1).then_some(())
    });
    let (winner, _) = running.pop().unwrap_or_else(|| {
        let all: Vec<String> = refused.iter().map(|(_, log)| words(log)).collect();
        panic!("no supervisor is left: {all:#?}")
    });
    assert_eq!(refused.len(), MANY - 1);
    for (status, log) in refused {
        let words = words(&log);
        assert_eq!(status.code(), Some(5), "{words}");
        let named = words.contains("RCC4012") && words.contains(&winner.id().to_string());
        assert!(
            named,
            "the message names the supervisor of the cell: {words}"
        );
        assert!(!words.contains("cancel"), "{words}");
    }
    let supervisor = place.announced(Role::Cli, "up");
    assert_eq!(
        (supervisor.pid, supervisor.liveness().is_alive()),
        (winner.id(), true)
    );
    winner
}

/// Asserts that all processes of the cell, its files and its logs are there.
fn assert_whole(place: &CellFixture) {
    await_some("all devices to be ready", || {
        let reply = place.try_rest("GET", "/devices", "")?;
        let rows = reply.body.as_array()?;
        let ready = rows.iter().all(|row| row["state"] == "ready");
        (ready && !rows.is_empty()).then_some(())
    });
    for (role, label) in [
        (Role::Executor, "exec"),
        (Role::Loader, "loader"),
        (Role::Driver, "lwr"),
        (Role::Driver, "io"),
    ] {
        assert!(
            place.announced(role, label).liveness().is_alive(),
            "{role} {label}"
        );
    }
    let cell = place.cell();
    assert!(cell.running_file().is_file() && cell.state().events_file().is_file());
    let runs = fs::read_dir(cell.state().logs_dir())
        .expect("logs")
        .flatten();
    let newest = runs.map(|entry| entry.path()).max().expect("logs of a run");
    assert!(newest.join("executor.log").is_file(), "{}", place.logs());
}

fn end(mut winner: Child, place: &CellFixture) {
    signal(winner.id(), Signal::SIGINT);
    let status = await_some("the end of rcc-cli up", || {
        winner.try_wait().expect("the child is ours")
    });
    assert!(status.success(), "{status}\n{}", place.logs());
    place.assert_nothing_left();
}

#[test]
fn of_many_supervisors_at_once_one_gets_the_cell_and_its_net_keeps_running() {
    let place = place();
    for round in 0..6 {
        let winner = one_of(&place, many(&place));
        assert_whole(&place);
        if round == 0 {
            // Supervisors that are started while the cell runs are all refused.
            let line = place.run(&nets::line("line", 0.2, 0.02));
            let mut late = many(&place);
            await_some("all of them to be refused", || {
                late.retain_mut(|(child, _)| child.try_wait().ok().flatten().is_none());
                late.is_empty().then_some(())
            });
            assert_eq!(place.state(line)["state"], "running", "{}", place.logs());
            place.done(line, "abort");
        }
        if round % 3 == 2 {
            // The next round finds the leftovers of a killed cell.
            let mut winner = winner;
            for pid in std::iter::once(winner.id()).chain(with_runtime_dir(place.folder())) {
                signal(pid, Signal::SIGKILL);
            }
            winner.wait().expect("the child is ours");
            place.await_dead();
        } else {
            end(winner, &place);
        }
    }
}

#[test]
fn a_cell_starts_completely_while_others_clean_it() {
    let place = place();
    for _ in 0..4 {
        // A killed cell leaves announcements and shared memory to remove.
        let mut first = one_of(&place, many(&place));
        for pid in std::iter::once(first.id()).chain(with_runtime_dir(place.folder())) {
            signal(pid, Signal::SIGKILL);
        }
        first.wait().expect("the child is ours");
        place.await_dead();
        let mut cleaners: Vec<Child> = (0..MANY)
            .map(|number| {
                let mut command = match number % 3 {
                    0 => place.program("rcc-janitor"),
                    1 => {
                        let mut wipe = place.program("rcc-janitor");
                        wipe.arg("--wipe");
                        wipe
                    }
                    _ => {
                        let mut doctor = place.program("rcc-cli");
                        doctor.args(["doctor", "--clean"]);
                        doctor
                    }
                };
                command.stdout(Stdio::null()).stderr(Stdio::null());
                ends_with_test(&mut command).spawn().expect("it starts")
            })
            .collect();
        let winner = one_of(&place, many(&place));
        for cleaner in &mut cleaners {
            cleaner.wait().expect("the child is ours");
        }
        assert_whole(&place);
        end(winner, &place);
    }
}

#[test]
fn second_processes_of_a_cell_are_refused_and_do_not_disturb_its_net() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.02));
    // The processes that are started here are not children of the cell's supervisor.
    let presence: Announcement = cell.announced(Role::Cli, "up");
    assert!(presence.is_supervisor() && presence.pid == cell.supervisor());
    for program in ["rcc-exec", "rcc-loader"] {
        let mut second = cell.program(program);
        let second = second.arg("--config").arg(cell.config()).output();
        let second = second.expect("the program runs");
        assert_eq!(second.status.code(), Some(1), "{program}: {second:?}");
    }
    let mut driver = cell.program("rcc-driver");
    driver.arg("--config").arg(cell.config());
    let driver = driver
        .args(["--device", "io"])
        .output()
        .expect("the program runs");
    assert_eq!(driver.status.code(), Some(1), "{driver:?}");
    assert_eq!(cell.state(line)["state"], "running", "{}", cell.logs());
    assert_eq!(cell.device("io").expect("a row")["losses"], 0);
    cell.done(line, "cancel");
    cell.assert_ends(line, "canceled");
    cell.stop();
}
