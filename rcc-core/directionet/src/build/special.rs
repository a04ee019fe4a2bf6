//! Conversions that a net cannot express: values from and to the outside, and the axes of robots, which the predecessor
//! commands one by one and RCC all at once. Arrays are in `arrays`. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::ShortText;
use rcc_core::unit::Unit;
use rcc_language::codes;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{BuiltPrimitive, BuiltValue, Conversion};
use crate::table::{SpecialConversion, TypeEntry};

impl Conversion<'_, '_> {
    pub(super) fn special(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        conversion: SpecialConversion,
        active: Option<&BuiltValue>,
    ) {
        match conversion {
            // Its value is known from the beginning, so it may be read before it is converted.
            SpecialConversion::Pre => {
                // They are in the order of the text.
                let place = self.delayed.binary_search_by_key(&number, |pre| pre.0);
                if let Some(pre) = place.ok().and_then(|place| self.delayed.get_mut(place)) {
                    pre.1 = active.cloned();
                }
            }
            SpecialConversion::Array
            | SpecialConversion::ArrayGet
            | SpecialConversion::ArraySet
            | SpecialConversion::ArraySlice => {
                self.array(number, entry, conversion);
            }
            SpecialConversion::ArrayIsNull => self.array_is_null(number, entry),
            SpecialConversion::ArraySetNull => self.array_set_null(number, entry),
            SpecialConversion::NetcommIn => self.input_from_application(number, entry),
            SpecialConversion::NetcommOut => self.output_to_application(number, entry),
            SpecialConversion::InterNetcommIn => self.subscribed(number, entry),
            SpecialConversion::InterNetcommOut => self.publish_to_net(number, entry),
            SpecialConversion::InvKin => self.inverse_kinematics(number, entry),
            SpecialConversion::JointMonitor => self.joint_monitor(number, entry),
            SpecialConversion::JointPosition => self.joint_position(number, entry, active),
        }
    }

    pub(super) fn put(&mut self, number: usize, port: &'static str, value: BuiltValue) {
        let Some(values) = self.values.get_mut(number) else {
            return;
        };
        match values.iter_mut().find(|(known, _)| *known == port) {
            Some((_, known)) => *known = value,
            None => values.push((port, value)),
        }
    }

    pub(super) fn one(
        &mut self,
        number: usize,
        ty: &'static str,
        inputs: Vec<(&'static str, BuiltValue, Span)>,
    ) -> usize {
        let made = self.built.len();
        let (id, span) = (self.id_of(number), self.span(number));
        self.built.push(BuiltPrimitive {
            inputs,
            ..BuiltPrimitive::new(ty, id, span, number)
        });
        made
    }

    /// Returns a required parameter that is a name.
    fn text(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        name: &str,
    ) -> Option<(String, Span)> {
        let literal = self.parameter(number, entry, name)?;
        match literal.shape {
            LiteralShape::Text(text) if !text.is_empty() => Some((text, literal.span)),
            _ => {
                let message = format!("{} needs a `{name}`", entry.name);
                self.error(codes::MISSING_PARAMETER, self.span(number), message, None);
                None
            }
        }
    }

    /// Converts a value from the application; several primitives with one key share one `Input`.
    fn input_from_application(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some((key, _)) = self.text(number, entry, "Key") else {
            return;
        };
        let Some(initial) = self.parameter(number, entry, "Value") else {
            return;
        };
        if matches!(&initial.shape, LiteralShape::List(elements) if elements.is_empty()) {
            let message = "an array input of length 0 never gets a value".to_string();
            let help =
                Some("give `Value` one element for each of the array's: `[0,0,0]`".to_string());
            return self.error(codes::OUT_OF_RANGE, initial.span, message, help);
        }
        let name = super::finish::id(&format!("in{key}"));
        let shared = format!("input {key}");
        let made = self.shared(
            shared,
            "Input",
            &name,
            vec![("initial", initial)],
            Vec::new(),
        );
        let value = self.built_output(made, "value");
        self.put(number, "outValue", value);
    }

    /// Returns the value sent to the application or to another net, as one output.
    fn one_value(&mut self, number: usize, entry: &'static TypeEntry) -> (BuiltValue, Span) {
        let (value, span) = self.argument(number, entry, "inValue");
        let value = match value {
            // A list needs a primitive that makes it one value.
            BuiltValue::List(_) | BuiltValue::Delayed(_) => self.pass(value),
            value => value,
        };
        (value, span)
    }

    fn output_to_application(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some((key, _)) = self.text(number, entry, "Key") else {
            return;
        };
        let (value, span) = self.one_value(number, entry);
        let report = self.parameter(number, entry, "Report");
        let id = super::finish::id(&format!("out{key}"));
        if report.is_some_and(|report| report.shape == LiteralShape::Bool(false)) {
            // The application never received it: it is meant for other nets.
            let topic = format!("{}/out{key}", self.options.name);
            self.publish(number, topic, value.clone(), span, id);
        } else {
            let made = self.one(number, "Monitor", vec![("value", value.clone(), span)]);
            if let Some(built) = self.built.get_mut(made) {
                built.id = id;
            }
        }
        self.keys.push((key, value));
    }

    fn publish(
        &mut self,
        number: usize,
        topic: String,
        value: BuiltValue,
        span: Span,
        id: ShortText,
    ) {
        let made = self.one(number, "Publish", vec![("in", value, span)]);
        let topic = Literal::new(LiteralShape::Text(topic), span);
        if let Some(built) = self.built.get_mut(made) {
            built.id = id;
            built.parameters.push(("topic", topic));
        }
    }

    /// Returns the topic `<RemoteNet>/<prefix><RemoteKey>`.
    fn remote(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        prefix: &str,
    ) -> Option<(String, Span)> {
        let [net, key] = ["RemoteNet", "RemoteKey"].map(|name| self.text(number, entry, name));
        let ((net, span), (key, _)) = (net?, key?);
        // The name that the net gets when it is read from the file of this name.
        let net = crate::net_name(&net);
        Some((format!("{net}/{prefix}{key}"), span))
    }

    /// Converts a value from another net; several primitives with one topic share one `Subscribe`.
    fn subscribed(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some((topic, span)) = self.remote(number, entry, "out") else {
            return self.refuse(number, entry);
        };
        let name = super::finish::id(&topic);
        let shared = format!("topic {topic}");
        let mut parameters = vec![("topic", Literal::new(LiteralShape::Text(topic), span))];
        let ty = entry.outputs.iter().find(|port| port.name == "outValue");
        // The length of an array is determined by its reader only.
        let ty = ty
            .filter(|port| !port.array)
            .and_then(|port| port.ty.rcc_type());
        parameters.extend(ty.map(|ty| {
            let name = LiteralShape::Text(ty.to_string());
            ("type", Literal::new(name, span))
        }));
        let made = self.shared(shared, "Subscribe", &name, parameters, Vec::new());
        let value = self.built_output(made, "value");
        self.put(number, "outValue", value);
    }

    fn publish_to_net(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some((topic, span)) = self.remote(number, entry, "in") else {
            return;
        };
        let (value, _) = self.one_value(number, entry);
        let id = super::finish::id(&topic);
        self.publish(number, topic, value, span, id);
    }

    fn robot(&mut self, number: usize, entry: &'static TypeEntry) -> Option<(String, u32, Span)> {
        let robot = self.parameter(number, entry, "Robot")?;
        let LiteralShape::Text(name) = &robot.shape else {
            return None;
        };
        let device = self.device(name, true, robot.span)?;
        let axis = self.count(number, entry, "Axis")?;
        let joints = self
            .cell
            .find(&device)
            .map(|(_, device)| device.model.joints);
        if let Some(joints) = joints.filter(|joints| axis >= *joints) {
            let message = format!("`{device}` has no axis {axis}: it has {joints}");
            let span = self
                .parameter(number, entry, "Axis")
                .map_or(robot.span, |it| it.span);
            self.error(codes::WRONG_ARM, span, message, None);
            return None;
        }
        Some((device, axis, robot.span))
    }

    /// Returns the one primitive of a type that a robot has.
    fn of_robot(&mut self, ty: &'static str, name: &str, device: &str, span: Span) -> usize {
        let literal = Literal::new(LiteralShape::Text(device.to_string()), span);
        let name = super::finish::id(&format!("{device}_{name}"));
        let parameters = vec![("device", literal)];
        let key = format!("{ty} {device}");
        self.shared(key, ty, &name, parameters, Vec::new())
    }

    fn joint_monitor(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some((device, axis, span)) = self.robot(number, entry) else {
            return self.refuse(number, entry);
        };
        let index = BuiltValue::Constant(Literal::new(LiteralShape::Int(i64::from(axis)), span));
        for (foreign, ty, name, port) in [
            ("outMeasuredPosition", "JointState", "state", "position"),
            ("outCommandedPosition", "JointState", "state", "hold"),
            (
                "outMeasuredVelocity",
                "JointVelocity",
                "velocity",
                "velocity",
            ),
            (
                "outCommandedVelocity",
                "JointVelocity",
                "velocity",
                "commanded",
            ),
        ] {
            // Only outputs that are read are converted: most nets read one of them.
            if self.is_read(number, foreign) {
                let made = self.of_robot(ty, name, &device, span);
                let all = self.built_output(made, port);
                let value = self.element(&all, &index, span);
                self.put(number, foreign, value);
            }
        }
        self.put(number, "outError", constant(LiteralShape::Int(0), span));
    }

    /// Returns true if something in the text reads an output.
    fn is_read(&self, number: usize, output: &str) -> bool {
        let read = self.read.get_or_init(|| self.flat.reads());
        read.contains(&(number, output))
    }

    /// Converts inverse kinematics. With the robot's own position as the hint, the arm angle stays that of the start;
    /// otherwise it is the hint's, if the arm has one.
    fn inverse_kinematics(&mut self, number: usize, entry: &'static TypeEntry) {
        let Some(robot) = self.parameter(number, entry, "Robot") else {
            return self.refuse(number, entry);
        };
        let LiteralShape::Text(name) = &robot.shape else {
            return self.refuse(number, entry);
        };
        let Some(device) = self.device(name, true, robot.span) else {
            return self.refuse(number, entry);
        };
        let (hint, at) = self.argument(number, entry, "inHintJoints");
        let (pose, span) = self.argument(number, entry, "inFrame");
        let parameter = || {
            vec![(
                "device",
                Literal::new(LiteralShape::Text(device.clone()), robot.span),
            )]
        };
        let made = if self.is_own_position(&hint, &device) {
            let made = self.one(number, "InverseKinematics", vec![("pose", pose, span)]);
            self.built[made].parameters = parameter();
            made
        } else if self.has_no_arm_angle(&device) {
            let made = self.one(number, "InverseKinematicsNear", Vec::new());
            self.built[made].parameters = parameter();
            let hint = self.in_unit(hint, Unit::RADIAN);
            // Ignored, and required.
            let arm_angle = constant(LiteralShape::Real(0.0, Some(Unit::RADIAN)), at);
            self.built[made].inputs = vec![
                ("pose", pose, span),
                ("arm_angle", arm_angle, at),
                ("hint", hint, at),
            ];
            made
        } else {
            let angle = self.one(number, "ArmAngle", Vec::new());
            self.built[angle].parameters = parameter();
            let made = self.one(number, "InverseKinematicsNear", Vec::new());
            self.built[made].parameters = parameter();
            let hint = self.in_unit(hint, Unit::RADIAN);
            self.built[angle].id.push_str("_angle");
            self.built[angle].inputs = vec![("joints", hint.clone(), at)];
            let arm_angle = self.built_output(angle, "angle");
            self.built[made].inputs = vec![
                ("pose", pose, span),
                ("arm_angle", arm_angle, at),
                ("hint", hint, at),
            ];
            made
        };
        let joints = self.built_output(made, "joints");
        self.put(number, "outJoints", joints);
    }

    /// Returns true for an arm whose joints follow from the pose and the hint alone.
    fn has_no_arm_angle(&self, device: &str) -> bool {
        let found = self.cell.find(device);
        found.is_some_and(|(_, device)| device.model.arm.is_some_and(|arm| !arm.has_arm_angle()))
    }

    /// Returns true for a list of all joint positions of a robot, measured or commanded, in order.
    fn is_own_position(&self, hint: &BuiltValue, device: &str) -> bool {
        let BuiltValue::List(elements) = hint else {
            return false;
        };
        elements
            .iter()
            .zip(0..)
            .all(|(element, index)| match element {
                BuiltValue::Output(output) => {
                    self.built.get(output.primitive).is_some_and(|built| {
                        let own = built
                            .parameters
                            .iter()
                            .any(|(_, it)| it.shape == LiteralShape::Text(device.to_string()));
                        built.ty == "JointState" && own && output.index == Some(index)
                    })
                }
                _ => false,
            })
    }

    /// Marks the outputs of a primitive whose error is reported as refused.
    fn refuse(&mut self, number: usize, entry: &'static TypeEntry) {
        for port in &entry.outputs {
            self.put(number, port.name, BuiltValue::Refused);
        }
    }

    fn joint_position(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        active: Option<&BuiltValue>,
    ) {
        let span = self.span(number);
        self.put(number, "outError", constant(LiteralShape::Int(0), span));
        for port in [
            "outErrorConcurrentAccess",
            "outErrorIllegalPosition",
            "outErrorJointFailed",
        ] {
            self.put(number, port, constant(LiteralShape::Bool(false), span));
        }
        let Some((device, axis, robot)) = self.robot(number, entry) else {
            return;
        };
        let (value, at) = self.argument(number, entry, "inPosition");
        let arm = self
            .arms
            .entry(device.clone())
            .or_insert_with(|| super::ArmAxes {
                span: robot,
                active: active.cloned(),
                made_for: number,
                ..super::ArmAxes::default()
            });
        let same = format!("{:?}", arm.active) == format!("{active:?}");
        let earlier = arm.axes.insert(axis, (value, at)).is_some();
        if earlier {
            let message = format!("axis {axis} of `{device}` is commanded twice");
            let help = Some("choose between the two values with `Core::DoubleConditional`".into());
            self.error(codes::CLAIMED_TWICE, span, message, help);
        } else if !same {
            let message =
                format!("axis {axis} of `{device}` has a different condition than the other axes");
            let help = Some("move all axes of a robot to one fragment".to_string());
            self.error(codes::NO_COUNTERPART, span, message, help);
        }
    }
}

fn constant(shape: LiteralShape, span: Span) -> BuiltValue {
    BuiltValue::Constant(Literal::new(shape, span))
}
