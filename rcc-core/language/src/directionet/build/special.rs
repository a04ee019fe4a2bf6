//! What needs more than a net of ours: arrays, values from and to outside, and the axes of robots, which are commanded one
//! by one there and all at once here. The loader's threads.

use rcc_config::diagnostic::Span;
use rcc_core::unit::Unit;

use super::{Build, Ours, Value};
use crate::directionet::table::{Builtin, Entry};
use crate::fault;
use crate::syntax::literal::{Literal, Shape};

impl Build<'_, '_> {
    pub(super) fn special(
        &mut self,
        number: usize,
        entry: &'static Entry,
        builtin: Builtin,
        active: Option<&Value>,
    ) {
        match builtin {
            // What it gives was known from the beginning: it may be read before it is made.
            Builtin::Pre => {
                let mut delayed = self.delayed.iter_mut();
                if let Some(pre) = delayed.find(|pre| pre.0 == number) {
                    pre.1 = active.cloned();
                }
            }
            Builtin::Array | Builtin::ArrayGet | Builtin::ArraySet | Builtin::ArraySlice => {
                self.array(number, entry, builtin);
            }
            Builtin::ArrayIsNull => self.array_is_null(number, entry),
            Builtin::ArraySetNull => self.array_set_null(number, entry),
            Builtin::NetcommIn => self.set_from_outside(number, entry),
            Builtin::NetcommOut => self.shown_outside(number, entry),
            Builtin::InterNetcommIn => self.subscribed(number, entry),
            Builtin::InterNetcommOut => self.given_to_another(number, entry),
            Builtin::InvKin => self.inverse_kinematics(number, entry),
            Builtin::JointMonitor => self.joint_monitor(number, entry),
            Builtin::JointPosition => self.joint_position(number, entry, active),
        }
    }

    pub(super) fn put(&mut self, number: usize, port: &'static str, value: Value) {
        if let Some(values) = self.values.get_mut(number) {
            values.insert(port, value);
        }
    }

    /// The elements of an array of the text, of which there are `length`.
    fn elements(&mut self, value: Value, length: u32, span: Span) -> Vec<Value> {
        let index = |index: u32| Value::Constant(Literal::new(Shape::Int(i64::from(index)), span));
        (0..length)
            .map(|it| match value {
                Value::Refused => Value::Refused,
                _ => self.element(value.clone(), &index(it), span),
            })
            .collect()
    }

    fn array(&mut self, number: usize, entry: &'static Entry, builtin: Builtin) {
        let Some(size) = self.count(number, entry, "Size").filter(|size| *size > 0) else {
            return self.bad_size(number, 0);
        };
        if size > u32::from(rcc_core::types::ELEMENTS_MAX) {
            return self.bad_size(number, size);
        }
        let span = self.span(number);
        if builtin == Builtin::Array {
            let element = entry.outputs.first().map(|port| port.ty.zero(span));
            let element = element.map_or(Value::Refused, Value::Constant);
            return self.put(
                number,
                "outArray",
                Value::List(vec![element; size as usize]),
            );
        }
        let (array, at) = self.argument(number, entry, "inArray");
        let name = if builtin == Builtin::ArraySlice {
            "Start"
        } else {
            "Index"
        };
        let Some(index) = self.count(number, entry, name) else {
            return;
        };
        match builtin {
            Builtin::ArrayGet => {
                let literal = Literal::new(Shape::Int(i64::from(index)), span);
                let value = self.element(array, &Value::Constant(literal), at);
                self.put(number, "outValue", value);
            }
            Builtin::ArraySet => {
                let (value, _) = self.argument(number, entry, "inValue");
                let mut elements = self.elements(array, size, at);
                match elements.get_mut(index as usize) {
                    Some(element) => *element = value,
                    None => {
                        let message = format!("there is no element {index} of {size}");
                        self.error(fault::BAD_ELEMENT, span, message, None);
                    }
                }
                self.put(number, "outArray", Value::List(elements));
            }
            _ => {
                // Both are u32; what is too far out is reported with the element that is missing.
                let end = index.saturating_add(size);
                let elements = self.elements(array, end, at).split_off(index as usize);
                self.put(number, "outArray", Value::List(elements));
            }
        }
    }

    fn bad_size(&mut self, number: usize, size: u32) {
        let most = rcc_core::types::ELEMENTS_MAX;
        let message = format!("an array has 1 to {most} elements, not {size}");
        self.error(fault::OUT_OF_RANGE, self.span(number), message, None);
    }

    fn array_is_null(&mut self, number: usize, entry: &'static Entry) {
        let (value, span) = self.argument(number, entry, "inValue");
        let made = self.one(number, "IsNull", vec![("in", value, span)]);
        let value = self.wire(made, "out");
        self.put(number, "outValue", value);
    }

    fn array_set_null(&mut self, number: usize, entry: &'static Entry) {
        let (value, span) = self.argument(number, entry, "inValue");
        let (condition, at) = self.argument(number, entry, "inNull");
        let inputs = vec![("in", value, span), ("condition", condition, at)];
        let made = self.one(number, "NullIf", inputs);
        let size = self.count(number, entry, "Size");
        let value = match self.wire(made, "out") {
            Value::Wire(wire) => Value::Wire(super::Wire {
                length: size,
                ..wire
            }),
            value => value,
        };
        self.put(number, "outValue", value);
    }

    pub(super) fn one(
        &mut self,
        number: usize,
        ty: &'static str,
        inputs: Vec<(&'static str, Value, Span)>,
    ) -> usize {
        let made = self.ours.len();
        self.ours.push(Ours {
            id: self.id_of(number),
            span: self.span(number),
            ty,
            parameters: Vec::new(),
            inputs,
            active: None,
            made_for: number,
        });
        made
    }

    /// A parameter that is a name, and must be given.
    fn text(&mut self, number: usize, entry: &'static Entry, name: &str) -> Option<(String, Span)> {
        let literal = self.parameter(number, entry, name)?;
        match literal.shape {
            Shape::Text(text) if !text.is_empty() => Some((text, literal.span)),
            _ => {
                let message = format!("{} needs a `{name}`", entry.name);
                self.error(fault::MISSING_PARAMETER, self.span(number), message, None);
                None
            }
        }
    }

    /// Several primitives with one key share one value.
    fn set_from_outside(&mut self, number: usize, entry: &'static Entry) {
        let Some((key, _)) = self.text(number, entry, "Key") else {
            return;
        };
        let Some(initial) = self.parameter(number, entry, "Value") else {
            return;
        };
        if matches!(&initial.shape, Shape::List(elements) if elements.is_empty()) {
            let message = "an array from outside of length 0 never gets a value".to_string();
            let help = Some("give `Value` as many elements as it has: `[0,0,0]`".to_string());
            return self.error(fault::OUT_OF_RANGE, initial.span, message, help);
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
        let value = self.wire(made, "value");
        self.put(number, "outValue", value);
    }

    /// What is given to the application or to another net, as one value.
    fn one_value(&mut self, number: usize, entry: &'static Entry) -> (Value, Span) {
        let (value, span) = self.argument(number, entry, "inValue");
        let value = match value {
            // A list of one's own is made into a value by what reads it.
            Value::List(_) | Value::Delayed(_) => self.pass(value),
            value => value,
        };
        (value, span)
    }

    fn shown_outside(&mut self, number: usize, entry: &'static Entry) {
        let Some((key, _)) = self.text(number, entry, "Key") else {
            return;
        };
        let (value, span) = self.one_value(number, entry);
        let report = self.parameter(number, entry, "Report");
        let id = super::finish::id(&format!("out{key}"));
        if report.is_some_and(|report| report.shape == Shape::Bool(false)) {
            // The application never saw it: it is there for other nets.
            let topic = format!("{}/out{key}", self.options.name);
            self.publish(number, topic, value.clone(), span, id);
        } else {
            let made = self.one(number, "Monitor", vec![("value", value.clone(), span)]);
            if let Some(ours) = self.ours.get_mut(made) {
                ours.id = id;
            }
        }
        self.keys.push((key, value));
    }

    fn publish(&mut self, number: usize, topic: String, value: Value, span: Span, id: String) {
        let made = self.one(number, "Publish", vec![("in", value, span)]);
        let topic = Literal::new(Shape::Text(topic), span);
        if let Some(ours) = self.ours.get_mut(made) {
            ours.id = id;
            ours.parameters.push(("topic", topic));
        }
    }

    /// `<RemoteNet>/<prefix><RemoteKey>`.
    fn remote(
        &mut self,
        number: usize,
        entry: &'static Entry,
        prefix: &str,
    ) -> Option<(String, Span)> {
        let [net, key] = ["RemoteNet", "RemoteKey"].map(|name| self.text(number, entry, name));
        let ((net, span), (key, _)) = (net?, key?);
        // As the net is named that is read from the file of this name.
        let net = crate::directionet::net_name(&net);
        Some((format!("{net}/{prefix}{key}"), span))
    }

    /// Several primitives with one topic share one value.
    fn subscribed(&mut self, number: usize, entry: &'static Entry) {
        let Some((topic, span)) = self.remote(number, entry, "out") else {
            return self.refuse(number, entry);
        };
        let name = super::finish::id(&topic);
        let shared = format!("topic {topic}");
        let mut parameters = vec![("topic", Literal::new(Shape::Text(topic), span))];
        let ty = entry.outputs.iter().find(|port| port.name == "outValue");
        // Nothing says how long an array is but what reads it.
        let ty = ty
            .filter(|port| !port.array)
            .and_then(|port| port.ty.ours());
        parameters.extend(ty.map(|ty| {
            let name = Shape::Text(ty.to_string());
            ("type", Literal::new(name, span))
        }));
        let made = self.shared(shared, "Subscribe", &name, parameters, Vec::new());
        let value = self.wire(made, "value");
        self.put(number, "outValue", value);
    }

    fn given_to_another(&mut self, number: usize, entry: &'static Entry) {
        let Some((topic, span)) = self.remote(number, entry, "in") else {
            return;
        };
        let (value, _) = self.one_value(number, entry);
        let id = super::finish::id(&topic);
        self.publish(number, topic, value, span, id);
    }

    fn robot(&mut self, number: usize, entry: &'static Entry) -> Option<(String, u32, Span)> {
        let robot = self.parameter(number, entry, "Robot")?;
        let Shape::Text(name) = &robot.shape else {
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
            self.error(fault::WRONG_ARM, span, message, None);
            return None;
        }
        Some((device, axis, robot.span))
    }

    /// The one primitive of a type that a robot has.
    fn of_robot(&mut self, ty: &'static str, name: &str, device: &str, span: Span) -> usize {
        let literal = Literal::new(Shape::Text(device.to_string()), span);
        let name = super::finish::id(&format!("{device}_{name}"));
        let parameters = vec![("device", literal)];
        let key = format!("{ty} {device}");
        self.shared(key, ty, &name, parameters, Vec::new())
    }

    fn joint_monitor(&mut self, number: usize, entry: &'static Entry) {
        let Some((device, axis, span)) = self.robot(number, entry) else {
            return self.refuse(number, entry);
        };
        let index = Value::Constant(Literal::new(Shape::Int(i64::from(axis)), span));
        for (theirs, ty, name, port) in [
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
            // Only what is read is made: most nets read one of them.
            if self.is_read(number, theirs) {
                let made = self.of_robot(ty, name, &device, span);
                let all = self.wire(made, port);
                let value = self.element(all, &index, span);
                self.put(number, theirs, value);
            }
        }
        self.put(number, "outError", constant(Shape::Int(0), span));
    }

    /// True if something of the text reads an output.
    fn is_read(&self, number: usize, output: &str) -> bool {
        self.read.contains(&(number, output.to_string()))
    }

    /// With the robot's own position as the hint the arm angle stays that of the start; with any other it is the hint's.
    fn inverse_kinematics(&mut self, number: usize, entry: &'static Entry) {
        let Some(robot) = self.parameter(number, entry, "Robot") else {
            return self.refuse(number, entry);
        };
        let Shape::Text(name) = &robot.shape else {
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
                Literal::new(Shape::Text(device.clone()), robot.span),
            )]
        };
        let made = if self.is_own_position(&hint, &device) {
            let made = self.one(number, "InverseKinematics", vec![("pose", pose, span)]);
            self.ours[made].parameters = parameter();
            made
        } else {
            let angle = self.one(number, "ArmAngle", Vec::new());
            self.ours[angle].parameters = parameter();
            let made = self.one(number, "InverseKinematicsNear", Vec::new());
            self.ours[made].parameters = parameter();
            let hint = self.in_unit(hint, Unit::RADIAN);
            self.ours[angle].id.push_str("_angle");
            self.ours[angle].inputs = vec![("joints", hint.clone(), at)];
            let arm_angle = self.wire(angle, "angle");
            self.ours[made].inputs = vec![
                ("pose", pose, span),
                ("arm_angle", arm_angle, at),
                ("hint", hint, at),
            ];
            made
        };
        let joints = self.wire(made, "joints");
        self.put(number, "outJoints", joints);
    }

    /// True for a list of all positions of a robot, measured or commanded, in order.
    fn is_own_position(&self, hint: &Value, device: &str) -> bool {
        let Value::List(elements) = hint else {
            return false;
        };
        elements
            .iter()
            .zip(0..)
            .all(|(element, index)| match element {
                Value::Wire(wire) => self.ours.get(wire.primitive).is_some_and(|ours| {
                    let own = ours
                        .parameters
                        .iter()
                        .any(|(_, it)| it.shape == Shape::Text(device.to_string()));
                    ours.ty == "JointState" && own && wire.index == Some(index)
                }),
                _ => false,
            })
    }

    /// What is read of a primitive whose fault is reported.
    fn refuse(&mut self, number: usize, entry: &'static Entry) {
        for port in &entry.outputs {
            self.put(number, port.name, Value::Refused);
        }
    }

    fn joint_position(&mut self, number: usize, entry: &'static Entry, active: Option<&Value>) {
        let span = self.span(number);
        self.put(number, "outError", constant(Shape::Int(0), span));
        for port in [
            "outErrorConcurrentAccess",
            "outErrorIllegalPosition",
            "outErrorJointFailed",
        ] {
            self.put(number, port, constant(Shape::Bool(false), span));
        }
        let Some((device, axis, robot)) = self.robot(number, entry) else {
            return;
        };
        let (value, at) = self.argument(number, entry, "inPosition");
        let arm = self
            .arms
            .entry(device.clone())
            .or_insert_with(|| super::Arm {
                span: robot,
                active: active.cloned(),
                made_for: number,
                ..super::Arm::default()
            });
        let same = format!("{:?}", arm.active) == format!("{active:?}");
        let earlier = arm.axes.insert(axis, (value, at)).is_some();
        if earlier {
            let message = format!("axis {axis} of `{device}` is commanded twice");
            let help =
                Some("choose between the two values with a `Core::DoubleConditional`".into());
            self.error(fault::CLAIMED_TWICE, span, message, help);
        } else if !same {
            let message =
                format!("axis {axis} of `{device}` has another condition than the others");
            let help = Some("put all axes of a robot into one fragment".to_string());
            self.error(fault::NO_COUNTERPART, span, message, help);
        }
    }
}

fn constant(shape: Shape, span: Span) -> Value {
    Value::Constant(Literal::new(shape, span))
}
