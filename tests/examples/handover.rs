//! Hands the arm of a running cell over 1,000 times, each time while a net of 5,000 primitives is loading. Runs on the
//! main thread. Usage: `cargo run --release -p rcc-tests --example handover [TIMES]`

use std::time::Instant;

use rcc_tests::TestCell;
use rcc_tests::handover::hand_over;

fn main() {
    rcc_tests::cell::without_time_limit();
    let times = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let times = times.unwrap_or(1000);
    let cell = TestCell::demo();
    let begun = Instant::now();
    let report = hand_over(&cell, times, 5000, |so_far| {
        if so_far.asked.is_multiple_of(100) {
            println!("{so_far:?}  after {:.0} s", begun.elapsed().as_secs_f64());
        }
    });
    let status = cell.watch().status();
    println!(
        "{} of {} hand-overs in consecutive cycles, {} without a gap in the arm's set-points, {} while the large net was \
         loading; {} late cycles of {}",
        report.consecutive,
        report.asked,
        report.unbroken,
        report.while_loading,
        status.late,
        status.cycle
    );
    cell.stop();
    assert!(report.consecutive == times && report.unbroken == times);
}
