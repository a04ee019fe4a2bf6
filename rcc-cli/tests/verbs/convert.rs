//! `convert` as a user types it: converts a net of the predecessor into a file that `check` accepts. Needs no cell.

use crate::program::{self, repository};

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let (code, _, errors) = program::run(arguments);
    (code, errors)
}

#[test]
fn a_net_of_the_predecessor_becomes_a_file_that_is_valid() {
    let net = "tests/data/directionet/flat/lwr_lin-02-lwr-lin.net";
    let folder = rcc_testing::folder();
    let file = folder.path().join("lin.yaml");
    let path = file.to_str().expect("UTF-8");
    let (converted, checked) = (run(&["convert", net, "-o", path]), run(&["check", path]));
    let written = std::fs::read_to_string(&file);
    assert_eq!(converted.0, Some(0), "{}", converted.1);
    assert!(written.is_ok_and(|text| text.contains("JointPositionCommand")));
    assert_eq!(checked.0, Some(0), "{}", checked.1);
}

#[test]
fn the_option_o_says_what_it_wrote() {
    let folder = rcc_testing::folder();
    for (verb, net, name) in [
        (
            "convert",
            "tests/data/directionet/flat/lwr_lin-02-lwr-lin.net",
            "a.yaml",
        ),
        ("graph", "configs/nets/blink.yaml", "b.svg"),
        ("plot", "configs/nets/line.yaml", "c.svg"),
    ] {
        let file = folder.path().join(name);
        let (_, said, _) = program::run(&[verb, net, "-o", file.to_str().expect("UTF-8")]);
        let wrote = format!("wrote {}", file.display());
        assert!(said.starts_with(&wrote), "{verb}: {said}");
        assert!(file.is_file(), "{verb}");
    }
}

#[test]
fn parts_without_counterpart_are_refused_with_their_location() {
    let (code, text) = run(&["convert", "tests/nets/bad/RCC1601-no-counterpart.net"]);
    assert_eq!(code, Some(3), "{text}");
    assert!(
        text.contains("RCC1601") && text.contains("RCC1601-no-counterpart.net:"),
        "{text}"
    );
}

/// The predecessor's point-to-point motions have steps in acceleration, which the rehearsal refuses.
#[test]
fn smooth_brings_a_motion_of_the_predecessor_within_the_limits_of_jerk() {
    let net = "tests/data/directionet/flat/lwr_lin-01-lwr-ptp.net";
    let folder = rcc_testing::folder();
    let (rough, smooth) = (
        folder.path().join("rough.yaml"),
        folder.path().join("smooth.yaml"),
    );
    let (rough, smooth) = (
        rough.to_str().expect("UTF-8"),
        smooth.to_str().expect("UTF-8"),
    );
    let end = ["--end", "_2"];
    let converted = run(&[&["convert", net, "-o", rough][..], &end].concat());
    assert_eq!(converted.0, Some(0), "{}", converted.1);
    let converted = run(&[&["convert", net, "--smooth", "-o", smooth][..], &end].concat());
    assert_eq!(converted.0, Some(0), "{}", converted.1);
    let noted = "7 low-pass filters of 2 Hz inserted; the net ends 1 s later";
    assert!(converted.1.contains(noted), "{}", converted.1);
    // The arm begins where the net does.
    let demo = std::fs::read_to_string(repository().join("configs/cells/demo.yaml"));
    let robots = format!("{}/", repository().join("configs/robots").display());
    let demo = demo.expect("the demo's configuration");
    let cell = demo
        .replace(
            "--start=0,-0.5235987755982988,0,1.5707963267948966,0,-1.0471975511965976,0",
            "--start=0,0,0,0,0,0,0",
        )
        .replace("../robots/", &robots);
    let config = folder.path().join("cell.yaml");
    std::fs::write(&config, cell).expect("written");
    let config = config.to_str().expect("UTF-8");
    let simulate = |net: &str| run(&["simulate", net, "--config", config]);
    let (refused, rehearsed) = (simulate(rough), simulate(smooth));
    assert!(
        refused.0 != Some(0) && refused.1.contains("jerk"),
        "{refused:?}"
    );
    assert_eq!(rehearsed.0, Some(0), "{}", rehearsed.1);
}

#[test]
fn smooth_refuses_what_it_cannot_filter() {
    let blink = run(&["convert", "configs/nets/blink.yaml", "--smooth"]);
    assert_eq!(blink.0, Some(2), "{}", blink.1);
    assert!(blink.1.contains("commands no joint"), "{}", blink.1);
    let array = run(&["convert", "configs/nets/line.yaml", "--smooth=3Hz"]);
    assert_eq!(array.0, Some(2), "{}", array.1);
    assert!(array.1.contains("one array"), "{}", array.1);
    let cutoff = run(&["convert", "configs/nets/line.yaml", "--smooth=0"]);
    assert_eq!(cutoff.0, Some(2), "{}", cutoff.1);
}
