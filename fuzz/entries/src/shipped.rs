//! The shipped files as fixtures: the demo cell, its devices as the core knows them, and the plans of valid nets. Read
//! once; used by the thread of the target.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use rcc_config::CellConfig;
use rcc_core::frame::DeviceModel;
use rcc_core::message::Joints;
use rcc_language::Compiler;
use rcc_language::devices::DeviceTable;
use rcc_language::library::FileLibraries;
use rcc_protocol::control::PlanData;

/// The demo cell, as the loader sees it.
pub struct ShippedFixtures {
    /// Its configuration.
    pub cell: CellConfig,
    /// Its device table for the compiler.
    pub table: DeviceTable,
    /// Its devices; the arm is the first.
    pub models: Vec<DeviceModel>,
    /// Plans of all shipped nets that fit this cell, sorted by file name.
    pub plans: Vec<PlanData>,
}

/// Hold position of the demo's arm, rad.
pub const HOLD: Joints = [
    0.0,
    -std::f64::consts::FRAC_PI_6,
    0.0,
    std::f64::consts::FRAC_PI_2,
    0.0,
    -std::f64::consts::FRAC_PI_3,
    0.0,
    0.0,
];

/// Returns the root folder of the repository.
#[must_use]
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns the fixtures.
#[must_use]
pub fn shipped() -> &'static ShippedFixtures {
    static SHIPPED: LazyLock<ShippedFixtures> = LazyLock::new(read);
    &SHIPPED
}

fn read() -> ShippedFixtures {
    let cell = CellConfig::load_offline(&repository().join("configs/cells/demo.yaml"));
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
    let table = DeviceTable::from(&cell);
    let mut texts = Vec::new();
    for folder in ["configs/nets", "tests/nets/ok"] {
        let entries = fs::read_dir(repository().join(folder))
            .into_iter()
            .flatten()
            .flatten();
        texts.extend(
            entries
                .map(|entry| entry.path())
                .filter(|path| path.extension().is_some_and(|e| e == "yaml")),
        );
    }
    texts.sort();
    let plan = |path: &PathBuf| {
        let text = fs::read_to_string(path).ok()?;
        let name = path.to_string_lossy();
        let compiler = Compiler {
            libraries: &FileLibraries,
            ..Compiler::of(&table)
        };
        let compiled = compiler.compile(&text, &name);
        compiled.ok().map(|compiled| compiled.plan)
    };
    let plans: Vec<PlanData> = texts.iter().filter_map(plan).collect();
    assert!(plans.len() >= 10, "the shipped nets compile");
    ShippedFixtures {
        models: table.models(),
        plans,
        cell,
        table,
    }
}
