//! `/metrics` beside real cells: it parses, agrees with the loader, its counters behave as counters, and its labels are
//! bounded. Each test has a cell of its own; run by the threads of the test harness.

use std::collections::BTreeMap;

use rcc_protocol::Role;
use rcc_tests::dashboard::DashboardServer;
use rcc_tests::{TestCell, await_some, repository};

/// Names that have labels of their own.
const NAMES_MAX: usize = 50;

/// Samples by name and labels, as written.
type Samples = BTreeMap<String, f64>;

fn net(name: &str) -> String {
    let path = repository().join("configs/nets").join(name);
    std::fs::read_to_string(path).expect("the example")
}

fn scrape(server: &DashboardServer) -> Samples {
    let lines = format!(
        "host: 127.0.0.1:{}\r\naccept: application/openmetrics-text;version=1.0.0\r\n",
        server.port()
    );
    let reply = server.request("GET", "/metrics", &lines, "");
    assert_eq!(reply.status, 200, "{reply:?}");
    let kind = "content-type: application/openmetrics-text; version=1.0.0; charset=utf-8";
    assert!(reply.head.contains(kind), "{}", reply.head);
    parsed(&reply.body)
}

/// Parses OpenMetrics strictly: each family is declared once with help and type before its samples, names have the
/// suffixes of their type and unit, no series occurs twice, histograms are cumulative, and the end is marked.
fn parsed(text: &str) -> Samples {
    let text = text.strip_suffix("# EOF\n").expect("it ends with EOF");
    let (mut samples, mut families) = (Samples::new(), Vec::new());
    let (mut family, mut kind, mut last) = (String::new(), String::new(), 0.0);
    for line in text.lines() {
        if let Some(rest) = line.strip_prefix("# HELP ") {
            let (name, help) = rest.split_once(' ').expect("a help");
            assert!(
                !help.is_empty() && !families.contains(&name.to_owned()),
                "{line}"
            );
            families.push(name.to_owned());
            family = name.to_owned();
        } else if let Some(rest) = line.strip_prefix("# TYPE ") {
            let (name, told) = rest.split_once(' ').expect("a type");
            assert_eq!(name, family);
            kind = told.to_owned();
        } else if let Some(rest) = line.strip_prefix("# UNIT ") {
            let (name, unit) = rest.split_once(' ').expect("a unit");
            assert!(
                name == family && family.ends_with(&format!("_{unit}")),
                "{line}"
            );
        } else {
            let (series, value) = line.rsplit_once(' ').expect("a value");
            let value: f64 = value.parse().expect("a number");
            let name = series.split('{').next().expect("a name");
            let suffix = name.strip_prefix(&family).expect("a sample of its family");
            let suffixes: &[&str] = match kind.as_str() {
                "counter" => &["_total"],
                "gauge" => &[""],
                "histogram" => &["_sum", "_count", "_bucket"],
                other => panic!("{other}"),
            };
            assert!(suffixes.contains(&suffix), "{line}");
            assert!(
                series.contains("cell=\"") && series.ends_with('}'),
                "{line}"
            );
            assert!(kind == "gauge" || value >= 0.0, "{line}");
            if suffix == "_bucket" {
                assert!(value >= last, "{line}");
            }
            last = if suffix == "_bucket" { value } else { 0.0 };
            if series.contains("le=\"+Inf\"") {
                let count = series
                    .replace("_bucket", "_count")
                    .replace(",le=\"+Inf\"", "");
                assert_eq!(samples.get(&count), Some(&value), "{line}");
            }
            assert!(samples.insert(series.to_owned(), value).is_none(), "{line}");
        }
    }
    samples
}

/// The value of the only series that begins so and has all of these labels.
fn value(samples: &Samples, name: &str, labels: &[(&str, &str)]) -> Option<f64> {
    let labels: Vec<String> = labels
        .iter()
        .map(|(key, value)| format!("{key}=\"{value}\""))
        .collect();
    let is_it = |series: &str| {
        series.starts_with(&format!("{name}{{"))
            && labels.iter().all(|label| series.contains(label))
    };
    let mut found = samples.iter().filter(|(series, _)| is_it(series));
    let (_, value) = found.next()?;
    assert!(found.next().is_none(), "{name} {labels:?}");
    Some(*value)
}

#[test]
fn metrics_agree_with_the_loader() {
    let cell = TestCell::demo();
    let server = DashboardServer::start(&cell, &["--metrics-open"]);
    let id = cell.run(&net("belt.yaml"));
    let before = cell.rest("GET", "/status", "").body;
    let samples = scrape(&server);
    let after = cell.rest("GET", "/status", "").body;
    for (name, labels, field, scale) in [
        ("rcc_cycles_total", &[][..], "cycle", 1.0),
        (
            "rcc_late_cycles_total",
            &[("cause", "woken_late")],
            "late_woken",
            1.0,
        ),
        (
            "rcc_late_cycles_total",
            &[("cause", "computed_long")],
            "late_computed",
            1.0,
        ),
        ("rcc_skipped_periods_total", &[], "skipped_periods", 1.0),
        ("rcc_incidents_total", &[], "incidents", 1.0),
        ("rcc_cycle_period_seconds", &[], "period_ns", 1e-9),
    ] {
        let of = |status: &serde_json::Value| {
            status["executor"][field]
                .as_u64()
                .map(|value| value as f64 * scale)
        };
        let found = value(&samples, name, labels);
        assert!(
            found.is_some() && of(&before) <= found && found <= of(&after),
            "{name}"
        );
    }
    let causes = ["late_woken", "late_computed"].map(|name| after["executor"][name].as_u64());
    let sum = causes.into_iter().flatten().sum::<u64>();
    assert_eq!(Some(sum), after["executor"]["late"].as_u64());
    for (grant, field) in [
        ("sched_fifo", "fifo"),
        ("memory_locked", "locked"),
        ("own_core", "pinned"),
    ] {
        let told = value(&samples, "rcc_realtime_granted", &[("grant", grant)]);
        assert_eq!(
            told,
            after["executor"][field].as_bool().map(f64::from),
            "{grant}"
        );
    }
    let running = [("net", "belt"), ("state", "running")];
    assert_eq!(value(&samples, "rcc_nets", &running), Some(1.0));
    for device in ["lwr", "io"] {
        let seen = cell.device(device).expect("a device");
        let state = seen["state"].as_str().expect("a state");
        let labels = [("device", device), ("state", state)];
        assert_eq!(
            value(&samples, "rcc_device_state", &labels),
            Some(1.0),
            "{device}"
        );
        let losses = value(&samples, "rcc_device_losses_total", &[("device", device)]);
        assert_eq!(losses, seen["losses"].as_f64(), "{device}");
        let quality = value(&samples, "rcc_device_quality_ratio", &[("device", device)]);
        assert!(
            quality.is_some_and(|quality| (0.0..=1.0).contains(&quality)),
            "{device}"
        );
    }
    // Acknowledged late cycles stay in the counters.
    cell.rest("POST", "/status/acknowledge", "");
    let (wakeups, executions) = (
        "rcc_cycle_wakeup_seconds_count",
        "rcc_cycle_execution_seconds_count",
    );
    let later = scrape(&server);
    for name in [wakeups, executions] {
        assert!(
            value(&later, name, &[]) >= value(&samples, name, &[]),
            "{name}"
        );
    }
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    let ended = [("net", "belt"), ("reason", "canceled")];
    assert_eq!(value(&scrape(&server), "rcc_nets_ended", &ended), Some(1.0));
    assert_eq!(server.own("POST", "/api/incidents", "").status, 200);
    await_some("the incident", || {
        (value(&scrape(&server), "rcc_incidents_total", &[]) > Some(0.0)).then_some(())
    });
    drop(server);
    cell.stop();
}

#[test]
fn counters_survive_a_restart_of_the_executor_as_counters() {
    let cell = TestCell::demo();
    let server = DashboardServer::start(&cell, &["--metrics-open"]);
    let first = scrape(&server);
    assert_eq!(value(&first, "rcc_executor_restarts_total", &[]), Some(0.0));
    let dead = cell.kill(Role::Executor, "exec");
    cell.await_successor(Role::Executor, "exec", dead);
    cell.await_devices();
    let second = await_some("a scrape of the new executor", || {
        let samples = scrape(&server);
        (value(&samples, "rcc_executor_up", &[]) == Some(1.0)).then_some(samples)
    });
    // One restart, told once; the new executor counts from zero and says when it started.
    assert_eq!(
        value(&second, "rcc_executor_restarts_total", &[]),
        Some(1.0)
    );
    let start = "rcc_executor_start_time_seconds";
    assert!(value(&second, start, &[]) > value(&first, start, &[]));
    let third = scrape(&server);
    assert_eq!(value(&third, "rcc_executor_restarts_total", &[]), Some(1.0));
    for (series, counted) in &second {
        let name = series.split('{').next().unwrap_or_default();
        if name.ends_with("_total") || name.ends_with("_count") || name.ends_with("_bucket") {
            assert!(third.get(series) >= Some(counted), "{series}");
        }
    }
    // Without a loader no old value is exported.
    let _place = cell.interrupt();
    let gone = await_some("a scrape without a cell", || {
        let samples = scrape(&server);
        (value(&samples, "rcc_loader_up", &[]) == Some(0.0)).then_some(samples)
    });
    assert_eq!(value(&gone, "rcc_executor_up", &[]), Some(0.0));
    assert_eq!(value(&gone, "rcc_cycles_total", &[]), None);
    assert_eq!(server.interrupt(), Some(130));
}

#[test]
fn more_names_than_labels_are_counted_together() {
    let cell = TestCell::demo();
    let text = net("belt.yaml");
    let named = |index: usize| text.replacen("net: belt", &format!("net: belt-{index:02}"), 1);
    assert_ne!(named(7), text, "the example's first line names it");
    for index in 0..NAMES_MAX + 5 {
        cell.load(&named(index));
    }
    let server = DashboardServer::start(&cell, &["--metrics-open"]);
    let samples = scrape(&server);
    let nets: Vec<_> = samples
        .iter()
        .filter(|(series, _)| series.starts_with("rcc_nets{"))
        .collect();
    assert_eq!(nets.len(), NAMES_MAX + 1);
    let other = [("net", "other"), ("state", "ready")];
    assert_eq!(value(&samples, "rcc_nets", &other), Some(5.0));
    let all: f64 = nets.iter().map(|(_, count)| **count).sum();
    assert_eq!(all, (NAMES_MAX + 5) as f64);
    drop(server);
    cell.stop();
}

#[test]
fn a_scraper_needs_its_token_and_gets_nothing_else() {
    let cell = TestCell::demo();
    let token = "0123456789abcdef0123456789abcdef";
    let file = cell.file(token);
    let private = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    std::fs::set_permissions(&file, private).expect("a mode");
    let path = file.display().to_string();
    let server = DashboardServer::start(&cell, &["--metrics-token", &path]);
    let host = format!("host: 127.0.0.1:{}\r\n", server.port());
    let status = |path: &str, lines: &str| server.request("GET", path, lines, "").status;
    let bearer = format!("authorization: Bearer {token}\r\n");
    assert_eq!(status("/metrics", &host), 401);
    assert_eq!(
        status("/metrics", &format!("{host}authorization: Bearer x\r\n")),
        403
    );
    assert_eq!(status("/api/timing", &format!("{host}{bearer}")), 401);
    let foreign = format!("host: evil.example:{}\r\n{bearer}", server.port());
    assert_eq!(status("/metrics", &foreign), 421);
    // A client that does not accept OpenMetrics gets the older format.
    let reply = server.request("GET", "/metrics", &format!("{host}{bearer}"), "");
    assert_eq!(reply.status, 200);
    assert!(
        reply
            .head
            .contains("content-type: text/plain; version=0.0.4"),
        "{}",
        reply.head
    );
    assert!(
        reply.body.contains("# TYPE rcc_cycles_total counter\n") && !reply.body.contains("# EOF")
    );
    drop(server);
    cell.stop();
}
