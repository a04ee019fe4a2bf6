//! Measures the time from LOAD to `ready` as a client on the Unix socket sees it: the request, the compiler, the files of
//! the command, the executor's build and rehearsal, and two cycles. Usage:
//! `cargo run --release -p rcc-tests --example load_time -- [TIMES]`.

use std::time::{Duration, Instant};

use rcc_client::LoaderClient;
use rcc_testing::quantile;
use rcc_tests::handover::{chain_of_sums, large_net};
use rcc_tests::{LIMIT, TestCell, nets};

/// Numbers of primitives of the nets that command nothing.
const SIZES: [usize; 4] = [50, 500, 2000, 10_000];
/// Number of primitives of a motion of `nets::line`.
const OF_A_LINE: usize = 5;

fn main() {
    rcc_tests::cell::without_time_limit();
    let times = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let times = times.unwrap_or(200);
    let cell = TestCell::demo();
    let client = LoaderClient::new("load-time", &cell.cell().socket(), LIMIT)
        .expect("the system has an event queue");
    println!("LOAD to `ready`, ms, {times} times each\n");
    println!("| net | text, kB | least | p50 | p90 | most | of it the rehearsal, p50 |");
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    row(&client, times, "50 with a line", &line_of(50));
    for size in SIZES {
        row(&client, times, &size.to_string(), &large_net(size));
    }
    cell.stop();
}

/// Returns a net of this many primitives that moves the arm on a line.
fn line_of(primitives: usize) -> String {
    let sums = primitives - OF_A_LINE - 1;
    let further = format!("{}discard: [n{sums}.out]\n", chain_of_sums(sums));
    nets::motion("line", 0.1, 0.2, &further)
}

/// Loads and unloads a net as often as asked, and prints its row.
fn row(client: &LoaderClient, times: usize, name: &str, text: &str) {
    let (mut took, mut rehearsed) = (Vec::new(), Vec::new());
    for _ in 0..times {
        let begun = Instant::now();
        let command = client.load(None, text, LIMIT).expect("an answer");
        took.push(begun.elapsed());
        assert_eq!(command.state, "ready", "{:?}", command.diagnostics);
        let rehearsal = command.rehearsal.map_or(0, |rehearsal| rehearsal.took_ns);
        rehearsed.push(Duration::from_nanos(rehearsal));
        let unloaded = client.delete::<serde_json::Value>(&format!("/commands/{}", command.id));
        unloaded.expect("the net is not running");
    }
    took.sort();
    rehearsed.sort();
    let ms = |sorted: &[Duration], share: f64| {
        let duration = quantile(sorted, share).unwrap_or_default();
        format!("{:.2}", duration.as_secs_f64() * 1e3)
    };
    let shares = [0.0, 0.5, 0.9, 1.0].map(|share| ms(&took, share));
    println!(
        "| {name} | {:.1} | {} | {} |",
        text.len() as f64 / 1e3,
        shares.join(" | "),
        ms(&rehearsed, 0.5),
    );
}
