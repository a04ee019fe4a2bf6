//! Hands the arm of a running cell over 1,000 times in flight, by rules, each time while a net of 5,000 primitives is
//! loading. Runs on the main thread. Usage: `cargo run --release -p rcc-tests --example rules [TIMES]`

use std::collections::BTreeMap;
use std::time::Instant;

use rcc_config::CellConfig;
use rcc_tests::rules::hand_over;
use rcc_tests::{TestCell, repository};

fn main() {
    rcc_tests::cell::without_time_limit();
    let times = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let times = times.unwrap_or(1000);
    let ports = BTreeMap::from([("fri".to_owned(), 1), ("io".to_owned(), 2)]);
    let config = CellConfig::load(&repository().join("configs/cells/demo.yaml"), &ports);
    let limits = config.expect("the demo cell").models()[0].limits;
    let of_seven =
        |limits: [f64; rcc_core::message::JOINTS_MAX]| std::array::from_fn(|joint| limits[joint]);
    let limits = [
        of_seven(limits.velocity_max),
        of_seven(limits.acceleration_max),
    ];
    let cell = TestCell::demo();
    let begun = Instant::now();
    let report = hand_over(&cell, (times, 5000), limits, |so_far| {
        if so_far.asked.is_multiple_of(100) {
            println!("{so_far:?}  after {:.0} s", begun.elapsed().as_secs_f64());
        }
    });
    let status = cell.watch().status();
    println!(
        "{} of {} rules fired, {} hand-overs in consecutive cycles, {} without a gap in the arm's set-points, {} while \
         the large net was loading; velocity at most {:.3}, acceleration at most {:.3} of the limits; {} late cycles of {}",
        report.fired,
        report.asked,
        report.consecutive,
        report.unbroken,
        report.while_loading,
        report.shares[0],
        report.shares[1],
        status.late,
        status.cycle
    );
    cell.stop();
    assert!(report.fired == times && report.consecutive == times && report.unbroken == times);
    assert!(report.shares.iter().all(|share| *share <= 1.0));
}
