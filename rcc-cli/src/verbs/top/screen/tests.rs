use ratatui::Terminal;
use ratatui::backend::TestBackend;
use rcc_api::bodies::{BucketView, CommandView, HistogramView, LateView, PrimitiveTimeView};

use super::*;

const REFUSED: &str = "RT: degraded, because SCHED_FIFO 80 was refused (Operation not permitted): raise the limit `rtprio` \
                       (LimitRTPRIO=80); memory is not locked (the limit `memlock` is 8192 kB): raise it \
                       (LimitMEMLOCK=infinity)";

fn histogram(p50_ns: u64, max_ns: u64) -> HistogramView {
    let buckets = [(p50_ns, 98_765), (2 * p50_ns, 432), (max_ns, 1)];
    HistogramView {
        count: 5,
        mean_ns: 102_000,
        p50_ns,
        p99_ns: 200_000,
        p999_ns: max_ns,
        max_ns,
        buckets: buckets
            .map(|(to_ns, count)| BucketView { to_ns, count })
            .to_vec(),
        ..HistogramView::default()
    }
}

fn snapshot() -> TopSnapshot {
    let mut snapshot = TopSnapshot::default();
    snapshot.status.cell = "demo".into();
    let executor = &mut snapshot.status.executor;
    (executor.cycle, executor.period_ns) = (12_345, 1_000_000);
    (executor.committed_ns, executor.budget_ns) = (102_000, 500_000);
    executor.grade = "RT: granted".into();
    executor.late = 3;
    executor.late_acknowledged = 1;
    executor.first_late = Some(LateView {
        cycle: 777,
        cause: "computed long".into(),
        wake_ns: 2_000,
        exec_ns: 1_500_000,
        skipped_periods: 1,
        net: Some("dear#2".into()),
        net_ns: 1_400_000,
    });
    let net = |id, name: &str, exec_mean_ns| CommandView {
        id,
        net: name.into(),
        state: "running".into(),
        exec_mean_ns,
        exec_max_ns: 2 * exec_mean_ns,
        ..CommandView::default()
    };
    let over = CommandView {
        state: "terminated".into(),
        ..net(9, "over", 1)
    };
    snapshot.nets = vec![net(1, "cheap", 2_000), net(2, "dear", 100_000), over];
    snapshot.timing.wake = histogram(34_800, 1_234_000);
    snapshot.timing.exec = histogram(150_000, 900_000);
    snapshot.timing.length = histogram(1_000_000, 2_100_000);
    let primitive = |ty: &str, sum_ns| PrimitiveTimeView {
        ty: ty.into(),
        runs: 4,
        primitives: 8,
        sum_ns,
        max_ns: 1_200,
    };
    snapshot.timing.primitives = vec![
        primitive("InverseKinematicsNear", 6_000),
        primitive("LinearMotion", 2_000),
    ];
    snapshot
}

fn drawn(snapshot: &TopSnapshot, (width, height): (u16, u16), message: &str) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal
        .draw(|frame| draw(frame, snapshot, message))
        .unwrap();
    let buffer = terminal.backend().buffer();
    let rows = buffer.content().chunks(usize::from(width));
    rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>() + "\n")
        .collect()
}

/// Asserts that the picture shows the parts; each may be broken between words.
fn shows(picture: &str, parts: &[&str]) {
    let joined = picture.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in parts {
        assert!(joined.contains(part), "{part} is missing in\n{picture}");
    }
}

const HEADS: [&str; 4] = [
    "cell demo cycle 12 345 period 1.0 ms load 10.2 % (99 % of cycles: 20.0 %) budget 102.0 µs used of 500.0 µs",
    "RT: granted",
    "2 late cycles, 3 since the start",
    "first: cycle 777 computed long: woke up 2.0 µs late, computed for 1.5 ms, most of it dear#2 (1.4 ms)",
];

#[test]
fn the_view_has_nets_histograms_primitives_and_late_cycles() {
    let picture = drawn(&snapshot(), (120, 50), "as told");
    shows(&picture, &HEADS);
    for part in [
        "NET      STATE    LOAD %  MEAN µs  MAX µs",
        "dear#2   running    10.0    100.0   200.0",
        "TIME             MEDIAN µs  MAX µs  99 % µs  99.9 % µs",
        "execution            150.0   900.0    200.0      900.0",
        "TIME  (logarithmic)",
        "≤ 200 µs",
        " 98765",
        "PRIMITIVE              EACH ns  SHARE %  MAX RUN ns",
        "InverseKinematicsNear      750     75.0        1200",
        "q quit   a acknowledge late cycles  as told",
    ] {
        assert!(picture.contains(part), "{part}\n{picture}");
    }
    let position = |what| picture.find(what);
    assert!(
        position("dear#2   running") < position("cheap#1  running"),
        "the dearest first\n{picture}"
    );
    assert!(!picture.contains("over#9"));
}

#[test]
fn at_80_columns_and_24_rows_no_heading_and_no_number_is_cut() {
    let picture = drawn(&snapshot(), (80, 24), "");
    shows(&picture, &HEADS);
    for part in [
        "NET      STATE    LOAD %  MEAN µs  MAX µs  LAST ns  EXPECTED ns",
        "dear#2   running    10.0    100.0   200.0        –            –",
        "cheap#1  running     0.2      2.0     4.0        –            –",
        "TIME             MEDIAN µs  MAX µs  99 % µs  99.9 % µs",
        "wake-up latency       34.8  1234.0    200.0     1234.0",
        "cycle               1000.0  2100.0    200.0     2100.0",
        "(log",
        "99197",
        "PRIMITIVE              EACH ns  SHARE %  MAX RUN ns",
        "InverseKinematicsNear      750     75.0        1200",
        "LinearMotion               250     25.0        1200",
        "q quit   a acknowledge late cycles",
    ] {
        assert!(picture.contains(part), "{part}\n{picture}");
    }
}

#[test]
fn the_real_time_sentence_is_wrapped_and_never_cut() {
    let mut snapshot = snapshot();
    snapshot.status.executor.grade = REFUSED.into();
    for columns in [40, 60, 80, 120] {
        shows(&drawn(&snapshot, (columns, 40), ""), &[REFUSED]);
    }
}

#[test]
fn a_narrow_terminal_names_the_columns_that_it_leaves_out() {
    let picture = drawn(&snapshot(), (48, 40), "");
    shows(&picture, &HEADS);
    for part in [
        "nets (no room for LAST, EXPECTED)",
        "NET      STATE    LOAD %  MEAN µs  MAX µs",
        "      750     75.0        1200",
        "98765",
    ] {
        assert!(picture.contains(part), "{part}\n{picture}");
    }
}

#[test]
fn many_nets_leave_room_for_the_times() {
    let mut snapshot = snapshot();
    let nets = (10..60).map(|id| CommandView {
        id,
        net: "more".into(),
        state: "ready".into(),
        ..CommandView::default()
    });
    snapshot.nets.extend(nets);
    let picture = drawn(&snapshot, (80, 24), "");
    shows(
        &picture,
        &["dear#2 running", "… and", "wake-up latency 34.8 1234.0"],
    );
}

#[test]
fn a_long_message_is_wrapped() {
    let message = "error RCC3003: the loader does not answer: is the cell up? see `rcc-cli status`";
    shows(&drawn(&snapshot(), (60, 30), message), &[message]);
}

#[test]
fn a_small_terminal_shows_what_fits() {
    for size in [(1, 1), (2, 30), (20, 5), (40, 10), (300, 3)] {
        let picture = drawn(&snapshot(), size, "");
        assert_eq!(picture.lines().count(), usize::from(size.1));
    }
}

#[test]
fn the_text_has_the_same_contents() {
    let text = text::text(&snapshot());
    for part in [
        "computed long",
        "InverseKinematicsNear      750     75.0        1200",
        "dear#2   running    10.0    100.0   200.0",
        "≤ 200 µs",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
}
