//! Programs of somebody else as drivers: one of another layout of shared memory is refused with words; one that is killed or
//! stopped loses its device alone. `.ci/outside` builds such programs in a folder of their own, in Rust and in C.
//! Run by the threads of the test harness; each test has a cell of its own.

use std::net::Ipv4Addr;

use line_drivers::simulated_box::SimulatedBox;
use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_core::message::Measurement;
use rcc_ipc::Session;
use rcc_protocol::control::MEASUREMENT;
use rcc_protocol::{Build, Configuration, Role};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::signal;
use rcc_tests::{TestCell, UnsupervisedCell, await_some, nets, repository};

/// The station of the demo cell, driven by the template's program.
fn with_box(text: &str, address: &str) -> String {
    let io = format!(
        "devices:
  box:
    driver: {{program: line-io}}
    settings: {{box: '{address}', period: 10 ms, timeout: 100 ms}}
    channels:
      lamp:    {{kind: digital output, address: 1, on_release: {{safe: false}}}}
      lamp_on: {{kind: digital input, address: 1}}
"
    );
    text.replace("devices:\n", &io)
}

#[test]
fn a_program_of_another_layout_is_not_attached_and_the_message_names_both() {
    let mut cell = UnsupervisedCell::new(|text| with_box(&text, "127.0.0.1:1"));
    cell.start_executor();
    cell.start_loader();
    // This process announces itself as a program that was built against another version of the kit.
    let config = CellConfig::load(cell.config(), &Default::default());
    let config = config.unwrap_or_else(|faults| panic!("{faults}"));
    let session = Session::join(cell.cell(), Role::Driver, "box").expect("a session");
    let board = session
        .create_board::<Measurement>(MEASUREMENT)
        .expect("a board");
    let mut announcement = session
        .announcement()
        .configured(Configuration::new(config.identity()).only("box"))
        .service(MEASUREMENT, board.service());
    announcement.build = Some(Build {
        version: "0.0.9".to_owned(),
        layout: 0xbad,
    });
    let announced = cell.cell().announce(&announcement).expect("the only one");
    let reason = await_some("the program not to be attached", || {
        let row = cell.device("box")?;
        let reason = row["reason"].as_str()?.to_owned();
        (row["state"] == "offline" && reason.contains("another version")).then_some(reason)
    });
    let (out, _) = cell.cli_exits(0, &["devices"]);
    for word in ["0.0.9, layout 0000000000000bad", &Build::own().to_string()] {
        assert!(reason.contains(word), "{word}: {reason}");
        assert!(out.contains(word), "{word}: {out}");
    }
    let lamp = cell.load(&nets::output("lamp", "box", "lamp"));
    let refused = cell.operate(lamp, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3008"),
        "{refused:?}"
    );
    assert!(refused.error_text().contains("0.0.9"), "{refused:?}");
    drop((announced, board, session));
    cell.stop();
}

#[test]
fn a_program_that_is_killed_or_stopped_loses_its_device_alone() {
    let io = SimulatedBox::start((Ipv4Addr::LOCALHOST, 0).into()).expect("a box");
    let address = io.address().to_string();
    let demo = repository().join("configs/cells/demo.yaml");
    let place = CellFixture::new(&demo, |text| with_box(&text, &address));
    let cell = TestCell::in_fixture(place);
    let lamp_is = |on: f64| {
        await_some("the lamp", || {
            (io.outputs().get("d1") == Some(&on)).then_some(())
        });
    };
    let mut arm = cell.simulator("lwr-sim");
    for (way, y) in [(Signal::SIGKILL, 0.15), (Signal::SIGSTOP, 0.0)] {
        let lamp = cell.run(&nets::output("lamp", "box", "lamp"));
        lamp_is(1.0);
        let line = cell.run(&nets::line("line", y, 0.1));
        arm.await_motion();
        let driver = cell.announced(Role::Driver, "box");
        signal(driver.pid, way);
        let row = cell.await_end(lamp);
        assert_eq!(row["fault"]["fault"], "device lost", "{row}");
        assert_eq!(row["fault"]["device"], "box", "{row}");
        match way {
            Signal::SIGKILL => drop(cell.await_successor(Role::Driver, "box", driver.incarnation)),
            _ => drop(signal(driver.pid, Signal::SIGCONT)),
        }
        cell.await_device("box", "ready");
        // No net commands it any more, and none begins by itself.
        lamp_is(0.0);
        cell.assert_ends(line, "finished");
    }
    drop(arm);
    cell.stop();
}
