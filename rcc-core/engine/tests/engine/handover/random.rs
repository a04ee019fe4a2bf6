//! Random hand-overs between nets of several types.

use rcc_testing::{Random, Rng};

use super::*;
use crate::common::start_of;

/// A random net of one of several types; some begin where the arm is, some do not.
fn any_net(fixture: &EngineFixture, random: &mut Rng) -> PlanData {
    let here = match fixture.told().has_position {
        1 => fixture.told().position[0],
        _ => fixture.driver.measurement.hold[0],
    };
    match random.below(8) {
        0 => line_net(),
        1 => drift_net(here + 0.01e-3, 0.01),
        2 => drift_net(here, -0.012),
        3 => drift_net(here + 0.1, 0.0),
        4 => drift_net(f64::NAN, 0.0),
        5 => slow(1, 1 + random.below(7) as u32, 0),
        6 => output_net(random.below(4) as u32),
        _ => endless_net(random.below(4) as u32),
    }
}

#[test]
fn set_points_keep_the_limits_of_the_arm_through_any_hand_over() {
    let mut all = 0;
    for seed in 1..=60 {
        let mut random = Rng::with_seed(seed);
        let mut fixture = EngineFixture::new();
        let mut ids: Vec<u64> = Vec::new();
        let (mut history, mut switched) = (Vec::new(), 0);
        for _ in 0..400 {
            let pick = |random: &mut Rng, ids: &[u64]| match ids.len() {
                0 => 1,
                len => ids[random.below(len)],
            };
            match random.below(10) {
                0..=2 if ids.len() < 20 => {
                    let plan = any_net(&fixture, &mut random);
                    ids.push(fixture.load(plan));
                }
                3 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(start_of(id));
                }
                4 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(|ticket| EngineRequest::Cancel { ticket, id });
                }
                5 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(|ticket| EngineRequest::Unload { ticket, id });
                }
                6..=8 => {
                    let active = |id: &&u64| {
                        let row = fixture.engine.command(**id);
                        row.is_some_and(|row| CommandState::from_number(row.state).is_active())
                    };
                    let stop: Vec<u64> = ids.iter().filter(active).take(3).copied().collect();
                    let start = [pick(&mut random, &ids)];
                    let (stop, start) = (named(&stop), named(&start));
                    let ticket = fixture.order(|ticket| EngineRequest::Handover {
                        ticket,
                        stop,
                        start,
                        lease: 0,
                    });
                    fixture.step();
                    history.push(fixture.told());
                    let answer = fixture.answer(ticket);
                    switched += u32::from(matches!(answer, Some(Answer::Done { .. })));
                }
                _ => {}
            }
            for _ in 0..random.below(30) {
                fixture.step();
                history.push(fixture.told());
            }
            fixture.records();
            while fixture.ends.replies.pop().is_ok() {}
            while fixture.ends.events.pop().is_ok() {}
            let rows = fixture.engine.tables().commands;
            ids.retain(|id| rows.iter().any(|row| row.id == *id));
        }
        all += switched;
        // Three set-points of one engagement in consecutive cycles give two velocities and an acceleration.
        for three in history.windows(3) {
            let one = |point: &rcc_core::message::SetPoint| {
                point.has_position == 1 && point.owner == three[0].owner
            };
            let gap = three[2].logical_ns - three[0].logical_ns != 2 * fixture.period_ns;
            if gap || !three.iter().all(one) {
                continue;
            }
            for joint in 0..7 {
                let [a, b, c] = [0, 1, 2].map(|index| three[index].position[joint]);
                let acceleration = (c - 2.0 * b + a) / 1e-6;
                assert!(
                    acceleration.abs() <= 20.1,
                    "seed {seed}: {acceleration} rad/s²"
                );
            }
        }
    }
    assert!(all > 600, "{all} hand-overs");
}
