"""Actions of outputs: on, off, a pulse, and a gripper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .actions import Action, End
from .blocks import Held
from .expressions import Expr, Scope, analog_input, digital_input
from .units import Number, quantity, s

#: How long `on` and `off` last: longer than any device takes until it has the value.
SETTLE = 0.1 * s
#: How long a pulse lasts that names no time.
PULSE = 0.1 * s


@dataclass(frozen=True)
class Output:
    """A digital output of a device."""

    device: str
    channel: str

    def on(self) -> Switch:
        """True. After its net this holds only if the channel has `on_release: hold`."""
        return Switch(self, True)

    def off(self) -> Switch:
        """False."""
        return Switch(self, False)

    def pulse(self, time: Number = PULSE) -> Pulse:
        """True for a time, s; 0.1 s by default."""
        return Pulse(self, time)


class Device:
    """A device of the cell; its digital outputs are attributes: `rcc.Device("io").lamp.on()`."""

    def __init__(self, device: str) -> None:
        """The name is that in the cell's configuration."""
        self.device = device

    def output(self, channel: str) -> Output:
        """A digital output."""
        return Output(self.device, channel)

    def input(self, channel: str) -> Expr:
        """A digital input."""
        return digital_input(self.device, channel)

    def analog(self, channel: str) -> Expr:
        """An analog input."""
        return analog_input(self.device, channel)

    def __getattr__(self, channel: str) -> Output:
        """A digital output by its name."""
        if channel.startswith("_"):
            raise AttributeError(channel)
        return self.output(channel)


@dataclass(frozen=True)
class Switch(Action):
    """An output that gets a value."""

    output: Output
    value: bool
    name: str = "switch"

    def build(self, scope: Scope) -> End:
        """Adds the output; it ends when the device has the value."""
        scope.net.DigitalOutput(device=self.output.device, channel=self.output.channel, in_=self.value)
        return End(scope.net.OnDelay(in_=True, time=SETTLE) | scope.cancel)

    def held(self) -> list[Held]:
        """The value must hold after the net."""
        return [Held(self.output.device, self.output.channel, self.value)]


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
        return End(ended)


@dataclass(frozen=True)
class Gripper:
    """A gripper with one output, and inputs that tell whether it is closed or open.

    Without an input, closing or opening takes `time`; with one, it lasts until the input is true, and `time` is the
    longest time, s: a gripper that is not there by then is a failure, and what should follow is not begun. Its output
    needs `on_release: hold`, or the part would fall after the net.
    """

    output: Output
    closed: Expr | None = None
    opened: Expr | None = None
    time: Number = field(default=2.0)
    closes_with: bool = True

    def close(self) -> Grip:
        """Closes."""
        return Grip(self, self.closes_with, self.closed, "close")

    def open(self) -> Grip:
        """Opens."""
        return Grip(self, not self.closes_with, self.opened, "open")


@dataclass(frozen=True)
class Grip(Action):
    """Closing or opening a gripper."""

    gripper: Gripper
    value: bool
    there: Expr | None
    name: str

    @property
    def output(self) -> Output:
        """The gripper's output."""
        return self.gripper.output

    def build(self, scope: Scope) -> End:
        """Adds the output and what tells the end."""
        scope.net.DigitalOutput(device=self.output.device, channel=self.output.channel, in_=self.value)
        end = self.end(scope, True)
        return End(end.done | scope.cancel, end.outcomes, end.failures)

    def end(self, scope: Scope, begun: Any) -> End:
        """How it ends if it began when `begun` became true."""
        late = scope.net.OnDelay(in_=begun, time=self.gripper.time)
        if self.there is None:
            return End(late)
        there = scope.net.Latch(
            set=scope.net.And(a=begun, b=scope.net.OrElse(in_=self.there.on(scope), other=False)), reset=False
        )
        time = quantity(self.gripper.time).value
        failure = f"gripper {self.output.device}.{self.output.channel} did not {self.name} within {time:g} s"
        return End(there | late, {f"{self.name.rstrip('e')}ed": there, "timed_out": ~there}, {"timed_out": failure})

    def held(self) -> list[Held]:
        """The value must hold after the net."""
        return [Held(self.output.device, self.output.channel, self.value)]
