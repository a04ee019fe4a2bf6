//! Invalid input gets a clear error and changes nothing: texts, datagrams, configurations and HTTP requests. Also the
//! loss of an I/O station. Each test has a cell of its own.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_core::message::Measurement;
use rcc_drivers::fri_lwr::wire::MSR_SIZE;
use rcc_ipc::Session;
use rcc_protocol::Role;
use rcc_protocol::control::MEASUREMENT;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::{command_line, signal, with_runtime_dir};
use rcc_tests::records::RecordCollector;
use rcc_tests::rest::raw;
use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{TestCell, UnsupervisedCell, await_some, nets, repository};

#[test]
fn invalid_texts_are_rejected_with_place_and_remedy_while_a_net_runs() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let unknown_device = nets::line("line", 0.1, 0.1).replace("device: lwr", "device: lwt");
    for (text, word) in [
        ("net: [", ""),
        ("{\"net\": \"x\", \"primitives\": {", ""),
        ("", ""),
        ("net: twice\nnet: twice\nprimitives: {}\n", "net"),
        ("net: empty\nprimitives: {}\n", "Termination"),
        (unknown_device.as_str(), "lwr"),
    ] {
        let (id, row) = cell.load_any(text);
        assert_eq!(row["state"], "rejected", "{text}: {row}");
        let findings = row["diagnostics"].as_array().expect("a list");
        assert!(!findings.is_empty(), "{row}");
        for finding in findings {
            assert!(
                finding["code"]
                    .as_str()
                    .is_some_and(|code| code.starts_with("RCC1")),
                "{finding}"
            );
            assert!(
                !finding["message"].as_str().unwrap_or_default().is_empty(),
                "{finding}"
            );
        }
        assert!(
            row["diagnostics"].to_string().contains(word),
            "{word}: {row}"
        );
        let unload = cell.rest("DELETE", &format!("/commands/{id}"), "");
        assert_eq!(unload.status, 200, "{unload:?}");
    }
    assert_eq!(cell.state(lamp)["state"], "running");
    let path = cell.file(&unknown_device);
    let path = path.to_str().expect("plain");
    let config = cell.config().to_str().expect("plain").to_owned();
    let (_, offline) = cell.cli_exits(3, &["check", path, "--config", &config]);
    let (_, online) = cell.cli_exits(3, &["run", path]);
    assert!(
        offline.contains("lwt") && online.contains("lwt"),
        "{offline}\n{online}"
    );
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn datagrams_of_an_unknown_sender_are_counted_and_ignored() {
    let cell = TestCell::demo();
    let session = Session::join(cell.cell(), Role::Monitor, "stranger").expect("a cell");
    let driver = cell.announced(Role::Driver, "lwr");
    let board = session
        .open_board::<Measurement>(&driver.services[MEASUREMENT])
        .expect("the driver's board");
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    let mut arm = cell.simulator("lwr-sim");
    arm.await_motion();
    let before = board.read().refused;
    let stranger = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let fri = (Ipv4Addr::LOCALHOST, cell.port("fri"));
    let captured = std::fs::read(repository().join("tests/data/fri/cap_lwr.msr"))
        .expect("a captured datagram");
    let mut other_identity = captured.clone();
    other_identity[4] ^= 0x55;
    let datagrams: [&[u8]; 5] = [
        b"",
        b"hello",
        &[0; MSR_SIZE - 1],
        &[0xff; MSR_SIZE],
        &other_identity,
    ];
    for datagram in datagrams {
        for _ in 0..10 {
            stranger.send_to(datagram, fri).expect("loopback takes it");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    // Valid measurements, but from a sender that is not the controller.
    for _ in 0..10 {
        stranger.send_to(&captured, fri).expect("loopback takes it");
        std::thread::sleep(Duration::from_millis(1));
    }
    cell.assert_ends(line, "finished");
    let refused = board.read().refused - before;
    assert!(refused >= 50, "{refused} were counted");
    assert_within_limits(&arm.state(), &[]);
    stranger.set_nonblocking(true).expect("a plain socket");
    assert!(
        stranger.recv(&mut [0; 2000]).is_err(),
        "an unknown sender gets no answer"
    );
    drop((board, session));
    cell.stop();
}

#[test]
fn a_lost_io_station_makes_its_ports_null_and_has_no_other_effect() {
    let cell = TestCell::demo();
    let reader = cell.run(&nets::input("reader", "io", "lamp_on"));
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    let records = RecordCollector::follow(&cell);
    let station = with_runtime_dir(cell.folder());
    let station = station
        .into_iter()
        .find(|pid| command_line(*pid)[0].ends_with("io-sim"));
    assert!(signal(station.expect("io-sim runs"), Signal::SIGKILL));
    await_some("the loss to be seen", || {
        let losses = cell.device("io")?["losses"].as_u64()?;
        (losses > 0 || cell.device("io")?["state"] == "offline").then_some(())
    });
    // The supervisor restarts it.
    cell.await_device("io", "ready");
    assert_eq!(
        cell.state(reader)["state"],
        "running",
        "the net only reads, so it keeps running"
    );
    cell.assert_ends(line, "finished");
    let seen: Vec<bool> = records
        .finish()
        .iter()
        .map(|record| record.values[0].is_nan())
        .collect();
    assert!(
        seen.iter().any(|null| *null) && !seen[seen.len() - 1],
        "null while the station was lost, known again afterwards"
    );
    let lamp = cell.run(&nets::lamp("lamp"));
    let mut simulator = cell.simulator("io-sim");
    await_some("the lamp", || {
        (simulator.state()["coils"][0] == true).then_some(())
    });
    cell.done(lamp, "cancel");
    cell.done(reader, "cancel");
    cell.stop();
}

#[test]
fn a_net_that_writes_to_a_lost_station_ends_and_a_new_one_is_refused() {
    let mut cell = UnsupervisedCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    cell.end("io-sim", Signal::SIGKILL);
    let row = cell.await_end(lamp);
    assert_eq!(
        (&row["fault"]["fault"], &row["fault"]["device"]),
        (&"device lost".into(), &"io".into()),
        "{row}"
    );
    let again = cell.load(&nets::lamp("again"));
    let refused = cell.operate(again, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3008"),
        "{refused:?}"
    );
    assert!(refused.error_text().contains("io"), "{refused:?}");
    cell.assert_ends(line, "finished");
    cell.start_simulator("io-sim");
    cell.await_device("io", "ready");
    cell.start_when_ready(again);
    cell.done(again, "cancel");
    cell.assert_ends(again, "canceled");
    cell.stop();
}

#[test]
fn an_invalid_configuration_ends_every_program_with_its_code_before_anything_is_created() {
    let place = CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| {
        text.replace("period: 1 ms\n", "period: 1 N\n")
            .replace("driver: modbus", "driver: modbuss")
    });
    let config = place.config().to_str().expect("plain").to_owned();
    let (_, errors) = place.cli_exits(3, &["up", &config]);
    assert!(
        errors.contains("RCC2") && errors.contains("period"),
        "{errors}"
    );
    let (_, errors) = place.cli_exits(3, &["check", &config, "--config", &config]);
    assert!(errors.contains("RCC2"), "{errors}");
    for (program, further) in [
        ("rcc-exec", &[][..]),
        ("rcc-loader", &[]),
        ("rcc-driver", &["--device", "io"]),
    ] {
        let output = place
            .program(program)
            .arg("--config")
            .arg(&config)
            .args(further)
            .output()
            .expect("the program runs");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(78), "{program}: {words}");
        assert!(
            words.contains("RCC2") && words.contains("period"),
            "{program}: {words}"
        );
    }
    assert!(place.cell().leftovers().expect("a list").is_empty());
    place.assert_nothing_left();
}

#[test]
fn a_driver_of_a_device_that_is_not_configured_is_refused() {
    let place = CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| text);
    let mut driver = place.program("rcc-driver");
    let output = driver
        .arg("--config")
        .arg(place.config())
        .args(["--device", "lwt"])
        .output()
        .expect("the program runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(78), "{words}");
    assert!(words.contains("lwt") && words.contains("lwr"), "{words}");
    place.assert_nothing_left();
}

#[test]
fn invalid_http_requests_get_an_error_with_a_code_and_change_nothing() {
    let cell = TestCell::demo();
    let socket = cell.cell().socket();
    for (method, path, body, status, code) in [
        ("GET", "/nothing", "", 404, "RCC4007"),
        ("PUT", "/commands", "", 405, "RCC4018"),
        ("POST", "/commands/1/jump", "", 404, "RCC4007"),
        ("GET", "/commands/nothing", "", 404, "RCC3001"),
        ("GET", "/commands/%F0%28", "", 404, "RCC3001"),
    ] {
        let reply = cell.rest(method, path, body);
        assert!(
            reply.status == status || reply.status == 400 || reply.status == 405,
            "{method} {path}: {reply:?}"
        );
        let known = reply.code() == code || reply.code() == "RCC4011";
        assert!(
            known && !reply.error_text().trim().is_empty(),
            "{method} {path}: {reply:?}"
        );
    }
    let large = "x".repeat((4 << 20) + 1);
    let reply = cell.rest("POST", "/commands", &large);
    assert_eq!((reply.status, reply.code()), (413, "RCC4006"), "{reply:?}");
    let reply = rcc_tests::rest::request(&socket, "POST", "/commands", b"net: \xff\xfe")
        .expect("an answer");
    assert_eq!((reply.status, reply.code()), (400, "RCC4011"), "{reply:?}");
    for bytes in [
        &b"\x00\x01\x02garbage"[..],
        b"GET / HTTP/9.9\r\n\r\n",
        b"POST /commands HTTP/1.1\r\ncontent-length: -1\r\n\r\n",
    ] {
        let answer = raw(&socket, bytes).expect("a connection");
        let text = String::from_utf8_lossy(&answer).into_owned();
        assert!(text.starts_with("HTTP/1.1 4"), "{text}");
        assert!(text.contains("RCC4011"), "{text}");
    }
    assert_eq!(
        cell.rest("GET", "/commands", "").body,
        serde_json::json!([]),
        "nothing changed"
    );
    let line = cell.run(&nets::line("line", 0.05, 0.2));
    cell.assert_ends(line, "finished");
    cell.stop();
}

#[test]
fn clients_that_hang_or_flood_do_not_affect_others() {
    let cell = TestCell::demo();
    let socket = cell.cell().socket();
    // More silent connections and incomplete requests than the loader serves at a time.
    let hanging: Vec<_> = (0..100)
        .map(|number| {
            let mut stream =
                std::os::unix::net::UnixStream::connect(&socket).expect("a connection");
            if number % 2 == 0 {
                let half =
                    b"POST /commands HTTP/1.1\r\nhost: rcc\r\ncontent-length: 100\r\n\r\nnet:";
                // The loader may have closed a surplus connection already.
                let _ = std::io::Write::write_all(&mut stream, half);
            }
            stream
        })
        .collect();
    let watch = cell.watch();
    let before = watch.status();
    let reply = await_some("an answer in spite of the hanging clients", || {
        let reply = cell.try_rest("GET", "/devices", "")?;
        (reply.status == 200 || reply.code() == "RCC4010").then_some(reply)
    });
    assert!(reply.status == 200 || reply.status == 429, "{reply:?}");
    drop(hanging);
    let line = await_some("a command to be accepted", || {
        let reply = cell.try_rest("POST", "/commands", &nets::line("line", 0.05, 0.2))?;
        (reply.status == 202)
            .then(|| reply.body["id"].as_u64())
            .flatten()
    });
    await_some("the line to be ready", || {
        (cell.state(line)["state"] == "ready").then_some(())
    });
    cell.start_when_ready(line);
    cell.assert_ends(line, "finished");
    assert!(watch.status().cycle > before.cycle);
    drop(watch);
    cell.stop();
}
