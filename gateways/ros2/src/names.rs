//! Names of ROS 2 for those of a cell. Pure.

use rcc_recording::table::field_name;

/// Names of nets that trajectories become begin so: they have no services and no parameters.
pub const GOAL_NETS: &str = "ros2-goal-";

/// Returns the topic of ROS for a channel of a recording: what is measured has the name that ROS users expect, `/joint_states`
/// for all arms together, and what is commanded keeps its own.
#[must_use]
pub fn recorded_topic(topic: &str) -> String {
    let mut words = topic.split('/').skip(1);
    match (words.next(), words.next(), words.next()) {
        (Some(_), Some("measured"), Some("joint_states")) => "/joint_states".to_owned(),
        (Some(device), Some("measured"), Some(what)) => format!("/{device}/{what}"),
        _ => topic.to_owned(),
    }
}

/// Returns the name of a topic of nets, such as `belt/position`: below the node's own name.
#[must_use]
pub fn net_topic(node: &str, topic: &str) -> String {
    let words: Vec<String> = topic.split('/').map(field_name).collect();
    format!("/{node}/topics/{}", words.join("/"))
}

/// Returns the name of a net's service: `start` or `cancel`.
#[must_use]
pub fn service(node: &str, net: &str, what: &str) -> String {
    format!("/{node}/{}/{what}", field_name(net))
}

/// Returns the name of the action of an arm.
#[must_use]
pub fn trajectory_action(device: &str) -> String {
    format!("/{}/follow_joint_trajectory", field_name(device))
}

/// Returns the name of the parameter for an `Input` of a net.
#[must_use]
pub fn parameter(net: &str, input: &str) -> String {
    format!("{}.{}", field_name(net), field_name(input))
}

/// Returns whether this can be the name of a node.
#[must_use]
pub fn is_node(name: &str) -> bool {
    ros2_client::NodeName::new("/", name).is_ok() && !name.contains("__")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ros_users_find_the_names_that_they_expect() {
        for (ours, theirs) in [
            ("/lwr/measured/joint_states", "/joint_states"),
            ("/lwr/commanded/joint_states", "/lwr/commanded/joint_states"),
            ("/lwr/measured/wrench", "/lwr/wrench"),
            ("/tf", "/tf"),
            ("/diagnostics", "/diagnostics"),
        ] {
            assert_eq!(recorded_topic(ours), theirs);
        }
        assert_eq!(
            net_topic("demo", "belt/slow-position"),
            "/demo/topics/belt/slow_position"
        );
        assert_eq!(service("demo", "pick-2", "start"), "/demo/pick_2/start");
        assert_eq!(trajectory_action("arm-1"), "/arm_1/follow_joint_trajectory");
        assert_eq!(parameter("pick-2", "speed"), "pick_2.speed");
    }

    #[test]
    fn every_name_is_one_of_ros() {
        for name in [
            net_topic("demo", "1st/place.x"),
            service("demo", "a--b", "cancel"),
            trajectory_action("r2"),
        ] {
            assert!(ros2_client::Name::parse(&name).is_ok(), "{name}");
        }
        assert!(is_node("demo") && !is_node("1") && !is_node("a-b"));
    }
}
