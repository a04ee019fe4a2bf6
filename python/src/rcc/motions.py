"""Motions of an arm as actions.

`arm.lin(pose, until=abs(arm.force.z) > 12 * rcc.N)` says what is to be done; `action.net()` is the net that does it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Union

from .actions import Action, End, Steps
from .blocks import UNSET, Value
from .blocks import Action as Base
from .expressions import Expr, Force, Scope, digital_input
from .outputs import Grip, Output, Pulse, Switch
from .units import Number

#: A pose as position (m) with the tool down, or as nets write it: `{"xyz": …, "rpy": …}`.
Pose = Union[Sequence[Number], Mapping[str, Any]]
#: What an `at` does: `torch.on`, `lamp.pulse(0.2)`, `gripper.open`.
OutputAction = Union[Switch, Pulse, Grip]
#: Parameters that a leg of a `MotionSequence` takes from a motion.
LEG = {
    "JointMotion": ("scale",),
    "LinearMotion": (
        "velocity", "acceleration", "jerk", "angular_velocity", "angular_acceleration", "angular_jerk", "scale",
        "arm_angle", "elbow",
    ),
}  # fmt: skip
LEG["CircularMotion"] = LEG["LinearMotion"]


@dataclass(frozen=True)
class Switching:
    """An output that is on on a part of a path, while the motion goes on."""

    output: Output
    on: Number
    off: Number


@dataclass(frozen=True)
class Event:
    """Something that is done at a place of a path: `port` of the motion exceeds `value`."""

    port: str
    value: Number
    do: OutputAction


@dataclass(frozen=True)
class Motion(Action):
    """A motion of an arm; CANCEL stops it on its path."""

    arm: Arm
    kind: str
    parameters: dict[str, Any]
    condition: Expr | None = None
    outputs: tuple[Switching, ...] = ()
    events: tuple[Event, ...] = ()
    monitors: tuple[tuple[str, Number], ...] = ()
    name: str = "motion"

    def until(self, condition: Expr) -> Motion:
        """Stops on the path when the condition is true, or null; the outcome is `stopped`, otherwise `arrived`."""
        return replace(self, condition=condition if self.condition is None else self.condition | condition)

    def while_(self, condition: Expr) -> Motion:
        """Goes on while the condition is true; stops on the path when it is false, or null."""
        return self.until(~condition)

    def switch(self, output: Output, *, on: Number, off: Number) -> Motion:
        """An output that is true between two distances of the path, m, and only while the motion goes on."""
        return replace(self, outputs=(*self.outputs, Switching(output, on, off)))

    def at(
        self,
        *,
        path: float | None = None,
        distance: Number | None = None,
        do: OutputAction | Callable[[], OutputAction],
    ) -> Motion:
        """Does something on the way: at a part of the path (0 to 1), or at a distance from its beginning, m.

        An output keeps what `at` gave it until the next `at`, or until the net ends and its `on_release` applies. If
        the motion stops early, an output that a later `at` would switch off goes off at once.
        """
        if (path is None) == (distance is None):
            raise TypeError("give either `path`, 0 to 1, or `distance`, m")
        if path is not None and not 0 <= path < 1:
            raise ValueError(f"path: {path} is not a part of the path: give 0 to less than 1, or `distance`")
        action = do() if callable(do) else do
        if not isinstance(action, (Switch, Pulse, Grip)):
            raise TypeError(f"`do` takes what an output or a gripper does, not {action!r}")
        where = ("progress", path) if path is not None else ("distance", distance)
        return replace(self, events=(*self.events, Event(where[0], where[1] or 0.0, action)))

    def monitor(self, *ports: str, rate: Number = 1000) -> Motion:
        """Publishes outputs of the motion (`joints`, `pose`, …) at a rate, Hz, for `cell.recording`."""
        return replace(self, monitors=(*self.monitors, *((port, rate) for port in ports)))

    def build(self, scope: Scope) -> End:
        """Adds the motion, its reactions and its outputs."""
        net, stop, stopped = scope.net, scope.cancel, None
        if self.condition is not None:
            # Null counts as true: an unknown condition must stop the motion, and must not keep the net from ending.
            known = net.OrElse(in_=self.condition.on(scope), other=True)
            stopped = net.Latch(set=known, reset=False)
            stop = net.Or(a=stop, b=stopped).out
        inputs = {"stop": stop}
        parameters = {"device": self.arm.device, **self.parameters}
        if "path" in parameters:
            parameters["path"] = [_with_conditions(leg, scope) for leg in parameters["path"]]
        move = net.add(self.kind, parameters=parameters, inputs=inputs)
        net.JointPositionCommand(device=self.arm.device, position=move.joints)
        for each in self.outputs:
            burns = (move.distance > each.on) & (move.distance < each.off) & ~(stop | move.done)
            net.DigitalOutput(device=each.output.device, channel=each.output.channel, in_=burns)
        for port, rate in self.monitors:
            net.Monitor(value=move[port], rate=rate, name=f"{move.name}_{port}")
        end = End(move.done)
        if stopped is not None:
            end = End(move.done, {"stopped": stopped, "arrived": ~stopped})
        outputs = dict.fromkeys(event.do.output for event in self.events)
        for output in outputs:
            events = [event for event in self.events if event.do.output == output]
            end = _add_events(scope, output, events, (move, stop), end)
        return end

    def leg(self) -> dict[str, Any]:
        """The motion as a leg of a `MotionSequence`."""
        given = {key: value for key, value in self.parameters.items() if value is not UNSET}
        if self.kind == "JointMotion":
            goal = {"joints": given.pop("to")} if "to" in given else {"pose": given.pop("pose")}
            leg: dict[str, Any] = {"ptp": goal}
        elif self.kind == "LinearMotion":
            leg = {"lin": given.pop("to")}
        elif self.kind == "CircularMotion":
            leg = {"circ": {"via": {"xyz": list(given.pop("via"))}, "to": given.pop("to")}}
        elif self.kind == "MotionSequence" and set(given) == {"path"} and len(given["path"]) == 1:
            return dict(given["path"][0])
        else:
            raise ValueError(f"`{self.name}` cannot be blended with other motions: use ptp, lin, circ or move")
        taken = LEG[self.kind]
        if left := [key for key in given if key not in taken]:
            raise ValueError(f"`{left[0]}` of `{self.name}` is not possible in a blended sequence, which takes {taken}")
        return {**leg, **given}


def _with_conditions(leg: Mapping[str, Any], scope: Scope) -> dict[str, Any]:
    """The leg with its `wait` and `until` as ports of the net."""
    return {key: part.on(scope) if isinstance(part, Expr) else part for key, part in leg.items()}


def _add_events(scope: Scope, output: Output, events: list[Event], motion: tuple[Any, Any], end: End) -> End:
    """Adds what happens to one output on the way; returns the end of the motion with it."""
    net, (move, stop) = scope.net, motion
    reached = [(net.Greater(a=move[event.port], b=event.value), event.do) for event in events]
    pulses = [net.Pulse(in_=level, time=do.time) for level, do in reached if isinstance(do, Pulse)]
    values = [(level, do) for level, do in reached if not isinstance(do, Pulse)]
    if pulses and values:
        raise ValueError(f"{output.device}.{output.channel} gets pulses and values: give it one of both")
    if pulses:
        value = _any(pulses) & ~scope.cancel
        net.DigitalOutput(device=output.device, channel=output.channel, in_=value)
        return End(end.done & ~value, end.outcomes, end.failures)
    edges = [(net.RisingEdge(in_=level, initial=False), do.value) for level, do in values]
    on, off = ([edge for edge, value in edges if value is which] for which in (True, False))
    state = net.Latch(set=_any(on), reset=_any([*off, stop, move.done]) if on and off else _any(off))
    # Null before the first event: the output keeps what it has.
    known = _any([level for level, _ in values])
    net.DigitalOutput(
        device=output.device, channel=output.channel, in_=net.NullIf(in_=state, condition=~known)
    )
    for level, do in values:
        if isinstance(do, Grip):
            end = _await_grip(level, do.end(scope, level), end)
    return end


def _await_grip(begun: Any, grip: End, end: End) -> End:
    """The end of a motion that also waits for a gripper, if that began to move."""
    done = end.done & (grip.done | ~begun)
    failed = {name: begun & grip.outcomes[name] for name in grip.failures}
    if not failed:
        return End(done, end.outcomes, end.failures)
    fine = ~_any(list(failed.values()))
    good = {name: holds & fine for name, holds in end.outcomes.items()} or {"arrived": fine}
    return End(done, {**failed, **good}, {**end.failures, **grip.failures})


def _any(conditions: Sequence[Any]) -> Any:
    """True while one of them is."""
    if not conditions:
        return False
    first, *others = conditions
    for other in others:
        first = first | other
    return first


def sequence(first: Base, *others: Base, blend: Number | None = None) -> Any:
    """Actions one after the other.

    Without `blend` each is a net of its own, started by this program, and the arm rests in between. With `blend` (m)
    they are motions of one arm that become one motion with rounded corners, to which `until`, `switch` and `at` apply.
    """
    if blend is None:
        return Steps((first, *others))
    motions: list[Motion] = []
    for action in (first, *others):
        if not isinstance(action, Motion):
            raise TypeError(f"only motions can be blended, not `{getattr(action, 'name', action)}`: use `.at(…)`")
        if action.condition is not None or action.outputs or action.events or action.monitors:
            raise TypeError("give `until`, `switch` and `at` to the blended sequence, not to its motions")
        motions.append(action)
    arms = list(dict.fromkeys(motion.arm.device for motion in motions))
    if len(arms) > 1:
        raise ValueError(f"motions of {' and '.join(arms)} cannot be blended: use `rcc.parallel`")
    legs = [motion.leg() for motion in motions]
    legs = [*({**leg, "blend": blend} for leg in legs[:-1]), legs[-1]]
    return Motion(motions[0].arm, "MotionSequence", {"path": legs}, name="sequence")


class Arm:
    """An arm of the cell by the name of its device."""

    def __init__(self, device: str) -> None:
        """The name is that in the cell's configuration."""
        self.device = device

    @property
    def force(self) -> Force:
        """Force at the wrist, N; axes as in `ForceTorque`."""
        return Force(self.device, "f")

    @property
    def torque(self) -> Force:
        """Torque at the wrist, N·m."""
        return Force(self.device, "t")

    def input(self, channel: str) -> Expr:
        """A digital input of the arm's controller."""
        return digital_input(self.device, channel)

    def output(self, channel: str) -> Output:
        """A digital output of the arm's controller."""
        return Output(self.device, channel)

    def move(
        self,
        to: Pose | None = None,
        *,
        by: Pose | None = None,
        frame: str = "base",
        until: Expr | None = None,
        **parameters: Value,
    ) -> Motion:
        """The motion that fits its goal.

        `to` a pose, or a position with the tool down: `lin`; `to` more numbers, the joints: `ptp`; `by` a displacement
        of the flange (m, or `{"xyz": …, "rpy": …}`) in axes of its `frame`, `base` or `tool`, from where the arm is.
        """
        if (to is None) == (by is None):
            raise TypeError("give either the goal `to`, or the displacement `by`")
        if to is not None:
            if frame != "base":
                raise TypeError("`frame` belongs to `by`")
            joints = not isinstance(to, Mapping) and len(to) != 3
            return (self.ptp if joints else self.lin)(to, until=until, **parameters)
        step = dict(by) if isinstance(by, Mapping) else {"xyz": list(by or ()), "rpy": [0, 0, 0]}
        leg = {"lin": step, "relative": frame, **parameters}
        return Motion(self, "MotionSequence", {"path": [leg]}, until, name="move")

    def ptp(
        self, to: Sequence[Number] | Mapping[str, Any], *, until: Expr | None = None, **parameters: Value
    ) -> Motion:
        """All joints together to joint positions (rad), or to a pose `{"xyz": …, "rpy": …}`; see `JointMotion`."""
        goal: dict[str, Any] = {"pose": to} if isinstance(to, Mapping) else {"to": to}
        return Motion(self, "JointMotion", {**goal, **parameters}, until, name="ptp")

    def lin(self, to: Pose, *, until: Expr | None = None, **parameters: Value) -> Motion:
        """A line of the flange to a pose; see `LinearMotion`."""
        return Motion(self, "LinearMotion", {"to": pose(to), **parameters}, until, name="lin")

    def circ(self, via: Sequence[Number], to: Pose, *, until: Expr | None = None, **parameters: Value) -> Motion:
        """An arc of the flange through a point; see `CircularMotion`."""
        return Motion(self, "CircularMotion", {"via": via, "to": pose(to), **parameters}, until, name="circ")

    def path(self, legs: Sequence[Mapping[str, Any]], *, until: Expr | None = None, **parameters: Value) -> Motion:
        """Legs with blends in one motion; see `MotionSequence`. `wait` and `until` of a leg are conditions."""
        return Motion(self, "MotionSequence", {"path": legs, **parameters}, until, name="path")


def pose(to: Pose) -> dict[str, Any]:
    """A pose; a position alone has the tool down."""
    if isinstance(to, Mapping):
        return dict(to)
    return {"xyz": list(to), "rpy": [0, math.pi, 0]}
