//! Why the executor refuses a request. Plain data, which messages are made from elsewhere; made by the executor's threads,
//! read by the loader.

use rcc_core::frame::PrepareFault;
use rcc_core::plan::{PlanError, Resource};
use serde::{Deserialize, Serialize};

use crate::rehearsal::PredictedViolation;

/// Reason why a value cannot be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputFault {
    /// The plan has no input with this index.
    Unknown,
    /// The input has another number of elements.
    Elements,
    /// An element is infinite, or is not a valid truth value.
    NoValue,
    /// An element is outside the input's range.
    OutOfRange,
    /// The request sets the input twice.
    Twice,
    /// The input is fed by another net.
    Subscribed,
}

/// Why rules cannot be installed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RuleFault {
    /// All rows of the table are in use by rules that can still fire.
    TableFull {
        /// [`crate::rules::RULES_MAX`].
        max: u32,
    },
    /// The condition is not a valid postfix expression.
    Condition,
    /// A value in the condition is outside the net.
    NoSuchValue,
    /// The rule does nothing.
    DoesNothing,
    /// The rule names the same command twice among those that it stops, cancels and starts.
    NamedTwice,
    /// The condition can never hold.
    NeverFires,
    /// The rule starts an arm, but neither has a lease nor says that it goes on without its client.
    NoLease,
    /// No such lease, or it has expired.
    LeaseUnknown,
    /// The number of recordings or their distance is out of range.
    Recording,
    /// The rule records, and stops, cancels or starts commands.
    RecordsOnly,
}

/// Reason for a refusal by the executor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// The bytes are not a valid call: caller and executor are from different builds.
    NotUnderstood,
    /// All rows of the command table are in use.
    TableFull,
    /// No command with this id exists.
    UnknownCommand,
    /// The state of the command ([`rcc_core::message::CommandState`] as a number) does not allow the call.
    WrongState {
        /// The state.
        state: u32,
    },
    /// Another command holds a resource.
    Busy {
        /// Id of the command that holds it.
        holder: u64,
        /// The resource.
        resource: Resource,
    },
    /// The net has no `Cancel` primitive and can only be aborted.
    NotCancelable,
    /// A device that the net commands is not ready for commands.
    DeviceNotReady {
        /// Device index.
        device: u32,
        /// [`rcc_core::message::DeviceState`] as a number.
        state: u32,
        /// Reason number of the driver.
        reason: u32,
    },
    /// The first set-point is not at the position where the device is held (`rcc_core::guard`).
    FirstSetPoint {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// Set-point minus hold set-point, or the set-point that breaks a limit; rad.
        value: f64,
        /// The allowed value.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over stops or starts more commands than this.
    SwitchTooLarge {
        /// [`crate::limits::SWITCH_MAX`].
        max: u32,
    },
    /// A hand-over names the same command twice.
    NamedTwice,
    /// A hand-over starts nets of several rates that are not evaluated in a common cycle within a second.
    NeverTogether,
    /// The first set-point does not continue the motion of the command that the hand-over stops (`rcc_core::guard`).
    Continuation {
        /// Device index.
        device: u32,
        /// Joint, counted from 1.
        joint: u32,
        /// The commanded value: rad, rad/s or rad/s².
        value: f64,
        /// The allowed value.
        limit: f64,
        /// [`rcc_core::guard::ViolationKind`] as a number.
        violation: u32,
    },
    /// A hand-over would release an arm: the command claims it but has no set-point for it in its first cycle.
    LetsGo {
        /// Device index.
        device: u32,
    },
    /// The first cycle of the net ended with a fault ([`rcc_core::message::FaultCode`] as a number).
    FirstCycle {
        /// The fault code.
        code: u32,
    },
    /// The plan failed its check.
    Plan(PlanError),
    /// The start values could not be computed.
    Prepare(PrepareFault),
    /// The rehearsal shows that the net breaks a limit of an arm.
    Foreseen(PredictedViolation),
    /// The nets would need more of a cycle than the budget of the cell.
    Budget {
        /// Expected time of the net, ns.
        needed_ns: u64,
        /// Time of the nets that run in the same cycles, ns.
        in_use_ns: u64,
        /// Budget for all nets together, ns.
        budget_ns: u64,
    },
    /// Another running command publishes or subscribes to the topic with another type or unit.
    OtherTopic {
        /// Id of the other command.
        other: u64,
        /// [`rcc_core::topic::Topic::key`].
        key: u64,
    },
    /// A value cannot be set.
    Input {
        /// Index of the input in the plan.
        input: u32,
        /// The reason.
        fault: InputFault,
    },
    /// A request reads more values or elements than this.
    ReadTooLarge {
        /// [`crate::limits::READ_MAX`].
        values: u32,
        /// [`crate::limits::READ_ELEMENTS_MAX`].
        elements: u32,
    },
    /// A value to be read is outside the net.
    NoSuchValue {
        /// Index of the value in the request.
        value: u32,
    },
    /// A request sets more values or elements than this.
    SetTooLarge {
        /// [`crate::limits::SET_MAX`].
        values: u32,
        /// [`crate::limits::SET_ELEMENTS_MAX`].
        elements: u32,
    },
    /// The executor is too busy now; try again.
    Overloaded,
    /// The executor is stopping.
    Stopping,
    /// The configuration of the cell switches the flight recorder off.
    NoRecorder,
    /// A CANCEL or ABORT arrived before the START had taken effect: the command stays ready.
    Withdrawn,
    /// A rule cannot be installed, or a lease cannot be used.
    Rule {
        /// Index of the rule in the request; 0 for a lease.
        index: u32,
        /// The reason.
        fault: RuleFault,
    },
    /// A rule cannot be installed because of one of its commands.
    RuleCommand {
        /// Index of the rule in the request.
        index: u32,
        /// State of the command ([`rcc_core::message::CommandState`] as a number); 0: it does not exist.
        state: u32,
    },
    /// No rule with this id exists.
    UnknownRule,
    /// The time after which a lease expires is out of range.
    LeaseTime {
        /// [`crate::rules::LEASE_MIN_NS`].
        min_ns: u64,
        /// [`crate::rules::LEASE_MAX_NS`].
        max_ns: u64,
    },
    /// All leases are in use.
    LeasesFull {
        /// [`crate::rules::LEASES_MAX`].
        max: u32,
    },
    /// The command is bound to a lease that has expired or was ended: the client for which it was to run is gone.
    LeaseEnded {
        /// The lease.
        lease: u64,
    },
}
