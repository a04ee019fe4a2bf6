"""Actions: what an arm and its outputs do, as values that become nets.

`arm.lin(pose, until=abs(arm.force.z) > 12 * rcc.N)` says what is to be done; `action.net()` is the net that does it.
The reaction is in the net, in the cycle, never in Python.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Union

from .blocks import Action as Base
from .blocks import Block, Port, Value
from .tools import Net
from .units import Number

#: A pose as position (m) with the tool down, or as nets write it: `{"xyz": …, "rpy": …}`.
Pose = Union[Sequence[Number], Mapping[str, Any]]


class Scope:
    """A net that is being made for actions: one `Cancel`, and each sensor once."""

    def __init__(self, name: str) -> None:
        """An empty net with a `Cancel`."""
        self.net = Net(name)
        self.cancel = self.net.Cancel(name="cancel").requested
        self._sensors: dict[tuple[str, ...], Block] = {}

    def sensor(self, kind: str, **parameters: str) -> Block:
        """The only instance of a sensor with these parameters."""
        key = (kind, *parameters.values())
        if key not in self._sensors:
            self._sensors[key] = self.net.add(kind, parameters=parameters)
        return self._sensors[key]

    def discard_unread(self, block: Block, outputs: Sequence[str]) -> None:
        """Says of each output that nothing reads that this is on purpose."""
        read = str(self.net.document())
        self.net.discard(*(block[output] for output in outputs if f"'{block.name}.{output}'" not in read))

    def finish(self) -> Net:
        """The complete net."""
        for (kind, *_), block in self._sensors.items():
            if kind == "ForceTorque":
                self.discard_unread(block, ("fx", "fy", "fz", "tx", "ty", "tz"))
        return self.net


class Expr:
    """A value that a net computes from its sensors: compare it, and calculate with it."""

    def __init__(self, build: Callable[[Scope], Any]) -> None:
        """`build` adds what computes the value, and returns its port."""
        self._build = build

    def on(self, scope: Scope) -> Any:
        """The port in this net."""
        return self._build(scope)

    def _with(self, other: Operand, join: Callable[[Any, Any], Any]) -> Expr:
        return Expr(lambda scope: join(self.on(scope), _on(other, scope)))

    def __add__(self, other: Operand) -> Expr:
        """Adds."""
        return self._with(other, lambda a, b: a + b)

    def __sub__(self, other: Operand) -> Expr:
        """Subtracts."""
        return self._with(other, lambda a, b: a - b)

    def __mul__(self, other: Operand) -> Expr:
        """Multiplies."""
        return self._with(other, lambda a, b: a * b)

    def __truediv__(self, other: Operand) -> Expr:
        """Divides."""
        return self._with(other, lambda a, b: a / b)

    def __gt__(self, other: Operand) -> Expr:
        """True while this is greater."""
        return self._with(other, lambda a, b: a > b)

    def __lt__(self, other: Operand) -> Expr:
        """True while this is less."""
        return self._with(other, lambda a, b: a < b)

    def __and__(self, other: Operand) -> Expr:
        """True while both are."""
        return self._with(other, lambda a, b: a & b)

    def __or__(self, other: Operand) -> Expr:
        """True while one is."""
        return self._with(other, lambda a, b: a | b)

    def __invert__(self) -> Expr:
        """True while this is false."""
        return Expr(lambda scope: ~self.on(scope))

    def __abs__(self) -> Expr:
        """The absolute value."""
        return Expr(lambda scope: abs(self.on(scope)))

    def __bool__(self) -> bool:
        """Refuses: the value exists in the cycle only."""
        raise TypeError("a sensor has a value in each cycle, none in Python: use `&`, `|`, `~`, not `and`, `or`, `not`")


Operand = Union[Expr, Value]


def _on(value: Operand, scope: Scope) -> Any:
    return value.on(scope) if isinstance(value, Expr) else value


@dataclass(frozen=True)
class End:
    """How an action ends: what is true then, and why it was stopped, if it has a condition."""

    done: Port
    stopped: Block | None = None

    def outcomes(self, stopped: Block) -> dict[str, Block]:
        """The named outcomes of its net."""
        return {"stopped": self.done & stopped, "arrived": self.done & ~stopped}


class Action(Base):
    """Something to do, to be run by `cell.run(action)`, or loaded as a net by `cell.load(action)`."""

    name: str

    @abstractmethod
    def build(self, scope: Scope) -> End:
        """Adds what does it; returns how it ends."""

    def net(self, name: str | None = None) -> Net:
        """The net that does it."""
        scope = Scope(name or self.name)
        end = self.build(scope)
        scope.net.Termination(done=end.done if end.stopped is None else end.outcomes(end.stopped), name="end")
        return scope.finish()

    def steps(self) -> list[Net]:
        """The nets, one after the other."""
        return [self.net()]


@dataclass(frozen=True)
class Output:
    """A digital output of a device."""

    device: str
    channel: str

    def pulse(self, time: Number) -> Pulse:
        """True for a time, s."""
        return Pulse(self, time)


@dataclass(frozen=True)
class Pulse(Action):
    """An output that is true for a time, or until CANCEL."""

    output: Output
    time: Number
    name: str = "pulse"

    def build(self, scope: Scope) -> End:
        """Adds the clock and the output."""
        over = scope.net.Greater(a=scope.net.Time().out, b=self.time)
        ended = over | scope.cancel
        scope.net.DigitalOutput(device=self.output.device, channel=self.output.channel, in_=~ended)
        return End(ended.out)


@dataclass(frozen=True)
class Switching:
    """An output that is on on a part of a path, while the motion goes on."""

    output: Output
    on: Number
    off: Number


@dataclass(frozen=True)
class Motion(Action):
    """A motion of an arm; CANCEL stops it on its path."""

    arm: Arm
    kind: str
    parameters: dict[str, Any]
    condition: Expr | None = None
    outputs: tuple[Switching, ...] = ()
    name: str = "motion"

    def until(self, condition: Expr) -> Motion:
        """Stops on the path when the condition is true, or null; the outcome is `stopped`, otherwise `arrived`."""
        return replace(self, condition=condition if self.condition is None else self.condition | condition)

    def switch(self, output: Output, *, on: Number, off: Number) -> Motion:
        """An output that is true between two distances of the path, m, and only while the motion goes on."""
        return replace(self, outputs=(*self.outputs, Switching(output, on, off)))

    def build(self, scope: Scope) -> End:
        """Adds the motion, its reactions and its outputs."""
        net, stop, stopped = scope.net, scope.cancel, None
        if self.condition is not None:
            # Null counts as true: an unknown condition must stop the motion, and must not keep the net from ending.
            known = net.OrElse(in_=self.condition.on(scope), other=True)
            stopped = net.Latch(set=known, reset=False)
            stop = net.Or(a=stop, b=stopped).out
        inputs = {"stop": stop}
        move = net.add(self.kind, parameters={"device": self.arm.device, **self.parameters}, inputs=inputs)
        net.JointPositionCommand(device=self.arm.device, position=move.joints)
        for each in self.outputs:
            burns = (move.distance > each.on) & (move.distance < each.off) & ~(stop | move.done)
            net.DigitalOutput(device=each.output.device, channel=each.output.channel, in_=burns)
        return End(move.done, stopped)


@dataclass(frozen=True)
class Together(Action):
    """Actions that begin in the same cycle; it ends when all have ended."""

    actions: tuple[Action, ...]
    name: str = "parallel"

    def build(self, scope: Scope) -> End:
        """Adds all of them to one net."""
        done, *others = (action.build(scope).done for action in self.actions)
        for other in others:
            # An end stays true: `done` of a motion does, and so does a time that is over.
            done = (done & other).out
        return End(done)


@dataclass(frozen=True)
class Steps(Base):
    """Actions one after the other, each a net of its own; the arm rests in between."""

    actions: tuple[Base, ...] = field(default_factory=tuple)

    def steps(self) -> list[Any]:
        """The nets of all actions."""
        return [net for action in self.actions for net in action.steps()]


def parallel(first: Action, *others: Action) -> Together:
    """Actions in one net: they begin in the same cycle, and a CANCEL reaches all."""
    return Together((first, *others))


def sequence(first: Base, *others: Base) -> Steps:
    """Actions one after the other. For motions without a rest in between see `Arm.path`."""
    return Steps((first, *others))


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
        """Legs with blends in one motion; see `MotionSequence`."""
        return Motion(self, "MotionSequence", {"path": legs, **parameters}, until, name="path")


class Force:
    """A force or torque by its axes."""

    def __init__(self, device: str, kind: str) -> None:
        """`kind` is `f` or `t`."""
        self._device, self._kind = device, kind

    def _axis(self, axis: str) -> Expr:
        return Expr(lambda scope: scope.sensor("ForceTorque", device=self._device)[self._kind + axis])

    @property
    def x(self) -> Expr:
        """Along x."""
        return self._axis("x")

    @property
    def y(self) -> Expr:
        """Along y."""
        return self._axis("y")

    @property
    def z(self) -> Expr:
        """Along z."""
        return self._axis("z")


def digital_input(device: str, channel: str) -> Expr:
    """A digital input of a device."""
    return Expr(lambda scope: scope.sensor("DigitalInput", device=device, channel=channel))


def analog_input(device: str, channel: str) -> Expr:
    """An analog input of a device."""
    return Expr(lambda scope: scope.sensor("AnalogInput", device=device, channel=channel))


def pose(to: Pose) -> dict[str, Any]:
    """A pose; a position alone has the tool down."""
    if isinstance(to, Mapping):
        return dict(to)
    return {"xyz": list(to), "rpy": [0, math.pi, 0]}
