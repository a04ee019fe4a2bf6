//! Limits on the work that a plan may request per cycle. In virtual time, on the test's thread.

use crate::common::{EngineFixture, TestPlan, endless_net};
use rcc_core::plan::{Delay, PlanError};
use rcc_core::types::Store;
use rcc_protocol::control::Refusal;

const WIDTH: u32 = 1 << 19;

#[test]
fn a_plan_whose_primitives_are_too_much_work_is_refused() {
    let fixture = EngineFixture::new();
    let mut plan = TestPlan::new();
    plan.data = endless_net(0);
    let wide = plan.reals(&vec![0.0; WIDTH as usize]);
    plan.add("Select", &[0, wide, wide, wide, WIDTH]);
    assert!(
        fixture.build(plan.data.clone()).is_ok(),
        "one of them is within the limit"
    );
    for _ in 0..64 {
        plan.add("Select", &[0, wide, wide, wide, WIDTH]);
    }
    let refused = fixture.build(plan.data).map(|_| ());
    assert_eq!(refused, Err(Refusal::Plan(PlanError::TooLarge)));
}

#[test]
fn a_plan_whose_delayed_links_are_too_much_work_is_refused() {
    let fixture = EngineFixture::new();
    let mut plan = TestPlan::new();
    plan.data = endless_net(0);
    let from = plan.reals(&vec![0.0; WIDTH as usize]);
    let delay = Delay {
        store: Store::Real,
        from,
        to: from,
        width: WIDTH,
    };
    plan.data.delays = vec![delay; 64];
    let refused = fixture.build(plan.data).map(|_| ());
    assert_eq!(refused, Err(Refusal::Plan(PlanError::TooLarge)));
}
