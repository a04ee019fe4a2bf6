"""Conditions and values of sensors: expressions that are computed in the net, each sensor once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Union

from .blocks import Block, Value
from .tools import Net


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
        """The complete net, without the conditions that nothing reads."""
        self.net.remove_unread("Not", "And", "Or", "Latch")
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
