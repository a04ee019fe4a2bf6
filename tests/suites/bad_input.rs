//! Bad input gets a clear error and changes nothing: texts, plans, bytes, datagrams, configurations, HTTP, and an I/O
//! station that is gone. Each test has a cell of its own.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, Measurement};
use rcc_drivers::fri_lwr::wire::MSR_SIZE;
use rcc_ipc::control::{Answer, CONTROL, Call, MEASUREMENT, PlanData, Refusal};
use rcc_ipc::{Client, Role, Session, wire};
use rcc_tests::place::Place;
use rcc_tests::processes::{command_line, of_folder, signal};
use rcc_tests::records::Records;
use rcc_tests::rest::raw;
use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{HandCell, TestCell, await_some, nets, repository};

#[test]
fn broken_texts_are_rejected_with_place_and_remedy_while_a_net_runs() {
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

/// The executor's control service, as only the loader uses it.
struct Control {
    client: Client,
    config: CellConfig,
    _session: Session,
}

impl Control {
    fn of(cell: &Place) -> Control {
        let session = Session::join(cell.cell(), Role::Loader, "stranger").expect("a cell");
        let executor = cell.announced(Role::Executor, "exec");
        let client = session
            .client(&executor.services[CONTROL])
            .expect("the control service");
        let config = CellConfig::load(cell.config(), &Default::default());
        Control {
            client,
            config: config.unwrap_or_else(|faults| panic!("{faults}")),
            _session: session,
        }
    }

    fn bytes(&self, bytes: &[u8]) -> Answer {
        let answer = self
            .client
            .call(bytes, Duration::from_secs(20))
            .expect("an answer");
        wire::decode_serde(&answer).expect("an answer of this build")
    }

    fn call(&self, call: &Call) -> Answer {
        self.bytes(&wire::encode_serde(call).expect("a call"))
    }

    fn reserve(&self) -> u64 {
        match self.call(&Call::Reserve) {
            Answer::Reserved { id } => id,
            other => panic!("{other:?}"),
        }
    }

    fn plan(&self, text: &str) -> PlanData {
        let compiled = rcc_loader::compile(text, "net", &self.config);
        compiled.unwrap_or_else(|faults| panic!("{faults}")).plan
    }
}

#[test]
fn bytes_that_are_no_call_are_refused_and_change_nothing() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let executor = cell.announced(Role::Executor, "exec");
    let control = Control::of(&cell);
    let before = cell
        .rest("GET", "/commands", "")
        .body
        .as_array()
        .expect("rows")
        .len();
    let mut random = rcc_ipc::monotonic_ns() | 1;
    eprintln!("seed {random}");
    for length in [0, 1, 2, 7, 64, 1000, 100_000] {
        // A call number that does not exist, then whatever comes.
        let mut bytes = vec![0xfa; length];
        for byte in bytes.iter_mut().skip(1) {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            *byte = (random >> 56) as u8;
        }
        assert_eq!(
            control.bytes(&bytes),
            Answer::Refused(Refusal::NotUnderstood),
            "{length} bytes"
        );
    }
    let mut cut = wire::encode_serde(&Call::Install {
        id: lamp,
        plan: control.plan(&nets::lamp("lamp")),
    })
    .expect("a call");
    cut.truncate(cut.len() / 2);
    assert_eq!(
        control.bytes(&cut),
        Answer::Refused(Refusal::NotUnderstood),
        "half of a call"
    );
    drop(control);
    let rows = cell.rest("GET", "/commands", "").body;
    assert_eq!(rows.as_array().expect("rows").len(), before, "{rows}");
    assert_eq!(
        cell.announced(Role::Executor, "exec"),
        executor,
        "the same executor"
    );
    assert_eq!(cell.state(lamp)["state"], "running");
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn a_plan_that_does_not_check_is_refused_by_the_executor_itself() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let control = Control::of(&cell);
    let plan = control.plan(&nets::line("line", 0.1, 0.1));
    let wrongs: [fn(&mut PlanData); 7] = [
        |plan| plan.catalogue ^= 1,
        |plan| plan.configuration ^= 1,
        |plan| plan.operands[0] = u32::MAX,
        |plan| plan.runs[0].kernel = u16::MAX,
        |plan| plan.runs[0].first = u32::MAX,
        |plan| plan.clocks = 0,
        |plan| plan.reals.clear(),
    ];
    for (number, wrong) in wrongs.iter().enumerate() {
        let mut plan = plan.clone();
        wrong(&mut plan);
        let id = control.reserve();
        let answer = control.call(&Call::Install { id, plan });
        assert!(
            matches!(answer, Answer::Refused(Refusal::Plan(_))),
            "{number}: {answer:?}"
        );
        await_some("the rejection", || {
            (cell.state(id)["state"] == "rejected").then_some(())
        });
        let start = cell.operate(id, "start");
        assert_eq!(start.code(), "RCC3003", "{start:?}");
        let unloaded = control.call(&Call::Unload { id });
        assert!(matches!(unloaded, Answer::Done { .. }), "{unloaded:?}");
    }
    assert_eq!(cell.state(lamp)["state"], "running");
    drop(control);
    cell.stop();
}

#[test]
fn a_plan_with_flipped_bits_is_refused_or_harmless() {
    let cell = TestCell::demo();
    let executor = cell.announced(Role::Executor, "exec");
    let lamp = cell.run(&nets::lamp("lamp"));
    let control = Control::of(&cell);
    let watch = cell.watch();
    let plan = control.plan(&nets::input("input", "io", "lamp_on"));
    let seed = rcc_ipc::monotonic_ns() | 1;
    eprintln!("seed {seed}");
    let (mut random, mut refused) = (seed, 0);
    for round in 0..300 {
        let id = control.reserve();
        let mut bytes = wire::encode_serde(&Call::Install {
            id,
            plan: plan.clone(),
        })
        .expect("a call");
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let bit = (random >> 33) as usize % (bytes.len() * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let answer = control.bytes(&bytes);
        refused += u32::from(matches!(answer, Answer::Refused(_)));
        // What is accepted is a plan that checks: it may run, and can be ended.
        if matches!(answer, Answer::Done { .. })
            && let Answer::Done { .. } = control.call(&Call::Start { id })
        {
            control.call(&Call::Abort { id });
        }
        if matches!(answer, Answer::Refused(_)) {
            control.call(&Call::Reject { id });
        }
        assert!(
            matches!(control.call(&Call::Unload { id }), Answer::Done { .. }),
            "round {round}: bit {bit}: {answer:?}"
        );
    }
    assert!(refused > 50, "{refused} of 300 were refused");
    let tables = watch.tables();
    let row = tables
        .commands
        .iter()
        .find(|row| row.id == lamp)
        .expect("the lamp's row");
    assert_eq!(CommandState::from_number(row.state), CommandState::Running);
    assert!(executor.is_alive(), "the same executor");
    drop((watch, control));
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn datagrams_of_a_stranger_are_counted_and_ignored() {
    let cell = TestCell::demo();
    let session = Session::join(cell.cell(), Role::Monitor, "stranger").expect("a cell");
    let driver = cell.announced(Role::Driver, "lwr");
    let board = session
        .open_board::<Measurement>(&driver.services[MEASUREMENT])
        .expect("the driver's board");
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    let mut arm = cell.simulator("fri_control");
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
    // A measurement that is right in form, from somebody else than the controller.
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
        "a stranger gets no answer"
    );
    drop((board, session));
    cell.stop();
}

#[test]
fn an_io_station_that_is_gone_makes_its_ports_null_and_nothing_else() {
    let cell = TestCell::demo();
    let reader = cell.run(&nets::input("reader", "io", "lamp_on"));
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    let records = Records::follow(&cell);
    let station = of_folder(cell.folder());
    let station = station
        .into_iter()
        .find(|pid| command_line(*pid)[0].ends_with("io-sim"));
    assert!(signal(station.expect("io-sim runs"), Signal::SIGKILL));
    await_some("the loss to be seen", || {
        let losses = cell.device("io")?["losses"].as_u64()?;
        (losses > 0 || cell.device("io")?["state"] == "offline").then_some(())
    });
    // The supervisor starts it again.
    cell.await_device("io", "ready");
    assert_eq!(cell.state(reader)["state"], "running", "it only reads");
    cell.assert_ends(line, "finished");
    let seen: Vec<bool> = records
        .finish()
        .iter()
        .map(|record| record.values[0].is_nan())
        .collect();
    assert!(
        seen.iter().any(|null| *null) && !seen[seen.len() - 1],
        "null while it was gone, then known again"
    );
    let lamp = cell.run(&nets::lamp("lamp"));
    let mut simulator = cell.simulator("io_control");
    await_some("the lamp", || {
        (simulator.state()["coils"][0] == true).then_some(())
    });
    cell.done(lamp, "cancel");
    cell.done(reader, "cancel");
    cell.stop();
}

#[test]
fn a_net_that_writes_to_a_station_that_is_gone_ends_and_a_new_one_is_refused() {
    let mut cell = HandCell::demo();
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
    assert!(refused.words().contains("io"), "{refused:?}");
    cell.assert_ends(line, "finished");
    cell.start_simulator("io-sim");
    cell.await_device("io", "ready");
    cell.start_when_ready(again);
    cell.done(again, "cancel");
    cell.assert_ends(again, "canceled");
    cell.stop();
}

#[test]
fn a_broken_configuration_ends_every_program_with_its_code_before_anything_is_made() {
    let place = Place::new(&repository().join("configs/cells/demo.yaml"), |text| {
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
            .expect("it runs");
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
fn a_device_that_the_configuration_does_not_have_is_no_device() {
    let place = Place::new(&repository().join("configs/cells/demo.yaml"), |text| text);
    let mut driver = place.program("rcc-driver");
    let output = driver
        .arg("--config")
        .arg(place.config())
        .args(["--device", "lwt"])
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(78), "{words}");
    assert!(words.contains("lwt") && words.contains("lwr"), "{words}");
    place.assert_nothing_left();
}

#[test]
fn http_that_is_wrong_gets_an_error_with_a_code_and_changes_nothing() {
    let cell = TestCell::demo();
    let socket = cell.cell().socket();
    for (method, path, body, status, code) in [
        ("GET", "/nothing", "", 404, "RCC4007"),
        ("PUT", "/commands", "", 404, "RCC4007"),
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
            known && !reply.words().trim().is_empty(),
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
        assert!(text.is_empty() || text.starts_with("HTTP/1.1 4"), "{text}");
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
fn clients_that_hang_or_flood_change_nothing_for_others() {
    let cell = TestCell::demo();
    let socket = cell.cell().socket();
    // More silent and half-sent requests than the loader answers at a time.
    let hanging: Vec<_> = (0..100)
        .map(|number| {
            let mut stream =
                std::os::unix::net::UnixStream::connect(&socket).expect("a connection");
            if number % 2 == 0 {
                std::io::Write::write_all(
                    &mut stream,
                    b"POST /commands HTTP/1.1\r\nhost: rcc\r\ncontent-length: 100\r\n\r\nnet:",
                )
                .expect("a part of a request");
            }
            stream
        })
        .collect();
    let watch = cell.watch();
    let before = watch.status();
    let reply = await_some("an answer between all of them", || {
        let reply = cell.try_rest("GET", "/devices", "")?;
        (reply.status == 200 || reply.code() == "RCC4010").then_some(reply)
    });
    assert!(reply.status == 200 || reply.status == 429, "{reply:?}");
    drop(hanging);
    let line = await_some("a command", || {
        let reply = cell.try_rest("POST", "/commands", &nets::line("line", 0.05, 0.2))?;
        (reply.status == 202)
            .then(|| reply.body["id"].as_u64())
            .flatten()
    });
    await_some("it to be ready", || {
        (cell.state(line)["state"] == "ready").then_some(())
    });
    cell.start_when_ready(line);
    cell.assert_ends(line, "finished");
    assert!(watch.status().cycle > before.cycle);
    drop(watch);
    cell.stop();
}
