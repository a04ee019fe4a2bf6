//! Exchanges of the driver `ethercat` with `ethercat-sim` over raw Ethernet, in a network namespace of its own: working counters
//! and times between exchanges, then the cable pulled and put back again and again.
//! `cargo run --release -p rcc-ethercat --example ethercat_cycle -- --minutes 10 --pulls 100` (as root); prints a table.
//! The thread in the namespace is the driver's host.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use clap::Parser;
use rcc_driver_kit::driver::{Driver, Exchange, Inputs, LinkError, Outputs};
use rcc_driver_kit::priority::set_realtime_priority;
use rcc_driver_kit::rcc_config::CellConfig;
use rcc_ethercat::driver::Ethercat;
use rcc_testing::namespace::{FAR, NEAR, in_namespace, plug_cable, pull_cable};
use rcc_testing::quantile;
use serde_json::Value;

/// Exchanges with a simulated line.
#[derive(Debug, Parser)]
struct Options {
    /// Time of the exchanges
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// Number of times that the cable is pulled afterwards
    #[arg(long, default_value_t = 10)]
    pulls: usize,
    /// SCHED_FIFO priority of the driver, if the system permits it
    #[arg(long, default_value_t = 70)]
    priority: u8,
}

/// Longest wait for a line that is lost or comes back.
const LIMIT: Duration = Duration::from_secs(60);
/// More than the watchdogs of the terminals: every other time the cable stays out for so long.
const OUT: Duration = Duration::from_millis(300);
/// Wait of one receive, as the host has it.
const WAIT: Duration = Duration::from_millis(4);

/// The simulator, which ends with this program.
struct Simulator(Child);

impl Drop for Simulator {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn simulator() -> Simulator {
    let here = std::env::current_exe().expect("a program has a path");
    let folder = here.ancestors().nth(2).expect("target/PROFILE/examples");
    let mut child = Command::new(folder.join("ethercat-sim"))
        .arg(format!("--nic={FAR}"))
        .args(["--priority=60", "--wire=2.1=1.1", "--parent-death"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("ethercat-sim beside this program: build it with the same profile");
    let output = child.stdout.take().expect("its output");
    let mut ready = String::new();
    let read = BufReader::new(output).read_line(&mut ready);
    assert!(
        read.is_ok() && ready.starts_with("ethercat-sim ready"),
        "{ready}"
    );
    Simulator(child)
}

fn driver() -> Ethercat {
    let text = include_str!("../../../configs/cells/ethercat.yaml");
    let text = text.replace("udp 127.0.0.1:${line}", NEAR);
    let ports = BTreeMap::from([("line".to_owned(), 1)]);
    let cell = CellConfig::parse(&text, "ethercat.yaml", Path::new(""), &ports);
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
    Ethercat::open(&cell.devices[0]).unwrap_or_else(|error| panic!("{error}"))
}

/// One exchange, as the host does it; the lamp is on in every other one.
fn exchange(driver: &mut Ethercat, number: u64) -> Result<(Exchange, Inputs), LinkError> {
    let mut inputs = Inputs::NONE;
    let exchange = driver.receive(WAIT, &mut inputs)?;
    let lamp = Outputs {
        digital: number & 1,
        digital_set: 1,
        digital_commanded: 1,
        ..Outputs::NONE
    };
    driver.send(&lamp)?;
    Ok((exchange, inputs))
}

/// Exchanges until `done`; returns the time that it took.
fn until(
    driver: &mut Ethercat,
    what: &str,
    done: impl Fn(&Result<Exchange, LinkError>) -> bool,
) -> Duration {
    let begun = Instant::now();
    while begun.elapsed() < LIMIT {
        let result = exchange(driver, 0).map(|(exchange, _)| exchange);
        if done(&result) {
            return begun.elapsed();
        }
    }
    panic!("never: {what}; {}", link(driver));
}

fn link(driver: &Ethercat) -> Value {
    driver.diagnosis().expect("it has one").link()
}

fn count(link: &Value, key: &str) -> u64 {
    link[key].as_u64().unwrap_or(0)
}

/// Returns a value of a sorted list, 0 if it is empty; `share` from 0 to 1.
fn at(sorted: &[u64], share: f64) -> u64 {
    quantile(sorted, share).unwrap_or(0)
}

fn run(options: &Options) {
    let _simulator = simulator();
    let mut driver = driver();
    set_realtime_priority(options.priority);
    until(&mut driver, "a line in OP", |result| {
        result.is_ok_and(|exchange| exchange.startable)
    });
    let before = link(&driver);
    let limit = Duration::from_secs_f64(options.minutes * 60.0);
    let (begun, mut last) = (Instant::now(), Instant::now());
    let (mut gaps, mut nulls, mut losses, mut skipped) = (Vec::new(), 0_u64, 0_u64, 0_u64);
    let mut number = 0;
    while begun.elapsed() < limit {
        match exchange(&mut driver, number) {
            Ok((exchange, inputs)) => {
                number += 1;
                gaps.push(last.elapsed().as_micros() as u64);
                last = Instant::now();
                nulls += u64::from(inputs.digital_known == 0);
                skipped += exchange.ticks - 1;
            }
            Err(LinkError::Silent) => {}
            Err(LinkError::Lost { .. }) => losses += 1,
        }
    }
    let after = link(&driver);
    let grown = |key| count(&after, key) - count(&before, key);
    gaps.sort_unstable();
    println!("| exchanges in {:.1} min | |\n|---|---|", options.minutes);
    println!("| complete | {} |", grown("complete"));
    println!(
        "| wrong working counter | {} |",
        grown("wrong_working_counter")
    );
    println!("| without an answer in time | {} |", grown("silent"));
    println!("| exchanges without values for the net | {nulls} |");
    println!("| losses of the device | {losses} |");
    println!("| skipped periods | {skipped} |");
    let points = [0.01, 0.5, 0.99, 0.999, 1.0].map(|share| at(&gaps, share).to_string());
    println!(
        "| time between two exchanges, µs: p1, p50, p99, p99.9, largest | {} |",
        points.join(", ")
    );
    pull(&mut driver, options.pulls);
}

fn pull(driver: &mut Ethercat, pulls: usize) {
    let (mut lost, mut back) = (Vec::new(), [Vec::new(), Vec::new()]);
    for number in 0..pulls {
        pull_cable();
        let pulled = Instant::now();
        let time = until(driver, "a lost line", |result| {
            matches!(result, Err(LinkError::Lost { .. }))
        });
        lost.push(time.as_millis() as u64);
        let long = number % 2 == 1;
        if long {
            until(driver, "expired watchdogs", |_| pulled.elapsed() > OUT);
        }
        plug_cable();
        let time = until(driver, "the line is back", |result| {
            result.is_ok_and(|exchange| exchange.startable)
        });
        back[usize::from(long)].push(time.as_millis() as u64);
    }
    println!("\n| cable pulled {pulls} times | least | median | most |\n|---|---|---|---|");
    let [short, long] = back;
    for (what, mut times) in [
        ("until the device is lost, ms", lost),
        ("from the cable to ready, terminals still in OP, ms", short),
        ("from the cable to ready, after their watchdogs, ms", long),
    ] {
        times.sort_unstable();
        let [least, median, most] = [0.0, 0.5, 1.0].map(|share| at(&times, share));
        println!("| {what} | {least} | {median} | {most} |");
    }
}

fn main() {
    let options = Options::parse();
    in_namespace("ethercat_cycle", move || run(&options));
}
