//! Two arms in one net: `configs/two-arms` in virtual time, every cycle checked with the arms' own kinematics.

use crate::harness::{NetHarness, cell, folder};
use rcc_config::CellConfig;
use rcc_core::pose::Pose;
use rcc_language::compile;

/// Start position of both arms of `configs/cells/two-arms.yaml`, rad.
const HOLD: [f64; 7] = [
    0.0,
    -0.523_598_775_598_298_8,
    0.0,
    core::f64::consts::FRAC_PI_2,
    0.0,
    -1.047_197_551_196_597_6,
    0.0,
];
/// Limit of a motion, cycles.
const CYCLES: u64 = 5000;

fn start(cell: &CellConfig) -> NetHarness {
    let path = folder("configs/two-arms/shared-load.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let net = compile(&text, "shared-load", cell).unwrap_or_else(|faults| panic!("{faults}"));
    assert!(net.warnings.diagnostics.is_empty(), "{}", net.warnings);
    NetHarness::new(net, cell, HOLD)
}

/// Returns the poses of the flanges in the world for the set-points; `None` if an arm is not commanded.
fn flanges(harness: &NetHarness, cell: &CellConfig) -> Option<[Pose; 2]> {
    let models = cell.models();
    let flange = |device: usize| {
        let output = &harness.outputs[device];
        let pose = models[device].arm.unwrap().forward(&output.position);
        output
            .has_position
            .then_some(models[device].base.compose(&pose))
    };
    Some([flange(0)?, flange(1)?])
}

/// Runs the net, canceled in this cycle, and returns the distance that the left flange covered, m.
fn carry(cancel: u64, cell: &CellConfig) -> f64 {
    let mut harness = start(cell);
    let mut first: Option<[Pose; 2]> = None;
    let mut way = 0.0;
    while !harness.terminated {
        assert!(harness.cycle < CYCLES, "it does not end");
        harness.cancel |= harness.cycle >= cancel;
        harness.step();
        let [left, right] =
            flanges(&harness, cell).expect("both arms are commanded in every cycle");
        let [left_first, right_first] = *first.get_or_insert([left, right]);
        let was = left_first.inverse().compose(&right_first);
        let is = left.inverse().compose(&right);
        let slipped = was.distance_to(&is);
        assert!(slipped < 1e-9, "{slipped} m in cycle {}", harness.cycle);
        let turned = was
            .rotation_vector_to(&is)
            .iter()
            .map(|angle| angle * angle)
            .sum::<f64>();
        assert!(turned.sqrt() < 1e-9, "{turned} in cycle {}", harness.cycle);
        way = left_first.distance_to(&left);
    }
    way
}

#[test]
fn both_hold_the_load_in_every_cycle_of_the_whole_line() {
    let cell = cell("configs/cells/two-arms.yaml");
    let way = carry(CYCLES, &cell);
    let up = 0.45 - 0.384;
    assert!(
        (way - (0.15_f64.powi(2) + up * up).sqrt()).abs() < 2e-3,
        "{way}"
    );
}

#[test]
fn both_hold_the_load_wherever_it_is_canceled() {
    let cell = cell("configs/cells/two-arms.yaml");
    let mut before = 0.0;
    for cancel in [0, 1, 40, 150, 300, 555, 700, 900] {
        let way = carry(cancel, &cell);
        assert!(way >= before, "{cancel}: {way}");
        before = way;
    }
    assert!(before > 0.05, "{before}");
}

#[test]
fn the_bases_of_the_arms_are_as_configured() {
    let cell = cell("configs/cells/two-arms.yaml");
    let mut harness = start(&cell);
    harness.step();
    let [left, right] = flanges(&harness, &cell).unwrap();
    // They face each other: their distance is that of the bases minus both reaches.
    let reach = left.position[0];
    let between = right.position[0] - left.position[0];
    assert!((between - (1.4 - 2.0 * reach)).abs() < 1e-9, "{between}");
    assert!((left.position[2] - right.position[2]).abs() < 1e-12);
}
