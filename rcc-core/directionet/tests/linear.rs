//! The time for a text grows with its length, whatever is wrong with it: eight times as many entries take about eight
//! times as long. A quadratic pass takes 64 times as long. Measured as processor time of the test's thread.

use std::path::Path;

use rcc_config::CellConfig;
use rcc_directionet::compiler;
use rcc_language::devices::DeviceTable;
use rcc_testing::work::growth;

/// Entries of the smaller text.
const SIZE: usize = 1_500;
const FACTOR: usize = 8;
/// Between linear (8) and quadratic (64), with room for caches that fit the smaller text only.
const GROWTH_MAX: f64 = 24.0;

/// Returns the beginning of names that are too long to be compared with others: the search for similar names has a fixed
/// budget, which would hide how everything else grows.
fn far() -> String {
    "x".repeat(130)
}

/// Returns a text of `count` entries, joined by commas, between a head and a tail.
fn text(head: &str, count: usize, entry: impl Fn(usize) -> String, tail: &str) -> String {
    let entries: Vec<String> = (0..count).map(entry).collect();
    format!("{head}{}{tail}", entries.join(","))
}

fn grows_linearly(what: &str, make: impl Fn(usize) -> String) {
    let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/cells/demo.yaml");
    let cell = CellConfig::load_offline(&demo).unwrap_or_else(|faults| panic!("{faults}"));
    let devices = DeviceTable::from(&cell);
    let mut texts = std::collections::BTreeMap::new();
    for size in [SIZE, FACTOR * SIZE] {
        texts.insert(size, make(size));
    }
    let growth = growth(SIZE, FACTOR, |size| {
        compiler(&devices)
            .compile(&texts[&size], "net.net")
            .map_or_else(|faults| faults.diagnostics.len(), |net| net.net.len())
    });
    assert!(growth < GROWTH_MAX, "{what}: {growth:.1} times as long");
}

const END: &str = ",outTerminate=t.outValue}";
const START: &str = "{t=Core::BooleanValue(Value='true'),";

#[test]
fn wrong_names_take_linear_time() {
    grows_linearly("links to nothing", |count| {
        let entry = |n| format!("a{n}=Core::DoubleAdd(inFirst={}{n}.outValue)", far());
        text(START, count, entry, END)
    });
    grows_linearly("outputs that are none", |count| {
        let entry = |n| format!("a{n}=Core::BooleanNot(inValue=t.{}{n})", far());
        text(START, count, entry, END)
    });
    grows_linearly("fragments without the output", |count| {
        let entry = |n| format!("f{n}={{}}(),a{n}=Core::BooleanNot(inValue=f{n}.{})", far());
        text(START, count, entry, END)
    });
    grows_linearly("unknown types", |count| {
        text(START, count, |n| format!("a{n}={}{n}()", far()), END)
    });
    grows_linearly("parameters and inputs that are none", |count| {
        let entry = |n| {
            format!(
                "a{n}=Core::BooleanValue({x}{n}='true',in{x}{n}=t.outValue)",
                x = far()
            )
        };
        text(START, count, entry, END)
    });
    grows_linearly("devices that are none", |count| {
        let entry = |n| format!("a{n}=RobotArm::JointMonitor(Robot='kr{n}',Axis='0')");
        text(START, count, entry, END)
    });
    grows_linearly("ends that are none", |count| {
        let ends: Vec<String> = (0..count).map(|n| format!("{}{n}", far())).collect();
        let entry = |n| format!("a{n}=Core::BooleanNetcommOut(inValue=t.outValue,Key='k{n}')");
        format!(
            "# end: {}\n{}",
            ends.join(", "),
            text(START, count, entry, END)
        )
    });
}

#[test]
fn one_primitive_or_fragment_with_many_arguments_takes_linear_time() {
    grows_linearly("inputs of a primitive", |count| {
        let head = "{t=Core::BooleanValue(";
        text(head, count, |n| format!("A{n}='1'"), &format!("){END}"))
    });
    grows_linearly("inputs of a fragment", |count| {
        let inside = |n| format!("a{n}=Core::BooleanNot(inValue=parent.in{n})");
        let inside = text("f={", count, inside, "}");
        let outside = text("(", count, |n| format!("in{n}=t.outValue"), ")");
        format!("{START}{inside}{outside}{END}")
    });
}

#[test]
fn wrong_values_take_linear_time() {
    grows_linearly("invalid values", |count| {
        let entry = |n| format!("a{n}=Core::BooleanValue(Value='maybe{n}')");
        text(START, count, entry, END)
    });
    grows_linearly("the same name again", |count| {
        text(START, count, |_| "a=Core::BooleanValue()".to_owned(), END)
    });
}

#[test]
fn long_names_take_linear_time() {
    grows_linearly("a long name around many primitives", |count| {
        let entry = |n| format!("a{n}=Core::BooleanValue()");
        let head = format!("{START}{}={{", "n".repeat(16 * count));
        text(&head, count, entry, &format!("}}(){END}"))
    });
    grows_linearly("two long names that are alike", |count| {
        let name = "n".repeat(8 * count);
        format!(
            "{START}a=Core::BooleanNot(inValue={name}x.outValue),{name}=Core::BooleanValue(){END}"
        )
    });
}

#[test]
fn valid_texts_take_linear_time() {
    grows_linearly("delayed links", |count| {
        let entry = |n| format!("a{n}=Core::BooleanPre(inValue=t.outValue)");
        text(START, count, entry, END)
    });
    grows_linearly("a chain", |count| {
        let entry = |n: usize| {
            let from = n.checked_sub(1).map_or("t".to_owned(), |n| format!("a{n}"));
            format!("a{n}=Core::BooleanNot(inValue={from}.outValue)")
        };
        text(START, count, entry, END)
    });
    grows_linearly("mappings of devices", |count| {
        let pairs: Vec<String> = (0..count).map(|n| format!("kr{n}=lwr")).collect();
        let header = format!("# devices: {}", pairs.join(", "));
        let entry = |n| format!("a{n}=RobotArm::JointMonitor(Robot='kr{n}',Axis='0')");
        format!("{header}\n{}", text(START, count, entry, END))
    });
}
