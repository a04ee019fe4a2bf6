//! The cell of another machine: with `--url`, verbs answer about the cell at that address, with the same JSON as on the
//! cell's machine. The address is a TCP port of the test's cell, and the runtime folder of the client is another one. Run
//! by the threads of the test harness.

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::{Command, Output};

use rcc_testing::TempDir;
use rcc_tests::{TestCell, await_some, nets, program};
use serde_json::Value;

const TOKEN: &str = "0123456789abcdef0123456789abcdef";

/// A cell with a TCP port, and a folder for its clients, which is removed also if the test fails.
struct RemoteCell {
    cell: TestCell,
    url: String,
    folder: TempDir,
}

impl RemoteCell {
    fn start() -> RemoteCell {
        // Free until the loader binds it, unless another program is as fast; the cell would say so.
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        let address = free.expect("a free port");
        let folder = rcc_testing::folder();
        let token = folder.path().join("token");
        fs::write(&token, TOKEN).expect("a token");
        fs::set_permissions(&token, fs::Permissions::from_mode(0o600)).expect("private");
        let access = format!(
            "access: {{tcp: {{listen: \"{address}\", token_file: {}}}}}\n",
            token.display()
        );
        RemoteCell {
            cell: TestCell::changed(|text| text + &access),
            url: format!("http://{address}"),
            folder,
        }
    }

    /// Runs `rcc-cli` as on another machine.
    fn cli(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(program("rcc-cli"));
        command
            .env("RCC_RUNTIME_DIR", self.folder.path().join("run"))
            .env("RCC_TOKEN", TOKEN)
            .env_remove("RCC_CELL")
            .args(["--url", &self.url, "--timeout", "20s"])
            .args(arguments);
        command.output().expect("rcc-cli runs")
    }

    fn json(&self, arguments: &[&str]) -> Vec<Value> {
        let output = self.cli(&[&["--output", "json"][..], arguments].concat());
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{arguments:?}: {output:?}");
        let lines = text.lines().map(serde_json::from_str);
        lines.collect::<Result<_, _>>().expect("lines of JSON")
    }

    fn local_json(&self, arguments: &[&str]) -> Vec<Value> {
        let (out, _) = self
            .cell
            .cli_exits(0, &[&["--output", "json"][..], arguments].concat());
        let lines = out.lines().map(serde_json::from_str);
        lines.collect::<Result<_, _>>().expect("lines of JSON")
    }

    fn stop(self) {
        self.cell.stop();
        self.folder.close().expect("ours");
    }
}

#[test]
fn events_and_incidents_of_another_machine_are_those_of_its_cell() {
    let remote = RemoteCell::start();
    let line = remote.cell.run(&nets::line("line", 0.2, 0.01));
    let recorded = remote.json(&["incidents", "record"]);
    let file = recorded[0]["file"].as_str().expect("a path").to_owned();
    remote.cell.cli_exits(0, &["abort", &line.to_string()]);
    remote.cell.await_end(line);

    // Until both have read the same part of the log.
    let shown = await_some("the same events", || {
        let (here, there) = (remote.local_json(&["events"]), remote.json(&["events"]));
        let aborted = |event: &Value| event["fields"]["reason"] == "aborted";
        (here == there && here.iter().any(aborted)).then_some(there)
    });
    let of_line = shown.iter().find(|event| event["kind"] == "loaded");
    assert_eq!(
        of_line.map(|event| event["net"].clone()),
        Some(format!("line#{line}").into())
    );
    let only = remote.json(&["events", "--net", "line"]);
    assert!(!only.is_empty() && only.len() < shown.len(), "{only:#?}");

    let (here, there) = (
        remote.local_json(&["incidents"]),
        remote.json(&["incidents"]),
    );
    assert_eq!(here, there);
    assert_eq!(there[0][0]["reason"], "request");

    let copy = remote.folder.path().join("copy.rcc-incident");
    let path = copy.to_str().expect("UTF-8");
    let fetched = remote.json(&["incidents", "fetch", &file, "-o", path]);
    let (original, copied) = (
        fs::read(&file).expect("a file"),
        fs::read(&copy).expect("a copy"),
    );
    assert!(
        original == copied,
        "{} and {} bytes",
        original.len(),
        copied.len()
    );
    assert_eq!(fetched[0]["bytes"], original.len());
    let (replayed, _) = remote.cell.cli_exits(0, &["replay", path]);
    assert!(replayed.contains("line"), "{replayed}");
    for name in ["nothing.rcc-incident", "cell.json", "../cell.json"] {
        let refused = remote.cli(&["incidents", "fetch", name, "-o", path]);
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{words}");
        assert!(words.contains("RCC4029"), "{words}");
    }
    remote.stop();
}

#[test]
fn an_interrupted_download_goes_on_where_it_was_interrupted() {
    let cell = TestCell::demo();
    let (out, _) = cell.cli_exits(0, &["--output", "json", "incidents", "record"]);
    let recorded: Value = serde_json::from_str(&out).expect("JSON");
    let path = PathBuf::from(recorded["file"].as_str().expect("a path"));
    let name = path
        .file_name()
        .and_then(|name| name.to_str())
        .expect("a name");
    let whole = fs::read(&path).expect("a file");
    let from = whole.len() - 1000;
    let address = format!("/incidents/{name}");
    let request = format!(
        "GET {address} HTTP/1.1\r\nhost: rcc\r\nconnection: close\r\nrange: bytes={from}-\r\n\r\n"
    );
    let answer =
        rcc_tests::rest::raw_answer(&cell.cell().socket(), request.as_bytes()).expect("an answer");
    let head = String::from_utf8_lossy(&answer).into_owned();
    assert!(head.starts_with("HTTP/1.1 206"), "{head}");
    assert!(answer.ends_with(&whole[from..]), "{head}");
    let beyond = whole.len() + 1;
    let request = format!(
        "GET {address} HTTP/1.1\r\nhost: rcc\r\nconnection: close\r\nrange: bytes={beyond}-\r\n\r\n"
    );
    let answer =
        rcc_tests::rest::raw_answer(&cell.cell().socket(), request.as_bytes()).expect("an answer");
    let text = String::from_utf8_lossy(&answer).into_owned();
    assert!(
        text.starts_with("HTTP/1.1 400") && text.contains("RCC4011"),
        "{text}"
    );
    cell.stop();
}

#[test]
fn an_unknown_parameter_or_method_is_refused_and_a_stop_is_carried_out_all_the_same() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.01));
    let typo = cell.rest(
        "GET",
        &format!("/commands/{line}/values?prts=move.pose"),
        "",
    );
    assert_eq!((typo.status, typo.code()), (400, "RCC4011"), "{typo:?}");
    assert!(
        typo.error_text().contains("did you mean `ports`?"),
        "{typo:?}"
    );
    let value = cell.rest("GET", &format!("/commands/{line}?brief=perhaps"), "");
    assert_eq!((value.status, value.code()), (400, "RCC4011"), "{value:?}");
    assert!(value.error_text().contains("brief"), "{value:?}");
    // Before the body is looked at.
    let method = cell.rest("PUT", "/commands", "net: x");
    assert_eq!(
        (method.status, method.code()),
        (405, "RCC4018"),
        "{method:?}"
    );
    assert!(
        method.error_text().contains("it takes GET and POST"),
        "{method:?}"
    );
    let address = cell.rest("GET", "/comands", "");
    assert_eq!(
        (address.status, address.code()),
        (404, "RCC4007"),
        "{address:?}"
    );
    assert!(
        address.error_text().contains("did you mean `/commands`?"),
        "{address:?}"
    );

    let stopped = cell.rest("POST", &format!("/commands/{line}/abort?now=1"), "");
    assert_eq!(
        (stopped.status, stopped.code()),
        (400, "RCC4011"),
        "{stopped:?}"
    );
    assert!(
        stopped.error_text().contains("the net was stopped"),
        "{stopped:?}"
    );
    assert_eq!(cell.await_end(line)["reason"], "aborted");
    cell.stop();
}

#[test]
fn tail_and_the_history_show_every_record_of_a_cell_on_another_machine() {
    let remote = RemoteCell::start();
    let text = "net: every\nprimitives:\n  clock: {type: Time}\n  cancel: {type: Cancel}\n  \
                end: {type: Termination, inputs: {done: cancel.requested}}\n  \
                watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: clock.out}}\n";
    let id = remote.cell.run(text);
    let shown = remote.json(&["tail", "every/clock.out", "--count", "500"]);
    assert_eq!(shown.len(), 500);
    // A busy machine may lose records: the loss is reported, and the numbers of the cycles go on.
    let values: Vec<&Value> = shown.iter().filter(|row| row["lost"].is_null()).collect();
    let cycles: Vec<u64> = values
        .iter()
        .filter_map(|row| row["cycle"].as_u64())
        .collect();
    assert!(
        cycles.windows(2).all(|pair| pair[0] < pair[1]),
        "{cycles:?}"
    );
    let of_executor = |row: &&Value| row["name"] == "every/clock.out" && row["command"] == id;
    assert!(values.iter().all(of_executor), "{shown:#?}");

    // The history outlives the command.
    remote
        .cell
        .cli_exits(8, &["cancel", &id.to_string(), "--wait"]);
    remote.cell.cli_exits(0, &["unload", &id.to_string()]);
    let socket = remote.cell.cell().socket();
    let path = "/history?ports=every/clock.out&seconds=3600&limit=100";
    let page = rcc_tests::rest::request(&socket, "GET", path, b"").expect("answered");
    assert_eq!(page.status, 200, "{page:?}");
    assert_eq!(page.body["values"].as_array().map(Vec::len), Some(100));
    let human = remote.cli(&["tail", "--for", "200ms"]);
    assert!(human.status.success(), "{human:?}");
    let refused = remote.cli(&["tail", "a b"]);
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(words.contains("invalid pattern `a b`"), "{words}");
    remote.stop();
}
