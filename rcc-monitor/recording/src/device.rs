//! The messages about a device: every measurement in a table of its own, and, at a lower rate, what viewers draw of an arm:
//! joint states, the frame of every link, poses and the wrench. Run by the thread that records.

use rcc_core::message::{Joints, Measurement};

use crate::arm::ViewedArm;
use crate::cdr::CdrWriter;
use crate::file::{ChannelInfo, RecordingError};
use crate::messages;
use crate::schemas::standard;
use crate::sink::{ChannelId, MessageSink, RecordingState};
use crate::table::{Column, Table, TableKey, TableSubject, field_name};

/// Name and unit of an input or output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelLabel {
    /// Name.
    pub name: String,
    /// Unit, if it has one.
    pub unit: Option<String>,
}

/// A device of a cell.
#[derive(Clone, Debug)]
pub struct RecordedDevice {
    /// Name.
    pub name: String,
    /// The arm, unless it is plain I/O.
    pub arm: Option<ViewedArm>,
    /// Digital inputs, digital outputs, analog inputs, analog outputs.
    pub channels: [Vec<ChannelLabel>; 4],
}

impl RecordedDevice {
    /// Returns labels for channels whose names are unknown: `digital_in_1`, …
    #[must_use]
    pub fn unnamed_channels(counts: [u32; 4]) -> [Vec<ChannelLabel>; 4] {
        let kinds = ["digital_in", "digital_out", "analog_in", "analog_out"];
        let labels = |(kind, count): (&str, u32)| {
            let numbers = 1..=count;
            let label = |number| ChannelLabel {
                name: format!("{kind}_{number}"),
                unit: None,
            };
            numbers.map(label).collect()
        };
        let mut rows = kinds.into_iter().zip(counts).map(labels);
        std::array::from_fn(|_| rows.next().unwrap_or_default())
    }
}

/// Channels of what viewers draw.
#[derive(Clone, Copy, Debug)]
struct ViewChannels {
    /// Measured and commanded.
    joints: [ChannelId; 2],
    poses: [ChannelId; 2],
    wrench: ChannelId,
    frames: ChannelId,
}

/// Writes the messages of one device.
#[derive(Debug)]
pub struct DeviceRecorder {
    device: RecordedDevice,
    table: Table,
    channel: ChannelId,
    view: Option<ViewChannels>,
    joint_names: Vec<String>,
    view_every_ns: u64,
    next_view_ns: u64,
    values: Vec<f64>,
    out: CdrWriter,
}

fn column(name: &str, type_name: String, width: usize, unit: &str) -> Column {
    Column {
        name: name.to_owned(),
        type_name,
        unit: (!unit.is_empty()).then(|| unit.to_owned()),
        width,
        never_null: false,
    }
}

/// Columns of a device; [`DeviceRecorder::elements`] has their values in this order.
fn columns(device: &RecordedDevice) -> Vec<Column> {
    let mut columns = vec![
        column("state", "Int".to_owned(), 1, ""),
        column("quality", "Real".to_owned(), 1, ""),
    ];
    if let Some(arm) = &device.arm {
        let joints = arm.joints();
        for (name, unit) in [
            ("position", "rad"),
            ("commanded", "rad"),
            ("torque", "N·m"),
            ("external_torque", "N·m"),
        ] {
            columns.push(column(name, format!("Real[{joints}]"), joints, unit));
        }
        columns.push(column("wrench", "Wrench".to_owned(), 6, ""));
    }
    for (index, labels) in device.channels.iter().enumerate() {
        let type_name = if index < 2 { "Bool" } else { "Real" };
        for label in labels {
            let unit = label.unit.as_deref().unwrap_or_default();
            columns.push(column(&label.name, type_name.to_owned(), 1, unit));
        }
    }
    columns
}

fn view_channels(sink: &mut dyn MessageSink, name: &str) -> ViewChannels {
    let mut channel = |topic: String, schema: &str| {
        sink.channel(ChannelInfo {
            topic,
            schema: standard(schema),
            metadata: [("device".to_owned(), name.to_owned())].into(),
        })
    };
    let topic = field_name(name);
    let mut pair = |what: &str, schema: &str| {
        ["measured", "commanded"].map(|kind| channel(format!("/{topic}/{kind}/{what}"), schema))
    };
    ViewChannels {
        joints: pair("joint_states", "sensor_msgs/JointState"),
        poses: pair("pose", "geometry_msgs/PoseStamped"),
        wrench: channel(
            format!("/{topic}/measured/wrench"),
            "geometry_msgs/WrenchStamped",
        ),
        frames: channel("/tf".to_owned(), "tf2_msgs/TFMessage"),
    }
}

impl DeviceRecorder {
    /// Adds the channels of a device; viewers get its arm at most every `view_every_ns`.
    #[must_use]
    pub fn new(
        sink: &mut dyn MessageSink,
        device: RecordedDevice,
        view_every_ns: u64,
    ) -> DeviceRecorder {
        let subject = TableSubject {
            name: format!("device {}", device.name),
            topic: format!("/devices/{}", field_name(&device.name)),
            metadata: [("device".to_owned(), device.name.clone())].into(),
        };
        let table = Table::new(subject, columns(&device));
        let channel = sink.channel(ChannelInfo {
            topic: table.topic.clone(),
            schema: table.schema.clone(),
            metadata: table.metadata.clone(),
        });
        let arm = device.arm.as_ref();
        let joint_names = arm.map(|arm| (1..=arm.joints()).map(|n| arm.joint_name(n)).collect());
        DeviceRecorder {
            view: arm.map(|_| view_channels(sink, &device.name)),
            joint_names: joint_names.unwrap_or_default(),
            table,
            channel,
            device,
            view_every_ns,
            next_view_ns: 0,
            values: Vec::new(),
            out: CdrWriter::new(),
        }
    }

    /// Returns the device.
    #[must_use]
    pub fn device(&self) -> &RecordedDevice {
        &self.device
    }

    /// Writes a measurement; `None` means that the device is lost: its values are null.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn write(
        &mut self,
        sink: &mut dyn MessageSink,
        time_ns: u64,
        measurement: Option<&Measurement>,
    ) -> Result<RecordingState, RecordingError> {
        self.elements(measurement);
        let key = TableKey {
            cycle: measurement.map_or(0, |measured| measured.sequence),
            command: 0,
        };
        self.table.encode(key, &self.values, &mut self.out);
        let state = sink.write(self.channel, time_ns, self.out.bytes())?;
        let (Some(measured), Some(view)) = (measurement, self.view) else {
            return Ok(state);
        };
        if time_ns < self.next_view_ns || state == RecordingState::Full {
            return Ok(state);
        }
        self.next_view_ns = time_ns + self.view_every_ns;
        self.write_view(sink, time_ns, measured, view)
    }

    /// Collects the elements of all columns.
    fn elements(&mut self, measurement: Option<&Measurement>) {
        let values = &mut self.values;
        values.clear();
        let Some(measured) = measurement else {
            // Offline; missing elements are null.
            values.push(f64::from_bits(0));
            return;
        };
        values.push(f64::from_bits(u64::from(measured.state)));
        values.push(f64::from(measured.quality_permille) / 1000.0);
        if let Some(arm) = &self.device.arm {
            for joints in [
                &measured.position,
                &measured.hold,
                &measured.torque,
                &measured.external_torque,
            ] {
                values.extend(joints.iter().take(arm.joints()));
            }
            values.extend(measured.wrench);
        }
        let [digital_in, digital_out, analog_in, analog_out] = &self.device.channels;
        let bit = |(bits, known): (u64, u64), index: usize| {
            let mask = 1_u64.checked_shl(index as u32).unwrap_or(0);
            match known & mask {
                0 => f64::NAN,
                _ => f64::from(u8::from(bits & mask != 0)),
            }
        };
        let ins = (measured.digital, measured.digital_known);
        let outs = (measured.digital_out, measured.digital_out_known);
        values.extend((0..digital_in.len()).map(|index| bit(ins, index)));
        values.extend((0..digital_out.len()).map(|index| bit(outs, index)));
        values.extend(measured.analog.iter().take(analog_in.len()));
        values.extend(measured.analog_out.iter().take(analog_out.len()));
    }

    fn write_view(
        &mut self,
        sink: &mut dyn MessageSink,
        time_ns: u64,
        measured: &Measurement,
        view: ViewChannels,
    ) -> Result<RecordingState, RecordingError> {
        let Some(arm) = &self.device.arm else {
            return Ok(RecordingState::Open);
        };
        let (out, names) = (&mut self.out, &self.joint_names);
        let rows: [(&Joints, &[f64]); 2] = [
            (&measured.position, &measured.torque),
            (&measured.hold, &[]),
        ];
        for ((position, effort), (joints, pose)) in rows
            .into_iter()
            .zip(view.joints.into_iter().zip(view.poses))
        {
            messages::joint_state(out, time_ns, names, [position, effort]);
            let _ = sink.write(joints, time_ns, out.bytes())?;
            let flange = arm.arm.forward(position);
            messages::pose_stamped(out, time_ns, &arm.base_frame(), &flange);
            let _ = sink.write(pose, time_ns, out.bytes())?;
        }
        messages::wrench_stamped(out, time_ns, &arm.flange_frame(), &measured.wrench);
        let _ = sink.write(view.wrench, time_ns, out.bytes())?;
        messages::transforms(out, time_ns, &arm.frames(&measured.position));
        sink.write(view.frames, time_ns, out.bytes())
    }
}
