//! Legs of every kind, and what is refused in them.

use super::*;
use rcc_core::path::leg_row::leg;
use rcc_core::path::{ArcOrientation, PathSegment, RelativeTo};
use rcc_core::types::Type;

fn literal(text: &str) -> (Literal, Vec<&'static str>) {
    let root = rcc_config::yaml::parse(&format!("x: {text}\n")).unwrap();
    let mut diagnostics = Vec::new();
    let literal = super::super::read(root.get("x").unwrap(), &mut diagnostics);
    let codes = diagnostics
        .iter()
        .map(|diagnostic| diagnostic.code)
        .collect();
    (literal, codes)
}

fn rows(text: &str) -> Vec<LegRow> {
    let (literal, diagnostics) = literal(text);
    assert_eq!(diagnostics, Vec::<&str>::new(), "{text}");
    let LiteralShape::List(rows) = &literal.shape else {
        panic!("{literal}")
    };
    let ty = Type::Matrix(rows.len() as u8, WIDTH as u8);
    let stored = literal.stored(ty).unwrap_or_else(|| panic!("{text}"));
    let values: Vec<f64> = stored.words().iter().copied().map(f64::from_bits).collect();
    let (rows, rest) = values.as_chunks::<WIDTH>();
    assert!(rest.is_empty());
    rows.to_vec()
}

const GOAL: &str = "xyz: [0.4, 0, 300 mm], rpy: [0, deg(180), 0]";

#[test]
fn legs_of_every_kind_become_rows() {
    let text = format!(
        "[{{ptp: {{joints: [deg(90), 0]}}, scale: 0.5}}, {{ptp: {{{GOAL}, branch: 3}}}}, \
         {{lin: {{{GOAL}}}, blend: 20 mm, velocity: 0.2 m/s, relative: tool}}, \
         {{circ: {{via: {{xyz: [0, 0, 1]}}, to: {{{GOAL}}}, orientation: path, angle: 1.5}}}}, \
         {{spline: [{{{GOAL}}}, {{{GOAL}}}], jerk: 3}}]"
    );
    let rows = rows(&text);
    assert_eq!(rows.len(), 6);
    let legs: Vec<_> = rows.iter().map(|row| leg(row, &[])).collect();
    let [
        Some(ptp),
        Some(pose),
        Some(lin),
        Some(circ),
        None,
        Some(spline),
    ] = legs.as_slice()
    else {
        panic!("{legs:?}")
    };
    assert!(
        matches!(ptp.segment, PathSegment::Joints { to: [a, b, c, ..] } if a > 1.57 && b == 0.0 && c.is_nan())
    );
    assert_eq!((ptp.scale, ptp.blend), (0.5, 0.0));
    assert!(matches!(
        pose.segment,
        PathSegment::JointsToPose {
            branch: Some(3),
            turn: None,
            ..
        }
    ));
    assert!(matches!(lin.segment, PathSegment::Line { to } if to.position == [0.4, 0.0, 0.3]));
    assert_eq!((lin.blend, lin.line.velocity), (0.02, 0.2));
    assert!(lin.line.jerk.is_infinite() && lin.relative == Some(RelativeTo::Tool));
    assert!(matches!(
        circ.segment,
        PathSegment::Circle {
            via: [0.0, 0.0, 1.0],
            orientation: ArcOrientation::Path,
            angle: Some(1.5),
            ..
        }
    ));
    assert_eq!(spline.line.jerk, 3.0);
}

#[test]
fn a_ptp_takes_its_pose_as_a_joint_motion_does() {
    let flat = rows(&format!("[{{ptp: {{{GOAL}, status: 2, turn: 5}}}}]"));
    let named = rows(&format!(
        "[{{ptp: {{pose: {{{GOAL}}}, status: 2, turn: 5}}}}]"
    ));
    let bits = |rows: &[LegRow]| {
        rows.iter()
            .flatten()
            .map(|x| x.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&flat), bits(&named));
    let both = format!("[{{ptp: {{pose: {{{GOAL}}}, {GOAL}}}}}]");
    assert_eq!(literal(&both).1, vec![codes::UNKNOWN_KEY; 2]);
}

#[test]
fn a_list_of_poses_becomes_rows_and_is_written_as_it_was() {
    let text = format!("[{{{GOAL}}}, {{{GOAL}}}]");
    let (literal, diagnostics) = literal(&text);
    assert!(diagnostics.is_empty());
    assert!(literal.stored(Type::Matrix(2, 7)).is_some());
    let written = crate::write::constant(&literal);
    assert!(
        written.contains("300 mm") && written.contains("deg(180)"),
        "{written}"
    );
}

#[test]
fn malformed_legs_are_refused_with_their_codes() {
    for (text, code) in [
        ("[{lin: {xyz: [0, 0, 0]}}]", codes::WRONG_SHAPE),
        ("[{lin: 3}]", codes::WRONG_SHAPE),
        (
            &format!("[{{lin: {{{GOAL}}}}}, {{line: {{{GOAL}}}}}]"),
            codes::WRONG_SHAPE,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, blend: 20 N}}, {{lin: {{{GOAL}}}}}]"),
            codes::UNIT_MISMATCH,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, blend: -1 mm}}, {{lin: {{{GOAL}}}}}]"),
            codes::OUT_OF_RANGE,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, velocity: 0}}]"),
            codes::OUT_OF_RANGE,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, scale: 2}}]"),
            codes::OUT_OF_RANGE,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, speed: 2}}]"),
            codes::UNKNOWN_KEY,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, relative: world}}]"),
            codes::WRONG_SHAPE,
        ),
        (
            &format!("[{{circ: {{to: {{{GOAL}}}}}}}]"),
            codes::WRONG_SHAPE,
        ),
        ("[{ptp: {joints: 3}}]", codes::WRONG_SHAPE),
        ("[{ptp: {joints: [0]}, velocity: 1}]", codes::UNKNOWN_KEY),
        (
            "[{ptp: {joints: [0]}, relative: base}]",
            codes::CONTRADICTION,
        ),
        (
            &format!("[{{ptp: {{{GOAL}, branch: 2, status: 6}}}}]"),
            codes::CONTRADICTION,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, arm_angle: 1, elbow: middle}}]"),
            codes::CONTRADICTION,
        ),
        (
            &format!("[{{circ: {{via: {{xyz: [0, 0, 1], rpy: [0, 0, 0]}}, to: {{{GOAL}}}}}}}]"),
            codes::UNKNOWN_KEY,
        ),
        (
            &format!("[{{lin: {{{GOAL}}}, blend: 20 mm}}]"),
            codes::CONTRADICTION,
        ),
        ("[{spline: []}]", codes::WRONG_SHAPE),
        (
            &format!("[{{ptp: {{{GOAL}, branch: 9}}}}]"),
            codes::WRONG_SHAPE,
        ),
    ] {
        assert_eq!(literal(text).1, vec![code], "{text}");
    }
}
