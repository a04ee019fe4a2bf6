//! Replays the kept corpus of every fuzz target through the function that the target runs: what was found once is found
//! again, on stable Rust. Run by the threads of the test harness.

use std::fs;
use std::path::PathBuf;

use rcc_fuzz::{TARGETS, rest};

fn folder(target: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../corpus")
        .join(target)
}

/// The inputs of a target, in the order of their names.
fn inputs(target: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder(target)).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn replay(target: &str) {
    let (_, run) = TARGETS
        .iter()
        .find(|(name, _)| *name == target)
        .expect("a target");
    let paths = inputs(target);
    assert!(!paths.is_empty(), "{target} has a corpus");
    for path in paths {
        // Shown if it panics.
        println!("{}", path.display());
        run(&fs::read(&path).expect("the corpus can be read"));
    }
    run(&[]);
}

macro_rules! replayed {
    ($($name:ident: $target:literal;)*) => {
        $(#[test] fn $name() { replay($target) })*

        #[test]
        fn every_target_is_replayed_and_has_a_program() {
            let replayed = [$($target),*];
            for (target, _) in TARGETS {
                let special = *target == "rest";
                assert!(special || replayed.contains(target), "{target} is not replayed");
                let program = folder("").join(format!("../fuzz_targets/{target}.rs"));
                assert!(program.is_file(), "{target} has no program");
            }
        }
    };
}

replayed! {
    boards_of_any_bytes_harm_nobody: "boards";
    texts_as_cells_are_accepted_or_refused_with_a_place: "cell";
    texts_of_the_predecessor_are_accepted_or_refused_with_a_place: "directionet";
    requests_of_any_bytes_are_carried_out_or_refused: "requests";
    datagrams_of_any_bytes_move_nothing_out_of_its_limits: "fri";
    incidents_of_any_words_are_refused_or_replayed: "incident";
    answers_of_any_bytes_leave_the_simulators_alive: "krc";
    servers_that_say_anything_leave_the_modbus_driver_alive: "modbus";
    texts_as_nets_are_accepted_or_refused_with_a_place: "net";
    messages_of_any_bytes_are_refused_or_come_back: "wire";
    changed_plans_are_refused_or_keep_the_limits: "plan";
}

#[test]
fn requests_of_any_kind_get_an_answer_of_ours() {
    replay("rest");
    rest::tear_down();
}
