//! The action `control_msgs/FollowJointTrajectory` of each arm: a trajectory becomes a net, which is checked, rehearsed and
//! started before the goal is accepted.

#[cfg(test)]
mod fake_loader;
pub mod goals;
pub mod messages;
pub mod motion;
pub mod server;
pub mod starter;
