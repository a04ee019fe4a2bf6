//! The dashboard beside real cells: who is let in, what pages are sent, and what they can do. Each test has a cell of its
//! own; run by the threads of the test harness.

use std::fs::Permissions;
use std::io::Read;
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::dashboard::{DashboardServer, request};
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::programs::program;
use rcc_tests::{TestCell, await_some, repository};
use serde_json::{Value, json};

fn net(name: &str) -> String {
    let path = repository().join("configs/nets").join(name);
    std::fs::read_to_string(path).expect("the example")
}

#[test]
fn only_this_machine_s_own_page_with_the_token_is_served() {
    let cell = TestCell::demo();
    let server = DashboardServer::start(&cell, &[]);
    let (port, token) = (server.port(), server.token());
    let own = format!("host: 127.0.0.1:{port}\r\n");
    let cookie = format!("cookie: rcc-dashboard-{port}={token}\r\n");
    let status =
        |method: &str, path: &str, lines: &str| server.request(method, path, lines, "").status;

    // The first address becomes a cookie that scripts cannot read and other sites do not send.
    let first = server.request("GET", &format!("/?token={token}"), &own, "");
    assert_eq!(first.status, 303, "{first:?}");
    let sent =
        format!("set-cookie: rcc-dashboard-{port}={token}; path=/; httponly; samesite=strict");
    assert!(first.head.contains(&sent), "{}", first.head);
    let page = server.request("GET", "/", &format!("{own}{cookie}"), "");
    assert_eq!(page.status, 200);
    for header in [
        "content-security-policy: default-src 'self';",
        "x-frame-options: deny",
        "referrer-policy: no-referrer",
    ] {
        assert!(page.head.contains(header), "{header}: {}", page.head);
    }
    // No token, a wrong one, and one in another address.
    for path in ["/", "/api/stream", "/assets/app.js", "/api/incidents"] {
        assert_eq!(status("GET", path, &own), 401, "{path}");
        let wrong = format!(
            "{own}cookie: rcc-dashboard-{port}={}\r\n",
            token.replace('0', "1") + "0"
        );
        assert_eq!(status("GET", path, &wrong), 403, "{path}");
    }
    assert_eq!(
        status("GET", "/?token=0123456789abcdef0123456789abcdef", &own),
        403
    );
    // DNS rebinding: the name of another host leads to this address.
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1"] {
        assert_eq!(
            status("GET", "/", &format!("host: {host}\r\n{cookie}")),
            421,
            "{host}"
        );
    }
    // Commands of other pages, of no page, and without a token stop before the loader.
    let id = cell.run(&net("belt.yaml"));
    let cancel = format!("/api/nets/{id}/cancel");
    for origin in [
        "",
        "origin: http://evil.example\r\n",
        "origin: null\r\n",
        "origin: http://127.0.0.1:1\r\n",
    ] {
        assert_eq!(
            status("POST", &cancel, &format!("{own}{cookie}{origin}")),
            403,
            "{origin}"
        );
        assert_eq!(
            status("POST", "/api/cancel", &format!("{own}{cookie}{origin}")),
            403,
            "{origin}"
        );
    }
    let foreign = format!("{own}origin: http://127.0.0.1:{port}\r\n");
    assert_eq!(status("POST", &cancel, &foreign), 401);
    assert_eq!(cell.state(id)["state"], "running");
    // Its own page may.
    assert_eq!(server.own("POST", &cancel, "").status, 200);
    cell.assert_ends(id, "canceled");
    assert_eq!(server.interrupt(), Some(130));
    cell.stop();
}

#[test]
fn a_page_sees_nets_values_of_monitored_and_other_ports_and_events() {
    let cell = TestCell::demo();
    let server = DashboardServer::start(&cell, &[]);
    let mut page = server.open();
    let found = page.find("cell", |data| data["devices"].as_array().cloned());
    let names: Vec<&Value> = found.iter().map(|device| &device["name"]).collect();
    assert_eq!(names, ["lwr", "io"]);
    let id = cell.run(&net("belt.yaml"));
    page.find("nets", |data| {
        let rows = data["rows"].as_array()?;
        rows.iter()
            .find(|row| row["id"] == id && row["state"] == "running")
            .cloned()
    });
    server.watch(&page, &["belt/soft.out", "circle/move.joints"], 200.0);
    let sampled = page.find("values", |data| data["series"].as_array()?.first().cloned());
    assert_eq!(sampled["key"], format!("belt#{id}/soft.out"));
    assert_eq!(
        (&sampled["unit"], &sampled["source"]),
        (&json!("m/s"), &json!("sample"))
    );
    // A net that is loaded later, and whose port has a monitor: every cycle at most once, in order.
    let circle = cell.run(&net("circle.yaml"));
    let key = format!("circle#{circle}/move.joints");
    let mut last = 0;
    for _ in 0..10 {
        let cycles = page.find("values", |data| {
            let columns = data["data"].as_array()?;
            columns.iter().find(|column| column["key"] == *key)?["c"]
                .as_array()
                .cloned()
        });
        for cycle in cycles {
            let cycle = cycle.as_u64().expect("a cycle");
            assert!(cycle > last, "{cycle} after {last}");
            last = cycle;
        }
    }
    cell.await_end(circle);
    page.find("events", |data| {
        let events = data["events"].as_array()?;
        let is_end = |event: &&Value| {
            let words = event["words"].as_str().unwrap_or_default();
            words.contains(&format!("circle#{circle}")) && words.contains("terminated")
        };
        events.iter().find(is_end).cloned()
    });
    drop(page);
    assert_eq!(server.interrupt(), Some(130));
    cell.stop();
}

#[test]
fn start_takes_a_confirmation_of_this_very_net_and_may_be_switched_off() {
    let cell = TestCell::demo();
    let id = cell.load(&net("belt.yaml"));
    let server = DashboardServer::start(&cell, &[]);
    let start = format!("/api/nets/{id}/start");
    for body in [
        "",
        "{}",
        "{\"confirm\": \"belt\"}",
        "{\"confirm\": \"line#1\"}",
    ] {
        let reply = server.own("POST", &start, body);
        assert_eq!(reply.status, 400, "{body}: {reply:?}");
    }
    assert_eq!(cell.state(id)["state"], "ready");
    let confirmed = json!({"confirm": format!("belt#{id}")}).to_string();
    let read_only = DashboardServer::start(&cell, &["--no-start"]);
    let refused = read_only.own("POST", &start, &confirmed);
    assert_eq!(
        (refused.status, refused.json()["code"].clone()),
        (403, json!("RCC4009"))
    );
    assert_eq!(cell.state(id)["state"], "ready");
    assert_eq!(server.own("POST", &start, &confirmed).status, 200);
    // CANCEL of everything that is active, by a dashboard that may not start anything.
    let canceled = read_only.own("POST", "/api/cancel", "").json();
    assert_eq!(canceled, json!([{"id": id, "net": "belt", "error": null}]));
    cell.assert_ends(id, "canceled");
    assert_eq!(read_only.own("POST", "/api/cancel", "").json(), json!([]));
    drop((server, read_only));
    cell.stop();
}

#[test]
fn a_dashboard_survives_loader_and_executor_and_the_cell_survives_it() {
    let cell = TestCell::demo();
    let server = DashboardServer::start(&cell, &[]);
    let mut page = server.open();
    server.watch(&page, &["belt/soft.out"], 100.0);
    for (role, label) in [(Role::Loader, "loader"), (Role::Executor, "exec")] {
        let dead = cell.kill(role, label);
        cell.await_successor(role, label, dead);
        cell.await_devices();
        if role == Role::Executor {
            // Its nets are gone with it.
            page.find("nets", |data| (data["ids"] == json!([])).then_some(()));
        }
        let id = cell.run(&net("belt.yaml"));
        page.find("values", |data| {
            let columns = data["data"].as_array()?;
            columns
                .iter()
                .find(|column| column["key"] == format!("belt#{id}/soft.out"))
                .cloned()
        });
        if role == Role::Loader {
            cell.done(id, "cancel");
            cell.assert_ends(id, "canceled");
        }
    }
    // The dashboard is killed while a net runs, and leaves a place that the next one takes.
    signal(server.pid(), Signal::SIGKILL);
    drop(server);
    let server = DashboardServer::start(&cell, &[]);
    let mut page = server.open();
    server.watch(&page, &["belt/soft.out"], 100.0);
    page.next("values");
    drop(page);
    assert_eq!(server.interrupt(), Some(130));
    cell.interrupt();
}

#[test]
fn a_page_that_reads_nothing_delays_no_other_page() {
    let cell = TestCell::demo();
    let id = cell.run(&net("belt.yaml"));
    let server = DashboardServer::start(&cell, &[]);
    // Their sockets fill, and then the ring of updates; nothing else is kept for them.
    let suspended: Vec<_> = (0..4).map(|_| server.open()).collect();
    for page in &suspended {
        server.watch(page, &["belt/*"], 250.0);
    }
    let mut page = server.open();
    server.watch(&page, &["belt/soft.out"], 250.0);
    let mut received = 0;
    let mut first = None;
    // Twice the updates that the ring holds.
    while received < 256 {
        let cycle = page.find("values", |data| data["data"][0]["c"][0].as_u64());
        first.get_or_insert(cycle);
        received += 1;
    }
    drop(suspended);
    // Pages that were closed make room again.
    await_some("room for another page", || {
        let pages: Vec<_> = (0..20).map(|_| server.open()).collect();
        (pages.len() == 20).then_some(())
    });
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    drop(page);
    assert_eq!(server.interrupt(), Some(130));
    cell.stop();
}

#[test]
fn a_net_is_drawn_and_an_incident_is_evaluated_again() {
    let cell = TestCell::demo();
    let id = cell.run(&net("belt.yaml"));
    let server = DashboardServer::start(&cell, &[]);
    let graph = server.own("GET", &format!("/api/nets/{id}/graph"), "");
    assert!(
        graph.status == 200 && graph.body.contains("data-id=\"soft\""),
        "{graph:?}"
    );
    assert_eq!(server.own("GET", "/api/nets/99/graph", "").status, 404);
    let written = server.own("POST", "/api/incidents", "");
    assert_eq!(written.status, 200, "{written:?}");
    let list = server.own("GET", "/api/incidents", "").json();
    let path = list[0]["file"].as_str().expect("a file").to_owned();
    let name = path.rsplit('/').next().expect("a name");
    let ports = server
        .own("GET", &format!("/api/incidents/{name}"), "")
        .json();
    assert_eq!(ports["nets"][0]["net"], "belt", "{ports}");
    let values = server
        .own(
            "GET",
            &format!("/api/incidents/{name}/values?ports=belt/soft.out"),
            "",
        )
        .json();
    assert_eq!(values["identical"], true, "{values}");
    let cycles = values["nets"][0]["cycles"].as_array().map_or(0, Vec::len);
    let column = values["nets"][0]["columns"]["belt/soft.out"]
        .as_array()
        .map_or(0, Vec::len);
    assert!(cycles > 0 && cycles == column, "{cycles} {column}");
    for bad in [
        "../x.rcc-incident",
        "%2e%2e%2fx.rcc-incident",
        "none.rcc-incident",
    ] {
        let refused = server.own("GET", &format!("/api/incidents/{bad}"), "");
        assert!(matches!(refused.status, 404 | 422), "{bad}: {refused:?}");
    }
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    drop(server);
    cell.stop();
}

#[test]
fn a_page_arms_a_condition_at_the_executor_and_disarms_no_other_rule() {
    let cell = TestCell::demo();
    let id = cell.run(&net("belt.yaml"));
    // A page that may not start nets may arm: such a rule only records.
    let server = DashboardServer::start(&cell, &["--no-start"]);
    let arm = |body: &Value| server.own("POST", "/api/triggers", &body.to_string());
    let armed = arm(&json!({"when": "belt.soft.out > 0.1", "edge": true}));
    assert_eq!(armed.status, 200, "{armed:?}");
    let listed = server.own("GET", "/api/triggers", "").json();
    assert_eq!(listed[0]["when"], "belt.soft.out > 0.1");
    assert_eq!(listed[0]["record"]["edge"], true);
    for refused in [
        json!({"when": "belt.none.out > 1", "edge": true}),
        json!({"when": "belt.soft.out > 1"}),
        json!({"when": "true", "edge": true, "start": ["belt"]}),
    ] {
        assert!(arm(&refused).status >= 400, "{refused}");
    }
    let set = cell.rest(
        "PUT",
        &format!("/commands/{id}/inputs"),
        r#"{"speed": 0.3}"#,
    );
    assert_eq!(set.status, 200, "{set:?}");
    await_some("the incident", || {
        let incidents = cell.rest("GET", "/incidents", "").body;
        let mut rows = incidents.as_array()?.iter();
        rows.any(|row| row["condition"] == "belt.soft.out > 0.1")
            .then_some(())
    });
    // A rule that cancels is none of its business.
    let rule = json!({"rules": [{"when": "belt.soft.out > 0.9", "cancel": ["belt"], "on_client_loss": "go on"}]});
    let installed = cell.rest("POST", "/rules", &rule.to_string());
    assert_eq!(installed.status, 200, "{installed:?}");
    let disarm = |rule: &Value| server.own("POST", &format!("/api/triggers/{rule}/disarm"), "");
    assert_eq!(disarm(&installed.body["rules"][0]["rule"]).status, 404);
    let waiting = arm(&json!({"when": "belt.soft.out > 0.8", "edge": false})).json();
    assert_eq!(disarm(&waiting["rules"][0]["rule"]).status, 200);
    cell.done(id, "cancel");
    drop(server);
    cell.stop();
}

#[test]
fn the_demo_opens_its_dashboard() {
    let folder = rcc_testing::folder();
    let opened = folder.path().join("opened");
    let browser = folder.path().join("browser");
    let script = format!(
        "#!/bin/sh\nprintf %s \"$1\" > {0}.new && mv {0}.new {0}\n",
        opened.display()
    );
    std::fs::write(&browser, script).expect("the script is written");
    std::fs::set_permissions(&browser, Permissions::from_mode(0o700)).expect("its mode is set");
    let mut demo = Command::new(program("rcc-cli"));
    demo.args(["demo", "--open"])
        .env("RCC_RUNTIME_DIR", folder.path())
        .env("RCC_STATE_DIR", folder.path().join("state"))
        .env("BROWSER", &browser)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .current_dir(repository());
    let mut demo = ends_with_test(&mut demo).spawn().expect("the demo starts");
    let address = await_some("the browser", || std::fs::read_to_string(&opened).ok());
    let (port, path) = address
        .strip_prefix("http://127.0.0.1:")
        .and_then(|rest| rest.split_once('/'))
        .expect("the page's address");
    let port: u16 = port.parse().expect("a port");
    let host = format!("host: 127.0.0.1:{port}\r\n");
    let first = request(port, ("GET", &format!("/{path}")), &host, "");
    assert_eq!(first.status, 303, "{first:?}");
    let token = path.strip_prefix("?token=").expect("a token");
    let cookie = format!("{host}cookie: rcc-dashboard-{port}={token}\r\n");
    let page = request(port, ("GET", "/"), &cookie, "");
    assert!(page.body.contains("<title>"), "{page:?}");
    signal(demo.id(), Signal::SIGINT);
    let mut output = String::new();
    let mut pipe = demo.stdout.take().expect("a pipe");
    pipe.read_to_string(&mut output).expect("text");
    assert!(
        output.contains(&format!("dashboard: {address}")),
        "{output}"
    );
    // The figures, or the time after them, were interrupted.
    let code = demo.wait().expect("it is a child").code();
    assert!(matches!(code, Some(130 | 0)), "{code:?} {output}");
    assert!(
        TcpStream::connect(("127.0.0.1", port)).is_err(),
        "the dashboard ends with it"
    );
}
