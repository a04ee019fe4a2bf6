//! The drivers of `example/` in the conformance suite, and tables that are wrong. Both are compiled by `cc` into a shared
//! library, which the tests load.
//! Test code only.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

use rcc_driver_kit::conformance::{device, rules};
use rcc_driver_kit::driver::{Driver, DriverError, Inputs, LinkError, Outputs};
use rcc_driver_kit::rcc_config::{DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::primitive::ChannelKind::{AnalogInput, DigitalInput, DigitalOutput};
use rcc_driver_kit::serde_json::json;

use crate::c_driver::{CDriver, DriverTable};
use crate::ffi::tests::{load, numbers, sizes};
use crate::ffi::{Description, TableError};
use crate::reasons::{FAILED, INVALID};

mod line_arm;
mod line_box;

/// Compiles these files into one shared library beside the test program; returns its path.
fn library(name: &str, sources: &[&str]) -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let test = std::env::current_exe().expect("a program has a path");
    let path = test.with_file_name(format!("lib{name}-{}.so", std::process::id()));
    let status = Command::new("cc")
        .args(["-shared", "-fPIC", "-std=c99", "-O1"])
        .args(["-Wall", "-Wextra", "-Werror", "-Iinclude", "-Iexample"])
        .args(sources)
        .arg("-o")
        .arg(&path)
        .arg("-lm")
        .current_dir(package)
        .status();
    assert!(status.expect("cc runs").success(), "{sources:?}");
    path
}

/// Returns the table `name` of a library, which is removed: once loaded, it needs no file.
fn example(name: &'static str) -> &'static Description {
    static TABLES: OnceLock<[Description; 2]> = OnceLock::new();
    let tables = TABLES.get_or_init(|| {
        let sources = [
            "example/line_box.c",
            "example/line_arm.c",
            "example/line_channels.c",
            "example/vendor_line.c",
        ];
        let path = library("line_drivers", &sources);
        let tables = ["line_box", "line_arm"].map(|name| load(&path, name).expect("a table"));
        std::fs::remove_file(path).expect("it was just made");
        tables
    });
    &tables[usize::from(name == "line_arm")]
}

/// Tables of `tables.c`.
struct Tables {
    layout: Vec<usize>,
    other_version: Result<Description, TableError>,
    incomplete: Result<Description, TableError>,
    faulty: Description,
}

fn tables() -> &'static Tables {
    static TABLES: OnceLock<Tables> = OnceLock::new();
    TABLES.get_or_init(|| {
        let path = library("tables", &["src/conforms/tables.c"]);
        let tables = Tables {
            layout: numbers(&path, "layout", sizes().len()),
            other_version: load(&path, "other_version"),
            incomplete: load(&path, "incomplete"),
            faulty: load(&path, "faulty").expect("a table"),
        };
        std::fs::remove_file(path).expect("it was just made");
        tables
    })
}

#[derive(Debug)]
enum Faulty {}

impl DriverTable for Faulty {
    fn description() -> Option<&'static Description> {
        Some(&tables().faulty)
    }
}

/// Opens the device whose functions fail as `fault` says, see `tables.c`.
fn faulty(fault: f64) -> Result<CDriver<Faulty>, DriverError> {
    let safe = Some(OnRelease::Safe(0.0));
    let rows = [
        ("lamp", DigitalOutput, 1.into(), safe, None),
        ("lamp_on", DigitalInput, 1.into(), None, None),
        ("speed_is", AnalogInput, 1.into(), None, None),
    ];
    CDriver::open(&DeviceConfig {
        robot: rules::some_robot().robot,
        ..device("faulty", json!({"fault": fault}), &rows)
    })
}

fn receive(fault: f64) -> (Result<bool, LinkError>, Inputs, String) {
    let mut driver = faulty(fault).unwrap_or_else(|error| panic!("{error}"));
    let mut inputs = Inputs::NONE;
    let received = driver.receive(Duration::from_millis(1), &mut inputs);
    let words = driver.diagnosis().expect("counters").link()["last_words"].to_string();
    (received.map(|exchange| exchange.startable), inputs, words)
}

fn lost(reason: u32) -> Result<bool, LinkError> {
    Err(LinkError::Lost { reason })
}

#[test]
fn the_structures_of_both_languages_have_one_layout() {
    assert_eq!(tables().layout, sizes());
}

#[test]
fn a_table_of_another_header_or_without_functions_is_refused_with_words() {
    let words = |table: &Result<Description, TableError>| {
        let error = table.as_ref().map(|_| ()).expect_err("refused");
        error.to_string()
    };
    let told = words(&tables().other_version);
    assert!(
        told.contains("version 2 of rcc_driver.h, the library has 1"),
        "{told}"
    );
    assert_eq!(
        words(&tables().incomplete),
        "rcc_driver.open is NULL or not UTF-8"
    );
}

#[test]
fn a_value_that_is_not_finite_is_lost_or_unknown_and_told() {
    let (received, inputs, _) = receive(0.0);
    assert_eq!((received, inputs.analog[0]), (Ok(true), 0.5));
    assert_eq!((inputs.position[6], inputs.position[7]), (0.25, 0.0));
    let (received, inputs, words) = receive(2.0);
    assert_eq!(received, lost(INVALID));
    assert_eq!(inputs.position, Inputs::NONE.position, "not passed on");
    assert!(words.contains("joint 3: its position is NaN"), "{words}");
    let (received, inputs, words) = receive(3.0);
    assert_eq!(received, Ok(true));
    assert!(
        inputs.analog[0].is_nan() && words.contains("analog[0] is inf"),
        "{words}"
    );
    assert_eq!(inputs.digital_known, 1, "the others are known");
}

#[test]
fn an_error_of_a_function_loses_the_device_with_its_words() {
    let (received, _, words) = receive(4.0);
    assert_eq!(received, lost(FAILED));
    assert!(words.contains("the fuse is blown"), "{words}");
    let (received, _, words) = receive(5.0);
    assert_eq!(received, lost(FAILED));
    assert!(words.contains("receive returned 77"), "{words}");
    let mut driver = faulty(8.0).unwrap_or_else(|error| panic!("{error}"));
    let sent = driver.send(&Outputs::NONE);
    assert_eq!(sent, Err(LinkError::Lost { reason: FAILED }));
    let link = driver.diagnosis().expect("counters").link();
    assert!(
        link["last_words"].to_string().contains("it takes nothing"),
        "{link}"
    );
}

#[test]
fn memory_that_is_overwritten_with_anything_ends_in_words() {
    // 0x5555…: 1.2e103 rad are finite, and the host judges them; 85 is no digital value.
    let (_, inputs, words) = receive(6.0);
    assert_eq!(inputs.digital_known, 0);
    assert!(words.contains("digital[0] is 85"), "{words}");
    let (received, _, words) = receive(7.0);
    assert_eq!(received, lost(INVALID));
    assert!(words.contains("period_s is NaN"), "{words}");
    let error = faulty(1.0).expect_err("open fails").to_string();
    assert!(
        error.contains("devices.device.settings.open: xxxx"),
        "{error}"
    );
}
