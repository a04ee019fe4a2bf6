//! Checks at the installation of rules, and the bounds of their table.

use rcc_core::plan::Resource;
use rcc_protocol::rules::{RULE_TERMS_MAX, RULES_MAX, RULES_PER_CYCLE, RuleFault};

use super::*;

fn fault(index: u32, fault: RuleFault) -> Answer {
    Answer::Refused(Refusal::Rule { index, fault })
}

#[test]
fn a_rule_that_is_wrong_is_refused_with_the_reason_and_no_other_is_installed() {
    let mut fixture = EngineFixture::new();
    let [arm, rival, lamp, endless, over_now] = [
        drift_net(HOLD[0], 0.0),
        drift_net(HOLD[0], 0.0),
        output_net(1),
        endless_net(2),
        ends_after(1, 3),
    ]
    .map(|plan| fixture.load(plan));
    cycle_of(fixture.start(over_now));
    fixture.steps(10);
    let yes = [RuleTerm::True];
    let good = rule(&yes, &[], &[], &[lamp]);
    let state = |index, command: u64, state: CommandState| Answer::RefusedFor {
        id: command,
        refusal: Refusal::RuleCommand {
            index,
            state: state as u32,
        },
    };
    let arms = Resource::Arm { device: 0 };
    let value = RuleTerm::Value {
        command: lamp,
        slot: 1000,
    };
    let cases = [
        (rule(&yes, &[], &[], &[]), fault(1, RuleFault::DoesNothing)),
        (
            rule(&yes, &[lamp], &[], &[lamp]),
            fault(1, RuleFault::NamedTwice),
        ),
        (
            rule(&yes, &[], &[], &[999]),
            state(1, 999, CommandState::None),
        ),
        (
            rule(&yes, &[999], &[], &[]),
            state(1, 999, CommandState::None),
        ),
        (
            rule(&[outcome(999, 1)], &[], &[], &[lamp]),
            state(1, 999, CommandState::None),
        ),
        (
            rule(&yes, &[], &[], &[over_now]),
            state(1, over_now, CommandState::Terminated),
        ),
        (
            rule(&yes, &[], &[endless], &[]),
            Answer::RefusedFor {
                id: endless,
                refusal: Refusal::NotCancelable,
            },
        ),
        (
            rule(&yes, &[], &[], &[arm, rival]),
            Answer::RefusedFor {
                id: rival,
                refusal: Refusal::Busy {
                    holder: arm,
                    resource: arms,
                },
            },
        ),
        (
            rule(&[value], &[], &[], &[lamp]),
            Answer::RefusedFor {
                id: lamp,
                refusal: Refusal::Rule {
                    index: 1,
                    fault: RuleFault::NoSuchValue,
                },
            },
        ),
        (
            rule(&[RuleTerm::And], &[], &[], &[lamp]),
            fault(1, RuleFault::Condition),
        ),
        (rule(&[], &[], &[], &[lamp]), fault(1, RuleFault::Condition)),
        (
            rule(&[outcome(over_now, 1)], &[], &[], &[lamp]),
            fault(1, RuleFault::NeverFires),
        ),
        (
            rule(&[RuleTerm::True, RuleTerm::Not], &[], &[], &[lamp]),
            fault(1, RuleFault::NeverFires),
        ),
        (
            Rule {
                goes_on: false,
                ..rule(&yes, &[], &[], &[arm])
            },
            fault(1, RuleFault::NoLease),
        ),
        (
            Rule {
                lease: 77,
                ..rule(&yes, &[], &[], &[lamp])
            },
            fault(1, RuleFault::LeaseUnknown),
        ),
    ];
    for (wrong, answer) in cases {
        assert_eq!(try_install(&mut fixture, &[good, wrong]), answer);
        assert_eq!(fixture.state(lamp), CommandState::Ready);
    }
    assert!(listed(&mut fixture).is_empty());
    install(&mut fixture, &[good]);
    assert_eq!(fixture.state(lamp), CommandState::Running);
}

#[test]
fn the_table_is_bounded_and_ended_rules_make_room() {
    let mut fixture = EngineFixture::new();
    let [timer, lamp] = [ends_after(5000, 1), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(timer));
    let never = rule(&[outcome(timer, 1)], &[], &[lamp], &[]);
    for _ in 0..RULES_MAX / 16 {
        install(&mut fixture, &[never; 16]);
    }
    let max = RULES_MAX as u32;
    let full = fault(0, RuleFault::TableFull { max });
    assert_eq!(try_install(&mut fixture, &[never]), full);
    assert_eq!(listed(&mut fixture).len(), RULES_MAX);
    cycle_of(fixture.ask(|ticket| EngineRequest::RemoveRule { ticket, id: 5 }));
    let (id, _) = install(&mut fixture, &[never]);
    assert_eq!(id, RULES_MAX as u64 + 1);
    let again = fixture.ask(|ticket| EngineRequest::RemoveRule { ticket, id: 5 });
    assert_eq!(again, Answer::Refused(Refusal::UnknownRule));
    // When the timer has ended, none of them can fire any more.
    fixture.until_terminated(timer, 6000);
    fixture.step();
    let states = listed(&mut fixture);
    assert!(states.iter().all(|rule| rule.state == RuleState::Expired));
    install(&mut fixture, &[rule(&[RuleTerm::True], &[], &[], &[lamp])]);
    assert_eq!(fixture.state(lamp), CommandState::Running);
    assert_eq!(listed(&mut fixture).len(), RULES_MAX);
}

#[test]
fn at_most_a_fixed_number_of_rules_fires_in_a_cycle_and_the_others_follow() {
    let mut fixture = EngineFixture::new();
    let count = RULES_PER_CYCLE + 3;
    let lamps: Vec<u64> = (0..count)
        .map(|_| fixture.load(ends_after(1000, 1)))
        .collect();
    // Each takes the place of the one before it: the same output, in the same cycle, is refused otherwise.
    let rules: Vec<Rule> = lamps
        .iter()
        .map(|lamp| rule(&[RuleTerm::True], &[], &[], &[*lamp]))
        .collect();
    let (first, cycle) = install(&mut fixture, &rules);
    fixture.step();
    let ended = listed(&mut fixture);
    let cycles: Vec<u64> = ended.iter().map(|rule| rule.cycle - cycle).collect();
    assert_eq!(ended[0].id, first);
    assert_eq!(ended[0].state, RuleState::Fired);
    assert!(
        ended[1..]
            .iter()
            .all(|rule| rule.state == RuleState::Refused)
    );
    let expected: Vec<u64> = (0..count as u64)
        .map(|index| index / RULES_PER_CYCLE as u64)
        .collect();
    assert_eq!(cycles, expected);
}

#[test]
fn the_longest_condition_is_judged_to_its_end() {
    let mut fixture = EngineFixture::new();
    let [timer, lamp] = [ends_after(20, 1), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(timer));
    let mut terms = vec![outcome(timer, 2)];
    while terms.len() < RULE_TERMS_MAX - 1 {
        terms.push(RuleTerm::Not);
    }
    terms.push(RuleTerm::Not);
    // An odd number of negations: it holds for every other outcome, and the timer never has one.
    assert_eq!(terms.len(), RULE_TERMS_MAX);
    let (id, _) = install(&mut fixture, &[rule(&terms, &[], &[], &[lamp])]);
    fixture.until_terminated(timer, 40);
    fixture.step();
    assert_eq!(status(&mut fixture, id).state, RuleState::Expired);
}
