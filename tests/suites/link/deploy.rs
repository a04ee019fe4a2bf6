//! Rolling deployment to three real cells: everywhere or nowhere if one refuses, and a stop with the way back if one fails.

use std::fs;

use rcc_tests::cell_fixture::await_told;

use super::fleet::{Arm, Fleet, OFFICE, SITES, VISITOR, path};

/// A net of the arm `lwr`, which stays where it is.
const HOLD: &str = "net: hold
primitives:
  cancel: {type: Cancel}
  move: {type: JointGoal, parameters: {device: lwr}, inputs: {goal: [0.0, -0.5235987755982988, 0.0, 1.5707963267948966, 0.0, -1.0471975511965976, 0.0], stop: cancel.requested}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: move.position}}
  end: {type: Termination, inputs: {done: cancel.requested}}
";

/// Returns the fleet, or says why the test is skipped.
fn fleet(test: &str, arms: [Arm; 3]) -> Option<Fleet> {
    match Fleet::start(arms) {
        Ok(fleet) => Some(fleet),
        Err(reason) => {
            eprintln!("skipped: {test} ({reason})");
            None
        }
    }
}

#[test]
fn a_net_that_one_cell_of_three_refuses_changes_nothing_anywhere() {
    let arms = [Arm::Ideal, Arm::Ideal, Arm::Renamed];
    let Some(mut fleet) = fleet("a net that one cell of three refuses", arms) else {
        return;
    };
    let (told, done) = fleet.deploy(OFFICE, HOLD);
    assert!(!done, "{told}");
    assert!(told.contains("nothing was changed on any cell"), "{told}");
    // The words of that cell's own loader, with its own devices.
    assert!(told.contains("lab-c/test: RCC1207"), "{told}");
    assert!(told.contains("`lwr`") && told.contains("other"), "{told}");
    assert!(!told.contains("lab-a/test:"), "{told}");
    assert_eq!(fleet.nets(), ["", "", ""]);
    // Whoever has no right is told so, and changes nothing either.
    let (told, done) = fleet.deploy(VISITOR, HOLD);
    assert!(!done, "{told}");
    let words = "lab/visitor must not deploy here: the cell's configuration allows it by `link: {deploy: [lab/visitor]}`";
    assert!(told.contains(words), "{told}");
    assert_eq!(fleet.nets(), ["", "", ""]);
    let (told, done) = fleet.link(VISITOR, &["rights"]);
    let all = SITES.map(|site| format!("{site}/test  lab/office may deploy and configure\n"));
    assert!(done && told.starts_with(&all.concat()), "{told}");
    // The configuration that does all this is one that `doctor` finds no fault with.
    let doctor = fleet.cells[0].cli_exits(0, &["doctor", "--measure", "0", "--output", "json"]);
    let words = "link: by certificate: lab/office may deploy and configure";
    assert!(doctor.0.contains(words), "{}", doctor.0);
    // A cell that is not there.
    fleet.kill_gateway(1);
    await_told("a cell that is missing to be told", || {
        match fleet.deploy(OFFICE, HOLD).0 {
            told if told.contains("3 cells were expected, and 2 are there") => Ok(()),
            told => Err(told),
        }
    });
    assert_eq!(fleet.nets(), ["", "", ""]);
    fleet.stop();
}

#[test]
fn a_cell_that_fails_in_the_middle_stops_the_deployment_and_the_way_back_works() {
    let arms = [Arm::Ideal, Arm::Off, Arm::Ideal];
    let Some(fleet) = fleet("a cell that fails in the middle", arms) else {
        return;
    };
    let (told, done) = fleet.deploy(OFFICE, HOLD);
    assert!(!done, "{told}");
    for words in [
        "lab-b/test: net hold is not valid",
        "the position of lwr is not known",
        "has it: lab-a/test  hold#1 is ready",
        "has it not: lab-c/test",
        "rcc-link withdraw 'lab-a/test/hold#1'",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    // Nothing is left of the rejected one, and nothing runs.
    assert_eq!(fleet.nets(), ["hold ready", "", ""]);
    let back = ["withdraw", "lab-a/test/hold#1"];
    // Access control drops it in silence, and the cell says why when asked.
    let (told, done) = fleet.link(VISITOR, &back);
    let words = "lab/visitor must not deploy here: the cell's configuration allows it by `link: {deploy: [lab/visitor]}`";
    assert!(!done && told.contains(words), "{told}");
    let (told, done) = fleet.link(OFFICE, &back);
    assert!(done, "{told}");
    assert_eq!(fleet.nets(), ["", "", ""]);
    // A net that was not deployed is not withdrawn.
    let own = fleet.cells[0].load(HOLD);
    let (told, done) = fleet.link(OFFICE, &["withdraw", &format!("lab-a/test/hold#{own}")]);
    assert!(
        !done && told.contains("was not loaded over the link"),
        "{told}"
    );
    assert_eq!(fleet.nets(), ["hold ready", "", ""]);
    fleet.stop();
}

#[test]
fn a_deployed_net_stands_beside_the_running_one_and_a_configuration_waits_for_the_restart() {
    let Some(fleet) = fleet("deployment beside a running net", [Arm::Ideal; 3]) else {
        return;
    };
    let cell = &fleet.cells[0];
    let running = cell.run(HOLD);
    let (told, done) = fleet.deploy(OFFICE, HOLD);
    assert!(done, "{told}");
    assert_eq!(
        fleet.nets(),
        ["hold running, hold ready", "hold ready", "hold ready"]
    );
    // CANCEL and `withdraw` each find the right one.
    let deployed = format!("lab-a/test/hold#{}", running + 1);
    let present = fs::read_to_string(cell.config()).expect("the configuration");
    let new = present.replace("stale_after: 250 ms", "stale_after: 300 ms");
    let configure = |text: &str, person| {
        let file = cell.file(text);
        fleet.link(person, &["deploy", "--to", "lab-a/test", &path(&file)])
    };
    let (told, done) = configure(&new, OFFICE);
    assert!(!done && told.contains("runs: cancel it before"), "{told}");
    cell.cli_exits(8, &["cancel", "hold", "--wait"]);
    let (told, done) = fleet.link(OFFICE, &["withdraw", &deployed]);
    assert!(done, "{told}");
    for (text, person, words) in [
        (new.clone(), VISITOR, "lab/visitor must not deploy here"),
        (new.replace("lwr4plus", "lwr5plus"), OFFICE, "lwr5plus"),
        (
            new.replace("site: lab-a", "site: lab-d"),
            OFFICE,
            "`link` differs",
        ),
        (
            new.replace("ideal-arm", "{program: /bin/sh}"),
            OFFICE,
            "`/bin/sh` is not run by",
        ),
    ] {
        let (told, done) = configure(&text, person);
        assert!(!done && told.contains(words), "{words}: {told}");
        assert_eq!(
            fs::read_to_string(cell.config()).ok().as_deref(),
            Some(present.as_str())
        );
    }
    let (told, done) = configure(&new, OFFICE);
    assert!(
        done && told.contains("it holds from the cell's next start"),
        "{told}"
    );
    assert_eq!(
        fs::read_to_string(cell.config()).ok().as_deref(),
        Some(new.as_str())
    );
    let previous = cell.config().with_extension("yaml.previous");
    assert_eq!(
        fs::read_to_string(previous).ok().as_deref(),
        Some(present.as_str())
    );
    // The cell goes on as it was, and says so.
    await_told("the cell to say that its file has changed", || {
        let status = cell.rest("GET", "/status", "").body;
        match status["configuration"].to_string().contains("stale_after") {
            true => Ok(()),
            false => Err(status["configuration"].to_string()),
        }
    });
    // Which state it has in the list depends on late cycles, too.
    let (told, _) = fleet.link(OFFICE, &["top", "--once"]);
    assert!(told.starts_with("3 cells: "), "{told}");
    for site in ["lab-a", "lab-b", "lab-c"] {
        let line = told
            .lines()
            .find(|line| line.starts_with(&format!("{site}/test  ")));
        assert!(line.is_some_and(|line| line.contains("  yes  ")), "{told}");
    }
    fleet.stop();
}
