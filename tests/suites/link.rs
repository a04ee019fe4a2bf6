//! Two cells in two network namespaces that a veth pair joins: a topic of cell A moves an arm of cell B. The link is cut and
//! its processes are killed: each net does what its configuration says, nothing moves by itself, and nothing leaks. Needs
//! root, network namespaces, and `rcc-link`; skipped by name without them.

use std::time::Duration;

use rcc_testing::{Random, Rng};
use rcc_tests::cell_fixture::{await_some, await_told};
use rcc_tests::program;
use serde_json::{Value, json};

use pair::CellPair;

mod cable;
mod conveyor;
mod deploy;
mod fleet;
mod hosts;
mod pair;

/// Cuts of a test; `RCC_LINK_CUTS` gives another number for a long run.
const CUTS: usize = 6;
/// Shortest cut, s.
const CUT_MIN_S: f64 = 0.001;
/// Longest cut, s: of a short and of a long run.
const CUT_MAX_S: [f64; 2] = [3.0, 10.0];
/// Exit code of `rcc-cli` after a net that was canceled.
const CANCELED: i32 = 8;
/// Age beyond which a value of the other cell is null, as configured.
const EXPIRES: Duration = Duration::from_millis(300);

/// Fails if `rcc-link` is not among the installed programs (`RCC_PROGRAMS`).
fn installed() -> Result<(), String> {
    let path = program("rcc-link");
    match path.exists() {
        true => Ok(()),
        false => Err(format!("{} does not exist", path.display())),
    }
}

/// Returns `RCC_SEED`, or a number of this process.
fn seed() -> u64 {
    let seed = std::env::var("RCC_SEED").ok();
    seed.map_or(u64::from(std::process::id()), |text| {
        text.parse().expect("a number")
    })
}

/// Returns the pair, or says why the test is skipped.
fn pair(test: &str) -> Option<CellPair> {
    match CellPair::start() {
        Ok(pair) => Some(pair),
        Err(reason) => {
            eprintln!("skipped: {test} ({reason})");
            None
        }
    }
}

#[test]
fn a_topic_of_one_cell_moves_an_arm_of_another() {
    let Some(pair) = pair("a topic of one cell moves an arm of another") else {
        return;
    };
    pair.run_both();
    // The joint follows what cell A publishes.
    for target in [0.2, -0.1, 0.15] {
        pair.publish(target);
        await_told("the arm to follow", || {
            let joint = pair.joint()?;
            match (joint - target).abs() < 1e-6 {
                true => Ok(()),
                false => Err(format!("the joint is at {joint}, not at {target}")),
            }
        });
    }
    let device = pair.b.device("press").expect("the device");
    assert_eq!(device["state"], "ready", "{device}");
    let tail = ["tail", "--connect", pair::ENDPOINT, "lab-a/test", "belt/*"];
    let line = pair.followed_in_b(&tail, "belt/position");
    assert!(
        line.starts_with("lab-a/test  belt/position  0.15 rad  age "),
        "{line}"
    );
    // The publisher ends: null, at once and without a loss of the device.
    pair.a.cli_exits(CANCELED, &["cancel", "belt", "--wait"]);
    await_some("null after the end of the publisher", || {
        (pair.value("gone.out").ok()? == Value::Bool(true)).then_some(())
    });
    pair.stop();
}

/// The net `follow` brings its arm to rest while the value is null and goes on afterwards, as its text says; `strict` ends,
/// and is not started again by anything.
#[test]
fn a_cut_link_is_null_and_nothing_starts_by_itself() {
    let Some(pair) = pair("a cut link is null and nothing starts by itself") else {
        return;
    };
    pair.run_both();
    let count = std::env::var("RCC_LINK_CUTS").ok();
    if count.is_some() {
        rcc_tests::cell::without_time_limit();
    }
    let longest = CUT_MAX_S[usize::from(count.is_some())];
    let count = count.map_or(CUTS, |text| text.parse().expect("a number"));
    let seed = seed();
    let mut random = Rng::with_seed(seed);
    // The first cut opens what later ones open again.
    pair.hosts.cut();
    pair.hosts.join();
    pair.publish(0.0);
    pair.await_joint(0.0);
    let before = pair.census();
    let (mut ended, mut long) = (0, 0);
    for number in 0..count {
        let seconds = random.log_uniform(CUT_MIN_S, longest);
        // Every third one certainly passes `expires`.
        let seconds = if number % 3 == 2 {
            seconds.max(1.0)
        } else {
            seconds
        };
        let strict = pair.start_strict();
        pair.publish(if number % 2 == 0 { 0.2 } else { -0.2 });
        pair.hosts.cut();
        std::thread::sleep(Duration::from_secs_f64(seconds));
        if seconds > 3.0 * EXPIRES.as_secs_f64() {
            long += 1;
            pair.assert_rests();
            assert_eq!(
                pair.b.state(strict)["outcome"],
                "lost",
                "cut {number}: {seconds} s"
            );
        }
        pair.hosts.join();
        await_some("the value to come back", || {
            (pair.value("gone.out").ok()? == Value::Bool(false)).then_some(())
        });
        // `follow` ran all the time; `strict` has ended, if it was cut for long enough, and stays so.
        assert_eq!(pair.follow_state(), "running", "cut {number}: {seconds} s");
        let state = pair.b.state(strict);
        match state["state"].as_str() {
            Some("running") => {
                drop(pair.b.cli_exits(CANCELED, &["cancel", "strict", "--wait"]));
            }
            _ => {
                assert_eq!(
                    (&state["state"], &state["outcome"]),
                    (&"terminated".into(), &"lost".into()),
                    "{state}"
                );
                ended += 1;
            }
        }
        pair.b.cli_exits(0, &["unload", "strict"]);
    }
    eprintln!(
        "{count} cuts, seed {seed}: {long} certainly beyond `expires`, {ended} ended the net `strict`"
    );
    assert!(long > 0 && ended >= long, "{long} {ended}");
    pair.assert_no_growth(&before);
    pair.stop();
}

#[test]
fn a_killed_gateway_or_device_comes_back_without_moving_anything() {
    let Some(mut pair) = pair("a killed gateway or device comes back without moving anything")
    else {
        return;
    };
    pair.run_both();
    pair.publish(0.1);
    pair.await_joint(0.1);
    // The gateway of A.
    pair.kill_gateway();
    await_some("null without the gateway", || {
        (pair.value("gone.out").ok()? == Value::Bool(true)).then_some(())
    });
    pair.assert_rests();
    pair.start_gateway();
    pair.publish(0.2);
    pair.await_joint(0.2);
    // The driver of B: its supervisor starts it again; the net of the arm goes on, since it handles null.
    let dead = pair.b.kill(rcc_protocol::Role::Driver, "press");
    pair.b
        .await_successor(rcc_protocol::Role::Driver, "press", dead);
    pair.publish(0.05);
    pair.await_joint(0.05);
    pair.stop();
}

#[test]
fn start_is_refused_unless_the_cell_names_the_net_and_cancel_is_not() {
    let Some(pair) = pair("START over the link is refused unless the cell names the net") else {
        return;
    };
    pair.run_both();
    let belt = pair.a.load(pair::OTHER);
    // Cell A allows lab-b/test to start `other`, and nothing else.
    let refused = pair.ask("start", "lab-c/test", "other");
    assert!(
        refused.contains("lab-c/test must not start `other`"),
        "{refused}"
    );
    let refused = pair.ask("start", "lab-b/test", "belt");
    assert!(refused.contains("must not start `belt`"), "{refused}");
    assert_eq!(pair.a.state(belt)["state"], "ready");
    let done = pair.ask("start", "lab-b/test", "other");
    assert!(done.contains("start in cycle"), "{done}");
    let done = pair.ask("cancel", "lab-c/test", "other");
    assert!(done.contains("cancel in cycle"), "{done}");
    pair.a.assert_ends(belt, "canceled");
    // By the command line of cells, which passes on what it is given.
    let ask = ["fleet", "cells", "--connect", pair::ENDPOINT];
    let (listed, _) = pair.b.cli_exits(0, &ask);
    assert!(listed.contains("lab-a/test  alive  cycle "), "{listed}");
    pair.stop();
}

/// A rule of B waits for a value of A: never on null, and so never on a value that is older than `expires`.
#[test]
fn a_rule_fires_on_a_value_of_another_cell_and_not_while_the_link_is_cut() {
    let Some(pair) = pair("a rule fires on a value of another cell") else {
        return;
    };
    pair.run_both();
    pair.publish(0.1);
    let other = pair.b.load(pair::OTHER);
    let rule = json!({
        "when": "follow.belt.out > 0.3", "start": "other", "on_client_loss": "go on",
    });
    let installed = pair
        .b
        .rest("POST", "/rules", &json!({"rules": [rule]}).to_string());
    assert_eq!(installed.status, 200, "{}", installed.body);
    pair.hosts.cut();
    await_some("null while the link is cut", || {
        (pair.value("gone.out").ok()? == Value::Bool(true)).then_some(())
    });
    pair.publish(0.4);
    assert_eq!(pair.b.state(other)["state"], "ready");
    pair.hosts.join();
    await_told("the rule to fire", || {
        let state = pair.b.state(other);
        match state["state"] == "running" {
            true => Ok(()),
            false => Err(state.to_string()),
        }
    });
    assert!(
        pair.value("belt.out")
            .is_ok_and(|it| it.as_f64() > Some(0.3))
    );
    pair.stop();
}

/// The reason is told by `devices`, in words that say what to do.
#[test]
fn devices_says_why_there_is_no_value() {
    let Some(mut pair) = pair("`devices` says why there is no value of another cell") else {
        return;
    };
    let told = |pair: &CellPair, words: &str| {
        await_told(words, || {
            let device = pair.b.device("press").ok_or("no device")?;
            match device.to_string().contains(words) {
                true => Ok(()),
                false => Err(device.to_string()),
            }
        });
    };
    // The gateway is there, and no net publishes.
    told(&pair, "never arrived");
    pair.kill_gateway();
    told(&pair, "nothing answers at settings.connect");
    pair.start_gateway();
    pair.run_both();
    await_some("the device to be ready", || {
        (pair.b.device("press")?["state"] == "ready").then_some(())
    });
    // Its driver tells what it knows from time to time.
    await_told("the topic in the report of `doctor link`", || {
        let report = pair.b.cli(&["doctor", "link", "press", "--output", "json"]);
        let words = String::from_utf8_lossy(&report.stdout).into_owned();
        match report.status.success() && words.contains("belt/position") {
            true => Ok(()),
            false => Err(words),
        }
    });
    pair.stop();
}
