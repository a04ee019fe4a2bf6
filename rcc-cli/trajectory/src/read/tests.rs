use rcc_config::codes;

use super::read;

const POINT: &str = "{positions: [0, 1], time_from_start: {sec: 1, nanosec: 500000000}}";

fn with(points: &str) -> String {
    format!("joint_names: [a, b]\npoints: [{points}]\n")
}

/// Returns code and message of each fault.
fn faults(text: &str) -> Vec<(&'static str, String)> {
    let faults = read(text).expect_err(text);
    faults
        .into_iter()
        .map(|fault| (fault.code, fault.message))
        .collect()
}

#[test]
fn reads_what_topic_echo_prints_with_its_separators() {
    let text = format!("---\n{}---\n", with(POINT));
    let read = read(&text).expect("one message");
    assert_eq!(read.joints, ["a", "b"]);
    assert_eq!(read.points.len(), 1);
    assert_eq!(read.points[0].time_s, 1.5);
    assert_eq!(read.points[0].velocities, None);
}

#[test]
fn reads_a_goal_and_says_which_of_its_keys_it_does_not_use() {
    let json = r#"{"goal": {"trajectory": {"header": {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "x"}, "joint_names": ["a"],
        "points": [{"positions": [1], "velocities": [], "effort": [2.0], "time_from_start": 0}]},
        "goal_tolerance": [{"name": "a"}], "path_tolerance": []}}"#;
    let read = read(json).expect("a goal");
    assert_eq!(read.unused, ["goal_tolerance", "header.stamp", "effort"]);
}

#[test]
fn reads_the_times_of_both_generations_of_ros_and_plain_seconds() {
    for (time, expected) in [
        ("{secs: 2, nsecs: 250000000}", 2.25),
        ("{sec: 2}", 2.0),
        ("0.125", 0.125),
    ] {
        let text = with(&format!("{{positions: [0, 1], time_from_start: {time}}}"));
        assert_eq!(
            read(&text).expect(time).points[0].time_s,
            expected,
            "{time}"
        );
    }
}

#[test]
fn refuses_a_second_message_at_its_place() {
    let text = format!("{}---\n{}", with(POINT), with(POINT));
    let fault = &read(&text).expect_err("two messages")[0];
    assert_eq!(fault.code, codes::TOO_MANY.code);
    let place = fault.place.expect("a place");
    assert!(
        text[place.start as usize..].starts_with("joint_names"),
        "{place:?}"
    );
}

#[test]
fn refuses_what_it_would_misread() {
    let table = [
        (
            "points: []",
            codes::MISSING_KEY.code,
            "needs a key `joint_names`",
        ),
        (
            "joint_names: [a, a]\npoints: [1]",
            codes::BAD_NAME.code,
            "joint `a` occurs twice",
        ),
        (
            &with("{positions: [0], time_from_start: 1}"),
            codes::WRONG_SHAPE.code,
            "1 numbers for 2 joints",
        ),
        (
            &with("{positions: [0, .nan], time_from_start: 1}"),
            codes::WRONG_SHAPE.code,
            "must be a finite number",
        ),
        (
            &with("{positions: [0, 1], velocites: [0, 0], time_from_start: 1}"),
            codes::UNKNOWN_KEY.code,
            "no key `velocites`",
        ),
        (
            &with("{positions: [0, 1], accelerations: [0, 0], time_from_start: 1}"),
            codes::MISSING_KEY.code,
            "no velocities",
        ),
        (
            &with("{positions: [0, 1], time_from_start: {sec: 1, ms: 4}}"),
            codes::WRONG_SHAPE.code,
            "`time_from_start` must be",
        ),
        (
            &with("{positions: [0, 1], time_from_start: -1}"),
            codes::OUT_OF_RANGE.code,
            "from 0 s",
        ),
        (
            &with(&format!("{POINT}, {POINT}")),
            codes::REVERSED.code,
            "not after the point before it",
        ),
        (
            &with(&format!(
                "{POINT}, {{positions: [0, 1], velocities: [0, 0], time_from_start: 9}}"
            )),
            codes::MISSING_KEY.code,
            "differ",
        ),
    ];
    for (text, code, words) in table {
        let found = faults(text);
        let is_there = found
            .iter()
            .any(|(have, message)| *have == code && message.contains(words));
        assert!(is_there, "{text}: {found:?}");
    }
}

#[test]
fn says_that_a_list_was_cut_by_topic_echo() {
    let text = with("{positions: ['...'], time_from_start: 1}");
    let fault = &read(&text).expect_err("cut")[0];
    assert!(
        fault
            .help
            .as_ref()
            .is_some_and(|help| help.contains("--full-length")),
        "{fault:?}"
    );
}

#[test]
fn refuses_more_points_than_a_net_can_look_up() {
    let points = |count: usize| {
        let points = (0..count).map(|number| {
            format!(
                "{{positions: [0, 1], time_from_start: {}}}",
                number as f64 * 0.01
            )
        });
        with(&points.collect::<Vec<_>>().join(", "))
    };
    assert_eq!(read(&points(1023)).map(|read| read.points.len()), Ok(1023));
    let refused = faults(&points(1024));
    assert_eq!(refused[0].0, codes::TOO_MANY.code);
    assert!(
        refused[0].1.contains("1024 points, the maximum is 1023"),
        "{refused:?}"
    );
}
