//! URDFs of supported arms, and unsupported ones with the joint that does not fit. Tests only.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use super::*;

fn data(name: &str) -> String {
    let path = format!(
        "{}/../../tests/data/kinematics/{name}",
        env!("CARGO_MANIFEST_DIR")
    );
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn the_golden_lwr_is_recognised() {
    let lwr = import(&data("lwr4plus.urdf"), None, None).unwrap();
    assert!(lwr.difference < 1e-14, "{}", lwr.difference);
    let Arm::Srs(arm) = lwr.arm else {
        panic!("{lwr:?}")
    };
    assert_eq!(arm.signs, [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0]);
    let text = yaml(&lwr, "lwr4plus.urdf");
    for line in [
        "  shoulder_height: 0.3105 m",
        "  upper_arm: 0.4 m",
        "  forearm: 0.39 m",
        "  wrist_to_flange: 0.078 m",
        "  j2: {position: [deg(-120), deg(120)]",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
}

#[test]
fn the_golden_kr6_is_recognised() {
    let kr6 = import(&data("kr6_r900_2.urdf"), None, None).unwrap();
    assert!(kr6.difference < 1e-14, "{}", kr6.difference);
    let text = yaml(&kr6, "kr6_r900_2.urdf");
    for line in [
        "  shoulder_height: 0.4 m",
        "  shoulder_offset: 0.025 m",
        "  lateral_offset: 0 m",
        "  upper_arm: 0.455 m",
        "  elbow_offset: -0.025 m",
        "  forearm: 0.42 m",
        "  wrist_to_flange: 0.09 m",
        "  signs: [-1, 1, 1, -1, 1, -1]",
        "  zeros: [deg(0), deg(90), deg(0), deg(0), deg(0), deg(0)]",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
}

/// A UR5e as its URDF gives it, without the parts that are not read.
const UR5E: &str = r#"<robot name="ur5e">
<link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/><link name="l6"/>
<joint name="shoulder_pan" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.1625"/>
<axis xyz="0 0 1"/><limit lower="-6.283185307179586" upper="6.283185307179586" velocity="3.141592653589793"/></joint>
<joint name="shoulder_lift" type="revolute"><parent link="l1"/><child link="l2"/><origin rpy="1.5707963267948966 0 0"/>
<axis xyz="0 0 1"/><limit lower="-6.283185307179586" upper="6.283185307179586" velocity="3.141592653589793"/></joint>
<joint name="elbow" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="-0.425 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3.141592653589793" upper="3.141592653589793" velocity="3.141592653589793"/></joint>
<joint name="wrist_1" type="revolute"><parent link="l3"/><child link="l4"/><origin xyz="-0.3922 0 0.1333"/>
<axis xyz="0 0 1"/><limit lower="-6.283185307179586" upper="6.283185307179586" velocity="3.141592653589793"/></joint>
<joint name="wrist_2" type="revolute"><parent link="l4"/><child link="l5"/><origin xyz="0 -0.0997 0" rpy="1.5707963267948966 0 0"/>
<axis xyz="0 0 1"/><limit lower="-6.283185307179586" upper="6.283185307179586" velocity="3.141592653589793"/></joint>
<joint name="wrist_3" type="revolute"><parent link="l5"/><child link="l6"/><origin xyz="0 0.0996 0" rpy="-1.5707963267948966 0 0"/>
<axis xyz="0 0 1"/><limit lower="-6.283185307179586" upper="6.283185307179586" velocity="3.141592653589793"/></joint>
</robot>"#;

#[test]
fn an_arm_without_closed_form_is_taken_by_its_axes_and_the_reason_is_told() {
    let ur5e = import(UR5E, None, None).unwrap();
    assert!(ur5e.difference < 1e-14, "{}", ur5e.difference);
    let reason = ur5e.not_closed.as_ref().unwrap().to_string();
    let said = "joint `wrist_3`: its axis misses the point where axes 4 and 5 meet by 99.7";
    assert!(reason.starts_with(said), "{reason}");
    let text = yaml(&ur5e, "ur5e.urdf");
    assert!(
        text.contains(&format!("no closed form fits: {reason}")),
        "{text}"
    );
    let read = rcc_config::RobotConfig::parse(&text, "ur5e.yaml").unwrap();
    let joints = [0.3, -1.2, 1.1, -0.7, 1.4, 0.2, 0.0, 0.0];
    let (theirs, ours) = (ur5e.arm.forward(&joints), read.arm.forward(&joints));
    assert!(theirs.distance_to(&ours) < 1e-11 && theirs.angle_to(&ours) < 1e-11);
    assert_eq!(read.joints.len(), 6);
}

#[test]
fn the_redundant_joint_of_seven_axes_moves_most_while_the_flange_stays() {
    // The elbow is off the line from shoulder to wrist.
    let bent = data("lwr4plus.urdf").replacen(
        "<child link=\"l4\"/><origin xyz=\"0 0 0\"",
        "<child link=\"l4\"/><origin xyz=\"0.05 0 0\"",
        1,
    );
    let arm = import(&bent, None, None).unwrap();
    let text = yaml(&arm, "bent.urdf");
    assert!(text.contains("  redundant_joint: 3\n"), "{text}");
    assert!(rcc_config::RobotConfig::parse(&text, "bent.yaml").is_ok());
}

/// Returns the error for a URDF in which a text was replaced, or the reason why it has no closed form.
fn refusal(file: &str, from: &str, to: &str) -> String {
    let text = data(file);
    assert!(text.contains(from), "{from}");
    match import(&text.replacen(from, to, 1), None, None) {
        Ok(imported) => {
            assert!(imported.difference < 1e-14, "{}", imported.difference);
            assert!(matches!(imported.arm, Arm::Serial(_)), "{imported:?}");
            imported.not_closed.unwrap().to_string()
        }
        Err(error) => error.to_string(),
    }
}

#[test]
fn a_joint_that_does_not_fit_is_named() {
    let cases = [
        // The elbow is off the line from shoulder to wrist.
        (
            "lwr4plus.urdf",
            "<child link=\"l4\"/><origin xyz=\"0 0 0\"",
            "<child link=\"l4\"/><origin xyz=\"0.05 0 0\"",
            "joint `j4`: its axis misses the base's z axis by 50.000000 mm",
        ),
        (
            "kr6_r900_2.urdf",
            "<child link=\"l3\"/><origin xyz=\"0.455 0 0\" rpy=\"0 0 0\"",
            "<child link=\"l3\"/><origin xyz=\"0.455 0 0\" rpy=\"0.1 0 0\"",
            "joint `j3`: its axis is [0.000000, 0.995004, 0.099833]",
        ),
        // A wrist with an offset.
        (
            "kr6_r900_2.urdf",
            "<origin xyz=\"0.09 0 0\"",
            "<origin xyz=\"0.09 0.02 0\"",
            "joint `j6`: its axis misses the point where axes 4 and 5 meet by 20.000000 mm",
        ),
        // A reversed range is not "no range".
        (
            "kr6_r900_2.urdf",
            "lower=\"-2.0943951023931953\" upper=\"2.0943951023931953\"",
            "lower=\"2.0943951023931953\" upper=\"-2.0943951023931953\"",
            "joint `j5`: its range goes from 2.0943951023931953 to -2.0943951023931953 rad",
        ),
        (
            "kr6_r900_2.urdf",
            "name=\"j4\" type=\"revolute\"",
            "name=\"j4\" type=\"prismatic\"",
            "joint `j4` is prismatic",
        ),
        (
            "kr6_r900_2.urdf",
            "rpy=\"0 1.5707963267948966 0\"",
            "rpy=\"0 1.5707963 0\"",
            "write them with all digits",
        ),
    ];
    for (file, from, to, said) in cases {
        let refusal = refusal(file, from, to);
        assert!(refusal.contains(said), "{refusal}");
    }
}

#[test]
fn a_robot_turned_mirrored_and_with_other_zeros_is_recognised() {
    // Another pose with all joints at 0, other directions, an arm offset from axis 1.
    let turned = data("kr6_r900_2.urdf")
        .replacen("xyz=\"0.025 0 0\"", "xyz=\"0.025 0.07 0\"", 1)
        .replacen(
            "<origin xyz=\"0 0 0.4\" rpy=\"0 0 0\"/>",
            "<origin xyz=\"0 0 0.4\" rpy=\"0 0 2.5\"/>",
            1,
        )
        .replacen("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 -1 0\"/>", 1)
        .replacen(
            "<origin xyz=\"0.42 0 0\" rpy=\"0 0 0\"/>",
            "<origin xyz=\"0.42 0 0\" rpy=\"0.3 0 0\"/>",
            1,
        );
    let arm = import(&turned, None, None).unwrap();
    assert!(arm.difference < 1e-14, "{}", arm.difference);
}

#[test]
fn no_property_of_a_joint_is_ignored() {
    let text = data("kr6_r900_2.urdf");
    let refused = |from: &str, to: &str| {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from}");
        import(&changed, None, None).unwrap_err().to_string()
    };
    let limit = "<limit";
    let mimic = refused(limit, "<mimic joint=\"j2\"/><limit");
    assert!(mimic.contains("follows `j2`"), "{mimic}");
    let infinite = text.find("upper=\"").unwrap() + "upper=\"".len();
    let close = infinite + text[infinite..].find('"').unwrap();
    let upper = &text[infinite..close];
    for number in ["inf", "nan"] {
        let message = refused(
            &format!("upper=\"{upper}\""),
            &format!("upper=\"{number}\""),
        );
        assert!(message.contains("invalid limits"), "{message}");
    }
    let soft = text.replacen(limit, "<safety_controller soft_lower_limit=\"-1\" soft_upper_limit=\"1.25\" k_velocity=\"1\"/><limit", 1);
    let arm = import(&soft, None, None).unwrap();
    assert_eq!(arm.chain.revolute_joints[0].range, Some([-1.0, 1.25]));
    let nothing = refused(
        limit,
        "<safety_controller soft_lower_limit=\"50\" soft_upper_limit=\"51\" k_velocity=\"1\"/><limit",
    );
    assert!(nothing.contains("do not overlap"), "{nothing}");
}

#[test]
fn ambiguous_and_unknown_links_are_named() {
    let text = data("kr6_r900_2.urdf");
    let refusal = import(&text, Some("nowhere"), None)
        .unwrap_err()
        .to_string();
    assert!(
        refusal.contains("link `nowhere` not found; available links: base, l1"),
        "{refusal}"
    );
    let refusal = import(&text, Some("flange"), Some("base"))
        .unwrap_err()
        .to_string();
    assert!(refusal.contains("no chain of joints leads"), "{refusal}");
    let five = import(&text, Some("l1"), None).unwrap();
    let reason = five.not_closed.unwrap().to_string();
    assert!(reason.contains("the chain has 5"), "{reason}");
    let refusal = import(&text, Some("l6"), None).unwrap_err().to_string();
    assert!(
        refusal.contains("the chain has 0 revolute joints"),
        "{refusal}"
    );
    let more = text.replacen("</robot>", "<link name=\"camera\"/><joint name=\"jc\" type=\"fixed\"><parent link=\"l6\"/><child link=\"camera\"/></joint></robot>", 1);
    assert!(import(&more, None, None).is_ok(), "flange is usual");
    let xacro = text.replacen("<link", "<xacro:arm prefix=\"left\"/><link", 1);
    let refusal = import(&xacro, None, None).unwrap_err().to_string();
    assert!(refusal.contains("expand it first"), "{refusal}");
    let refusal = import("<robot", None, None).unwrap_err().to_string();
    assert!(refusal.contains("invalid URDF"), "{refusal}");
}

#[test]
fn deep_long_and_crowded_texts_are_refused_with_a_reason() {
    let said = |text: &str| import(text, None, None).unwrap_err().to_string();
    // 600 kB, which took seconds when each element was compared with all open ones.
    let deep = said(&format!("<robot name=\"x\">{}", "<a>".repeat(200_000)));
    assert!(deep.contains("nested more than 32 deep"), "{deep}");
    let long = said(&" ".repeat(BYTES_MAX + 1));
    assert!(long.contains("at most 8388608 are allowed"), "{long}");
    let attributes: String = (0..50_000).map(|at| format!(" a{at}=\"\"")).collect();
    let crowded = said(&format!("<robot name=\"x\"{attributes}/>"));
    assert!(crowded.contains("more than 64 attributes"), "{crowded}");
    let entities =
        "<!DOCTYPE robot [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><robot name=\"&b;\"/>";
    assert!(
        said(entities).contains("invalid URDF"),
        "{}",
        said(entities)
    );
}

#[test]
fn a_robot_of_very_many_links_is_refused_with_a_short_message() {
    let mut text = String::from("<robot name=\"long\"><link name=\"l0\"/>");
    for at in 1..20_000 {
        let before = at - 1;
        text += &format!(
            "<link name=\"l{at}\"/><joint name=\"j{at}\" type=\"continuous\"><parent link=\"l{before}\"/><child link=\"l{at}\"/></joint>"
        );
    }
    let text = text + "</robot>";
    let refusal = import(&text, None, None).unwrap_err().to_string();
    assert!(refusal.contains("19999 revolute joints"), "{refusal}");
    assert!(refusal.len() < 500, "{refusal}");
    let refusal = import(&text, Some("nowhere"), None)
        .unwrap_err()
        .to_string();
    assert!(
        refusal.contains("and 19980 more") && refusal.len() < 500,
        "{refusal}"
    );
}

#[test]
fn missing_parts_of_a_urdf_are_reported_with_their_line() {
    let said = |joint: &str| {
        let text = format!("<robot name=\"x\">\n<link name=\"a\"/>\n{joint}</robot>");
        import(&text, None, None).unwrap_err().to_string()
    };
    for (joint, words) in [
        ("<joint name=\"j\"/>", "line 3: `joint` has no `type`"),
        (
            "<joint name=\"j\" type=\"bent\"/>",
            "line 3: type=\"bent\" is not a joint type",
        ),
        (
            "<joint name=\"j\" type=\"fixed\"/>",
            "line 3: `joint` has no `parent`",
        ),
        (
            "<joint name=\"j\" type=\"fixed\"><parent link=\"a\"/><child/></joint>",
            "line 3: `child` has no `link`",
        ),
        (
            "<joint name=\"j\" type=\"fixed\"><parent link=\"a\"/><child link=\"b\"/><origin xyz=\"0 0\"/></joint>",
            "line 3: xyz=\"0 0\" is not three numbers",
        ),
        ("<link/>", "line 3: `link` has no `name`"),
    ] {
        let said = said(joint);
        assert!(said.contains(words), "{said}");
    }
    let other = import("<sdf/>", None, None).unwrap_err().to_string();
    assert!(other.contains("the root element is `sdf`"), "{other}");
}

#[test]
fn limits_that_urdf_1_2_leaves_unlimited_are_those_of_no_limits() {
    let text = data("kr6_r900_2.urdf");
    let bounds = "lower=\"-6.1086523819801535\" upper=\"6.1086523819801535\" velocity=\"3\"";
    let joint = "name=\"j6\" type=\"revolute\"";
    assert!(text.contains(bounds) && text.contains(joint));
    for version in ["1.0", "1.2"] {
        let name = format!("<robot version=\"{version}\" name=");
        let text = text.replacen("<robot name=", &name, 1);
        // A continuous joint has a speed, and no range; bounds that are written are ignored.
        for limit in ["velocity=\"3\"", bounds] {
            let continuous = text.replacen(bounds, limit, 1).replacen(
                joint,
                "name=\"j6\" type=\"continuous\"",
                1,
            );
            let arm = import(&continuous, None, None).unwrap();
            let last = &arm.chain.revolute_joints[5];
            assert_eq!((last.range, last.velocity), (None, Some(3.0)), "{version}");
        }
        // No speed, or an unlimited one: one is assumed, and the text says so.
        for speed in ["", " velocity=\"inf\""] {
            let slow = text.replacen(bounds, &bounds.replace(" velocity=\"3\"", speed), 1);
            let arm = import(&slow, None, None).unwrap();
            assert_eq!(arm.chain.revolute_joints[5].velocity, None, "{version}");
            let text = yaml(&arm, "kr6.urdf");
            assert!(text.contains("no speed in the URDF: assumed"), "{text}");
        }
    }
    // A revolute joint without bounds is unlimited in 1.2: it is a continuous one.
    let text = text.replacen("<robot name=", "<robot version=\"1.2\" name=", 1);
    let unlimited = text.replacen(bounds, "velocity=\"3\"", 1);
    let refusal = import(&unlimited, None, None).unwrap_err().to_string();
    assert!(refusal.contains("is `continuous`"), "{refusal}");
}

#[test]
fn a_quaternion_replaces_angles_from_version_1_1_on() {
    let text = data("kr6_r900_2.urdf");
    let name = "<robot name=";
    let with = |version: &str| {
        let text = text.replacen(name, &format!("<robot version=\"{version}\" name="), 1);
        let at = "rpy=\"0 1.5707963267948966 0\"";
        assert!(text.contains(at));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        text.replacen(at, &format!("quat_xyzw=\"0 {half} 0 {half}\""), 1)
    };
    assert!(import(&with("1.1"), None, None).unwrap().difference < 1e-14);
    let without = import(&with("1.0"), None, None).unwrap();
    assert!(without.not_closed.is_some(), "it is not known there");
}
