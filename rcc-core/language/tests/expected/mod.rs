//! The nets of `tests/nets/bad` with their expected diagnostics. `RCC_BLESS=1` rewrites the expected texts; review each
//! of them before committing. Used by the tests of every notation.

use std::fs;
use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_language::devices::DeviceTable;
use rcc_language::library::{FileLibraries, LibraryError, LibrarySource};
use rcc_language::parse::Notation;
use rcc_language::{Compiled, Compiler, Faults};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/nets")
}

fn cell() -> DeviceTable {
    let cell = CellConfig::load_offline(&folder().join("cell.yaml"));
    DeviceTable::from(&cell.unwrap_or_else(|faults| panic!("{faults}")))
}

/// Reads libraries relative to the folder of the nets.
struct LibrariesBesideNet;

impl LibrarySource for LibrariesBesideNet {
    fn read(&self, path: &str) -> Result<String, LibraryError> {
        FileLibraries.read(&folder().join("bad").join(path).to_string_lossy())
    }
}

/// Returns the files of the folder with this extension, sorted.
pub fn files(ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder().join("bad")).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|known| known == ending));
    files.sort();
    files
}

pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().into_owned()
}

fn compile(
    text: &str,
    name: &str,
    cell: &DeviceTable,
    notations: &[Notation],
) -> Result<Compiled, Faults> {
    let compiler = Compiler {
        cell,
        libraries: &LibrariesBesideNet,
        notations,
    };
    compiler.compile(text, name)
}

/// Asserts that each net with this extension gives its expected diagnostics.
pub fn check_diagnostics(ending: &str, notations: &[Notation]) {
    let cell = cell();
    let bless = std::env::var_os("RCC_BLESS").is_some();
    let mut different = Vec::new();
    for path in files(ending) {
        let text = fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let faults = match compile(&text, &name, &cell, notations) {
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

/// Asserts that errors refuse the nets with this extension, and warnings do not.
pub fn check_refusals(ending: &str, notations: &[Notation]) {
    let cell = cell();
    for path in files(ending) {
        let text = fs::read_to_string(&path).unwrap();
        let accepted = compile(&text, "net", &cell, notations).is_ok();
        assert_eq!(
            accepted,
            stem(&path).starts_with("RCC19"),
            "{}",
            path.display()
        );
    }
}
