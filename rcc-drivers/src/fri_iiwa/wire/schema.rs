//! Messages of the Fast Robot Interface as Protocol Buffers (proto2).
//! Plain data.
//!
//! Every field is optional here, also those that the protocol requires, so that a missing one is not taken for 0;
//! [`super::decode`] refuses a message without them. Numbers and types are those of KUKA's client SDK 1.11 to 2.7;
//! enumerations travel as integers. Units: rad, N·m and N; lengths of transformations in mm.

use prost::Message;

/// Header of both messages.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct Envelope {
    /// Always present.
    #[prost(message, optional, tag = "1")]
    pub header: Option<Header>,
}

/// The message that the robot sends.
#[derive(Clone, PartialEq, Message)]
pub struct Monitoring {
    /// Always present.
    #[prost(message, optional, tag = "1")]
    pub header: Option<Header>,
    /// State of the robot.
    #[prost(message, optional, tag = "2")]
    pub robot: Option<Robot>,
    /// Measured values.
    #[prost(message, optional, tag = "3")]
    pub data: Option<MonitorData>,
    /// State of the session.
    #[prost(message, optional, tag = "4")]
    pub connection: Option<Connection>,
    /// The robot's interpolator; present in the commanding states.
    #[prost(message, optional, tag = "5")]
    pub interpolator: Option<Interpolator>,
    /// Transformations that the client asked for, at most 5.
    #[prost(message, repeated, tag = "6")]
    pub transformations: Vec<Transformation>,
    /// Up to version 2.5.
    #[prost(message, optional, tag = "15")]
    pub end: Option<MessageEnd>,
}

/// The message with which the client answers.
#[derive(Clone, PartialEq, Message)]
pub struct Command {
    /// Always present.
    #[prost(message, optional, tag = "1")]
    pub header: Option<Header>,
    /// Commanded values.
    #[prost(message, optional, tag = "2")]
    pub data: Option<CommandData>,
    /// Up to version 2.5.
    #[prost(message, optional, tag = "15")]
    pub end: Option<MessageEnd>,
}

/// Identity and counters of a message; all are required.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct Header {
    /// Kind of the message: [`super::MONITORING_ID`] or [`super::COMMAND_ID`].
    #[prost(uint32, optional, tag = "1")]
    pub identifier: Option<u32>,
    /// The sender's counter, plus 1 for each message.
    #[prost(uint32, optional, tag = "2")]
    pub sequence: Option<u32>,
    /// The counter of the last message that the sender received.
    #[prost(uint32, optional, tag = "3")]
    pub reflected: Option<u32>,
}

/// State of the robot.
#[derive(Clone, PartialEq, Message)]
pub struct Robot {
    /// Number of joints.
    #[prost(int32, optional, tag = "1")]
    pub joints: Option<i32>,
    /// [`super::SafetyState`].
    #[prost(int32, optional, tag = "2")]
    pub safety: Option<i32>,
    /// [`super::DriveState`] of each joint.
    #[prost(int32, repeated, packed = "false", tag = "5")]
    pub drives: Vec<i32>,
    /// [`super::OperationMode`].
    #[prost(int32, optional, tag = "6")]
    pub operation: Option<i32>,
    /// [`super::ControlMode`].
    #[prost(int32, optional, tag = "7")]
    pub control: Option<i32>,
}

/// State of the session; state and quality are required.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct Connection {
    /// [`super::SessionState`].
    #[prost(int32, optional, tag = "1")]
    pub session: Option<i32>,
    /// [`super::Quality`].
    #[prost(int32, optional, tag = "2")]
    pub quality: Option<i32>,
    /// Period of the robot's messages, ms.
    #[prost(uint32, optional, tag = "3")]
    pub send_period_ms: Option<u32>,
    /// The client answers each message whose count is a multiple of it.
    #[prost(uint32, optional, tag = "4")]
    pub receive_multiplier: Option<u32>,
}

/// Measured values.
#[derive(Clone, PartialEq, Message)]
pub struct MonitorData {
    /// rad.
    #[prost(message, optional, tag = "1")]
    pub measured_position: Option<JointValues>,
    /// N·m.
    #[prost(message, optional, tag = "2")]
    pub measured_torque: Option<JointValues>,
    /// rad; 1.x.
    #[prost(message, optional, tag = "3")]
    pub commanded_position: Option<JointValues>,
    /// N·m.
    #[prost(message, optional, tag = "4")]
    pub commanded_torque: Option<JointValues>,
    /// Measured torques minus those of the robot's model, N·m.
    #[prost(message, optional, tag = "5")]
    pub external_torque: Option<JointValues>,
    /// N and N·m; 2.7.
    #[prost(message, optional, tag = "6")]
    pub external_force: Option<CartesianVector>,
    /// Inputs and outputs of the station, at most 10; from 1.14.
    #[prost(message, repeated, tag = "8")]
    pub io: Vec<IoValue>,
    /// Measured pose; 2.x.
    #[prost(message, optional, tag = "9")]
    pub measured_pose: Option<Transformation>,
    /// Measured redundancy; 2.x.
    #[prost(message, optional, tag = "10")]
    pub redundancy: Option<Redundancy>,
    /// Time of the measurement.
    #[prost(message, optional, tag = "15")]
    pub timestamp: Option<TimeStamp>,
}

/// Set-point of the robot's own interpolator, on which the client's commands are superposed.
#[derive(Clone, PartialEq, Message)]
pub struct Interpolator {
    /// rad; required in the commanding states.
    #[prost(message, optional, tag = "1")]
    pub position: Option<JointValues>,
    /// 2.x.
    #[prost(message, optional, tag = "2")]
    pub pose: Option<Transformation>,
    /// 2.x.
    #[prost(message, optional, tag = "3")]
    pub redundancy: Option<Redundancy>,
    /// [`super::ClientCommandMode`].
    #[prost(int32, optional, tag = "10")]
    pub command_mode: Option<i32>,
    /// [`super::Overlay`].
    #[prost(int32, optional, tag = "11")]
    pub overlay: Option<i32>,
    /// From 0 to 1, meaningful while commands are executed.
    #[prost(double, optional, tag = "12")]
    pub tracking_performance: Option<f64>,
}

/// Values that a client commands.
#[derive(Clone, PartialEq, Message)]
pub struct CommandData {
    /// rad.
    #[prost(message, optional, tag = "1")]
    pub position: Option<JointValues>,
    /// N and N·m.
    #[prost(message, optional, tag = "2")]
    pub wrench: Option<CartesianVector>,
    /// N·m.
    #[prost(message, optional, tag = "3")]
    pub torque: Option<JointValues>,
    /// Transformations of frames, at most 5.
    #[prost(message, repeated, tag = "4")]
    pub transformations: Vec<Transformation>,
    /// Outputs that change, at most 10; from 1.14.
    #[prost(message, repeated, tag = "5")]
    pub io: Vec<IoValue>,
    /// 2.x.
    #[prost(message, optional, tag = "6")]
    pub pose: Option<Transformation>,
    /// 2.x.
    #[prost(message, optional, tag = "7")]
    pub redundancy: Option<Redundancy>,
}

/// One value for each of the seven joints.
#[derive(Clone, PartialEq, Message)]
pub struct JointValues {
    /// Exactly 7.
    #[prost(double, repeated, packed = "false", tag = "1")]
    pub value: Vec<f64>,
}

/// Force and torque.
#[derive(Clone, PartialEq, Message)]
pub struct CartesianVector {
    /// x, y, z (N), A, B, C (N·m): exactly 6.
    #[prost(double, repeated, tag = "1")]
    pub element: Vec<f64>,
}

/// Position and orientation of a frame.
#[derive(Clone, PartialEq, Message)]
pub struct Transformation {
    /// Name of the frame; empty for the flange's pose.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// 1.x: 12 numbers, 3×4 by rows. 2.x: x, y, z and the quaternion w, x, y, z. Lengths in mm.
    #[prost(double, repeated, tag = "2")]
    pub element: Vec<f64>,
    /// Time of the transformation.
    #[prost(message, optional, tag = "3")]
    pub timestamp: Option<TimeStamp>,
}

/// Which of the joint positions of a pose.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Redundancy {
    /// E1 = 0, none = 4.
    #[prost(int32, optional, tag = "1")]
    pub strategy: Option<i32>,
    /// rad for E1.
    #[prost(double, optional, tag = "2")]
    pub value: Option<f64>,
}

/// One input or output of the station.
#[derive(Clone, PartialEq, Message)]
pub struct IoValue {
    /// `Group.Name`, at most 63 bytes.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// [`super::IoKind`].
    #[prost(int32, optional, tag = "2")]
    pub kind: Option<i32>,
    /// [`super::IoDirection`].
    #[prost(int32, optional, tag = "3")]
    pub direction: Option<i32>,
    /// Of Boolean and digital values.
    #[prost(uint64, optional, tag = "4")]
    pub digital: Option<u64>,
    /// Of analog values.
    #[prost(double, optional, tag = "5")]
    pub analog: Option<f64>,
}

/// Time since 1970.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct TimeStamp {
    /// s.
    #[prost(uint32, optional, tag = "1")]
    pub seconds: Option<u32>,
    /// ns.
    #[prost(uint32, optional, tag = "2")]
    pub nanoseconds: Option<u32>,
}

/// End of a message up to version 2.5; nobody evaluates it.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct MessageEnd {
    /// Bytes.
    #[prost(int32, optional, tag = "1")]
    pub length: Option<i32>,
    /// Checksum.
    #[prost(message, optional, tag = "2")]
    pub checksum: Option<Checksum>,
}

/// Checksum in a [`MessageEnd`].
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct Checksum {
    /// CRC-32.
    #[prost(int32, optional, tag = "1")]
    pub crc32: Option<i32>,
}
