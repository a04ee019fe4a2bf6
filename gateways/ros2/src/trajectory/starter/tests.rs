use rcc_api::bodies::{CommandView, LeaseDone, LeaseGranted, Loaded, StatusView};
use rcc_api::codes::{DISCONTINUOUS, UNKNOWN_COMMAND};
use serde_json::json;

use super::*;
use crate::trajectory::fake_loader::{Answer, FakeLoader};
use crate::trajectory::messages::{JointPoint, Stamp};

/// Command of the goal that runs.
const OLD: u64 = 7;
/// Command of the new goal.
const NEW: u64 = 9;

fn config() -> String {
    format!(
        "{}/../../configs/cells/by-joints.yaml",
        env!("CARGO_MANIFEST_DIR")
    )
}

fn point(positions: Vec<f64>, sec: i32) -> JointPoint {
    JointPoint {
        positions,
        time_from_start: Stamp { sec, nanosec: 0 },
        ..JointPoint::default()
    }
}

/// Returns a starter whose goal [`OLD`] runs if `runs`, and a goal whose first point is at `first_s`.
fn starter(loader: &FakeLoader, runs: bool, first_s: i32) -> (GoalStarter, Goal) {
    let config = CellConfig::load_offline(Path::new(&config())).expect("a configuration");
    let mut devices = config.devices.iter();
    let arm = devices.find_map(|one| Some((&one.name, one.robot.as_ref()?)));
    let (device, robot) = arm.expect("an arm");
    let joints: Vec<String> = robot.joints.iter().map(|one| one.name.clone()).collect();
    let mut end = vec![0.0; joints.len()];
    end[0] = 0.2;
    let mut goal = Goal::default();
    goal.trajectory.joint_names.clone_from(&joints);
    goal.trajectory.points = vec![
        point(vec![0.0; joints.len()], first_s),
        point(end, first_s + 2),
    ];
    let mut starter = GoalStarter::new("test", device, joints, Arc::default());
    starter.cell = Some(Cell::at(&loader.socket).expect("a loader"));
    starter.last = runs.then_some(OLD);
    (starter, goal)
}

/// Returns a loader whose nets rest once they were canceled, and that refuses each hand-over. `seen` is called with each
/// request before it is answered.
fn loader(mut seen: impl FnMut(&str) + Send + 'static) -> FakeLoader {
    let (mut old_state, mut new_state) = ("running", "ready");
    FakeLoader::new(move |request| -> Answer {
        seen(request);
        let view = |id, state: &str| {
            Ok(json!(CommandView {
                id,
                net: format!("{GOAL_NETS}arm"),
                state: state.to_owned(),
                reason: Some("canceled".to_owned()),
                can_cancel: true,
                ..CommandView::default()
            }))
        };
        let done = || Ok(json!({"id": 0, "net": "goal", "cycle": 1}));
        match request {
            "GET /status" => {
                let mut status = StatusView {
                    config: config(),
                    ..StatusView::default()
                };
                status.executor.period_ns = 1_000_000;
                Ok(json!(status))
            }
            "POST /commands" => Ok(json!(Loaded {
                id: NEW,
                state: "ready".to_owned(),
            })),
            "GET /commands/7" => view(OLD, old_state),
            "GET /commands/9" => view(NEW, new_state),
            "POST /commands/7/cancel" => {
                old_state = "terminated";
                done()
            }
            "POST /leases" => Ok(json!(LeaseGranted {
                lease: 1,
                expires_ms: 1000,
            })),
            "POST /switch" => Err(DISCONTINUOUS.code),
            "POST /commands/9/start" => {
                new_state = "running";
                done()
            }
            "DELETE /commands/9" => done(),
            lease if lease.contains("/leases/1") => Ok(json!(LeaseDone::default())),
            _ => Err(UNKNOWN_COMMAND.code),
        }
    })
}

/// Returns the requests that change a command, and what has become of the goal.
fn started(
    (runs, first_s): (bool, i32),
    cancel_at: &'static str,
) -> (Vec<String>, Result<u64, Refusal>) {
    let canceled = CancelFlag::default();
    let flag = canceled.clone();
    let loader = loader(move |request| {
        if request == cancel_at {
            flag.set();
        }
    });
    let (mut starter, goal) = starter(&loader, runs, first_s);
    if cancel_at.is_empty() {
        canceled.set();
    }
    let started = starter.start(&goal, &canceled);
    let mut requests = loader.requests();
    requests.retain(|request| !request.contains("/leases"));
    (requests, started.map(|started| started.command))
}

#[test]
fn a_goal_that_nobody_cancels_is_started_from_rest() {
    let (requests, command) = started((false, 0), "nothing");
    assert_eq!(command, Ok(NEW));
    assert_eq!(requests, ["POST /commands", "POST /commands/9/start"]);
    // The running goal does not lead to the new one.
    let (requests, command) = started((true, 0), "nothing");
    assert_eq!(command, Ok(NEW));
    let all = [
        "POST /commands",
        "POST /switch",
        "POST /commands/7/cancel",
        "POST /commands/9/start",
    ];
    assert_eq!(requests, all);
}

#[test]
fn a_goal_that_is_canceled_before_start_never_moves_the_arm() {
    const LOADED: &str = "POST /commands";
    const STOPPED: &str = "POST /commands/7/cancel";
    const UNLOADED: &str = "DELETE /commands/9";
    // Name, goal, the request at which it is canceled, and all requests.
    type Row = (
        &'static str,
        (bool, i32),
        &'static str,
        &'static [&'static str],
    );
    let rows: [Row; 6] = [
        ("waiting", (true, 0), "", &[]),
        ("rehearsed", (false, 0), LOADED, &[LOADED, UNLOADED]),
        // The running goal goes on.
        ("rehearsed-beside", (true, 0), LOADED, &[LOADED, UNLOADED]),
        ("planned-beside", (true, 1), "GET /commands/7", &[]),
        (
            "not-handed-over",
            (true, 0),
            "POST /switch",
            &[LOADED, "POST /switch", UNLOADED],
        ),
        (
            "stopping",
            (true, 0),
            STOPPED,
            &[LOADED, "POST /switch", STOPPED, UNLOADED],
        ),
    ];
    for (name, goal, cancel_at, wanted) in rows {
        let (requests, started) = started(goal, cancel_at);
        let refusal = started.expect_err(name).0;
        assert_eq!(
            refusal.error_string, "canceled before it was started",
            "{name}"
        );
        assert_eq!(requests, wanted, "{name}");
    }
}
