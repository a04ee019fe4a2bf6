//! Hands the arm of a running cell over 1,000 times in flight, by rules, each time while a net of 5,000 primitives is
//! loading. Each late cycle is attributed to the machine or to the executor by a reference thread of higher priority on
//! the executor's core. Runs on the main thread. Usage: `cargo run --release -p rcc-tests --example rules [TIMES]`

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use rcc_config::CellConfig;
use rcc_tests::endurance::{CORE, PRIORITY};
use rcc_tests::journal::Journal;
use rcc_tests::lateness::{LatenessMonitor, LatenessReport};
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
        of_seven(limits.jerk_max),
    ];
    let pin = format!("{{priority: {PRIORITY}, core: {CORE}}}");
    let cell = TestCell::changed(|text| text.replace("{priority: 80}", &pin));
    let monitor = LatenessMonitor::start(&cell, CORE, PRIORITY, &Arc::new(Journal::default()));
    let begun = Instant::now();
    let report = hand_over(&cell, (times, 5000), limits, |so_far| {
        if so_far.asked.is_multiple_of(100) {
            println!("{so_far:?}  after {:.0} s", begun.elapsed().as_secs_f64());
        }
    });
    let [velocity, acceleration, jerk] = report.shares;
    println!(
        "{} of {} rules fired, {} hand-overs in consecutive cycles, {} without a gap in the arm's set-points, {} while \
         the large net was loading; velocity at most {velocity:.3}, acceleration at most {acceleration:.3}, jerk at most \
         {jerk:.3} of the limits",
        report.fired, report.asked, report.consecutive, report.unbroken, report.while_loading,
    );
    let late = monitor.map(LatenessMonitor::finish);
    match &late {
        Some(late) => tell(late),
        None => println!(
            "no real-time priority: late cycles cannot be attributed; {} late cycles",
            cell.watch().status().late
        ),
    }
    cell.stop();
    assert!(report.fired == times && report.consecutive == times && report.unbroken == times);
    // Not the jerk: a net takes over an acceleration that is less than the true one by up to the jerk limit times a period
    // (`Guard::motion`), so that for one cycle the jerk is beyond its limit; 1.35 of it were seen.
    assert!(velocity <= 1.0 && acceleration <= 1.0);
    assert!(late.is_none_or(|late| late.consecutive && late.unexplained == 0));
}

fn tell(late: &LatenessReport) {
    println!(
        "{} late cycles of {}: {} while the reference thread was late too, {} by steal time of the host, {} unexplained; \
         longest stall of the reference thread {:.2} ms, longest computation of a cycle {:.3} ms",
        late.late,
        late.cycles,
        late.by_machine,
        late.by_steal,
        late.unexplained,
        late.stall_max_ns as f64 / 1e6,
        late.exec_max_ns as f64 / 1e6,
    );
    for each in late.each.iter().filter(|each| !each.beside.is_empty()) {
        println!("{each:?}");
    }
}
