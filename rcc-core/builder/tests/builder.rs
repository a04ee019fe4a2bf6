//! Built nets are valid: they compile for the demo cell and equal those of the files. Mistakes are refused with an
//! error.

use std::path::{Path, PathBuf};

use rcc_config::{CellConfig, auto_ports, yaml};
use rcc_language::{compile, parse, write};
use rcc_net::{BuildError, Matrix, NetBuilder, Real, Reals, literal, null};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn cell() -> CellConfig {
    let path = root().join("configs/cells/demo.yaml");
    let ports = auto_ports(&path).unwrap();
    let ports = ports.into_iter().map(|(name, _)| (name, 1)).collect();
    CellConfig::load(&path, &ports).unwrap()
}

fn is_valid(net: &NetBuilder) -> u32 {
    let text = net.to_yaml().unwrap_or_else(|error| panic!("{error}"));
    let compiled =
        compile(&text, "built", &cell()).unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    u32::try_from(compiled.names.primitives.len()).unwrap()
}

#[test]
fn a_net_from_a_file_can_be_built() {
    let net = NetBuilder::new("toggle");
    net.describe("Toggles an output with each rising edge of an input.");
    let door = net.digital_input("door", "io", "door_closed");
    let edge = net.rising_edge("edge", door.out);
    let before = net.delayed(false);
    let last = net.or_else("last", before, false);
    let other = net.not("other", last.out);
    let next = net.select("next", edge.out, other.out, last.out);
    before.feed(next.out);
    net.digital_output("lamp", "io", "lamp", next.out);
    let cancel = net.cancel("cancel");
    net.termination("end", cancel.requested);
    net.monitor("watch", next.out);
    let file = std::fs::read_to_string(root().join("configs/nets/toggle.yaml")).unwrap();
    let file = parse::read_net(&yaml::parse(&file).unwrap(), &mut Vec::new()).unwrap();
    assert_eq!(net.to_yaml().unwrap(), write::yaml(&file));
    is_valid(&net);
}

#[test]
fn operators_make_primitives() {
    let net = NetBuilder::new("operators");
    let time = net.time("time").out;
    let product = -(time * 2.0 - "1 s") / "4 s" + 1.0;
    let late = net.greater("late", product, 0.5);
    let early = net.less("early", time, "3 s");
    net.termination("end", (late.out | !early.out) & true);
    assert_eq!(is_valid(&net), 12);
}

#[test]
fn constants_of_every_type_are_written() {
    let net = NetBuilder::new("constants");
    let list = net.constant("list", literal::<Reals<2>>("[deg(3), 0.5 rad]"));
    net.monitor("first", list.out.element(0)).rate(100.0);
    let nothing = net.or_else("nothing", null::<Real>(), 3.0);
    net.monitor("second", nothing.out).rate("100 Hz");
    let goal = net.constant("goal", rcc_net::pose([0.1, 0.2, 0.3], [0.0, 0.0, 1.0]));
    net.monitor("third", goal.out);
    net.termination("end", false);
    is_valid(&net);
}

#[test]
fn an_element_of_a_matrix_is_named_by_row_and_column() {
    let identity = || literal::<Matrix<2, 2>>("[[1.0, 0.0], [0.0, 1.0]]");
    let product = |net: &NetBuilder, row, column| {
        let product = net.matrix_multiply("product", identity(), identity());
        let product = product.out.assume::<Matrix<2, 2>>();
        net.monitor("watch", product.element(row, column));
        net.termination("end", false);
    };
    let net = NetBuilder::new("matrix");
    product(&net, 1, 0);
    let text = net.to_yaml().unwrap();
    assert!(text.contains("product.out[1,0]"), "{text}");
    is_valid(&net);
    for (row, column) in [(0, 2), (2, 0)] {
        let net = NetBuilder::new("matrix");
        product(&net, row, column);
        let error = BuildError::NoElement {
            output: "product.out".to_owned(),
            row,
            column,
            rows: 2,
            columns: 2,
        };
        assert_eq!(net.build().unwrap_err(), error);
    }
}

#[test]
fn unread_outputs_are_discarded_by_name() {
    let net = NetBuilder::new("discard");
    let ft = net.force_torque("ft", "lwr");
    net.discard(ft.fx);
    net.monitor("watch", ft.fz);
    net.discard_rest();
    net.termination("end", false);
    let text = net.to_yaml().unwrap();
    assert!(
        text.contains("discard: [ft.fx, ft.fy, ft.tx, ft.ty, ft.tz]"),
        "{text}"
    );
    is_valid(&net);
}

#[test]
fn a_delayed_link_must_be_fed() {
    let net = NetBuilder::new("never");
    let before = net.delayed::<Real>(0.0);
    net.abs("size", before);
    let error = BuildError::NeverFed {
        primitive: "size".to_string(),
        input: "in".to_string(),
    };
    assert_eq!(net.build().unwrap_err(), error);
}

#[test]
fn invalid_names_and_constants_are_refused() {
    for make in [
        |net: &NetBuilder| {
            net.time("Bad Id");
        },
        |net: &NetBuilder| {
            net.time("twice");
            net.time("twice");
        },
        |net: &NetBuilder| {
            net.abs::<Real>("size", "12 furlong");
        },
    ] {
        let net = NetBuilder::new("bad");
        make(&net);
        assert!(matches!(net.build(), Err(BuildError::Faulty(_))));
    }
}
