//! The life cycle of commands (figure 2 of the paper) with every refusal, in virtual time.

mod faults;

use crate::common::{
    EngineFixture, HOLD, TestPlan, endless_net, line_net, model, motion_net, output_net,
};
use rcc_core::frame::DeviceModel;
use rcc_core::guard::{ViolationKind, axis};
use rcc_core::message::{CommandState, DeviceState, EndReason, FaultCode};
use rcc_core::plan::Resource;
use rcc_core::types::Store;
use rcc_core::workspace::Workspace;
use rcc_engine::queue::{EngineEvent, EngineRequest};
use rcc_protocol::control::{Answer, Refusal};

fn refused(answer: Answer) -> Refusal {
    match answer {
        Answer::Refused(refusal) => refusal,
        answer => panic!("not refused: {answer:?}"),
    }
}

#[test]
fn a_command_goes_through_its_states_and_start_takes_effect_in_the_next_cycle() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(output_net(1));
    assert_eq!(fixture.state(id), CommandState::Ready);
    let before = fixture.engine.status().cycle;
    assert_eq!(fixture.start(id), Answer::Done { cycle: before + 1 });
    assert_eq!(fixture.state(id), CommandState::Running);
    assert_eq!(fixture.entry(id).started_cycle, before + 1);
    let image = fixture.engine.image(0).unwrap();
    assert_eq!(
        image.at(image.head.sequence).unwrap().digital_commanded,
        0b10
    );
    assert!(matches!(
        fixture.ask(|ticket| EngineRequest::Cancel { ticket, id }),
        Answer::Done { .. }
    ));
    assert_eq!(fixture.until_terminated(id, 2), EndReason::Canceled);
    fixture.step();
    let image = fixture.engine.image(0).unwrap();
    assert_eq!(
        image.at(image.head.sequence).unwrap().digital_commanded,
        0,
        "no command after the end"
    );
    assert!(matches!(
        fixture.ask(|ticket| EngineRequest::Unload { ticket, id }),
        Answer::Done { .. }
    ));
    assert_eq!(refused(fixture.start(id)), Refusal::UnknownCommand);
}

#[test]
fn the_table_and_the_events_name_the_outcome_that_ended_a_net() {
    // Two conditions of one `Termination`; the first true one in the order of the plan is the outcome.
    for (first, second, wanted) in [(1, 0, 1), (0, 1, 2), (1, 1, 1), (2, 1, 2)] {
        let mut plan = TestPlan::new();
        let (first, second) = (plan.bool(first), plan.bool(second));
        plan.add("Termination", &[first, second]);
        let mut fixture = EngineFixture::new();
        let id = fixture.load(plan.data);
        assert_eq!(fixture.entry(id).outcome, 0);
        fixture.start(id);
        assert_eq!(fixture.until_terminated(id, 2), EndReason::Finished);
        let entry = fixture.entry(id);
        assert_eq!((entry.outcome, entry.cycles), (wanted, 1));
        let events = std::iter::from_fn(|| fixture.ends.events.pop().ok());
        let told = events.filter_map(|event| match event {
            EngineEvent::Command { state, outcome, .. } => Some((state, outcome)),
            _ => None,
        });
        let terminated = CommandState::Terminated as u32;
        assert_eq!(told.last(), Some((terminated, wanted)));
    }
    // A net that is aborted or ends by a fault has no outcome.
    let mut fixture = EngineFixture::new();
    let id = fixture.load(output_net(1));
    fixture.start(id);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id });
    assert_eq!(fixture.until_terminated(id, 2), EndReason::Aborted);
    assert_eq!(fixture.entry(id).outcome, 0);
}

#[test]
fn a_plan_has_one_to_32_conditions_of_its_termination() {
    let fixture = EngineFixture::new();
    for (count, good) in [(1, true), (32, true), (33, false)] {
        let mut plan = TestPlan::new();
        let no = plan.bool(0);
        plan.add("Termination", &vec![no; count]);
        let built = fixture.build(plan.data);
        assert_eq!(built.is_ok(), good, "{count}");
    }
}

#[test]
fn operations_in_the_wrong_state_are_refused_and_change_nothing() {
    let mut fixture = EngineFixture::new();
    let Answer::Reserved { id } = fixture.ask(|ticket| EngineRequest::Reserve { ticket }) else {
        panic!()
    };
    let loading = Refusal::WrongState {
        state: CommandState::Loading as u32,
    };
    assert_eq!(refused(fixture.start(id)), loading);
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Cancel { ticket, id })),
        loading
    );
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Abort { ticket, id })),
        loading
    );
    assert!(matches!(
        fixture.ask(|ticket| EngineRequest::Reject { ticket, id }),
        Answer::Done { .. }
    ));
    assert_eq!(fixture.state(id), CommandState::Rejected);
    let net = fixture.build(output_net(0)).unwrap();
    let rejected = Refusal::WrongState {
        state: CommandState::Rejected as u32,
    };
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Install { ticket, id, net })),
        rejected
    );
    let id = fixture.load(output_net(0));
    let ready = Refusal::WrongState {
        state: CommandState::Ready as u32,
    };
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Cancel { ticket, id })),
        ready
    );
    fixture.start(id);
    let running = Refusal::WrongState {
        state: CommandState::Running as u32,
    };
    assert_eq!(refused(fixture.start(id)), running);
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Unload { ticket, id })),
        running
    );
    assert_eq!(fixture.state(id), CommandState::Running);
    for id in [0, 999] {
        assert_eq!(refused(fixture.start(id)), Refusal::UnknownCommand);
    }
}

#[test]
fn a_net_without_cancel_can_only_be_aborted() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(endless_net(0));
    fixture.start(id);
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Cancel { ticket, id })),
        Refusal::NotCancelable
    );
    assert_eq!(fixture.state(id), CommandState::Running);
    assert!(matches!(
        fixture.ask(|ticket| EngineRequest::Abort { ticket, id }),
        Answer::Done { .. }
    ));
    assert_eq!(
        (fixture.state(id), fixture.reason(id)),
        (CommandState::Terminated, EndReason::Aborted)
    );
}

#[test]
fn a_busy_resource_names_its_holder_and_others_run_beside_it() {
    let mut fixture = EngineFixture::new();
    let (first, second, other) = (
        fixture.load(endless_net(2)),
        fixture.load(endless_net(2)),
        fixture.load(endless_net(3)),
    );
    fixture.start(first);
    let busy = Refusal::Busy {
        holder: first,
        resource: Resource::Digital {
            device: 0,
            channel: 2,
        },
    };
    assert_eq!(refused(fixture.start(second)), busy);
    assert_eq!(fixture.state(second), CommandState::Ready);
    assert!(matches!(fixture.start(other), Answer::Done { .. }));
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id: first });
    assert!(
        matches!(fixture.start(second), Answer::Done { .. }),
        "a free resource can be taken"
    );
    assert_eq!(fixture.engine.status().running, 2);
}

#[test]
fn reserving_a_row_of_a_full_table_is_refused() {
    let mut fixture = EngineFixture::new();
    for _ in 0..rcc_core::message::COMMANDS_MAX {
        assert!(matches!(
            fixture.ask(|ticket| EngineRequest::Reserve { ticket }),
            Answer::Reserved { .. }
        ));
    }
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Reserve { ticket })),
        Refusal::TableFull
    );
}

#[test]
fn in_a_full_table_the_oldest_rejected_command_gives_way() {
    let mut fixture = EngineFixture::new();
    let mut ids = Vec::new();
    for _ in 0..rcc_core::message::COMMANDS_MAX {
        let answer = fixture.ask(|ticket| EngineRequest::Reserve { ticket });
        let Answer::Reserved { id } = answer else {
            panic!("{answer:?}");
        };
        ids.push(id);
    }
    // The younger one is rejected first.
    for id in [ids[40], ids[7]] {
        let answer = fixture.ask(|ticket| EngineRequest::Reject { ticket, id });
        assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
    }
    for gone in [ids[7], ids[40]] {
        let answer = fixture.ask(|ticket| EngineRequest::Reserve { ticket });
        assert!(matches!(answer, Answer::Reserved { id } if !ids.contains(&id)));
        let tables = fixture.engine.tables();
        assert!(tables.commands.iter().all(|row| row.id != gone));
    }
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Reserve { ticket })),
        Refusal::TableFull,
        "commands that are being loaded stay"
    );
}

#[test]
fn a_motion_ends_when_its_arm_has_played_everything() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    fixture.start(id);
    assert_eq!(fixture.until_terminated(id, 5000), EndReason::Finished);
    let entry = fixture.entry(id);
    let after = fixture.engine.status().cycle - entry.ended_cycle;
    assert!(
        after > fixture.driver.delay,
        "terminated {after} cycles after the last set-point"
    );
    assert_eq!(fixture.driver.measurement.state, DeviceState::Ready as u32);
    let distances: Vec<f64> = fixture
        .records()
        .iter()
        .map(|record| record.values[0])
        .collect();
    assert_eq!(distances.len() as u64, entry.cycles, "one record a cycle");
    assert!((distances.last().unwrap() - 0.1).abs() < 1e-12);
    assert!(distances.windows(2).all(|pair| pair[0] <= pair[1]));
}

#[test]
fn cancel_stops_the_motion_on_its_path() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    fixture.start(id);
    fixture.steps(300);
    fixture.ask(|ticket| EngineRequest::Cancel { ticket, id });
    assert_eq!(fixture.state(id), CommandState::Canceling);
    let canceling = Refusal::WrongState {
        state: CommandState::Canceling as u32,
    };
    assert_eq!(
        refused(fixture.ask(|ticket| EngineRequest::Cancel { ticket, id })),
        canceling
    );
    assert_eq!(fixture.until_terminated(id, 2000), EndReason::Canceled);
    let last = fixture.records().last().unwrap().values[0];
    assert!(last > 0.01 && last < 0.09, "{last}");
}

#[test]
fn a_first_set_point_elsewhere_is_refused_writes_nothing_and_leaves_the_command_ready() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    fixture.driver.measurement.hold[3] += 0.01;
    let refusal = refused(fixture.start(id));
    let Refusal::FirstSetPoint {
        device: 0,
        joint: 4,
        value,
        limit,
        ..
    } = refusal
    else {
        panic!("{refusal:?}")
    };
    assert!((value + 0.01).abs() < 1e-9 && limit == 1e-3, "{refusal:?}");
    assert_eq!(fixture.state(id), CommandState::Ready);
    let entry = fixture.entry(id);
    assert_eq!((entry.cycles, entry.exec_max_ns), (0, 0), "no cycle counts");
    let image = fixture.engine.image(0).unwrap();
    assert!(image.set_points.iter().all(|point| point.has_position == 0));
    fixture.driver.measurement.hold = HOLD;
    assert!(
        matches!(fixture.start(id), Answer::Done { .. }),
        "the arena is restored"
    );
    assert_eq!(fixture.until_terminated(id, 5000), EndReason::Finished);
}

#[test]
fn start_is_refused_while_the_arm_does_not_rest_or_is_lost() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    for state in [
        DeviceState::Online,
        DeviceState::Stopping,
        DeviceState::Commanded,
        DeviceState::Offline,
    ] {
        fixture.driver.measurement.state = state as u32;
        fixture.driver.alive = false;
        fixture.driver.measurement.stamp_ns = fixture.now_ns;
        let refusal = refused(fixture.start(id));
        assert!(
            matches!(refusal, Refusal::DeviceNotReady { device: 0, state: s, .. } if s == state as u32),
            "{refusal:?}"
        );
        assert_eq!(fixture.state(id), CommandState::Ready);
    }
}

#[test]
fn a_motion_that_begins_elsewhere_by_its_parameter_is_refused() {
    let mut fixture = EngineFixture::new();
    let mut from = model().arm.unwrap().forward(&HOLD).to_slots();
    from[2] += 0.05;
    let id = fixture.load(motion_net(Some(from)));
    assert!(matches!(
        refused(fixture.start(id)),
        Refusal::FirstSetPoint { device: 0, .. }
    ));
}

#[test]
fn the_holder_of_an_arm_is_shown_while_it_commands_it() {
    let mut fixture = EngineFixture::new();
    let holder = |fixture: &EngineFixture| fixture.engine.tables().devices[0].holder;
    let id = fixture.load(line_net());
    assert_eq!(holder(&fixture), 0, "a net that is ready commands nothing");
    fixture.start(id);
    fixture.steps(10);
    assert_eq!(holder(&fixture), id);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id });
    fixture.steps(2);
    assert_eq!(holder(&fixture), 0);
}

#[test]
fn abort_frees_the_arm_at_once_but_start_waits_for_rest() {
    let mut fixture = EngineFixture::new();
    let (first, second) = (fixture.load(line_net()), fixture.load(line_net()));
    fixture.start(first);
    fixture.steps(200);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id: first });
    assert_eq!(fixture.reason(first), EndReason::Aborted);
    assert!(matches!(
        refused(fixture.start(second)),
        Refusal::DeviceNotReady { .. }
    ));
}

#[test]
fn too_many_late_cycles_in_a_row_end_the_most_expensive_net() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(endless_net(0));
    fixture.start(id);
    fixture.engine.account(0, 1000, 1);
    fixture.step();
    assert_eq!(
        fixture.state(id),
        CommandState::Running,
        "the row was interrupted"
    );
    (0..3).for_each(|_| fixture.engine.account(1000, 2_000_000, 2));
    assert_eq!(fixture.reason(id), EndReason::Fault);
    assert_eq!(fixture.entry(id).fault.code, FaultCode::Overrun as u32);
    let status = fixture.engine.status();
    assert_eq!((status.late, status.skipped_periods), (4, 7));
    assert!(
        status.first_late.cycle > 0 && status.last_late.cycle > status.first_late.cycle,
        "latched"
    );
}

#[test]
fn a_stop_cancels_what_can_be_canceled_aborts_the_rest_and_starts_nothing() {
    let mut fixture = EngineFixture::new();
    let (motion, output, idle) = (
        fixture.load(line_net()),
        fixture.load(endless_net(0)),
        fixture.load(endless_net(1)),
    );
    fixture.start(motion);
    fixture.start(output);
    fixture.steps(200);
    fixture.engine.begin_stop();
    assert_eq!(fixture.state(motion), CommandState::Canceling);
    assert_eq!(fixture.reason(output), EndReason::Aborted);
    assert_eq!(refused(fixture.start(idle)), Refusal::Stopping);
    assert_eq!(fixture.until_terminated(motion, 2000), EndReason::Canceled);
    fixture.step();
    assert!(fixture.engine.is_idle());
}

#[test]
fn every_truncated_or_altered_plan_is_refused_or_harmless() {
    // The check or the cycle copes with any plan: no panic, no access out of bounds.
    let fixture = EngineFixture::new();
    let good = line_net();
    for index in 0..good.operands.len() {
        for value in [0, 1, 6, 7, 40, 1000, u32::MAX] {
            let mut plan = good.clone();
            plan.operands[index] = value;
            if let Ok(mut net) = fixture.build(plan) {
                let input = rcc_core::frame::DeviceInput {
                    present: true,
                    measurement: fixture.driver.measurement,
                };
                for _ in 0..3 {
                    net.evaluate(&fixture.models, &[input], 1e-3);
                }
            }
        }
    }
    let mut plan = good.clone();
    plan.configuration = 6;
    assert_eq!(
        fixture.build(plan).unwrap_err(),
        Refusal::Plan(rcc_core::plan::PlanError::OtherConfiguration)
    );
    let mut plan = good.clone();
    plan.runs.pop();
    assert_eq!(
        fixture.build(plan).unwrap_err(),
        Refusal::Plan(rcc_core::plan::PlanError::Terminations { count: 0 })
    );
}
