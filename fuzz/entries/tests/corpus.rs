//! Replays the kept corpus of every fuzz target on stable Rust, so that a fault found once is found again. Run by the
//! threads of the test harness.

use std::fs;
use std::path::PathBuf;

use rcc_fuzz::{TARGETS, rest};

fn folder(target: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../corpus")
        .join(target)
}

/// Returns the inputs of a target, sorted by name.
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
    arbitrary_boards_cause_no_panic_and_no_unsafe_set_point: "boards";
    arbitrary_cell_texts_are_accepted_or_refused_with_a_position: "cell";
    arbitrary_directionet_texts_are_accepted_or_refused_with_a_position: "directionet";
    arbitrary_requests_are_carried_out_or_refused: "requests";
    arbitrary_datagrams_move_nothing_beyond_its_limits: "fri";
    arbitrary_messages_of_an_iiwa_are_refused_or_round_trip: "iiwa";
    arbitrary_incident_files_are_refused_or_replayed: "incident";
    arbitrary_answers_do_not_crash_the_simulators: "krc";
    arbitrary_servers_do_not_crash_the_modbus_driver: "modbus";
    arbitrary_net_texts_are_accepted_or_refused_with_a_position: "net";
    arbitrary_messages_are_refused_or_round_trip: "wire";
    changed_plans_are_refused_or_keep_the_limits: "plan";
}

#[test]
fn arbitrary_rest_requests_get_an_answer_of_the_interface() {
    replay("rest");
    rest::tear_down();
}
