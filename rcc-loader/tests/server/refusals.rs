//! The message of every refusal of the executor.

use rcc_config::CellConfig;
use rcc_core::path::Quantity;
use rcc_protocol::rehearsal::{LimitPeak, RehearsalEnd, RehearsalReport, SlowMotion};
use rcc_protocol::rules::RuleFault;

use super::*;

/// Returns names with which command 3 publishes a topic that command 8 subscribes to with another type.
fn names_with_topic(id: u64) -> Names {
    let (topic, primitive) = ("tool/force".to_owned(), "force".to_owned());
    match id {
        3 => Names {
            publishes: vec![TopicNames {
                primitive,
                topic,
                type_name: "Wrench".to_owned(),
                unit: None,
            }],
            ..Names::default()
        },
        _ => Names {
            inputs: vec![InputNames {
                primitive,
                type_name: "Real".to_owned(),
                unit: Some("N".to_owned()),
                at_least: Vec::new(),
                at_most: Vec::new(),
                expires_s: None,
                topic: Some(topic),
            }],
            ..Names::default()
        },
    }
}

/// Names nets by their ids, and knows nothing else beside the configuration.
fn plain_names(config: &CellConfig) -> NameResolver<'_> {
    NameResolver {
        disagreement: &|_| None,
        config,
        net: &|id| format!("net#{id}"),
        names: &|_| Names::default(),
        reason: &|_, _| String::new(),
        condition: &|_| None,
    }
}

#[test]
fn every_refusal_has_a_code_names_and_a_remedy() {
    let config = config();
    let names = NameResolver {
        names: &names_with_topic,
        reason: &|_, reason| format!("because {reason}"),
        ..plain_names(&config)
    };
    let device = |violation| Refusal::FirstSetPoint {
        device: 0,
        joint: 2,
        value: 0.2,
        limit: 0.002,
        violation,
    };
    let resource = Resource::Digital {
        device: 0,
        channel: 0,
    };
    let key = Topic::new("tool/force", "Wrench", "").key;
    let continuation = |violation| Refusal::Continuation {
        device: 0,
        joint: 2,
        value: 0.2,
        limit: 0.002,
        violation,
    };
    let rule = |fault| Refusal::Rule { index: 2, fault };
    let refusals = [
        Refusal::NotUnderstood,
        Refusal::SwitchTooLarge { max: 8 },
        Refusal::NamedTwice,
        Refusal::NeverTogether,
        Refusal::LetsGo { device: 0 },
        continuation(4),
        continuation(5),
        Refusal::TableFull,
        Refusal::UnknownCommand,
        Refusal::WrongState { state: 4 },
        Refusal::Busy {
            holder: 3,
            resource,
        },
        Refusal::NotCancelable,
        Refusal::DeviceNotReady {
            device: 0,
            state: 1,
            reason: 9,
        },
        device(5),
        device(2),
        Refusal::FirstCycle { code: 3 },
        Refusal::Plan(rcc_core::plan::PlanError::OtherConfiguration),
        Refusal::Prepare(PrepareFault::Motion {
            motion: 0,
            leg: 0,
            fault: MotionFault::AmbiguousRotation,
        }),
        Refusal::OtherTopic { other: 3, key },
        Refusal::Overloaded,
        Refusal::Stopping,
        Refusal::NoRecorder,
        Refusal::Withdrawn,
        Refusal::UnknownRule,
        Refusal::LeaseTime {
            min_ns: 1,
            max_ns: 2,
        },
        Refusal::LeasesFull { max: 4 },
        Refusal::LeaseEnded { lease: 3 },
        Refusal::RuleCommand { index: 0, state: 0 },
        Refusal::RuleCommand { index: 1, state: 6 },
        rule(RuleFault::TableFull { max: 128 }),
        rule(RuleFault::Condition),
        rule(RuleFault::NoSuchValue),
        rule(RuleFault::DoesNothing),
        rule(RuleFault::NamedTwice),
        rule(RuleFault::NeverFires),
        rule(RuleFault::NoLease),
        rule(RuleFault::LeaseUnknown),
        rule(RuleFault::Recording),
        rule(RuleFault::RecordsOnly),
    ];
    for refusal in refusals {
        let error = names.refusal(8, refusal);
        assert!(codes::TABLE.contains(&error.code), "{refusal:?}");
        assert!(
            !error.help.is_empty() && !error.message.is_empty(),
            "{refusal:?}"
        );
    }
    let fault = MotionFault::JointRange {
        fraction: 0.5,
        joint: 2,
        value: core::f64::consts::PI,
        limit: 2.0,
    };
    let (motion, leg) = (0, 1);
    let beyond = Refusal::Prepare(PrepareFault::Motion { motion, leg, fault });
    let told = names.refusal(8, beyond).message;
    let words = "motion 0, leg 2: J3 would be at 180.000° (3.141593 rad) at 50 %";
    assert!(told.contains(words), "{told}");
    let busy = names
        .refusal(
            8,
            Refusal::Busy {
                holder: 3,
                resource,
            },
        )
        .message;
    assert_eq!(busy, "net#8 needs lwr.torch, which net#3 holds");
    let resource = Resource::Topic { key };
    let twice = Refusal::Busy {
        holder: 3,
        resource,
    };
    assert_eq!(
        names.refusal(8, twice).message,
        "net#8 publishes topic tool/force, and so does net#3, which runs"
    );
    assert_eq!(
        names
            .refusal(8, Refusal::OtherTopic { other: 3, key })
            .message,
        "net#8 subscribes to tool/force as Real in N, and net#3 publishes tool/force as Wrench, which runs"
    );
    let first = names.refusal(8, device(5)).message;
    let joint = &config.devices[0].robot.as_ref().expect("an arm").joints[1].name;
    assert!(
        first.contains(&format!("lwr joint {joint}")) && first.contains("11.459°"),
        "{first}"
    );
}

#[test]
fn a_device_that_is_not_ready_is_told_with_its_state_reason_and_remedy() {
    let config = config();
    let condition = (DeviceState::Offline, "the device sends nothing".to_owned());
    let names = NameResolver {
        condition: &|_| Some(condition.clone()),
        ..plain_names(&config)
    };
    let rejected = names.refusal(8, Refusal::Prepare(PrepareFault::HoldUnknown { device: 0 }));
    assert_eq!(
        rejected.message,
        "net#8 is rejected: the position of lwr is not known: it is offline (the device sends nothing)"
    );
    let (device, state, reason) = (0, DeviceState::Offline as u32, 0);
    let refused = names.refusal(
        8,
        Refusal::DeviceNotReady {
            device,
            state,
            reason,
        },
    );
    assert_eq!(
        refused.message,
        "net#8 needs lwr, which is offline (the device sends nothing)"
    );
    for error in [rejected, refused] {
        let help = error.help;
        assert!(help.contains("`rcc-cli doctor device lwr`"), "{help}");
    }
}

#[test]
fn a_motion_that_its_given_velocity_makes_slow_is_told_with_the_place_and_the_remedy() {
    let config = config();
    let names = plain_names(&config);
    let rehearsed = RehearsalReport {
        time_s: 3.5,
        end: RehearsalEnd::Finished,
        evaluations: 3500,
        outcome: 0,
        peaks: [LimitPeak::NONE; 3],
        singularity: f64::NAN,
        shortened: 0,
        most_shortened: None,
        slowest: Some(SlowMotion {
            motion: 0,
            leg: 1,
            fraction: 0.253,
            quantity: Quantity::Joint(3),
            order: 2,
            takes_s: 3.4,
            possible_s: 1.98,
        }),
        uncommanded: 0,
        took_ns: 0,
    };
    let net = Names {
        motions: vec!["move".to_owned()],
        ..Names::default()
    };
    let words = names.rehearsal(&rehearsed, &net).words;
    let joint = &config.devices[0].robot.as_ref().expect("an arm").joints[3].name;
    let expected = format!(
        "`move` takes 3.40 s where its limits allow 1.98 s, because its velocity is given and the acceleration of {joint} at \
         25 % of leg 2 bounds all of it: `time_optimal: true` uses what every place allows, up to that velocity"
    );
    assert!(words.contains(&expected), "{words}");
}
