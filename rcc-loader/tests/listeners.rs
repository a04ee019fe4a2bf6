//! Tests the loader's listeners against clients that are slow, half-open, too many, too large, or malformed: they get
//! an error, are disconnected and logged, while others are served. Each test has a cell of its own, on loopback.

#[path = "listeners/access.rs"]
mod access;
#[path = "server/fake_executor.rs"]
#[allow(dead_code)]
mod fake_executor;
#[path = "listeners/kept_open.rs"]
mod kept_open;
#[path = "server/test_server.rs"]
mod test_server;

use std::fs;
use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use fake_executor::TestCell;
use rcc_api::routes::TEXT_MAX;
use rcc_api::token::{TOKEN_LENGTH_MAX, TOKEN_LENGTH_MIN};
use rcc_config::{AccessConfig, TcpAccess};
use rcc_ipc::Cell;
use rcc_loader::server::connection::{
    ConnectionLimits, EXCHANGE_TIME_MAX, HEAD_TIME_MAX, HEADS_MAX, IDLE_TIME_MAX, STALL_MAX, STOPS,
    STREAMS, TCP, UNAUTHENTICATED, UNIX,
};
use rcc_loader::server::listeners::{ListenError, Listeners};
use rcc_loader::server::request_head::{HEAD_MAX, HEADERS_MAX};
use rcc_loader::server::service::history;
use rcc_loader::server::{bodies, live, routes, store};
use test_server::{LIMIT, TestServer, answer, ask, exchange};

const TOKEN: &str = "0123456789abcdef0123456789abcdef";
const SOCKET: &str = "RCC_DOORS_TEST_SOCKET";

/// Run in the second process: sends one request.
#[test]
fn peer() {
    let Some(socket) = std::env::var_os(SOCKET) else {
        return;
    };
    let stream = UnixStream::connect(PathBuf::from(socket)).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    let (status, _) = exchange(stream, &get("/primitives", ""));
    assert_eq!(status, 200);
}

fn another_process_is_served(cell: &Cell) -> bool {
    let status = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "peer", "--test-threads", "1"])
        .env(SOCKET, cell.socket())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    status.unwrap().success()
}

fn get(path: &str, lines: &str) -> Vec<u8> {
    format!("GET {path} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n{lines}\r\n").into_bytes()
}

/// Returns a request whose body does not arrive.
fn slow_body(lines: &str) -> Vec<u8> {
    format!("POST /commands HTTP/1.1\r\nhost: x\r\n{lines}content-length: 1000\r\n\r\nnet: ")
        .into_bytes()
}

fn with_token() -> String {
    format!("authorization: Bearer {TOKEN}\r\n")
}

fn connect(cell: &Cell) -> UnixStream {
    let stream = UnixStream::connect(cell.socket()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    stream
}

/// Connects from one of the loopback addresses; each is a peer of its own.
fn connect_from(last: u8, to: SocketAddr) -> TcpStream {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let stream = runtime.block_on(async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket
            .bind((Ipv4Addr::new(127, 0, 0, last), 0).into())
            .unwrap();
        socket.connect(to).await.unwrap().into_std().unwrap()
    });
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    stream
}

/// Returns a configuration with TCP on any free port, and the token.
fn tcp(cell: &Cell) -> AccessConfig {
    let token_file = cell.runtime_dir().join("token");
    let mut options = fs::File::options();
    let file = options
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(&token_file);
    file.unwrap().write_all(TOKEN.as_bytes()).unwrap();
    AccessConfig {
        group: None,
        tcp: Some(TcpAccess {
            listen: (Ipv4Addr::LOCALHOST, 0).into(),
            token_file,
        }),
    }
}

/// Waits for a line in the log.
fn wait_for_log(served: &TestServer, text: &str) {
    let limit = Instant::now() + LIMIT;
    while !served.log().contains(text) {
        assert!(Instant::now() < limit, "no `{text}` in:\n{}", served.log());
        std::thread::yield_now();
    }
}

#[test]
fn the_limits_in_the_docs_are_those_of_the_code() {
    let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/security.md");
    let docs = fs::read_to_string(docs).unwrap();
    let kib = |bytes: usize| format!("{} KiB", bytes >> 10);
    let mib = |bytes: usize| format!("{} MiB", bytes >> 20);
    let seconds = |time: std::time::Duration| format!("{} s", time.as_secs());
    let requests = |limits: ConnectionLimits| {
        let ConnectionLimits {
            connections,
            connections_of_peer,
            reserve,
            rate,
            burst,
        } = limits;
        format!(
            "{connections}; {connections_of_peer} a peer | {reserve} | {rate} a second, {burst} at once"
        )
    };
    for row in [
        format!("| Unix socket | process | {} |", requests(UNIX)),
        format!("| TCP, with the token | address | {} |", requests(TCP)),
        format!(
            "| CANCEL and ABORT, at each | as there | {} |",
            requests(STOPS)
        ),
        format!(
            "| streams and set-point channels, at each | as there | {} |",
            requests(STREAMS)
        ),
        format!(
            "| TCP, without the token | address | refused | – | {} a second, {} at once |",
            UNAUTHENTICATED.0, UNAUTHENTICATED.1
        ),
        format!(
            "| connections of a listener without a complete head | {HEADS_MAX} | {} |",
            seconds(HEAD_TIME_MAX)
        ),
        format!(
            "| body of a LOAD | {}, all together {}, of a peer {} | {} |",
            mib(TEXT_MAX),
            mib(bodies::TEXTS.all),
            mib(bodies::TEXTS.of_peer),
            seconds(bodies::BODY_TIME_MAX)
        ),
        format!(
            "| body of START, a hand-over or inputs | {} | {} |",
            kib(bodies::SET_TEXT_MAX),
            seconds(bodies::BODY_TIME_MAX)
        ),
        format!(
            "| long answers, all together; of a peer | {}; {} | {} |",
            mib(bodies::ANSWERS.all),
            mib(bodies::ANSWERS.of_peer),
            seconds(EXCHANGE_TIME_MAX)
        ),
        format!(
            "| files of commands, all together | {} | – |",
            mib(store::KEPT_MAX as usize)
        ),
        format!(
            "| stored part of a rejected text; of its findings | {}; {} | – |",
            kib(store::REJECTED_TEXT_MAX),
            kib(store::FINDINGS_MAX)
        ),
        format!(
            "| head of a request | {}, {HEADERS_MAX} lines | {} |",
            kib(HEAD_MAX),
            seconds(HEAD_TIME_MAX)
        ),
        format!(
            "| work for a request | {} at a time | {} |",
            routes::REQUESTS_MAX,
            seconds(routes::REQUEST_TIME_MAX)
        ),
        format!(
            "| texts that wait to be compiled; of a peer | {}; {} | – |",
            routes::LOADING.all,
            routes::LOADING.of_peer
        ),
        format!(
            "| whole request after its head, except for streams | – | {} |",
            seconds(EXCHANGE_TIME_MAX)
        ),
        format!(
            "| kept-open connection without a request | {HEADS_MAX}, with those without a complete head | {} |",
            seconds(IDLE_TIME_MAX)
        ),
        format!(
            "| stream whose client takes nothing | – | {} |",
            seconds(STALL_MAX)
        ),
        format!(
            "| set-point channels; of a peer | {}; {} | – |",
            routes::CHANNELS.all,
            routes::CHANNELS.of_peer
        ),
        format!(
            "| streams; of a peer | {}; {} | – |",
            routes::STREAMS.all,
            routes::STREAMS.of_peer
        ),
        format!(
            "| streams above 250 samples per second; of a peer | {}; {} | – |",
            routes::FAST_STREAMS.all,
            routes::FAST_STREAMS.of_peer
        ),
        format!(
            "| line of a set-point channel | {} | – |",
            kib(bodies::SET_TEXT_MAX)
        ),
        format!(
            "| set-point channel without a line | – | {} |",
            seconds(routes::CHANNEL_IDLE_MAX)
        ),
        format!(
            "| monitored values that are kept; of an answer | {}; {} | – |",
            history::RECORDS_MAX,
            history::VALUES_MAX
        ),
        format!(
            "| what a stream's client has not taken | {}, {} pieces | – |",
            kib(live::BYTES_MAX),
            live::PIECES_MAX
        ),
        format!("| token | {TOKEN_LENGTH_MIN} to {TOKEN_LENGTH_MAX} characters | – |"),
        format!(
            "| request to the executor | {} | – |",
            mib(rcc_protocol::control::REQUEST_MAX)
        ),
        format!(
            "| answer of the executor | {} | – |",
            kib(rcc_protocol::control::RESPONSE_MAX)
        ),
        format!(
            "| clients of the executor | {} | – |",
            rcc_ipc::request::CLIENTS_MAX
        ),
        format!(
            "| monitors of a stream | {} | – |",
            rcc_ipc::stream::SUBSCRIBERS_MAX
        ),
        format!(
            "| log lines about one kind of refusal | 1 | each {} |",
            seconds(rcc_process::log_throttle::LOG_INTERVAL)
        ),
    ] {
        assert!(docs.contains(&row), "docs/security.md lacks:\n{row}");
    }
}

#[test]
fn a_client_that_does_not_finish_its_head_is_cut_off_and_others_are_served() {
    let test = TestCell::new("slow");
    let served = TestServer::start(&test.cell);
    let silent = connect(&test.cell);
    let mut slow = connect(&test.cell);
    slow.write_all(b"GET /status HTTP/1.1\r\nhost:").unwrap();
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
    for stream in [silent, slow] {
        let (status, body) = answer(stream);
        assert_eq!((status, &body["code"]), (408, &"RCC4017".into()));
        assert!(body["message"].as_str().unwrap().contains("2s"), "{body}");
    }
    wait_for_log(&served, "took longer than 2s");
}

#[test]
fn a_client_that_does_not_finish_its_body_is_cut_off_and_others_are_served() {
    let test = TestCell::new("body");
    let _served = TestServer::start(&test.cell);
    let mut slow = connect(&test.cell);
    slow.write_all(b"POST /commands HTTP/1.1\r\nhost: x\r\ncontent-length: 1000\r\n\r\nnet: ")
        .unwrap();
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
    let (status, body) = answer(slow);
    assert_eq!((status, &body["code"]), (408, &"RCC4017".into()));
}

#[test]
fn requests_that_are_too_large_are_refused_with_an_error() {
    let test = TestCell::new("large");
    let served = TestServer::start(&test.cell);
    let long = format!("x: {}\r\n", "y".repeat(HEAD_MAX));
    let many = "x: y\r\n".repeat(HEADERS_MAX + 1);
    for lines in [long, many] {
        let (status, body) = exchange(connect(&test.cell), &get("/primitives", &lines));
        assert_eq!((status, &body["code"]), (431, &"RCC4016".into()));
    }
    let endless = vec![b'A'; HEAD_MAX * 4];
    assert_eq!(exchange(connect(&test.cell), &endless).1["code"], "RCC4016");
    let (status, body) = ask(&test.cell, "POST /commands", &vec![b'#'; TEXT_MAX + 1]);
    assert_eq!((status, &body["code"]), (413, &"RCC4006".into()));
    wait_for_log(&served, "RCC4016");
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
}

#[test]
fn malformed_requests_are_refused_with_an_error() {
    let test = TestCell::new("nonsense");
    let _served = TestServer::start(&test.cell);
    for bytes in [
        &b"\x00\xff\r\n\r\n"[..],
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"POST /commands HTTP/1.1\r\ncontent-length: -1\r\n\r\n",
        b"POST /commands HTTP/1.1\r\ncontent-length: 1\r\ncontent-length: 2\r\n\r\nab",
        b"POST /commands HTTP/1.1\r\ncontent-length: 3\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n",
        b"POST /commands HTTP/1.1\r\ntransfer-encoding: gzip\r\n\r\nab",
        b"POST /commands HTTP/1.0\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n",
        b"POST /commands HTTP/1.1\r\ntransfer-encoding: chunked\r\n\r\nxyz\r\n",
        b"POST /commands HTTP/1.1\r\ntransfer-encoding: chunked\r\n\r\nffffffffffffffffff\r\n",
    ] {
        let (status, body) = exchange(connect(&test.cell), bytes);
        assert_eq!(
            (status, &body["code"]),
            (400, &"RCC4011".into()),
            "{bytes:?}"
        );
    }
    // The client closes its side in the middle of a head.
    let mut half = connect(&test.cell);
    half.write_all(b"GET / HTTP/1.1\r\n").unwrap();
    half.shutdown(std::net::Shutdown::Write).unwrap();
    assert_eq!(answer(half).0, 400);
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
}

#[test]
fn an_answer_has_no_date() {
    let test = TestCell::new("no-date");
    let _served = TestServer::start(&test.cell);
    let mut stream = connect(&test.cell);
    stream.write_all(&get("/primitives", "")).unwrap();
    let mut text = String::new();
    std::io::Read::read_to_string(&mut stream, &mut text).unwrap();
    let (head, _) = text.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    assert!(!head.to_lowercase().contains("\r\ndate:"), "{head}");
}

#[test]
fn requests_sent_at_once_over_one_connection_are_answered_until_one_closes_it() {
    let test = TestCell::new("pipeline");
    let _served = TestServer::start(&test.cell);
    let put =
        "PUT /commands/none/inputs HTTP/1.1\r\nhost: x\r\ncontent-length: 12\r\n\r\nlamp: false\n";
    let open = "GET /nothing HTTP/1.1\r\nhost: x\r\n\r\n";
    let mut stream = connect(&test.cell);
    let ahead = [put, open].concat().repeat(20);
    let all = [ahead.as_bytes(), &get("/nothing", ""), open.as_bytes()].concat();
    stream.write_all(&all).unwrap();
    let mut text = String::new();
    std::io::Read::read_to_string(&mut stream, &mut text).unwrap();
    assert_eq!(text.matches("HTTP/1.1 404").count(), 21, "{text}");
    assert_eq!(text.matches("RCC4001").count(), 20, "{text}");
    assert_eq!(text.matches("connection: close").count(), 1, "{text}");
}

#[test]
fn a_process_that_holds_too_many_connections_gets_no_more_and_another_one_is_served() {
    let test = TestCell::new("many");
    let served = TestServer::start(&test.cell);
    let held: Vec<_> = (0..UNIX.connections_of_peer)
        .map(|_| {
            let mut stream = connect(&test.cell);
            stream.write_all(&slow_body("")).unwrap();
            stream
        })
        .collect();
    let (status, body) = ask(&test.cell, "GET /primitives", b"");
    assert_eq!((status, &body["code"]), (429, &"RCC4010".into()));
    assert!(another_process_is_served(&test.cell));
    wait_for_log(&served, "requests of process");
    // The held connections time out; then there is room again.
    for stream in held {
        assert_eq!(answer(stream).0, 408);
    }
    // A slot is released shortly after its client has the answer.
    let begun = std::time::Instant::now();
    while ask(&test.cell, "GET /primitives", b"").0 != 200 {
        assert!(
            begun.elapsed() < std::time::Duration::from_secs(30),
            "never any room again"
        );
        std::thread::yield_now();
    }
}

#[test]
fn an_address_that_asks_too_often_is_refused_and_another_one_is_served() {
    let test = TestCell::new("often");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let address = served.address.unwrap();
    let request = get("/nothing", &with_token());
    let limit = Instant::now() + LIMIT;
    loop {
        let (status, body) = exchange(connect_from(1, address), &request);
        if status == 429 {
            assert!(
                body["message"]
                    .as_str()
                    .unwrap()
                    .contains("requests per second"),
                "{body}"
            );
            break;
        }
        assert_eq!(status, 404);
        assert!(Instant::now() < limit, "never refused");
    }
    assert_eq!(exchange(connect_from(2, address), &request).0, 404);
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
    wait_for_log(&served, "requests per second");
}

#[test]
fn an_address_that_holds_too_many_connections_gets_no_more_and_another_one_is_served() {
    let test = TestCell::new("half-open");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let address = served.address.unwrap();
    let _held: Vec<_> = (0..TCP.connections_of_peer)
        .map(|_| {
            let mut stream = connect_from(1, address);
            stream.write_all(&slow_body(&with_token())).unwrap();
            stream
        })
        .collect();
    let request = get("/primitives", &with_token());
    assert_eq!(
        exchange(connect_from(1, address), &request).1["code"],
        "RCC4010"
    );
    assert_eq!(
        exchange(connect_from(2, address), &get("/primitives", &with_token())).0,
        200
    );
    assert!(another_process_is_served(&test.cell));
}
