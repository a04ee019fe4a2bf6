//! Tests of devices: parameters, names, and that the files are configurations of RCC.

use super::*;
use rcc_config::CellConfig;

fn parameters(rows: &[(&str, &str)]) -> BTreeMap<String, String> {
    let rows = rows.iter();
    rows.map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
        .collect()
}

fn spec(name: &str, ty: &str, rows: &[(&str, &str)]) -> DeviceSpec {
    DeviceSpec::read(name, ty, &parameters(rows))
        .expect("a device")
        .0
}

#[test]
fn an_arm_has_the_limits_that_the_library_gives() {
    let lwr = spec(
        "lwr",
        "kuka_lwr_sim",
        &[
            ("home_joint", "[0.0, -0.5,0,1.57,0, -1.05, 0]"),
            ("max_vel", "[1,1,1,1,1,1,2.5]"),
            ("link_lengths", "[0.11,0.2005,0.2,0.2,0.2,0.19,0.078,0]"),
        ],
    );
    let DeviceKind::Arm(arm) = lwr.kind else {
        panic!("an arm")
    };
    assert_eq!(arm.joints[1].home, -0.5);
    assert_eq!(arm.joints[6].velocity, 2.5);
    let ArmGeometry::Srs { lengths, .. } = arm.geometry else {
        panic!("seven joints")
    };
    assert!(
        (lengths[0] - 0.3105).abs() < 1e-12 && (lengths[2] - 0.39).abs() < 1e-12,
        "{lengths:?}"
    );
}

#[test]
fn faulty_parameters_are_refused_with_their_names() {
    for (ty, rows, word) in [
        ("kuka_lwr_sim", &[("max_vel", "[1,2]")][..], "max_vel"),
        ("kuka_lwr_sim", &[("max_vel", "[1,1,1,1,1,1,0]")], "max_vel"),
        (
            "kuka_lwr_sim",
            &[("home_joint", "[9,0,0,0,0,0,0]")],
            "home_joint",
        ),
        (
            "kuka_iiwa_sim",
            &[("link_lengths", "[0,0,0,0,0,0,0,0]")],
            "link_lengths",
        ),
        (
            "kuka_lwr_sim",
            &[("min_joint", "[nan,0,0,0,0,0,0]")],
            "min_joint",
        ),
        ("kuka_kr_arm_sim", &[], "dh_d"),
        ("io", &[("digin", "65")], "digin"),
        ("schunk_wsg_sim", &[], "schunk_wsg_sim"),
    ] {
        let refused = DeviceSpec::read("x", ty, &parameters(rows))
            .expect_err(ty)
            .to_string();
        assert!(refused.contains(word), "{refused}");
    }
    for name in ["", " a", "a,b", "a=b", "a'b", "\u{e4}", "a\nb"] {
        assert!(
            DeviceSpec::read(name, "io", &BTreeMap::new()).is_err(),
            "{name:?}"
        );
    }
    let (_, unknown) =
        DeviceSpec::read("io", "io", &parameters(&[("colour", "red")])).expect("a device");
    assert_eq!(unknown, ["colour"]);
}

#[test]
fn the_files_are_a_configuration_of_rcc() {
    let folder = std::env::temp_dir().join(format!("rcc-robotics-api-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let options = CellOptions {
        name: "robotics-api".to_owned(),
        period_ms: 2,
        delay_ms: 80,
    };
    let arm = spec("lwr", "kuka_lwr_sim", &[]);
    let io = spec("io 1", "io", &[]);
    let DeviceKind::Arm(lwr) = &arm.kind else {
        panic!("an arm")
    };
    let robot = folder.join("lwr.yaml");
    std::fs::write(&robot, robot_file("lwr", lwr, "", options.period_ms)).expect("a file");
    let text = cell_file(
        &options,
        &[
            ("lwr".to_owned(), &arm, Some(robot)),
            ("io_1".to_owned(), &io, None),
        ],
    );
    let ports = BTreeMap::from([("io_1".to_owned(), 1502)]);
    let cell = CellConfig::parse(&text, "cell.yaml", &folder, &ports);
    std::fs::remove_dir_all(&folder).expect("it was there");
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    assert_eq!(cell.devices.len(), 2);
    assert_eq!(cell.devices[1].channels.len(), 48);
}

#[test]
fn names_become_ids_that_differ() {
    assert_eq!(cell_name("lwr", &[]), "lwr");
    assert_eq!(cell_name("My Arm", &[]), "my_arm");
    assert_eq!(cell_name("0-arm", &["d0_arm"]), "d0_arm_2");
}

#[test]
fn what_is_reported_names_the_interfaces() {
    let lwr = spec("lwr", "kuka_lwr_sim", &[]).description().to_string();
    assert_eq!(
        lwr,
        r#"{type:"kuka_lwr_sim",interfaces:{robotarm:{jointcount:"7"},armkinematics:{}}}"#
    );
    let io = spec("io", "io", &[("anin", "0")]).description().to_string();
    assert_eq!(
        io,
        r#"{type:"io",interfaces:{io:{digin:"16",digout:"16",anin:"0",anout:"8"}}}"#
    );
}
