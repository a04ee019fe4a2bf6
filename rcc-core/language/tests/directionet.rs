//! Nets that the predecessor's library generated: they load, or what is missing is said with its place.

mod bench;

use bench::{Bench, cell, folder};
use rcc_config::CellConfig;
use rcc_language::{Compiled, Faults, compile};

fn demo() -> CellConfig {
    cell("configs/cells/demo.yaml")
}

fn text(name: &str) -> String {
    std::fs::read_to_string(folder("tests/data/directionet").join(name)).unwrap()
}

/// All nets, `flat/…` and `nested/…`, sorted.
fn all() -> Vec<String> {
    let mut names = Vec::new();
    for kind in ["flat", "nested"] {
        let files = std::fs::read_dir(folder("tests/data/directionet").join(kind)).unwrap();
        let files = files.map(|file| file.unwrap().file_name().to_string_lossy().into_owned());
        names.extend(files.map(|file| format!("{kind}/{file}")));
    }
    names.sort();
    names
}

/// Compiles a net with lines of ours before it.
fn load(header: &str, name: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile(&format!("{header}\n{}", text(name)), name, cell)
}

#[test]
fn an_output_is_set_as_the_net_says() {
    let cell = demo();
    let header = "# devices: io0=io\n# end: _2";
    let name = "flat/do_set-01-io-digital-output-0-setdigitalva.net";
    let net = load(header, name, &cell).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(net.net, "do-set-01-io-digital-output-0-setdigitalva");
    let mut bench = Bench::new(net, &cell, [0.0; 7]);
    bench.step();
    let (io, _) = cell.device("io").unwrap();
    assert_eq!(bench.outputs[io].digital_commanded, 1);
    assert_eq!(bench.outputs[io].digital, 1);
}

#[test]
fn what_a_cell_does_not_have_is_told_once_with_what_to_write() {
    let name = "flat/kr_lin-01-kr-ptp.net";
    let faults = load("", name, &demo()).unwrap_err();
    let devices: Vec<_> = faults
        .diagnostics
        .iter()
        .filter(|fault| fault.code == rcc_language::fault::UNKNOWN_DEVICE)
        .collect();
    assert_eq!(devices.len(), 1);
    let help = devices[0].help.as_ref().unwrap();
    assert!(help.contains("# devices: kr=NAME"), "{help}");
}

#[test]
fn every_fault_of_a_text_is_told_at_once_and_with_its_place() {
    let text = "{a=Core::DoubleAdd(inFrist=b.outValue,Second='x'),b=Core::DubleValue(Value='1'),\
        c=Core::TimeWall(),d=Core::DoubleAdd(inFirst=nobody.outValue,inSecond=a.outVal),outTerminate=a.outValue}";
    let faults = compile(text, "net", &demo()).unwrap_err();
    let places: Vec<&str> = faults
        .diagnostics
        .iter()
        .filter_map(|fault| fault.place)
        .map(|place| &text[place.start..place.end])
        .collect();
    assert_eq!(
        places,
        [
            "inFrist",
            "x",
            "Core::DubleValue",
            "Core::TimeWall",
            "nobody",
            "outVal"
        ]
    );
}

#[test]
fn every_net_is_read_to_the_end() {
    let cell = demo();
    for name in all() {
        match load("", &name, &cell) {
            Ok(net) => println!("{name}: {} primitives", net.names.primitives.len()),
            Err(faults) => {
                println!("{name}:");
                let mut seen = std::collections::BTreeSet::new();
                for fault in &faults.diagnostics {
                    assert!(fault.code >= "RCC12", "{name}: {}", fault.message);
                    if seen.insert(&fault.message) {
                        println!("  {} {}", fault.code, fault.message);
                    }
                }
            }
        }
    }
}
