//! An arm of Denavit and Hartenberg's rows as a URDF, from which `rcc-cli robot import` recognises the kind of arm and
//! proves it. Pure functions.

use std::fmt::Write as _;

use super::{DhTable, JointSpec};

/// Returns the URDF of six joints. Standard form: from one joint to the next Rot(z, q + t), Trans(z, d), Trans(x, a),
/// Rot(x, al).
#[must_use]
pub fn urdf(table: &DhTable, joints: &[JointSpec]) -> String {
    let mut text =
        String::from("<?xml version=\"1.0\"?>\n<robot name=\"arm\">\n  <link name=\"base\"/>\n");
    let columns = table.d.iter().zip(&table.a).zip(&table.t).zip(&table.al);
    // Fixed transform from the previous joint to the next one: x and z, m, and the rotation about x, rad.
    let (mut xyz, mut roll) = ([0.0, 0.0], 0.0);
    let mut parent = "base".to_owned();
    for (number, ((((d, a), t), al), joint)) in (1..).zip(columns.zip(joints)) {
        // Trans(z, d) Trans(x, a) Rot(x, al) of the row before, then Rot(z, t) of this one: two origins, because a URDF
        // has roll, pitch and yaw about fixed axes, of which this order is not one.
        let [x, z] = xyz;
        // Writing into a String cannot fail.
        let _ = write!(
            text,
            "  <link name=\"offset{number}\"/>\n  <joint name=\"fixed{number}\" type=\"fixed\">\n    <parent link=\"{parent}\"/>\n    \
             <child link=\"offset{number}\"/>\n    <origin xyz=\"{x:?} 0 {z:?}\" rpy=\"{roll:?} 0 0\"/>\n  </joint>\n  \
             <link name=\"link{number}\"/>\n  <joint name=\"A{number}\" type=\"revolute\">\n    <parent link=\"offset{number}\"/>\n    \
             <child link=\"link{number}\"/>\n    <origin xyz=\"0 0 0\" rpy=\"0 0 {t:?}\"/>\n    <axis xyz=\"0 0 1\"/>\n    \
             <limit lower=\"{:?}\" upper=\"{:?}\" velocity=\"{:?}\" effort=\"1\"/>\n  </joint>\n",
            joint.least, joint.greatest, joint.velocity,
        );
        parent = format!("link{number}");
        (xyz, roll) = ([*a, *d], *al);
    }
    let [x, z] = xyz;
    let _ = write!(
        text,
        "  <link name=\"flange\"/>\n  <joint name=\"to_flange\" type=\"fixed\">\n    <parent link=\"{parent}\"/>\n    \
         <child link=\"flange\"/>\n    <origin xyz=\"{x:?} 0 {z:?}\" rpy=\"{roll:?} 0 0\"/>\n  </joint>\n</robot>\n"
    );
    text
}
