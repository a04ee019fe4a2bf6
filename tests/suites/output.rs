//! Output that cannot be written never ends a running cell or net: full disks, closed pipes, readers that do not read.
//! Where the output is the result, a failed write is an error. Each test has a cell of its own.

use std::fs::File;
use std::io::PipeReader;
use std::process::{Child, Stdio};

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{TestCell, await_some, nets, repository};

/// A destination of output that takes nothing.
#[derive(Clone, Copy, Debug)]
enum Sink {
    /// A full disk.
    Full,
    /// A pipe whose reading end is closed.
    Gone,
    /// A full pipe whose reader does not read.
    Stuck,
}

impl Sink {
    /// Opens the sink; returns it, and the reading end of a pipe that must stay open.
    fn open(self) -> (Stdio, Option<PipeReader>) {
        if let Sink::Full = self {
            let full = File::options().write(true).open("/dev/full");
            return (full.expect("/dev/full").into(), None);
        }
        let (reader, mut writer) = std::io::pipe().expect("a pipe");
        if let Sink::Gone = self {
            return (writer.into(), None);
        }
        let room = nix::fcntl::fcntl(&writer, nix::fcntl::FcntlArg::F_GETPIPE_SZ);
        let room = usize::try_from(room.expect("the size of a pipe")).expect("a size");
        std::io::Write::write_all(&mut writer, &vec![b'.'; room])
            .expect("the pipe takes as many bytes as its size");
        (writer.into(), Some(reader))
    }
}

/// Starts `rcc-cli up` with its output in these sinks; returns also the ends of pipes that must stay open.
fn up_into(place: &CellFixture, out: Sink, err: Sink) -> (Child, [Option<PipeReader>; 2]) {
    let ((out, keep_out), (err, keep_err)) = (out.open(), err.open());
    let mut command = place.program("rcc-cli");
    command
        .arg("up")
        .arg(place.config())
        .stdout(out)
        .stderr(err);
    let child = ends_with_test(&mut command).spawn();
    (child.expect("rcc-cli starts"), [keep_out, keep_err])
}

/// Asserts that `up` with its output in these sinks survives a motion and the death of a driver, and ends on Ctrl-C.
fn assert_up_survives(out: Sink, err: Sink) {
    let place = CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| text);
    let (mut up, _readers) = up_into(&place, out, err);
    await_some("all devices to be ready", || {
        assert!(
            up.try_wait().expect("the child is ours").is_none(),
            "{out:?}: up has ended"
        );
        let reply = place.try_rest("GET", "/devices", "")?;
        let rows = reply.body.as_array()?;
        let ready = rows.iter().all(|row| row["state"] == "ready");
        (ready && !rows.is_empty()).then_some(())
    });
    let mut arm = place.simulator("lwr-sim");
    let line = place.run(&nets::line("line", 0.2, 0.05));
    arm.await_motion();
    // The death and the restart of a driver cause much output.
    let dead = place.kill(Role::Driver, "io");
    let io = place.await_successor(Role::Driver, "io", dead);
    place.await_device("io", "ready");
    assert!(
        up.try_wait().expect("the child is ours").is_none(),
        "{out:?}: up must keep running"
    );
    assert_eq!(
        place.state(line)["state"],
        "running",
        "{out:?}\n{}",
        place.logs()
    );
    assert!(io.liveness().is_alive());
    assert!(signal(up.id(), Signal::SIGINT));
    let status = await_some("the end of rcc-cli up", || {
        up.try_wait().expect("the child is ours")
    });
    assert!(status.success(), "{out:?}: {status}\n{}", place.logs());
    place.assert_nothing_left();
}

#[test]
fn up_keeps_running_when_the_disk_of_its_output_is_full() {
    assert_up_survives(Sink::Full, Sink::Full);
}

#[test]
fn up_keeps_running_when_the_reader_of_its_output_is_gone() {
    assert_up_survives(Sink::Gone, Sink::Gone);
}

#[test]
fn up_keeps_running_and_ends_on_request_when_nobody_reads_its_output() {
    assert_up_survives(Sink::Stuck, Sink::Full);
}

#[test]
fn run_follows_and_cancels_its_net_when_its_output_fails() {
    let cell = TestCell::demo();
    let file = cell.file(&nets::line("line", 0.2, 0.05));
    for sink in [Sink::Full, Sink::Gone, Sink::Stuck] {
        let ((out, _reader), (err, _)) = (sink.open(), Sink::Full.open());
        let mut run = cell.program("rcc-cli");
        run.arg("run").arg(&file).stdout(out).stderr(err);
        let mut run = ends_with_test(&mut run).spawn().expect("rcc-cli starts");
        let id = await_some("the line to run", || {
            assert!(
                run.try_wait().expect("the child is ours").is_none(),
                "{sink:?}: run has ended"
            );
            let rows = cell.rest("GET", "/commands", "").body;
            let row = rows
                .as_array()?
                .iter()
                .find(|row| row["state"] == "running")?;
            row["id"].as_u64()
        });
        assert!(signal(run.id(), Signal::SIGINT));
        // `run` has unloaded its net.
        let status = await_some("the end of run", || {
            run.try_wait().expect("the child is ours")
        });
        assert_eq!(status.code(), Some(130), "{sink:?}\n{}", cell.logs());
        let gone = cell.rest("GET", &format!("/commands/{id}"), "");
        assert_eq!(gone.status, 404, "{gone:?}");
        cell.await_devices();
    }
    cell.stop();
}

#[test]
fn a_result_that_cannot_be_written_is_an_error_but_a_closed_pipe_prints_no_message() {
    let cell = TestCell::demo();
    let lamp = cell.file(&nets::lamp("lamp"));
    let lamp = lamp.to_str().expect("plain");
    for arguments in [
        vec!["ls"],
        vec!["status"],
        vec!["devices"],
        vec!["--output", "json", "status"],
        vec!["primitives"],
        vec!["events"],
        vec!["check", lamp],
        vec!["fmt", "--stdout", lamp],
        vec!["graph", lamp],
        vec!["explain", lamp],
        vec!["schema"],
        vec!["--help"],
        vec!["--version"],
    ] {
        for (sink, exit) in [(Sink::Full, 1), (Sink::Gone, 141)] {
            let mut command = cell.program("rcc-cli");
            let output = command
                .args(&arguments)
                .stdout(sink.open().0)
                .output()
                .expect("rcc-cli runs");
            let errors = String::from_utf8_lossy(&output.stderr);
            assert_eq!(
                output.status.code(),
                Some(exit),
                "{arguments:?} {sink:?}: {errors}"
            );
            match sink {
                Sink::Full => assert!(errors.contains("RCC4008"), "{arguments:?}: {errors}"),
                _ => assert_eq!(errors, "", "{arguments:?}"),
            }
        }
    }
    cell.stop();
}

#[test]
fn no_program_panics_when_its_log_cannot_be_written() {
    let cell = TestCell::demo();
    let config = cell.config().display().to_string();
    let missing = cell.folder().join("missing.yaml").display().to_string();
    for program in ["rcc-exec", "rcc-loader", "rcc-driver"] {
        let device: &[&str] = match program {
            "rcc-driver" => &["--device", "io"],
            _ => &[],
        };
        // Each one ends with an error: it runs already, or its configuration file is missing.
        for (config, exit) in [(&config, 1), (&missing, 78)] {
            for sink in [Sink::Full, Sink::Gone] {
                let mut command = cell.program(program);
                command.args(device).args(["--config", config]);
                let ended = command.stdout(sink.open().0).stderr(sink.open().0).status();
                let code = ended.expect("it runs").code();
                assert_eq!(code, Some(exit), "{program}, {config}, {sink:?}");
            }
        }
    }
    let mut tail = cell.program("rcc-monitor");
    tail.args(["tail", "--count", "1"]).stdout(Stdio::null());
    let mut tail = ends_with_test(tail.stderr(Sink::Full.open().0))
        .spawn()
        .expect("rcc-monitor starts");
    let lamp = cell.run(&nets::lamp("lamp"));
    let ended = await_some("the first record", || {
        tail.try_wait().expect("the child is ours")
    });
    assert!(ended.success(), "{ended}");
    cell.done(lamp, "cancel");
    cell.stop();
}
