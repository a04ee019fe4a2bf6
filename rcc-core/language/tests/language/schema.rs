//! The JSON Schema, checked by an independent program (Python's jsonschema): it is a valid schema, accepts what the
//! language accepts, and refuses errors that are visible without following links.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use rcc_config::{CellConfig, auto_ports, yaml};
use rcc_language::devices::DeviceTable;
use rcc_language::schema::schema;

const PROGRAM: &str = r#"
import json, sys
try:
    import jsonschema
except ImportError:
    sys.exit(3)
schema = json.load(open(sys.argv[1]))
jsonschema.Draft202012Validator.check_schema(schema)
validator = jsonschema.Draft202012Validator(schema)
for name, net in json.load(open(sys.argv[2])).items():
    errors = [error.message for error in validator.iter_errors(net)]
    print(json.dumps([name, errors]))
"#;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn cell() -> DeviceTable {
    let path = root().join("configs/cells/demo.yaml");
    let ports = auto_ports(&path).unwrap();
    let ports = ports.into_iter().map(|(name, _)| (name, 1)).collect();
    DeviceTable::from(&CellConfig::load(&path, &ports).unwrap())
}

#[test]
fn the_schemas_of_cells_and_robots_accept_the_shipped_files_and_refuse_wrong_keys() {
    let broken = |files: &BTreeMap<String, serde_json::Value>, key: &str| {
        let files = files.iter().map(|(name, file)| {
            let mut file = file.clone();
            let root = file.as_object_mut().unwrap();
            let value = root.remove(key).unwrap();
            root.insert(format!("{key}s"), value);
            (name.clone(), file)
        });
        files.collect::<BTreeMap<_, _>>()
    };
    for (folder, schema, key) in [
        ("configs/cells", rcc_config::schema::cell(), "period"),
        ("configs/robots", rcc_config::schema::robot(), "kinematics"),
    ] {
        let good = nets(folder);
        assert!(good.len() >= 3, "{folder}");
        for (name, errors) in errors(&schema, &good, key).into_iter().flatten() {
            assert!(errors.is_empty(), "{name}: {errors:?}");
        }
        for (name, errors) in errors(&schema, &broken(&good, key), key)
            .into_iter()
            .flatten()
        {
            assert!(!errors.is_empty(), "{name}");
        }
    }
}

/// Returns the YAML nets by name.
fn nets(folder: &str) -> BTreeMap<String, serde_json::Value> {
    let Ok(files) = fs::read_dir(root().join(folder)) else {
        return BTreeMap::new();
    };
    let paths = files.map(|file| file.unwrap().path());
    let paths = paths.filter(|path| path.extension().is_some_and(|end| end == "yaml"));
    let trees = paths.filter_map(|path| {
        let tree = yaml::parse(&fs::read_to_string(&path).unwrap()).ok()?;
        Some((
            path.file_stem()?.to_string_lossy().into_owned(),
            tree.to_json(),
        ))
    });
    trees.collect()
}

/// Returns the validator's answer for each net; nothing if the validator is not installed.
fn errors(
    schema: &serde_json::Value,
    nets: &BTreeMap<String, serde_json::Value>,
    name: &str,
) -> Option<BTreeMap<String, Vec<String>>> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let [schema_file, nets_file] =
        ["schema", "nets"].map(|what| folder.join(format!("{name}-{what}.json")));
    fs::write(&schema_file, schema.to_string()).unwrap();
    fs::write(&nets_file, serde_json::to_string(nets).unwrap()).unwrap();
    let python = Command::new("python3")
        .args(["-c", PROGRAM])
        .arg(&schema_file)
        .arg(&nets_file)
        .output();
    let output = match python {
        Ok(output) if output.status.code() != Some(3) => output,
        _ => {
            eprintln!("skipped: there is no python3 with jsonschema");
            return None;
        }
    };
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let lines = String::from_utf8(output.stdout).unwrap();
    Some(
        lines
            .lines()
            .map(|line| serde_json::from_str::<(String, Vec<String>)>(line).unwrap())
            .collect(),
    )
}

#[test]
fn the_schema_accepts_what_the_language_accepts() {
    let mut all = nets("configs/nets");
    all.extend(nets("configs/nets/library"));
    all.extend(nets("tests/nets/ok"));
    assert!(all.len() >= 10);
    for cell in [None, Some(cell())] {
        let Some(found) = errors(&schema(cell.as_ref()), &all, "ok") else {
            return;
        };
        for (name, errors) in found {
            assert!(errors.is_empty(), "{name}: {errors:#?}");
        }
    }
}

#[test]
fn the_schema_refuses_errors_that_need_no_links() {
    let all = nets("tests/nets/bad");
    let Some(found) = errors(&schema(Some(&cell())), &all, "bad") else {
        return;
    };
    // Warnings, and errors that need links, units, numbers, the text of a formula, the legs of a path, or the whole net.
    let unseen = |name: &str| {
        [
            "RCC1102-conditions-of-legs",
            "RCC1102-faults-in-a-library",
            "RCC1107-two-fragments-of-one-name",
            "RCC19",
            "RCC1106",
            "RCC1108",
            "RCC12",
            "RCC13",
            "RCC14",
            "RCC15",
            "RCC16",
        ]
        .iter()
        .any(|code| name.starts_with(code))
    };
    let seen = [
        "RCC1201",
        "RCC1204-unknown",
        "RCC1205",
        "RCC1207",
        "RCC1208",
        "RCC1209",
        "RCC1301",
        "RCC1401",
    ];
    let mut refused = 0;
    for (name, errors) in found {
        let must = seen.iter().any(|code| name.starts_with(code)) || !unseen(&name);
        assert!(!must || !errors.is_empty(), "{name} is accepted");
        refused += usize::from(!errors.is_empty());
        if name.starts_with("RCC19") {
            assert!(errors.is_empty(), "{name} is only a warning: {errors:#?}");
        }
    }
    assert!(refused >= 12, "{refused}");
}

#[test]
fn the_schema_has_every_primitive_and_port() {
    let schema = schema(None);
    for entry in rcc_core::primitives::CATALOGUE {
        let definition = &schema["$defs"][entry.spec.name]["properties"];
        for port in entry.spec.inputs {
            assert!(definition["inputs"]["properties"][port.name].is_object());
        }
        for parameter in entry.spec.parameters {
            assert!(definition["parameters"]["properties"][parameter.name].is_object());
        }
    }
}
