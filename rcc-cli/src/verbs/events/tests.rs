//! Filters and folding of the event log.

use rcc_protocol::events::{CommandFault, EventOrigin, EventSource, LastEvent};

use super::view::{Line, folded, json};
use super::*;

fn event(role: EventOrigin, label: &str, cycle: Option<u64>, what: EventKind) -> Event {
    Event::now(EventSource::this(role, label), cycle, what)
}

fn loaded() -> Event {
    let executor = EventSource::this(EventOrigin::Executor, "exec").incarnation;
    let what = EventKind::Loaded {
        command: 3,
        executor,
        net: "line".into(),
        primitives: 9,
        uses: vec!["lwr".into()],
        outcomes: vec!["arrived".into(), "touched".into()],
    };
    event(EventOrigin::Loader, "loader", None, what)
}

fn lost() -> Event {
    let fault = CommandFault {
        code: "device lost".into(),
        device: Some("lwr".into()),
        joint: None,
        rule: None,
        value: None,
        limit: None,
        unit: None,
    };
    let what = EventKind::Command {
        command: 3,
        state: "terminated".into(),
        reason: Some("fault".into()),
        outcome: None,
        cycles: Some(7),
        fault: Some(fault),
    };
    event(EventOrigin::Executor, "exec", Some(70), what)
}

fn late(cycle: u64, count: u64, wake_us: f64) -> Event {
    let what = EventKind::Late {
        count,
        first_cycle: cycle,
        worst_wake_us: wake_us,
        worst_exec_us: 20.0,
        computed_long: Some(0),
        command: None,
        command_us: None,
    };
    event(EventOrigin::Executor, "exec", Some(cycle), what)
}

fn stopping(role: EventOrigin, label: &str) -> Event {
    event(role, label, None, EventKind::Stopping { why: "x".into() })
}

fn filter(arguments: &Arguments) -> EventFilter {
    let mut filter = EventFilter::new(arguments).unwrap();
    filter.prepare(&[loaded(), lost()]);
    filter
}

fn of_net(net: &str) -> EventFilter {
    filter(&Arguments {
        net: Some(net.into()),
        ..Arguments::default()
    })
}

fn of_device(device: &str) -> EventFilter {
    filter(&Arguments {
        device: Some(device.into()),
        ..Arguments::default()
    })
}

fn since(text: &str) -> Result<Since, Failure> {
    let since = Some(text.to_owned());
    let arguments = Arguments {
        since,
        ..Arguments::default()
    };
    EventFilter::new(&arguments).map(|filter| filter.since().clone())
}

#[test]
fn a_command_has_the_name_under_which_it_was_loaded() {
    let filter = filter(&Arguments::default());
    let sentence = lost().sentence(&|executor, id| filter.title(executor, id));
    assert!(
        sentence.starts_with("line#3 terminated by a fault, device lost: lwr"),
        "{sentence}"
    );
    assert_eq!(filter.title("another life", 3), "#3");
}

#[test]
fn an_outcome_has_the_name_of_the_text() {
    let filter = filter(&Arguments::default());
    for (cycles, words) in [
        (2104, "line#3 terminated: finished: touched"),
        (1, "line#3 terminated: finished in its first cycle: touched"),
    ] {
        let what = EventKind::Command {
            command: 3,
            state: "terminated".into(),
            reason: Some("finished".into()),
            outcome: Some(2),
            cycles: Some(cycles),
            fault: None,
        };
        let ended = event(EventOrigin::Executor, "exec", Some(70), what);
        assert_eq!(ended.sentence_with(&filter), words);
        let line = json(&ended, words, &filter);
        assert!(line.contains("\"outcome\":\"touched\""), "{line}");
    }
}

#[test]
fn a_net_is_wanted_by_name_id_or_both() {
    for net in ["line", "line#3", "3"] {
        assert!(of_net(net).matches(&lost()), "{net}");
        assert!(of_net(net).require_known(&[], false).is_ok(), "{net}");
    }
    assert!(!of_net("other").matches(&lost()));
}

#[test]
fn a_device_is_wanted_with_its_driver_and_its_process() {
    let died = EventKind::ProcessDied {
        process: "driver/lwr".into(),
        pid: 1,
        how: "SIGKILL".into(),
        last_words: String::new(),
    };
    for name in ["lwr", "driver/lwr"] {
        let filter = of_device(name);
        assert!(filter.matches(&lost()));
        assert!(filter.matches(&stopping(EventOrigin::Driver, "lwr")));
        assert!(filter.matches(&event(EventOrigin::Supervisor, "up", None, died.clone())));
        assert!(!filter.matches(&stopping(EventOrigin::Driver, "io")));
    }
}

#[test]
fn unknown_names_are_refused_with_those_that_are_known() {
    let refused = of_device("lrw")
        .require_known(&["io".to_owned()], true)
        .unwrap_err();
    assert!(refused.body.message.contains("`lrw`"), "{refused:?}");
    assert_eq!(refused.body.help.as_deref(), Some("known: io, lwr"));
    assert!(
        of_device("io")
            .require_known(&["io".to_owned()], false)
            .is_ok()
    );
    let refused = of_net("lime").require_known(&[], false).unwrap_err();
    assert_eq!(refused.body.help.as_deref(), Some("known: line"));
    // A net that is loaded later may be followed.
    assert!(of_net("lime").require_known(&[], true).is_ok());
}

#[test]
fn a_severity_includes_the_higher_ones() {
    for (severity, wanted) in [
        (SeverityArgument::Info, [true, true, true]),
        (SeverityArgument::Warning, [false, true, true]),
        (SeverityArgument::Error, [false, false, true]),
    ] {
        let filter = filter(&Arguments {
            severity: Some(severity),
            ..Arguments::default()
        });
        let found = [loaded(), late(1, 1, 1.0), lost()].map(|event| filter.matches(&event));
        assert_eq!(found, wanted, "{severity:?}");
    }
}

#[test]
fn since_takes_a_time_a_date_or_a_cycle() {
    assert_eq!(since("81 422").unwrap(), Since::Cycle(81_422));
    for time in ["10min", "3h", "2d", "500ms"] {
        assert!(matches!(since(time).unwrap(), Since::Time(_)), "{time}");
    }
    for (text, time) in [
        ("2026-11-23", "2026-11-23"),
        ("2026-11-23T16:35", "2026-11-23T16:35"),
        ("2026-11-23 16:35:17.9", "2026-11-23T16:35:17.9"),
    ] {
        assert_eq!(since(text).unwrap(), Since::Time(time.to_owned()));
    }
    for bad in ["yesterday", "2026-11", "2026-11-23X16", "16:35", "-3h", ""] {
        let refused = since(bad).unwrap_err();
        assert!(
            refused
                .body
                .help
                .as_deref()
                .is_some_and(|help| help.contains("2026-11-23T16:35")),
            "{bad}: {refused:?}"
        );
    }
    let since = Some("71".to_owned());
    let filter = filter(&Arguments {
        since,
        ..Arguments::default()
    });
    assert!(!filter.matches(&lost()));
}

#[test]
fn late_cycles_fold_into_one_line_with_count_worst_first_and_last() {
    let filter = filter(&Arguments::default());
    let quiet = || stopping(EventOrigin::Driver, "io");
    let events = [
        late(10, 1, 300.0),
        quiet(),
        late(900, 3, 1200.0),
        late(4000, 1, 5.0),
        quiet(),
    ];
    let lines = folded(events.iter());
    let [Line::Late(fold), Line::Event(_), Line::Event(_)] = &lines[..] else {
        panic!("{lines:?}");
    };
    let words = fold.sentence(&filter);
    for part in [
        "5 late cycles from cycle 10 on",
        "up to 1.200 ms late",
        "3 reports, the last at ",
        ", cycle 4 000",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
}

#[test]
fn late_cycles_before_and_after_a_fault_are_not_folded_together() {
    let events = [
        late(10, 1, 300.0),
        late(11, 1, 300.0),
        lost(),
        late(71, 1, 5.0),
    ];
    let lines = folded(events.iter());
    let is_late = |line: &Line| matches!(line, Line::Late(_));
    assert_eq!(
        lines.iter().map(is_late).collect::<Vec<_>>(),
        [true, false, true]
    );
    // Neither are those of two executors.
    let mut other = late(10, 1, 1.0);
    other.source.incarnation = "0".repeat(16);
    assert_eq!(folded([late(10, 1, 1.0), other].iter()).len(), 2);
}

#[test]
fn one_late_cycle_is_a_sentence_in_the_singular() {
    let filter = filter(&Arguments::default());
    let lines = folded([late(7, 1, 300.0)].iter());
    let [Line::Late(fold)] = &lines[..] else {
        panic!("{lines:?}");
    };
    let words = fold.sentence(&filter);
    assert!(
        words.starts_with("1 late cycle, cycle 7: woke up 0.300 ms late"),
        "{words}"
    );
}

#[test]
fn the_newest_run_includes_runs_before_it_that_died() {
    let start = |died: bool| {
        let last = LastEvent {
            who: "loader".into(),
            time: String::new(),
            words: String::new(),
        };
        let what = EventKind::CellStarted {
            config: "cell.yaml".into(),
            ports: std::collections::BTreeMap::new(),
            previous: died.then_some(last),
        };
        event(EventOrigin::Supervisor, "up", None, what)
    };
    assert_eq!(newest_run(&[]), 0);
    assert_eq!(newest_run(&[loaded(), lost()]), 0);
    let all = [start(false), lost(), start(false), lost(), start(true)];
    assert_eq!(newest_run(&all), 2);
}
