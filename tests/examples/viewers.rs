//! Effect of ten open dashboards, a `tail` and a recording on the executor: parts without and with them take turns in one run
//! of the demo's cell, in which three nets with moving values and twenty monitors at 1 kHz run. Run by a person:
//! `cargo run --release -p rcc-tests --example viewers -- --seconds 60 --rounds 3`.

use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use clap::Parser;
use nix::sys::signal::Signal;
use rcc_tests::cycle_times::{CycleTimes, pinned, watched_net};
use rcc_tests::dashboard::DashboardServer;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::{TestCell, await_some, repository};

/// Open pages.
const VIEWERS: usize = 10;

/// Compares the executor's cycles alone and beside viewers.
#[derive(Parser)]
struct Arguments {
    /// Duration of each part, s.
    #[arg(long, default_value_t = 30.0)]
    seconds: f64,
    /// Number of parts without, and as many with viewers.
    #[arg(long, default_value_t = 2)]
    rounds: u32,
}

/// The viewers of the cell.
struct Viewers {
    server: DashboardServer,
    pages: Vec<JoinHandle<u64>>,
    is_over: Arc<AtomicBool>,
    programs: Vec<Child>,
    file: std::path::PathBuf,
}

impl Viewers {
    /// Starts everything, and returns when all pages see values and the recording has begun.
    fn start(cell: &TestCell) -> Viewers {
        let server = DashboardServer::start(cell, &[]);
        let is_over = Arc::new(AtomicBool::new(false));
        let pages = (0..VIEWERS).map(|_| {
            let mut page = server.open();
            server.watch(&page, &["belt/*", "touch/*", "watched/clock.out"], 250.0);
            page.next("values");
            let is_over = Arc::clone(&is_over);
            std::thread::spawn(move || {
                let mut batches = 0;
                // Relaxed: a flag; nothing else is passed with it.
                while !is_over.load(Ordering::Relaxed) {
                    batches += u64::from(page.next_event().0 == "values");
                }
                batches
            })
        });
        let pages = pages.collect();
        let file = cell.folder().join("viewers.mcap");
        let program = |arguments: &[&str]| {
            let mut command = cell.program("rcc-monitor");
            command.args(arguments).stdout(Stdio::null());
            ends_with_test(&mut command)
                .spawn()
                .expect("rcc-monitor runs")
        };
        let path = file.display().to_string();
        let programs = vec![program(&["tail"]), program(&["record", &path])];
        await_some("the recording", || file.exists().then_some(()));
        Viewers {
            server,
            pages,
            is_over,
            programs,
            file,
        }
    }

    /// Ends everything; returns the fewest batches that a page has read.
    fn end(self) -> u64 {
        self.is_over.store(true, Ordering::Relaxed);
        let counts = self.pages.into_iter().map(|page| page.join());
        let counts: Result<Vec<u64>, _> = counts.collect();
        for mut program in self.programs {
            signal(program.id(), Signal::SIGINT);
            program.wait().expect("it is a child");
        }
        std::fs::remove_file(self.file).expect("our file");
        drop(self.server);
        let counts = counts.expect("the readers do not panic");
        counts.into_iter().min().unwrap_or(0)
    }
}

fn main() {
    let Arguments { seconds, rounds } = Arguments::parse();
    let span = Duration::from_secs_f64(seconds);
    rcc_tests::cell::without_time_limit();
    let cell = TestCell::changed(pinned);
    for name in ["belt.yaml", "touch.yaml"] {
        let text = std::fs::read_to_string(repository().join("configs/nets").join(name));
        cell.run(&text.expect("the example"));
    }
    cell.run(&watched_net());
    let (mut alone, mut beside) = (CycleTimes::default(), CycleTimes::default());
    let mut least = u64::MAX;
    println!("{}", CycleTimes::HEADING);
    for _ in 0..rounds {
        let part = CycleTimes::during(&cell, || std::thread::sleep(span));
        println!("{}", part.row("alone"));
        alone.add(&part);
        let viewers = Viewers::start(&cell);
        let part = CycleTimes::during(&cell, || std::thread::sleep(span));
        least = least.min(viewers.end());
        println!("{}", part.row("with viewers"));
        beside.add(&part);
    }
    println!("{}", alone.row("all alone"));
    println!("{}", beside.row("all with"));
    println!("{}", beside.compared(&alone));
    println!("each of {VIEWERS} pages read at least {least} batches of values in a part");
    assert!(least > 0, "a page saw no values");
    cell.interrupt();
}
