//! Whatever is read here has the tree, positions and faults of the general parser: shipped files, forms written down
//! here, and random changes of both. Run by a thread of the test harness.

use std::path::Path;

use rcc_testing::{Random, Rng};

use super::super::{read, read_any_form};

/// Forms that are read without the general parser.
const READ: &[&str] = &[
    "a: 1",
    "a: 1\n",
    "# comment\n\na: 1   # one\n  # two\nb: x y z\n",
    "a:\n  b: 1\n  c:\n    d: 'it''s'\ne: \"q\\\"\\n\"\n",
    "a:\n- 1\n- {x: 1}\n- b: 1\n  c: 2\n- - 1\n  - 2\nd: 2\n",
    "- a\n-  b: 1\n   c: [1,2 , -3.5e1]\n- 'x': y\n",
    "{\"a\": 1,\"b\":[true,null,{}],\"c\":{\"d\":\"\\/\"}}\n",
    "{a: 1,\n b: {c: [ ],\n  d: x#y}}",
    "a: {b: 1,\n  c: 2}\nd: [1, # one\n   2]\n",
    "a: grün 日本 🤖 – µm\nb: x:y\nc: -1\nd: http://x\n",
    "a: \"= 2 * b.out + 0.1 m\"\n",
];

/// Forms that are declined: the general parser reads or refuses them.
const DECLINED: &[&str] = &[
    "",
    "a",
    "a:\n",
    "a: 1\na: 2\n",
    "b: {c: 1, c: 2}\n",
    "a: x\u{34f}\n",
    "{\"a\u{ad}\": 1}",
    "a: 1\n b: 2\n",
    "a: x\n  y\n",
    "a: |\n  x\n",
    "a: &x 1\nb: *x",
    "a: 1\r\nb: 2\r\n",
    "a:\tb",
    "a: b: c",
    "{a: 1,}",
    "{a, b}",
    "[a: 1]",
    "{a:[1]}",
    "a: {b: 1,\nc: 2}",
    "a: \"\\u00e9\"",
    "a: 'x\n  y'",
    "--- a: 1",
    "a: 1\n---\nb: 2",
    "a: [1, 2",
    "a: - b",
    "- a\n b: 1",
    "\u{feff}a: 1",
];

fn agrees(text: &str) -> bool {
    let Some(tree) = super::read(text) else {
        return false;
    };
    let (expected, faults) = read_any_form(text);
    assert_eq!(Some(tree), expected, "{text:?}");
    assert!(faults.is_empty(), "{text:?}: {faults:?}");
    true
}

#[test]
fn usual_forms_are_read_as_by_the_general_parser() {
    for text in READ {
        assert!(agrees(text), "declined: {text:?}");
    }
}

#[test]
fn other_forms_are_declined() {
    for text in DECLINED {
        assert!(!agrees(text), "read: {text:?}");
    }
}

/// Texts of the files below a folder.
fn files(folder: &Path, texts: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files(&path, texts);
        } else if let Ok(text) = std::fs::read_to_string(&path) {
            texts.push(text);
        }
    }
}

fn shipped() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut texts = Vec::new();
    for folder in [
        "configs/cells",
        "configs/nets",
        "configs/robots",
        "tests/nets",
    ] {
        files(&root.join(folder), &mut texts);
    }
    texts
}

#[test]
fn shipped_files_are_read_the_same() {
    let texts = shipped();
    let read = texts.iter().filter(|text| agrees(text)).count();
    // Texts of the folder with bad nets are not YAML, or contain unusual forms on purpose.
    assert!(read * 10 > texts.len() * 3, "{read} of {}", texts.len());
}

#[test]
fn changed_texts_are_read_the_same_or_declined() {
    let seed = Rng::new().u64(..);
    println!("seed {seed}");
    let mut random = Rng::with_seed(seed);
    let mut texts: Vec<String> = shipped();
    texts.retain(|text| text.len() < 4000 && super::read(text).is_some());
    texts.extend(READ.iter().chain(DECLINED).map(|text| (*text).to_owned()));
    let pieces = [
        "\n", " ", ":", ": ", "- ", "#", " #", ",", "{", "}", "[", "]", "'", "\"", "a", "0", "-",
        "\n  ", "?", "? ", "&", "*", "!", "|", ">", "%", "@", "`", "\\", "~", ".", "...", "---",
        "é", "\t", "\n\n",
    ];
    let mut read_again = 0;
    for _ in 0..8_000 {
        let mut text = random.pick(&texts).expect("texts").clone();
        for _ in 0..=random.below(3) {
            let mut at = random.below(text.len() + 1);
            while !text.is_char_boundary(at) {
                at -= 1;
            }
            match random.below(3) {
                0 if at < text.len() => {
                    text.remove(at);
                }
                _ => text.insert_str(at, random.pick(&pieces).expect("pieces")),
            }
        }
        read_again += usize::from(agrees(&text));
    }
    assert!(read_again > 400, "{read_again}");
}

#[test]
fn a_text_of_any_length_has_its_keys_compared() {
    let mut text: String = (0..40).map(|number| format!("k{number}: 1\n")).collect();
    assert!(agrees(&text));
    text += "k3: 2\nk39: 2\n";
    let (_, faults) = read(&text);
    assert_eq!(faults.len(), 2);
    assert!(!agrees(&text));
}
