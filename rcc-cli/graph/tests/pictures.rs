//! Diagrams of the example nets: those in docs/pictures are current, complete and well formed. `RCC_BLESS=1 cargo test
//! -p rcc-graph --test pictures` regenerates docs/pictures. Run by a thread of the test harness.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_graph::layout::PlanePoint;
use rcc_graph::scene::{NetScene, scene};
use rcc_graph::{dot::dot, drawn_role, is_label, links, mermaid::mermaid, shown, svg::svg};
use rcc_language::Compiler;
use rcc_language::devices::DeviceTable;
use rcc_language::library::FileLibraries;
use rcc_language::structure::{NetStructure, PrimitiveRole};

fn folder(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

fn cell() -> CellConfig {
    let path = folder("configs/cells/demo.yaml");
    CellConfig::load_offline(&path).unwrap_or_else(|faults| panic!("{faults}"))
}

fn structure(text: &str, name: &str) -> NetStructure {
    let cell = DeviceTable::from(&cell());
    let compiler = Compiler {
        libraries: &FileLibraries,
        ..Compiler::of(&cell)
    };
    let net = compiler.compile_with_structure(text, name);
    net.unwrap_or_else(|faults| panic!("{faults}")).1
}

/// Returns the example nets by name.
fn nets() -> BTreeMap<String, NetStructure> {
    let entries = std::fs::read_dir(folder("configs/nets")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let paths = paths.filter(|path| path.extension().is_some_and(|end| end == "yaml"));
    paths
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let net = structure(&std::fs::read_to_string(&path).unwrap(), &name);
            (name, net)
        })
        .collect()
}

/// Checks that boxes do not overlap, lie within the diagram, and that links end at the ports of their boxes.
fn check(net: &NetStructure, scene: &NetScene) {
    for (number, (a, at)) in scene.boxes.iter().enumerate() {
        for (b, other) in &scene.boxes[number + 1..] {
            let beside = at.x + a.width <= other.x || other.x + b.width <= at.x;
            let above = at.y + a.height <= other.y || other.y + b.height <= at.y;
            assert!(beside || above, "{} and {}", a.id, b.id);
        }
        let inside =
            at.x >= 0.0 && at.x + a.width <= scene.width && at.y + a.height <= scene.height;
        assert!(inside, "{}", a.id);
    }
    let drawn: Vec<usize> = scene.boxes.iter().map(|(it, _)| it.part).collect();
    for (number, part) in net.primitives.iter().enumerate() {
        let count = drawn.iter().filter(|drawn| **drawn == number).count();
        assert_eq!(count, usize::from(!is_label(net, part)), "{}", part.id);
        if shown(net, part).is_some() {
            let notes = scene.boxes.iter().flat_map(|(it, _)| &it.notes);
            let id = part.id.rsplit('/').next().unwrap();
            assert!(notes.clone().any(|note| note.contains(id)), "{}", part.id);
        }
    }
    for (reader, input, _, link) in links(net) {
        let source = &net.primitives[link.primitive];
        if source.role == PrimitiveRole::Constant || is_label(net, &net.primitives[reader]) {
            continue;
        }
        let pieces = scene
            .links
            .iter()
            .filter(|piece| piece.to == Some((reader, input)));
        let signal = (link.primitive, link.output, link.delayed);
        let pieces: Vec<_> = pieces.filter(|piece| piece.signal == signal).collect();
        assert_eq!(pieces.len(), 1, "{}.{input}", net.primitives[reader].id);
        let (it, at) = scene
            .boxes
            .iter()
            .find(|(it, _)| it.part == reader)
            .unwrap();
        let port = it.inputs.iter().find(|port| port.port == input).unwrap();
        let end = PlanePoint {
            x: at.x,
            y: at.y + port.y,
        };
        let last = pieces[0].route.points().last().unwrap();
        assert!(
            (last.x - end.x).abs() < 0.01 && (last.y - end.y).abs() < 0.01,
            "{}",
            it.id
        );
    }
}

/// Checks that elements are closed in order, attributes are quoted, and entities are those of XML.
fn check_xml(text: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        let words = &rest[..start];
        assert!(!words.contains('>'), "{words}");
        check_entities(words);
        let end = start + rest[start..].find('>').expect("an element that ends");
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name));
            continue;
        }
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        check_entities(tag);
        let name = tag.split([' ', '/', '\n']).next().unwrap();
        if !tag.ends_with('/') {
            open.push(name);
        }
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?}");
}

fn check_entities(words: &str) {
    for part in words.split('&').skip(1) {
        let name = part.split(';').next().unwrap();
        assert!(
            ["amp", "lt", "gt", "quot", "#39"].contains(&name),
            "&{name}"
        );
    }
}

#[test]
fn every_part_of_a_net_is_drawn_once_and_in_place() {
    for (name, net) in nets() {
        let scene = scene(&net, None).unwrap_or_else(|many| panic!("{name}: {many:?}"));
        check(&net, &scene);
        check_xml(&svg(&net, &scene));
    }
}

/// The nets with a diagram in the docs; a new example net needs none.
const PICTURES: [&str; 4] = ["feedback", "guarded-line", "line", "welding-line"];

#[test]
fn the_pictures_in_the_docs_are_those_of_the_example_nets() {
    let write = std::env::var_os("RCC_BLESS").is_some();
    let nets = nets();
    for name in PICTURES {
        let net = &nets[name];
        let path = folder("docs/pictures").join(format!("{name}.svg"));
        let drawn = svg(net, &scene(net, None).unwrap());
        if write {
            std::fs::create_dir_all(folder("docs/pictures")).unwrap();
            std::fs::write(&path, &drawn).unwrap();
        }
        let kept = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            kept == drawn,
            "{} is old: RCC_BLESS=1 cargo test -p rcc-graph --test pictures",
            path.display()
        );
    }
}

const SMALL: &str = "net: small
description: a <net> & \"more\"
primitives:
  time: {type: Time}
  two:  {type: Constant, parameters: {value: 2 s}}
  late: {type: OrElse, inputs: {in: time.out, other: {from: late.out, delayed: true, initial: 0 s}}}
  over: {type: Greater, inputs: {a: late.out, b: two.out}}
  show: {type: Monitor, parameters: {rate: 100 Hz}, inputs: {value: late.out}}
  end:  {type: Termination, inputs: {done: over.out}}
";

#[test]
fn dot_has_ports_and_dashed_delayed_links() {
    let text = dot(&structure(SMALL, "small"), None);
    for line in [
        "  n0:o0:e -> n2:i0:w;",
        "  n2:o0:e -> n2:i1:w [style=dashed, constraint=false];",
        "  n2:o0:e -> n3:i0:w;",
        "  n2:o0:e -> n4:i0:w;",
        "  n3:o0:e -> n5:i0:w;",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    assert_eq!(text.matches(" -> ").count(), 5, "{text}");
    assert!(
        text.contains("<B>over</B><BR/>Greater") && text.contains("b = 2 s (two)"),
        "{text}"
    );
    assert!(!text.contains("n1 ["), "a constant is a label");
}

#[test]
fn mermaid_has_boxes_and_links_and_escapes_texts() {
    let text = mermaid(&structure(SMALL, "small"), None);
    let wanted = "flowchart LR
  n0[\"<b>time</b><br/>Time\"]
  n2[\"<b>late</b><br/>OrElse\"]
  n3[\"<b>over</b><br/>Greater<br/>b = 2 s #40;two#41;\"]
  n4[\"<b>show</b><br/>Monitor\"]:::shows
  n5[\"<b>end</b><br/>Termination\"]:::ends
  n0 -->|\"out → in\"| n2
  n2 -.->|\"out → other\"| n2
  n2 -->|\"out → a\"| n3
  n2 -->|\"out → value\"| n4
  n3 -->|\"out → done\"| n5
  classDef ends fill:#f9dfe3,stroke:#d96b7c,color:#1d2530
  classDef shows fill:#d9f2f1,stroke:#45aaa6,color:#1d2530
";
    assert_eq!(text, wanted);
}

#[test]
fn reasons_for_null_are_shown_and_texts_are_escaped() {
    let net = structure(SMALL, "small");
    let text = svg(&net, &scene(&net, None).unwrap());
    check_xml(&text);
    assert!(
        text.contains("a &lt;net&gt; &amp; &quot;more&quot;"),
        "{text}"
    );
    assert!(
        text.contains("b = 2 s (two)") && text.contains("Real s, first 0 s"),
        "{text}"
    );
    assert!(text.contains("◉ show: out, 100 Hz"), "{text}");
    let values = BTreeMap::from([("time.out".to_owned(), "1.25 s".to_owned())]);
    let live = svg(&net, &scene(&net, Some(&values)).unwrap());
    assert!(live.contains(">1.25 s<"), "{live}");
}

#[test]
fn a_net_with_too_many_boxes_is_refused() {
    let mut text = "net: large\nprimitives:\n  p0: {type: Time}\n".to_owned();
    for number in 1..500 {
        text += &format!(
            "  p{number}: {{type: Negate, inputs: {{in: p{}.out}}}}\n",
            number - 1
        );
    }
    text += "  over: {type: Greater, inputs: {a: p499.out, b: 0 s}}\n  end: {type: Termination, inputs: {done: over.out}}\n";
    let net = structure(&text, "large");
    assert_eq!(scene(&net, None).map_err(|many| many.boxes), Err(502));
    assert_eq!(dot(&net, None).matches(" -> ").count(), 501);
}

#[test]
fn a_wide_net_is_wrapped_into_the_page() {
    for (name, net) in nets() {
        let scene = scene(&net, None).unwrap();
        let wide = scene.boxes.iter().map(|(it, _)| it.width);
        let least = wide.fold(0.0, f64::max);
        // The lanes of links from row to row come on top.
        assert!(
            scene.width < rcc_graph::scene::PAGE.max(least) + 300.0,
            "{name}: {}",
            scene.width
        );
    }
}

#[test]
fn goals_have_the_colour_of_motions_and_lists_show_their_constants() {
    let text = "net: choose
primitives:
  share: {type: AnalogInput, parameters: {device: lwr, channel: wire_speed_measured}}
  pick:  {type: Multiplexer, inputs: {index: 1, in: [1 m/s, share.out, 2 m/s]}}
  watch: {type: Monitor, inputs: {value: pick.out}}
  state: {type: JointState, parameters: {device: lwr}}
  goal:  {type: JointGoal, parameters: {device: lwr}, inputs: {goal: state.position}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: goal.position}}
  end:   {type: Termination, inputs: {done: goal.done}}
";
    let net = structure(text, "choose");
    let goal = net
        .primitives
        .iter()
        .find(|part| part.id == "goal")
        .unwrap();
    assert_eq!(drawn_role(goal), PrimitiveRole::Moves);
    let text = mermaid(&net, None);
    let line = text.lines().find(|line| line.contains("JointGoal"));
    assert!(
        line.is_some_and(|line| line.ends_with(":::moves")),
        "{text}"
    );
    for drawn in [dot(&net, None), text] {
        assert!(drawn.contains("1 m/s, ·, 2 m/s"), "{drawn}");
    }
    let drawn = svg(&net, &scene(&net, None).unwrap());
    assert!(drawn.contains("1 m/s, ·"), "{drawn}");
}

const NESTED: &str = "net: nested
fragments:
  smooth:
    parameters: {gain: {type: Real, default: 0.2}}
    inputs: {x: {type: Real}}
    outputs: {y: filter.out}
    primitives:
      filter: {type: LowPass, parameters: {gain: $gain}, inputs: {in: x}}
  twice:
    inputs: {x: {type: Real}}
    outputs: {y: last.y}
    primitives:
      first: {fragment: smooth, inputs: {x: x}}
      turned: {type: Negate, inputs: {in: first.y}}
      last: {fragment: smooth, parameters: {gain: 0.5}, inputs: {x: turned.out}}
primitives:
  time: {type: Time}
  a: {fragment: twice, inputs: {x: time.out}}
  b: {fragment: smooth, inputs: {x: a.y}}
  over: {type: Greater, inputs: {a: b.y, b: 1 s}}
  end: {type: Termination, inputs: {done: over.out}}
";

#[test]
fn fragments_are_frames_that_hold_what_is_in_them() {
    let net = structure(NESTED, "nested");
    let scene = scene(&net, None).unwrap();
    check(&net, &scene);
    check_xml(&svg(&net, &scene));
    let titles: Vec<&str> = scene
        .frames
        .iter()
        .map(|frame| frame.title.as_str())
        .collect();
    assert_eq!(titles, ["a", "first", "last", "b"]);
    let frame = |place: usize| &scene.frames[place];
    let at = |id: &str| {
        let number = net
            .primitives
            .iter()
            .position(|part| part.id == id)
            .unwrap();
        let found = scene.boxes.iter().find(|(it, _)| it.part == number);
        found.map(|(it, at)| (*at, it.width, it.height)).unwrap()
    };
    for (id, place) in [
        ("a/first/filter", 0),
        ("a/first/filter", 1),
        ("a/turned", 0),
        ("a/last/filter", 2),
        ("b/filter", 3),
    ] {
        let ((it, width, height), frame) = (at(id), frame(place));
        let inside = it.x >= frame.at.x
            && it.y >= frame.at.y
            && it.x + width <= frame.at.x + frame.width
            && it.y + height <= frame.at.y + frame.height;
        assert!(inside, "{id} in {}", frame.title);
    }
    let text = dot(&net, None);
    assert_eq!(text.matches("subgraph").count(), 4, "{text}");
    assert_eq!(text.matches('{').count(), text.matches('}').count());
    let text = mermaid(&net, None);
    assert_eq!(
        text.matches("subgraph").count(),
        text.matches("  end\n").count(),
        "{text}"
    );
    if let Some(file) = std::env::var_os("RCC_NESTED_SVG") {
        std::fs::write(file, svg(&net, &scene)).unwrap();
    }
}

#[test]
fn conditional_parts_show_their_condition() {
    let text = "net: regions\nfragments:\n  half:\n    inputs: {x: {}}\n    outputs: {y: out.out}\n    primitives: {out: {type: Multiply, inputs: {a: x, b: 0.5}}}\n\
        primitives:\n  arc: {type: DigitalInput, parameters: {device: lwr, channel: arc}}\n  time: {type: Time}\n  \
        a: {fragment: half, inputs: {x: time.out}, active: arc.out}\n  twice: {type: Add, inputs: {a: a.y, b: a.y}, active: arc.out}\n  \
        end: {type: Termination, inputs: {done: false}}\ndiscard: [twice.out]\n";
    let net = structure(text, "regions");
    assert_eq!(net.condition("a"), Some("arc.out"));
    assert_eq!(net.condition("time"), None);
    let scene = scene(&net, None).unwrap();
    assert_eq!(scene.frames[0].title, "a, while arc.out");
    let twice = scene.boxes.iter().find(|(it, _)| it.id == "twice").unwrap();
    assert_eq!(twice.0.parameters, ["while arc.out"]);
    assert!(dot(&net, None).contains("a, while arc.out"));
    assert!(mermaid(&net, None).contains("a, while arc.out"));
}
