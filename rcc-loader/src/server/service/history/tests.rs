//! Tests of the history without an executor. Run by the test harness.

use super::*;
use bytemuck::Zeroable;
use rcc_core::types::Store;

const EXECUTOR: u64 = 0xab;

fn record(sequence: u64, monitor: u32) -> MonitorRecord {
    let mut record = MonitorRecord {
        sequence,
        stamp_ns: sequence * 1_000_000,
        command: 7,
        monitor,
        width: 2,
        ..MonitorRecord::zeroed()
    };
    record.values[..2].copy_from_slice(&[sequence as f64, f64::NAN]);
    record
}

fn monitor(primitive: &str, source: &str) -> MonitorNames {
    MonitorNames {
        primitive: primitive.to_owned(),
        source: source.to_owned(),
        store: Store::Real,
        slot: 0,
        width: 2,
        type_name: "Real[2]".to_owned(),
        unit: Some("m".to_owned()),
        rate_hz: 1000.0,
        every: 1,
        never_null: false,
    }
}

/// Returns a history of records with these numbers, of two monitors in turns.
fn kept(numbers: impl IntoIterator<Item = u64>) -> RetainedRecords {
    let mut kept = RetainedRecords::default();
    let records = numbers
        .into_iter()
        .map(|number| record(number, number as u32 % 2));
    kept.add(EXECUTOR, &records.collect::<Vec<_>>());
    let net = MonitoredNet {
        name: "line".to_owned(),
        monitors: vec![monitor("watch", "move.pose"), monitor("other", "ik.joints")],
    };
    kept.nets.insert(7, Arc::new(net));
    kept
}

fn patterns(given: &[&str]) -> Vec<Pattern> {
    given
        .iter()
        .map(|one| one.parse().expect("a pattern"))
        .collect()
}

fn numbers(page: &HistoryPage) -> Vec<u64> {
    page.values.iter().map(|value| value.sequence).collect()
}

/// Returns where the next page begins.
fn after(page: &HistoryPage) -> AnswerStart {
    let request = HistoryRequest {
        after: Some(page.next.clone()),
        ..HistoryRequest::default()
    };
    begin(&request).expect("a position")
}

#[test]
fn a_client_that_asks_for_what_follows_misses_nothing() {
    let mut history = kept(0..20);
    let newest = history.page(AnswerStart::Newest, &[], 4);
    assert_eq!(
        (numbers(&newest), newest.continues),
        (vec![16, 17, 18, 19], true)
    );
    let none = history.page(after(&newest), &[], 4);
    assert_eq!((numbers(&none), none.continues), (vec![], true));
    history.add(EXECUTOR, &[record(20, 0), record(21, 1), record(22, 0)]);
    let first = history.page(after(&none), &[], 2);
    let rest = history.page(after(&first), &[], 2);
    assert_eq!((numbers(&first), numbers(&rest)), (vec![20, 21], vec![22]));
    assert!(first.continues && rest.continues && first.lost + rest.lost == 0);
}

#[test]
fn a_client_that_begins_now_sees_only_what_follows() {
    let mut history = kept(0..20);
    let now = history.page(AnswerStart::Newest, &[], 0);
    assert_eq!((numbers(&now), now.continues), (vec![], true));
    history.add(EXECUTOR, &[record(20, 0)]);
    assert_eq!(numbers(&history.page(after(&now), &[], 10)), [20]);
}

#[test]
fn ports_and_monitors_are_selected_by_patterns_and_null_is_null() {
    let history = kept(0..6);
    let page = history.page(AnswerStart::Newest, &patterns(&["line/move.*"]), 10);
    assert_eq!(numbers(&page), [0, 2, 4]);
    let MonitoredValue { name, value, .. } = &page.values[1];
    assert_eq!(
        (name.as_str(), value),
        ("line/move.pose", &serde_json::json!([2.0, null]))
    );
    let element = history.page(AnswerStart::Newest, &patterns(&["*/other[0]"]), 1);
    let MonitoredValue { name, value, .. } = &element.values[0];
    assert_eq!(
        (name.as_str(), value),
        ("line/ik.joints[0]", &serde_json::json!(5.0))
    );
    let missing = history.page(AnswerStart::Newest, &patterns(&["line/move.pose[2]"]), 10);
    assert!(missing.values.is_empty());
}

#[test]
fn the_last_seconds_are_counted_from_the_newest_record() {
    let history = kept(0..2000);
    let last = begin(&HistoryRequest {
        seconds: Some(0.01),
        ..HistoryRequest::default()
    });
    let page = history.page(last.expect("a time"), &[], 100);
    assert_eq!(numbers(&page), (1989..2000).collect::<Vec<u64>>());
}

#[test]
fn lost_records_are_counted_and_a_lost_position_is_told() {
    let history = kept((0..5).chain(8..10));
    let page = history.page(AnswerStart::After(EXECUTOR, 3), &[], 100);
    assert_eq!(
        (numbers(&page), page.lost, page.continues),
        (vec![3, 4, 8, 9], 3, true)
    );
    let other = history.page(AnswerStart::After(EXECUTOR + 1, 3), &[], 1);
    assert_eq!((numbers(&other), other.continues), (vec![0], false));
    let count = RECORDS_MAX as u64 + 10;
    let full = kept(0..count);
    assert_eq!(full.records.len(), RECORDS_MAX);
    let page = full.page(AnswerStart::After(EXECUTOR, 3), &[], 1);
    assert_eq!((numbers(&page), page.continues), (vec![10], false));
    let future = full.page(AnswerStart::After(EXECUTOR, count + 1), &[], 1);
    assert!(!future.continues);
}

#[test]
fn records_of_another_executor_replace_those_before() {
    let mut history = kept(0..5);
    history.add(EXECUTOR + 1, &[record(0, 0)]);
    let page = history.page(AnswerStart::Newest, &[], 100);
    assert_eq!(numbers(&page), [0]);
    assert_eq!(
        page.values[0].name, "#7/monitor0",
        "its names are not known yet"
    );
}

#[test]
fn what_cannot_be_answered_is_refused() {
    let request = |after: Option<&str>, seconds| HistoryRequest {
        after: after.map(str::to_owned),
        seconds,
        ..HistoryRequest::default()
    };
    for wrong in [
        request(Some("7"), None),
        request(Some("xyz-7"), None),
        request(Some("ab-"), None),
        request(Some("ab-7"), Some(1.0)),
        request(None, Some(-1.0)),
        request(None, Some(f64::NAN)),
    ] {
        let code = begin(&wrong).map_err(|error| error.code);
        assert_eq!(code, Err(codes::BAD_REQUEST), "{wrong:?}");
    }
}
