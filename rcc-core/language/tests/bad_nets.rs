//! Every diagnostic code has a net in `tests/nets/bad` that causes it, with the expected rendering beside it.
//! `RCC_BLESS=1` rewrites the expected texts; review each of them before committing.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_language::codes::DESCRIPTIONS;
use rcc_language::devices::DeviceTable;
use rcc_language::library::{FileLibraries, LibraryError, LibrarySource};
use rcc_language::{Compiled, Faults, compile_with};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/nets")
}

fn cell() -> CellConfig {
    CellConfig::load_offline(&folder().join("cell.yaml"))
        .unwrap_or_else(|faults| panic!("{faults}"))
}

/// Reads libraries relative to the folder of the nets.
struct LibrariesBesideNet;

impl LibrarySource for LibrariesBesideNet {
    fn read(&self, path: &str) -> Result<String, LibraryError> {
        FileLibraries.read(&folder().join("bad").join(path).to_string_lossy())
    }
}

fn compile(text: &str, name: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile_with(text, name, &DeviceTable::from(cell), &LibrariesBesideNet)
}

/// Returns the files of the folder with this extension, sorted.
fn files(ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder().join("bad")).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|known| known == ending));
    files.sort();
    files
}

/// Returns the nets of the folder, in YAML and in DirectIONet.
fn nets() -> Vec<PathBuf> {
    [files("yaml"), files("net")].concat()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().into_owned()
}

#[test]
fn every_bad_net_gives_its_expected_diagnostics() {
    let cell = cell();
    let bless = std::env::var_os("RCC_BLESS").is_some();
    let mut different = Vec::new();
    for path in nets() {
        let text = fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let faults = match compile(&text, &name, &cell) {
            Ok(compiled) => compiled.warnings,
            Err(faults) => faults,
        };
        let code = stem(&path).split('-').next().unwrap().to_string();
        assert!(
            faults.diagnostics.iter().any(|fault| fault.code == code),
            "{name} does not cause {code}:\n{faults}"
        );
        let silent = faults.diagnostics.iter().find(|fault| fault.help.is_none());
        assert!(silent.is_none(), "{name}: no remedy for {silent:?}");
        let found = faults.render(false);
        let expected = path.with_extension("txt");
        if bless {
            fs::write(&expected, found).unwrap();
        } else if fs::read_to_string(&expected).unwrap_or_default() != found {
            different.push(format!("{name}:\n{found}"));
        }
    }
    assert!(
        different.is_empty(),
        "not as expected (RCC_BLESS=1 accepts):\n{}",
        different.join("\n")
    );
}

#[test]
fn every_code_has_a_net() {
    let stems = nets().iter().map(|path| stem(path)).collect::<Vec<_>>();
    for description in DESCRIPTIONS {
        let has = stems.iter().any(|stem| stem.starts_with(description.code));
        assert!(
            has,
            "{}: {} needs a file in tests/nets/bad",
            description.code, description.meaning
        );
    }
}

#[test]
fn nets_and_expected_texts_come_in_pairs() {
    let nets: BTreeSet<String> = nets().iter().map(|path| stem(path)).collect();
    let texts: BTreeSet<String> = files("txt").iter().map(|path| stem(path)).collect();
    assert_eq!(nets, texts);
}

#[test]
fn errors_refuse_a_net_and_warnings_do_not() {
    let cell = cell();
    for path in nets() {
        let text = fs::read_to_string(&path).unwrap();
        let accepted = compile(&text, "net", &cell).is_ok();
        assert_eq!(
            accepted,
            stem(&path).starts_with("RCC19"),
            "{}",
            path.display()
        );
    }
}
