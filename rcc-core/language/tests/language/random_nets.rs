//! Random nets, valid by construction, of up to 10,000 primitives: they compile, run, and are unchanged by a round trip
//! through the writer. Their mutations never panic, never take long, and every diagnostic has a span.

use crate::generate::{TestRandom, random_net};
use crate::harness::{NetHarness, cell};
use rcc_config::yaml;
use rcc_language::{Faults, compile, parse, write};

const HOLD: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];
const SEED: u64 = 2010;

fn written_anew(text: &str) -> String {
    let mut faults = Vec::new();
    let (root, broken) = yaml::read(text);
    assert!(broken.is_empty(), "{broken:?}");
    let net = root.and_then(|root| parse::read_net(&root, &mut faults));
    assert!(faults.is_empty(), "{faults:?}");
    write::yaml(&net.expect("a net"))
}

fn holds(size: usize, seed: u64) {
    let cell = cell("tests/nets/cell.yaml");
    let net = random_net(size, seed);
    assert!(net.primitives >= size);
    let compiled = compile(&net.text, "random", &cell)
        .unwrap_or_else(|faults| panic!("seed {seed}: {faults}\n{}", cut(&net.text)));
    let again = compile(&written_anew(&net.text), "random", &cell)
        .unwrap_or_else(|faults| panic!("seed {seed}, written anew: {faults}"));
    // As words, so that NaN equals itself.
    assert_eq!(
        format!("{:?}", compiled.plan),
        format!("{:?}", again.plan),
        "seed {seed}: the text written anew is another net"
    );
    let mut harness = NetHarness::new(compiled, &cell, HOLD);
    for _ in 0..20 {
        harness.step();
    }
    assert!(!harness.terminated);
}

fn cut(text: &str) -> &str {
    text.get(..text.len().min(20_000)).unwrap_or_default()
}

#[test]
fn small_random_nets_compile_run_and_survive_a_round_trip() {
    for seed in 0..150 {
        holds(1 + seed as usize % 60, SEED + seed);
    }
}

#[test]
fn a_random_net_of_ten_thousand_compiles_runs_and_survives_a_round_trip() {
    holds(10_000, SEED);
}

/// Changes one position of a text: a byte, a word, a line, or a piece copied from elsewhere.
fn mutated(text: &str, random: &mut TestRandom) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let (from, to) = (random.below(lines.len()), random.below(lines.len()));
    match random.below(6) {
        0 => drop(lines.remove(from)),
        1 => lines.swap(from, to),
        2 => lines.insert(to, lines[from].clone()),
        3 => {
            let mut words: Vec<&str> = lines[from].split(' ').collect();
            let others: Vec<&str> = lines[to].split(' ').collect();
            let place = random.below(words.len());
            words[place] = others[random.below(others.len())];
            let line = words.join(" ");
            lines[from] = line;
        }
        4 => {
            let mut bytes = lines[from].clone().into_bytes();
            let place = random.below(bytes.len());
            if let Some(byte) = bytes.get_mut(place) {
                *byte = b" :{}[],.'\"#-&*!|>%@x0\t"[random.below(22)];
            }
            lines[from] = String::from_utf8_lossy(&bytes).into_owned();
        }
        _ => {
            let line = &lines[from];
            let cut: String = line.chars().take(random.below(line.len() + 1)).collect();
            lines[from] = cut;
        }
    }
    lines.join("\n")
}

/// Asserts that every diagnostic has a code and a message, and that its span is inside the text unless it is about the
/// whole text.
fn check_diagnostics(faults: &Faults, text: &str) {
    assert!(!faults.diagnostics.is_empty());
    for fault in &faults.diagnostics {
        assert!(fault.code.starts_with("RCC"), "{fault:?}");
        assert!(!fault.message.is_empty(), "{fault:?}");
        if let Some(place) = fault.place {
            let inside = place.start <= place.end && place.end <= text.len() + 1;
            assert!(inside, "{fault:?}");
        }
    }
    let drawn = faults.to_string();
    assert!(drawn.len() > 20, "{drawn}");
}

#[test]
fn mutations_of_valid_texts_are_accepted_or_refused_with_a_span() {
    let cell = cell("tests/nets/cell.yaml");
    let mut refused = 0;
    for seed in 0..60 {
        let valid = random_net(12, SEED + seed).text;
        let mut random = TestRandom(seed);
        for _ in 0..20 {
            let mut text = mutated(&valid, &mut random);
            if random.once_in(3) {
                text = mutated(&text, &mut random);
            }
            if let Err(faults) = compile(&text, "mutated", &cell) {
                check_diagnostics(&faults, &text);
                refused += 1;
            }
        }
    }
    assert!(
        refused > 500,
        "{refused} of 1200 refused: that is no mutation"
    );
}
