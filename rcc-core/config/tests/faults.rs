//! All faults of a configuration as displayed to people: `bad/CODE-words.yaml` causes the fault, the `.txt` next to it
//! is the expected text. `RCC_BLESS=1` rewrites the expected texts; review the difference before committing it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use rcc_config::codes::CODES;
use rcc_config::diagnostic::Faults;
use rcc_config::{CellConfig, Protocol, auto_ports};

/// Tests run in the package's folder; a relative path keeps the expected texts independent of it.
const FOLDER: &str = "tests/bad";

fn cases() -> Vec<PathBuf> {
    let entries = fs::read_dir(FOLDER).unwrap();
    let mut files: Vec<_> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "yaml")
        })
        .collect();
    files.sort();
    files
}

fn code(path: &Path) -> String {
    let stem = path.file_stem().unwrap().to_str().unwrap();
    stem.split('-').next().unwrap().to_owned()
}

fn faults(path: &Path) -> Faults {
    let ports: &[(&str, u16)] = match code(path).as_str() {
        "RCC2017" => &[("fri", 5000), ("frii", 5001)],
        _ => &[],
    };
    let ports = ports
        .iter()
        .map(|(name, number)| ((*name).to_owned(), *number))
        .collect();
    match CellConfig::load(path, &ports) {
        Ok(_) => panic!("{} is accepted", path.display()),
        Err(faults) => faults,
    }
}

#[test]
fn every_bad_file_gives_the_expected_text() {
    let bless = std::env::var_os("RCC_BLESS").is_some();
    for path in cases() {
        let shown = faults(&path).render(false);
        let expected = path.with_extension("txt");
        if bless {
            fs::write(&expected, &shown).unwrap();
        }
        let expected = fs::read_to_string(&expected).unwrap_or_default();
        assert_eq!(shown, expected, "{}", path.display());
    }
}

#[test]
fn every_bad_file_causes_the_fault_in_its_name_and_no_other() {
    for path in cases() {
        let codes: BTreeSet<_> = faults(&path)
            .diagnostics
            .iter()
            .map(|fault| fault.code)
            .collect();
        assert_eq!(
            codes,
            BTreeSet::from([code(&path).as_str()]),
            "{}",
            path.display()
        );
    }
}

#[test]
fn every_code_has_a_bad_file() {
    let have: BTreeSet<_> = cases().iter().map(|path| code(path)).collect();
    for code in CODES {
        assert!(have.contains(code.code), "{} ({})", code.code, code.meaning);
    }
}

#[test]
fn a_missing_file_is_a_fault_and_not_a_panic() {
    let path = Path::new(FOLDER).join("no-such-file.yaml");
    let fault = CellConfig::load(&path, &BTreeMap::new()).unwrap_err();
    assert_eq!(fault.diagnostics[0].code, "RCC2001");
    assert_eq!(
        auto_ports(&path).unwrap_err().diagnostics[0].code,
        "RCC2001"
    );
}

#[test]
fn faults_of_the_cell_and_of_its_robots_are_reported_together() {
    let text = "cell: a\nperiod: 1\ndevices:\n  lwr: {driver: a, robot: robots/six.yaml}\n";
    let faults =
        CellConfig::parse(text, "a.yaml", Path::new(FOLDER), &BTreeMap::new()).unwrap_err();
    let rows = faults.rows();
    let files: Vec<_> = rows
        .iter()
        .map(|row| (row.code.as_str(), row.file.as_str()))
        .collect();
    assert_eq!(
        files,
        [
            ("RCC2006", "a.yaml"),
            ("RCC2019", "tests/bad/robots/six.yaml")
        ]
    );
}

#[test]
fn a_duplicate_key_hides_no_other_fault() {
    let text = "cell: a\nperiod: 1\ndevices:\n  b: {driver: c}\n  b: {driver: c}\n";
    let faults =
        CellConfig::parse(text, "a.yaml", Path::new(FOLDER), &BTreeMap::new()).unwrap_err();
    let codes: Vec<_> = faults.diagnostics.iter().map(|fault| fault.code).collect();
    assert_eq!(codes, ["RCC2006", "RCC1002"]);
}

#[test]
fn a_robot_that_two_devices_share_is_read_once() {
    let text = "cell: a\nperiod: 1 ms\ndevices:\n  b: {driver: a, robot: robots/six.yaml}\n  c: {driver: a, robot: robots/six.yaml}\n";
    let faults =
        CellConfig::parse(text, "a.yaml", Path::new(FOLDER), &BTreeMap::new()).unwrap_err();
    assert_eq!(faults.diagnostics.len(), 1);
}

#[test]
fn ports_can_be_listed_although_the_rest_is_faulty() {
    let path = Path::new(FOLDER).join("RCC2016-automatic-port-without-number.yaml");
    assert_eq!(
        auto_ports(&path).unwrap(),
        [("fri".to_owned(), Protocol::Udp)]
    );
    let path = Path::new(FOLDER).join("RCC2022-bad-ports.yaml");
    assert_eq!(auto_ports(&path).unwrap_err().diagnostics.len(), 3);
}
