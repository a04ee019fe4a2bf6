//! Effect of ten open dashboards on the executor: its cycles without and with them, in one run, on a net of two moving
//! values in the demo's cell. Run by a person: `cargo run --release -p rcc-tests --example viewers -- --seconds 30`.

use std::time::{Duration, Instant};

use rcc_tests::dashboard::DashboardServer;
use rcc_tests::{TestCell, repository};
use serde_json::Value;

/// Open pages.
const VIEWERS: usize = 10;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let seconds = match (arguments.next().as_deref(), arguments.next()) {
        (Some("--seconds"), Some(text)) => text.parse().expect("a number of seconds"),
        (None, _) => 30.0,
        _ => panic!("usage: viewers [--seconds SECONDS]"),
    };
    let span = Duration::from_secs_f64(seconds);
    rcc_tests::cell::without_time_limit();
    let cell = TestCell::demo();
    for name in ["belt.yaml", "touch.yaml"] {
        let text = std::fs::read_to_string(repository().join("configs/nets").join(name));
        cell.run(&text.expect("the example"));
    }
    println!(
        "pages  cycles  late  wake-up: median  99 %  99.9 %  longest  computing: median  99 %  99.9 %  longest"
    );
    print_row(0, &measured(&cell, || std::thread::sleep(span)));
    let server = DashboardServer::start(&cell, &[]);
    let pages: Vec<_> = (0..VIEWERS)
        .map(|_| {
            let page = server.open();
            server.watch(&page, &["belt/*", "touch/*"], 250.0);
            page
        })
        .collect();
    let begun = Instant::now();
    let mut counts = Vec::new();
    let row = measured(&cell, || {
        let readers = pages.into_iter().map(|mut page| {
            std::thread::spawn(move || {
                let mut batches = 0_u64;
                while begun.elapsed() < span {
                    batches += u64::from(page.next_event().0 == "values");
                }
                batches
            })
        });
        let readers: Vec<_> = readers.collect();
        counts = readers
            .into_iter()
            .map(|reader| reader.join().expect("a reader"))
            .collect();
    });
    print_row(VIEWERS, &row);
    let total: u64 = counts.iter().sum();
    let least = counts.iter().min().copied().unwrap_or(0);
    println!("{total} batches of values were read, at least {least} by each page");
    assert!(least > 0, "a page saw no values");
    drop(server);
    cell.interrupt();
}

/// Resets the executor's histograms, waits, and returns them with the number of late cycles.
fn measured(cell: &TestCell, wait: impl FnOnce()) -> Value {
    let reset = cell.rest("POST", "/status/acknowledge", "");
    assert_eq!(reset.status, 200, "{reset:?}");
    wait();
    let mut timing = cell.rest("GET", "/timing", "").body;
    let executor = cell.rest("GET", "/status", "").body["executor"].clone();
    let of = |name: &str| executor[name].as_u64().unwrap_or(0);
    timing["late"] = Value::from(of("late") - of("late_acknowledged"));
    timing
}

fn print_row(pages: usize, timing: &Value) {
    let us =
        |histogram: &str, name: &str| timing[histogram][name].as_u64().unwrap_or(0) as f64 / 1e3;
    let four = |histogram: &str| {
        ["p50_ns", "p99_ns", "p999_ns", "max_ns"]
            .map(|name| format!("{:.1} µs", us(histogram, name)))
            .join("  ")
    };
    println!(
        "{pages}  {}  {}  {}  {}",
        timing["exec"]["count"],
        timing["late"],
        four("wake"),
        four("exec")
    );
}
