//! Exchanges that a device skips, in virtual time.
//! Test code only.

use super::fixture::{DELAY, MS, SessionFixture, usual};
use super::*;

#[test]
fn a_stall_over_the_end_of_a_net_drops_none_of_its_last_set_points() {
    for stall in 1..=DELAY + 5 {
        let mut fixture = SessionFixture::new();
        fixture.run(1, &usual());
        // The net has ended; the device goes on without an exchange, and says so in the next one.
        for _ in 1..stall {
            fixture.now_ns += MS;
            fixture.write(SetPoint::NONE);
            fixture.observe();
        }
        fixture.device.ticks = stall;
        fixture.idle(1);
        fixture.device.ticks = 1;
        fixture.idle(2 * DELAY);
        assert_eq!(
            (fixture.session.reason(), fixture.last()),
            (0, 0.2),
            "{stall} ms"
        );
    }
}
