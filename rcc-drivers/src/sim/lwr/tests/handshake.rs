//! Handshakes between the PC and the KRL program, the strategy chosen at run time, and the program's variables.
//! Runs in the test harness.

use super::*;
use crate::sim::lwr::settings::EntryQuality;

/// A PC that writes integers into `$FRI_FRM_INT`, with the command flags of the controller's strategy.
impl Pc {
    fn write(&mut self, cycles: usize, integers: &[(usize, i32)]) {
        for _ in 0..cycles {
            let mut answer = self.mirror();
            answer.krl.integers = [0; 16];
            for (number, value) in integers {
                answer.krl.integers[number - 1] = *value;
            }
            self.answer(&answer);
        }
    }
}

fn with(script: KrlProgram) -> Pc {
    Pc::new(Settings {
        script,
        ..Settings::default()
    })
}

#[test]
fn each_convention_has_its_own_integers_for_start_and_stop() {
    type Integers = &'static [(usize, i32)];
    let rows: [(KrlProgram, Integers, Integers, Integers, &str); 3] = [
        (
            KrlProgram::FirstApp,
            &[(1, 7)],
            &[(1, 10)],
            &[(1, 2)],
            "INT[1] is 7, 1 or 10 asks",
        ),
        (
            KrlProgram::Stanford,
            &[(1, 10)],
            &[(16, 10)],
            &[(16, 20)],
            "INT[16] is 0, 10 asks",
        ),
        (
            KrlProgram::Centro,
            &[(1, 10)],
            &[(2, 1)],
            &[(2, 0)],
            "INT[2] is 0, 1 asks",
        ),
    ];
    for (script, idle, start, stop, words) in rows {
        let mut pc = with(script);
        pc.write(300, idle);
        assert_eq!(pc.state(), SessionState::Monitor);
        let waiting = pc.krc.monitor_reason.expect("a request").to_string();
        assert!(waiting.contains(words), "{waiting}");
        pc.write(2, start);
        assert_eq!(pc.state(), SessionState::Command, "{script:?}");
        pc.write(2, stop);
        assert_eq!(pc.state(), SessionState::Monitor, "{script:?}");
    }
}

#[test]
fn the_program_answers_with_the_integers_of_its_convention() {
    let mut stanford = with(KrlProgram::Stanford);
    stanford.write(1, &[]);
    assert_eq!(stanford.seen.krl.integers[15], 10);
    let mut centro = with(KrlProgram::Centro);
    centro.write(300, &[]);
    assert_eq!(centro.seen.krl.integers[1], 0);
    centro.write(2, &[(2, 1)]);
    assert_eq!(
        (centro.state(), centro.seen.krl.integers[1]),
        (SessionState::Command, 1)
    );
}

#[test]
fn the_pc_chooses_the_strategy_in_monitor_mode_only() {
    let rows = [
        (KrlProgram::FirstApp, 1, 2),
        (KrlProgram::Stanford, 16, 15),
        (KrlProgram::Centro, 2, 1),
    ];
    for (script, request, strategy) in rows {
        let (start, stop) = match script {
            KrlProgram::FirstApp => (10, 2),
            KrlProgram::Stanford => (10, 20),
            _ => (1, 0),
        };
        let mut pc = with(script);
        pc.write(300, &[(request, stop), (strategy, 30)]);
        assert_eq!(pc.seen.control as u16, 3, "{script:?}");
        pc.write(2, &[(request, start), (strategy, 30)]);
        assert_eq!(pc.state(), SessionState::Command);
        pc.write(5, &[(request, start), (strategy, 10)]);
        assert_eq!(
            (pc.state(), pc.seen.control as u16),
            (SessionState::Command, 3)
        );
        pc.write(5, &[(request, stop), (strategy, 10)]);
        assert_eq!(
            (pc.state(), pc.seen.control as u16),
            (SessionState::Monitor, 1)
        );
        assert_eq!(pc.krc.fault, None);
    }
}

#[test]
fn the_control_port_changes_the_strategy_in_monitor_mode_and_refuses_it_in_command_mode() {
    let mut pc = Pc::new(Settings::default());
    pc.execute(r#"{"strategy":"cartesian-impedance"}"#);
    assert_eq!(pc.krc.settings.strategy, ControlLaw::CartesianImpedance);
    let mut pc = Pc::commanding(Settings::default());
    let refused = pc
        .krc
        .execute(KrcCommand::Strategy(ControlLaw::JointImpedance));
    assert!(refused.is_err_and(|error| error.to_string().contains("monitor mode")));
    assert_eq!(pc.krc.settings.strategy, ControlLaw::Position);
}

#[test]
fn an_arm_that_has_yielded_stays_where_it_is_when_the_strategy_changes() {
    let mut pc = Pc::new(Settings {
        strategy: ControlLaw::JointImpedance,
        ..Settings::default()
    });
    pc.execute(r#"{"wrench":{"force":[0,20,0],"torque":[0,0,0]}}"#);
    pc.write(3000, &[]);
    let yielded = pc.krc.robot.arm.position;
    assert!((yielded[0] - pc.krc.robot.desired[0]).abs() > 1e-3);
    pc.execute(r#"{"strategy":"position"}"#);
    pc.write(500, &[]);
    assert_eq!(pc.krc.robot.desired, yielded);
    assert!((pc.krc.robot.arm.position[0] - yielded[0]).abs() < 1e-9);
}

#[test]
fn a_program_that_waits_for_perfect_does_not_start_at_ok() {
    let late = Settings {
        entry_quality: EntryQuality::Perfect,
        ..Settings::default()
    };
    let mut pc = Pc::new(late);
    for _ in 0..500 {
        let answer = pc.mirror();
        // An answer in the second half of its period is in time, but never PERFECT.
        assert_eq!(pc.krc.receive(&answer.encode(), 0.7e-3), Ok(()));
        pc.continue_through_stall(1);
    }
    assert_eq!(
        (pc.state(), pc.seen.quality),
        (SessionState::Monitor, Quality::Ok)
    );
    let waiting = pc.krc.monitor_reason.expect("the quality").to_string();
    assert!(waiting.contains("at least Perfect"), "{waiting}");
    pc.mirror_for(300);
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn integers_of_the_control_port_stay_until_the_program_writes_them() {
    let mut pc = Pc::commanding(Settings::default());
    for number in 1..=16 {
        let line = format!(
            r#"{{"set_int":{{"number":{number},"value":{}}}}}"#,
            100 + number
        );
        pc.execute(&line);
    }
    pc.mirror_for(2);
    let expected: [i32; 16] = std::array::from_fn(|i| 101 + i as i32);
    assert_eq!(pc.seen.krl.integers, expected);
    pc.execute(r#"{"estop":null}"#);
    pc.mirror_for(1);
    assert_eq!(pc.seen.krl.integers[1], 9, "the code of the fault");
    pc.execute(r#"{"quit":null}"#);
    pc.mirror_for(1);
    assert_eq!(pc.seen.krl.integers[0], -1);
    let refused = r#"{"set_int":{"number":0,"value":1}}"#;
    let refused = pc.krc.execute(serde_json::from_str(refused).unwrap());
    assert!(refused.is_err());
}
