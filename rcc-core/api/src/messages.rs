//! Messages for people: why the executor refused a call, and what ended a net, with names instead of numbers. Pure;
//! used by the server's threads.

use rcc_config::diagnostic::closest;
use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::frame::PrepareFault;
use rcc_core::guard::ViolationKind;
use rcc_core::message::{CommandState, DeviceState, FaultCode};
use rcc_core::plan::{PlanError, Resource};
use rcc_core::primitive::ChannelKind;
use rcc_language::names::Names;
use rcc_protocol::ProcessMismatch;
use rcc_protocol::control::{InputFault, Refusal};

use crate::codes::{self, ErrorCode};
use crate::error::ApiError;
use crate::topics;
use motion::motion;
use violation::first_set_point;

mod impedance;
mod motion;
mod rehearsal;
mod rules;
mod violation;

/// Resolves numbers to names: from the configuration, the nets, and the reasons that drivers give.
pub struct NameResolver<'a> {
    /// Configuration of the cell.
    pub config: &'a CellConfig,
    /// Returns `net#id` for a command.
    pub net: &'a dyn Fn(u64) -> String,
    /// Returns the names of a command's net; empty if they are not known.
    pub names: &'a dyn Fn(u64) -> Names,
    /// Returns why the living driver of a device is not attached, if its build or configuration differs.
    pub disagreement: &'a dyn Fn(&str) -> Option<ProcessMismatch>,
    /// Returns a driver's explanation of a reason number of its device.
    pub reason: &'a dyn Fn(&str, u32) -> String,
    /// Returns the current state of a device and its reason, empty if there is none; `None` without an executor.
    pub condition: &'a dyn Fn(&str) -> Option<(DeviceState, String)>,
}

/// The loader has already checked the value, so the names beside the net do not explain this refusal.
fn input_refused(net: &str, input: u32, fault: InputFault) -> (ErrorCode, String, String) {
    let why = match fault {
        InputFault::Unknown => "does not exist",
        InputFault::Elements => "has another number of elements",
        InputFault::NoValue => "accepts only finite numbers and truth values",
        InputFault::OutOfRange => "has a range that does not contain the value",
        InputFault::Twice => "is set twice in one request",
        InputFault::Subscribed => "receives its value from another net",
    };
    (
        codes::INPUT_REFUSED,
        format!("input {input} of {net} {why}"),
        "no input was set; if the value is valid for this input, load the net again".into(),
    )
}

impl NameResolver<'_> {
    /// Returns the id of a motion of a command, or its number if the names do not contain it.
    #[must_use]
    pub fn motion(&self, id: u64, motion: u32) -> String {
        let id = (self.names)(id).motions.get(motion as usize).cloned();
        id.unwrap_or_else(|| format!("motion {motion}"))
    }

    fn device(&self, index: u32) -> Option<&DeviceConfig> {
        self.config.devices.get(index as usize)
    }

    /// Returns a device's name, or its number if the configuration does not contain it.
    #[must_use]
    pub fn device_name(&self, index: u32) -> String {
        self.device(index)
            .map_or_else(|| format!("device {index}"), |device| device.name.clone())
    }

    /// Returns a joint's name; `joint` is counted from 1.
    #[must_use]
    pub fn joint_name(&self, device: u32, joint: u32) -> String {
        let row = (joint as usize).checked_sub(1);
        self.device(device)
            .and_then(|device| device.robot.as_ref())
            .and_then(|robot| robot.joints.get(row?))
            .map_or_else(|| format!("joint {joint}"), |joint| joint.name.clone())
    }

    /// Returns true if all arms of the cell are linear axes: a motion does not say which one it moves.
    fn arms_are_linear(&self) -> bool {
        let mut robots = self
            .config
            .devices
            .iter()
            .filter_map(|device| device.robot.as_ref());
        robots.clone().next().is_some() && robots.all(|robot| robot.arm.is_linear())
    }

    /// Returns a joint's name if it is the same in all arms of the cell; `joint` is counted from 1.
    fn joint_of_any(&self, joint: u32) -> String {
        let robots = self.config.devices.iter().zip(0..);
        let mut names = robots
            .filter(|(device, _)| device.robot.is_some())
            .map(|(_, index)| self.joint_name(index, joint));
        let first = names.next();
        first
            .filter(|first| names.all(|name| name == *first))
            .unwrap_or_else(|| format!("joint {joint}"))
    }

    fn channel_name(&self, device: u32, kind: ChannelKind, channel: u32) -> String {
        let name = self.device(device).and_then(|device| {
            device
                .channels_of(kind)
                .find(|row| row.index == channel)
                .map(|row| row.name.clone())
        });
        let name = name.unwrap_or_else(|| format!("channel {channel}"));
        format!("{}.{name}", self.device_name(device))
    }

    /// Names a resource of a command: `lwr` for an arm, `lwr.torch` for an output.
    #[must_use]
    pub fn resource(&self, id: u64, resource: Resource) -> String {
        match resource {
            Resource::Arm { device } => self.device_name(device),
            Resource::Digital { device, channel } => {
                self.channel_name(device, ChannelKind::DigitalOutput, channel)
            }
            Resource::Analog { device, channel } => {
                self.channel_name(device, ChannelKind::AnalogOutput, channel)
            }
            Resource::Topic { key } => {
                let names = (self.names)(id);
                let topic_use = topics::of_key(&names, key);
                topic_use.map_or("a topic".to_owned(), |topic_use| {
                    format!("topic {}", topic_use.topic)
                })
            }
        }
    }

    /// Converts a refusal to an error with names, values, units and a remedy. `id` is the command that it concerns.
    #[must_use]
    pub fn refusal(&self, id: u64, refusal: Refusal) -> ApiError {
        let net = (self.net)(id);
        let (code, message, help): (ErrorCode, String, String) = match refusal {
            Refusal::NotUnderstood => (
                codes::OTHER_BUILD,
                "the executor could not decode the loader's request".into(),
                "install both from the same build and restart them".into(),
            ),
            Refusal::TableFull => (
                codes::TABLE_FULL,
                format!(
                    "the command table is full: all {} rows are in use",
                    rcc_core::message::COMMANDS_MAX
                ),
                "unload commands that have ended: `rcc-cli ls`, then `rcc-cli unload NAME`".into(),
            ),
            Refusal::UnknownCommand => return unknown(&id.to_string()),
            Refusal::WrongState { state } => wrong_state(&net, CommandState::from_number(state)),
            Refusal::Busy { holder, resource } => self.busy(&net, holder, resource),
            Refusal::NotCancelable => (
                codes::NOT_CANCELABLE,
                format!("{net} has no Cancel primitive and can only be aborted"),
                format!(
                    "use `rcc-cli abort {net}`, or add a `Cancel` that stops the net's motion"
                ),
            ),
            Refusal::DeviceNotReady {
                device,
                state,
                reason,
            } => self.not_ready(&net, device, DeviceState::from_number(state), reason),
            Refusal::FirstSetPoint {
                device,
                joint,
                value,
                limit,
                violation,
            } => first_set_point(
                &net,
                &self.violation(device, joint, value, limit, violation),
                ViolationKind::from_number(violation),
                value,
            ),
            Refusal::SwitchTooLarge { max } => (
                codes::NAMED_TWICE,
                format!("too many commands in a hand-over: it can stop at most {max} and start at most {max}"),
                "split the hand-over into several steps".into(),
            ),
            Refusal::NamedTwice => (
                codes::NAMED_TWICE,
                format!("{net} is named twice"),
                "name each command only once, either to stop it or to start it".into(),
            ),
            Refusal::NeverTogether => (
                codes::NOT_TOGETHER,
                format!("{net} and the nets started with it have no common cycle within a second"),
                "give the nets the same rate and phase, or start them one after the other".into(),
            ),
            Refusal::Continuation {
                device,
                joint,
                value,
                limit,
                violation,
            } => self.discontinuous(&net, device, joint, value, limit, violation),
            Refusal::LetsGo { device } => (
                codes::LETS_GO,
                format!(
                    "{net} has no set-point for {} in its first cycle, so the arm would be released",
                    self.device_name(device)
                ),
                "let the net command the arm from its first cycle on, or stop the other net first and start this one when the arm is at rest"
                    .into(),
            ),
            Refusal::FirstCycle { code } => (
                codes::FIRST_CYCLE,
                format!(
                    "{net} cannot start: its first cycle ends with a fault ({})",
                    FaultCode::from_number(code).name()
                ),
                "nothing was written to the devices; correct the net or its parameters, then load it again".into(),
            ),
            Refusal::Plan(error) => self.plan((id, &net), error),
            Refusal::Prepare(fault) => self.prepare((id, &net), fault),
            Refusal::Foreseen(foreseen) => self.foreseen(id, &foreseen),
            Refusal::Budget {
                needed_ns,
                in_use_ns,
                budget_ns,
            } => over_budget(&net, [needed_ns, in_use_ns, budget_ns]),
            Refusal::OtherTopic { other, key } => self.other_topic(id, other, key),
            Refusal::Input { input, fault } => input_refused(&net, input, fault),
            Refusal::SetTooLarge { values, elements } => (
                codes::INPUT_REFUSED,
                format!("too many values: at most {values} with {elements} elements can be set at a time"),
                "set them in several requests".into(),
            ),
            Refusal::ReadTooLarge { values, elements } => (
                codes::TOO_MANY_PORTS,
                format!("too many ports: at most {values} with {elements} elements can be read at a time"),
                "name fewer ports: `--ports 'move.*'`, or `?ports=move.*`".into(),
            ),
            Refusal::NoSuchValue { value } => (
                codes::UNKNOWN_PORT,
                format!("port {value} of the list is outside the plan of {net}"),
                "the file with the net's names is damaged: load the net again".into(),
            ),
            Refusal::Overloaded => (
                codes::OVERLOADED,
                format!("the executor is overloaded and cannot take {net} now"),
                "try again, or unload other commands first".into(),
            ),
            Refusal::Stopping => (
                codes::STOPPING,
                "the executor is stopping".into(),
                "restart the cell: `rcc-cli up FILE`".into(),
            ),
            Refusal::NoRecorder => (
                codes::NO_RECORDER,
                "the flight recorder is off: the configuration says `recorder: {memory: 0 MB}`".into(),
                "give it memory there (64 MB by default) and restart the cell".into(),
            ),
            Refusal::Withdrawn => (
                codes::WRONG_STATE,
                format!(
                    "the start of {net} was withdrawn before it took effect, by a stop of a client or because its lease has ended; it remains ready"
                ),
                format!("to start it nevertheless: `rcc-cli start {net}`"),
            ),
            Refusal::Rule { index, fault } => {
                rules::fault(&format!("rule {} of the request", index + 1), &net, fault)
            }
            Refusal::RuleCommand { index, state } => {
                rules::command(&format!("rule {} of the request", index + 1), &net, state)
            }
            Refusal::UnknownRule => (
                codes::UNKNOWN_RULE,
                "the rule does not exist, or has been removed".into(),
                "`rcc-cli rules ls` lists all".into(),
            ),
            Refusal::LeaseTime { min_ns, max_ns } => (
                codes::BAD_REQUEST,
                "the time after which the lease expires is out of range".into(),
                format!(
                    "`expires_ms` is at least {} and at most {}",
                    min_ns / 1_000_000,
                    max_ns / 1_000_000
                ),
            ),
            Refusal::LeasesFull { max } => (
                codes::LEASE_REFUSED,
                format!("all {max} leases are in use"),
                "end leases that are no longer needed: `DELETE /leases/NUMBER`".into(),
            ),
            Refusal::LeaseEnded { lease } => (
                codes::UNKNOWN_LEASE,
                format!("{net} is bound to lease {lease}, which has expired or was ended"),
                "bind it to a lease of your own (`POST /leases/ID/commands`), or load it again".into(),
            ),
        };
        ApiError::new(code, message, help)
    }

    fn busy(&self, net: &str, holder: u64, resource: Resource) -> (ErrorCode, String, String) {
        if matches!(resource, Resource::Topic { .. }) {
            return self.published_twice(net, holder, resource);
        }
        let (holder, resource) = ((self.net)(holder), self.resource(holder, resource));
        (
            codes::BUSY,
            format!("{net} needs {resource}, which {holder} holds"),
            format!("wait until {holder} has ended, or cancel it: `rcc-cli cancel {holder}`"),
        )
    }

    fn published_twice(
        &self,
        net: &str,
        holder: u64,
        topic: Resource,
    ) -> (ErrorCode, String, String) {
        let (holder, topic) = ((self.net)(holder), self.resource(holder, topic));
        (
            codes::BUSY,
            format!("{net} publishes {topic}, and so does {holder}, which runs"),
            format!(
                "end {holder} first, or hand over: `rcc-cli start {net} --after-stopping {holder}`"
            ),
        )
    }

    /// One net publishes what the other one subscribes to, with different types or units.
    fn other_topic(&self, id: u64, other: u64, key: u64) -> (ErrorCode, String, String) {
        let says = |id: u64| {
            let names = (self.names)(id);
            let net = (self.net)(id);
            match topics::of_key(&names, key) {
                Some(topic_use) => format!(
                    "{net} {} {} as {}",
                    topic_use.verb(),
                    topic_use.topic,
                    topic_use.kind()
                ),
                None => format!("{net} uses another type for a topic"),
            }
        };
        (
            codes::OTHER_TOPIC,
            format!("{}, and {}, which runs", says(id), says(other)),
            "use the same type and unit in both, or give one of them another topic; `rcc-cli topics` lists all"
                .to_owned(),
        )
    }

    fn not_ready(
        &self,
        net: &str,
        device: u32,
        state: DeviceState,
        reason: u32,
    ) -> (ErrorCode, String, String) {
        let name = self.device_name(device);
        if let Some(why) = (self.disagreement)(&name) {
            return (
                codes::DEVICE_NOT_READY,
                format!(
                    "{net} needs {name}, whose driver is not attached: it was {} than the executor ({why})",
                    why.description()
                ),
                why.remedy(),
            );
        }
        let mut explanation = (self.reason)(&name, reason);
        if explanation.is_empty() {
            // The executor's refusal has no number for a driver that is gone or silent.
            let current = (self.condition)(&name).filter(|(current, _)| *current == state);
            explanation = current.map_or_else(String::new, |(_, reason)| reason);
        }
        let because = because(&explanation);
        let help = match state {
            DeviceState::Offline => {
                format!("find the cause with `rcc-cli doctor device {name}`, then start again")
            }
            DeviceState::Online => {
                format!("make {name} ready at its own controller, then start again")
            }
            DeviceState::Ready => "start again".to_owned(),
            DeviceState::Commanded | DeviceState::Stopping => {
                format!("wait until {name} is at rest, then start again")
            }
        };
        (
            codes::DEVICE_NOT_READY,
            format!("{net} needs {name}, which is {}{because}", state.name()),
            help,
        )
    }

    fn plan(&self, (id, net): (u64, &str), error: PlanError) -> (ErrorCode, String, String) {
        let restart = "install loader and executor from the same build, start both with the same configuration file, and load the \
                       net again";
        let (message, help) = match error {
            PlanError::OtherCatalogue => (
                "loader and executor have different catalogues of primitives".to_owned(),
                restart.to_owned(),
            ),
            PlanError::OtherConfiguration => (
                "loader and executor have different device configurations".to_owned(),
                restart.to_owned(),
            ),
            PlanError::TooLarge => (
                "the plan is too large".to_owned(),
                "split the net into several nets".to_owned(),
            ),
            PlanError::ClaimedTwice { resource } => (
                format!("{} is commanded twice", self.resource(id, resource)),
                "let only one primitive command it".to_owned(),
            ),
            other => (
                format!("the plan is invalid ({other:?})"),
                "this is a bug in the loader: report it with the net".to_owned(),
            ),
        };
        (
            codes::PLAN_REFUSED,
            format!("{net} is rejected: {message}"),
            help,
        )
    }

    fn prepare(&self, (id, net): (u64, &str), fault: PrepareFault) -> (ErrorCode, String, String) {
        let (message, help) = match fault {
            PrepareFault::HoldUnknown { device } => {
                let name = self.device_name(device);
                let state = match (self.condition)(&name) {
                    Some((state, reason)) if state != DeviceState::Ready => {
                        format!(": it is {}{}", state.name(), because(&reason))
                    }
                    // It became ready meanwhile, or there is no device at all, as in a simulation.
                    _ => String::new(),
                };
                (
                    format!("the position of {name} is not known{state}"),
                    format!("find the cause with `rcc-cli doctor device {name}`, then load again"),
                )
            }
            PrepareFault::NoArm { device } => (
                format!("{} has no arm", self.device_name(device)),
                "use a device that has `robot:` in the cell's configuration".to_owned(),
            ),
            PrepareFault::Motion {
                motion: number,
                leg,
                fault,
            } => {
                let (why, help) = motion(
                    fault,
                    |joint| self.joint_of_any(joint),
                    self.arms_are_linear(),
                );
                let id = self.motion(id, number);
                (format!("{id}, leg {}: {why}", leg + 1), help)
            }
        };
        (
            codes::NOT_PREPARED,
            format!("{net} is rejected: {message}"),
            help,
        )
    }
}

/// Returns the reason of a device's state in parentheses; empty without a reason.
fn because(reason: &str) -> String {
    match reason {
        "" => String::new(),
        _ => format!(" ({reason})"),
    }
}

/// Returns the error for a name or id that does not exist.
#[must_use]
pub fn unknown(name: &str) -> ApiError {
    ApiError::new(
        codes::UNKNOWN_COMMAND,
        format!("command `{name}` not found"),
        "`rcc-cli ls` lists all commands; `rcc-cli load FILE` loads one",
    )
}

/// Returns the error for a name that none of the loaded nets has; suggests the one that is most like it.
#[must_use]
pub fn unknown_among<'n>(name: &str, nets: impl Iterator<Item = &'n str>) -> ApiError {
    match closest(name, nets.filter(|net| !net.is_empty())) {
        Some(near) => ApiError::new(
            codes::UNKNOWN_COMMAND,
            format!("command `{name}` not found"),
            format!("did you mean `{near}`? `rcc-cli ls` lists all commands"),
        ),
        None => unknown(name),
    }
}

fn over_budget(net: &str, times_ns: [u64; 3]) -> (ErrorCode, String, String) {
    let [needed, in_use, budget] = times_ns.map(|ns| format!("{:.1} µs", ns as f64 * 1e-3));
    let in_use = match times_ns[1] {
        0 => "nothing is in use yet".to_owned(),
        _ => format!("{in_use} are in use"),
    };
    let help = if times_ns[1] == 0 {
        format!(
            "`rcc-cli explain {net}` shows what is expensive: make the net smaller, give it `every: 2` or more, or raise \
             `executor: {{budget: …}}`"
        )
    } else {
        format!(
            "end another net first (`rcc-cli ls` shows the cost of each), make this one smaller (`rcc-cli explain \
             {net}`), or raise `executor: {{budget: …}}`"
        )
    };
    (
        codes::OVER_BUDGET,
        format!(
            "{net} cannot start: it is expected to take {needed} of a cycle; {in_use}, and the budget of all nets is {budget}"
        ),
        help,
    )
}

fn wrong_state(net: &str, state: CommandState) -> (ErrorCode, String, String) {
    let help = match state {
        CommandState::Loading => "wait until it is ready: `rcc-cli state`".to_owned(),
        CommandState::Rejected => {
            format!("`rcc-cli state {net}` shows why and the remedy; then load the text again")
        }
        CommandState::Ready => format!("start it first: `rcc-cli start {net}`"),
        CommandState::Running | CommandState::Canceling => {
            format!("wait until it has ended, or cancel it: `rcc-cli cancel {net}`")
        }
        CommandState::Terminated | CommandState::None => {
            "a command runs only once: load its text again".to_owned()
        }
    };
    (
        codes::WRONG_STATE,
        format!("{net} is {}", state.name()),
        help,
    )
}
