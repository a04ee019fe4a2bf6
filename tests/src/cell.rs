//! A cell of one test, supervised by `rcc-cli up`, with its own folder, shared-memory prefix and ports.
//! [`TestCell::stop`] ends it and checks for leftovers; dropping it removes it in any case. Runs on the threads of the
//! test harness.

use std::fs::File;
use std::ops::Deref;
use std::path::Path;
use std::process::{Child, ExitStatus};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cell_fixture::CellFixture;
use crate::processes::{ends_with_test, signal, with_runtime_dir};
use crate::programs::repository;
use crate::waiting::{LIMIT, await_some};

/// A running cell under `rcc-cli up`.
#[derive(Debug)]
pub struct TestCell {
    place: Option<CellFixture>,
    up: Child,
    _life: CellTimeout,
}

/// Time after which a test's cell is killed: longer than any test has taken on a busy machine.
const CELL_LIFETIME_MAX: Duration = Duration::from_secs(300);
static IS_LIMITED: AtomicBool = AtomicBool::new(true);

/// Removes the time limit of this process's cells: for programs that a person runs and can end.
pub fn without_time_limit() {
    IS_LIMITED.store(false, Ordering::Relaxed);
}

/// Reason why the fixture is always `Some`: it is taken out only when the cell itself is consumed.
const HERE: &str = "the fixture is present until the cell is consumed";

impl TestCell {
    /// Starts the demo cell.
    pub fn demo() -> TestCell {
        TestCell::changed(|text| text)
    }

    /// Starts the demo cell with its configuration edited by `change`.
    pub fn changed(change: impl Fn(String) -> String) -> TestCell {
        TestCell::start(&repository().join("configs/cells/demo.yaml"), change)
    }

    /// Starts a cell from a configuration file edited by `change`.
    pub fn start(config: &Path, change: impl Fn(String) -> String) -> TestCell {
        TestCell::in_fixture(CellFixture::new(config, change))
    }

    /// As [`TestCell::start`], for devices that are only online until a net enables them.
    pub fn start_online(config: &Path, change: impl Fn(String) -> String) -> TestCell {
        let mut cell = TestCell::begin(CellFixture::new(config, change));
        cell.await_all("online");
        cell
    }

    /// Starts the cell of a fixture and waits until it is ready.
    pub fn in_fixture(place: CellFixture) -> TestCell {
        let mut cell = TestCell::begin(place);
        cell.await_ready();
        cell
    }

    /// Starts the cell of a fixture and returns immediately: some of its devices wait for something else.
    pub fn begin(place: CellFixture) -> TestCell {
        let up = start_up(&place);
        TestCell {
            _life: CellTimeout::begin(place.folder()),
            place: Some(place),
            up,
        }
    }

    /// Waits until every device is ready.
    pub fn await_ready(&mut self) {
        self.await_all("ready");
    }

    /// Waits until every device is in this state.
    fn await_all(&mut self, state: &str) {
        let Self { place, up, .. } = self;
        let place = place.as_ref().expect(HERE);
        await_some(&format!("the cell to be {state}"), || {
            if let Some(status) = up.try_wait().expect("the child can be asked") {
                panic!("rcc-cli up ended ({status}):\n{}", place.logs());
            }
            let reply = place.try_rest("GET", "/devices", "")?;
            let rows = reply.body.as_array()?;
            let all = rows.iter().all(|row| row["state"] == state);
            (all && !rows.is_empty()).then_some(())
        });
    }

    /// Returns the process id of `rcc-cli up`.
    pub fn supervisor(&self) -> u32 {
        self.up.id()
    }

    /// Kills `rcc-cli up` and waits until it is dead.
    pub fn kill_supervisor(&mut self) {
        self.up.kill().expect("the process is a child of this one");
        self.up.wait().expect("the process is a child of this one");
    }

    /// Waits until `rcc-cli up` has exited.
    pub fn await_end_of_up(&mut self) -> ExitStatus {
        let Self { place, up, .. } = self;
        let place = place.as_ref().expect(HERE);
        await_some("the end of rcc-cli up", || {
            up.try_wait()
                .unwrap_or_else(|error| panic!("{error}\n{}", place.logs()))
        })
    }

    /// True if `rcc-cli up` has exited.
    pub fn has_ended(&mut self) -> bool {
        self.up.try_wait().is_ok_and(|status| status.is_some())
    }

    /// Starts `rcc-cli up` again after it has exited and returns immediately.
    pub fn begin_up_again(&mut self) {
        self.up = start_up(self);
    }

    /// Starts `rcc-cli up` again after it has exited and waits until the cell is ready.
    pub fn up_again(&mut self) {
        self.up = start_up(self);
        self.await_ready();
    }

    /// Ends the cell as Ctrl-C does, and asserts that `rcc-cli up` succeeded and nothing is left.
    pub fn stop(mut self) {
        let status = self.end();
        assert!(
            status.is_some_and(|status| status.success()),
            "{status:?}\n{}",
            self.logs()
        );
        self.assert_nothing_left();
    }

    /// Ends the cell as Ctrl-C does, ignores the exit status, and returns the fixture for another cell.
    pub fn interrupt(mut self) -> CellFixture {
        self.end();
        self.place.take().expect(HERE)
    }

    fn end(&mut self) -> Option<ExitStatus> {
        let begun = Instant::now();
        if self.up.try_wait().ok().flatten().is_none() {
            // False only if it exited between the two calls.
            signal(self.up.id(), Signal::SIGINT);
        }
        while begun.elapsed() < LIMIT {
            if let Some(status) = self.up.try_wait().ok().flatten() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        None
    }
}

impl Deref for TestCell {
    type Target = CellFixture;

    fn deref(&self) -> &CellFixture {
        self.place.as_ref().expect(HERE)
    }
}

impl Drop for TestCell {
    fn drop(&mut self) {
        let Some(place) = self.place.take() else {
            return;
        };
        if std::thread::panicking() {
            eprintln!("{}", place.logs());
        }
        // Already dead after `stop`; otherwise the test failed or no longer needs the cell.
        let _ = self.up.kill();
        let _ = self.up.wait();
    }
}

/// Kills the processes of a cell after [`CELL_LIFETIME_MAX`]: a test that waits for a line of their output then sees
/// the end of the stream and fails instead of hanging.
#[derive(Debug)]
struct CellTimeout {
    // Dropping the sender ends the thread.
    _over: Sender<()>,
}

impl CellTimeout {
    fn begin(folder: &Path) -> CellTimeout {
        let (over, has_ended) = std::sync::mpsc::channel();
        let folder = folder.to_owned();
        std::thread::spawn(move || {
            if has_ended.recv_timeout(CELL_LIFETIME_MAX) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            if !IS_LIMITED.load(Ordering::Relaxed) {
                return;
            }
            eprintln!(
                "test timed out: killing the processes of its cell after {CELL_LIFETIME_MAX:?}"
            );
            for pid in with_runtime_dir(&folder) {
                signal(pid, Signal::SIGKILL);
            }
        });
        CellTimeout { _over: over }
    }
}

/// Starts `rcc-cli up` with its output in `up.log`.
fn start_up(place: &CellFixture) -> Child {
    let log = File::options()
        .create(true)
        .append(true)
        .open(place.folder().join("up.log"));
    let log = log.expect("a log can be written");
    let mut command = place.program("rcc-cli");
    command
        .arg("up")
        .arg(place.config())
        .stdout(log.try_clone().expect("a handle"))
        .stderr(log);
    ends_with_test(&mut command)
        .spawn()
        .expect("rcc-cli starts")
}
