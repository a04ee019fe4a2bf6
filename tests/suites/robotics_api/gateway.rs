//! The gateway of one test, with a cell of its own or attached to one. Run by the threads of the test harness.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use nix::sys::signal::Signal;
use rcc_tests::cell_fixture::NAME;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{CellFixture, program, repository};

/// A running gateway.
pub struct GatewayFixture {
    /// Folder of the test; its cell is the one that the gateway makes.
    pub place: CellFixture,
    /// Where it listens.
    pub port: u16,
    child: Child,
}

impl GatewayFixture {
    /// Starts a gateway that makes a cell of its own.
    pub fn own(arguments: &[&str]) -> GatewayFixture {
        // Only the folder of the fixture is used.
        let place = CellFixture::new(&repository().join("configs/cells/two-arms.yaml"), |text| {
            text
        });
        let mut own = vec!["--own-cell", NAME];
        own.extend(arguments);
        GatewayFixture::start(place, &own)
    }

    fn start(place: CellFixture, arguments: &[&str]) -> GatewayFixture {
        let log = File::create(place.folder().join("up.log")).expect("a log");
        let (child, port) = start(command(&place).args(arguments).stderr(log));
        GatewayFixture { place, port, child }
    }

    /// Ends the gateway as Ctrl-C does, and asserts that nothing is left.
    pub fn stop(mut self) {
        assert!(
            signal(self.child.id(), Signal::SIGINT),
            "the gateway has ended already: {}",
            self.place.logs()
        );
        let status = self.child.wait().expect("a child");
        assert!(status.success(), "{status}: {}", self.place.logs());
        self.place.assert_nothing_left();
    }

    /// Kills the gateway.
    pub fn kill(&mut self) {
        self.child.kill().expect("a child");
        self.child.wait().expect("a child");
    }
}

impl Drop for GatewayFixture {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}", self.place.logs());
            let own = self
                .place
                .state_dir()
                .join("cells")
                .join(NAME)
                .join("robotics-api/up.log");
            eprintln!("{}", std::fs::read_to_string(own).unwrap_or_default());
        }
        // It has ended unless the test failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Returns the command for the gateway in the folder of a fixture.
pub fn command(place: &CellFixture) -> Command {
    let mut command = Command::new(program("rcc-robotics-api"));
    command
        .args(["--bind", "127.0.0.1:0"])
        .env("RCC_RUNTIME_DIR", place.folder())
        .env("RCC_STATE_DIR", place.state_dir())
        .stdin(Stdio::null());
    command
}

/// Starts a gateway; returns it with its port.
pub fn start(command: &mut Command) -> (Child, u16) {
    let mut child = ends_with_test(command.stdout(Stdio::piped()))
        .spawn()
        .expect("the gateway starts");
    let mut line = String::new();
    let out = child.stdout.take().expect("a pipe");
    BufReader::new(out).read_line(&mut line).expect("a line");
    let port = line
        .trim()
        .rsplit(':')
        .next()
        .and_then(|port| port.parse().ok());
    (
        child,
        port.unwrap_or_else(|| panic!("the gateway says `{line}`")),
    )
}
