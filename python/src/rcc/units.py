"""Quantities: numbers with a unit, in SI base units; ``0.1 * m / s`` is written ``0.1 m/s`` into a net."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Union

Powers = tuple[tuple[str, int], ...]


def _combine(left: Powers, right: Powers, sign: int) -> Powers:
    powers = dict(left)
    for unit, power in right:
        powers[unit] = powers.get(unit, 0) + sign * power
    return tuple((unit, power) for unit, power in powers.items() if power)


def _written(powers: Powers) -> str:
    def each(sign: int) -> list[str]:
        chosen = [(unit, sign * power) for unit, power in powers if sign * power > 0]
        return [unit if power == 1 else f"{unit}^{power}" for unit, power in chosen]

    above, below = each(1), each(-1)
    return "/".join(["*".join(above) or "1", *below])


@dataclass(frozen=True)
class Quantity:
    """A number with a unit. Adding different units raises `TypeError`."""

    value: float
    powers: Powers = ()

    def __str__(self) -> str:
        """As nets write it: ``0.1 m/s``."""
        return f"{self.value!r} {_written(self.powers)}" if self.powers else repr(self.value)

    def __mul__(self, other: Number) -> Quantity:
        """Multiplies values and units."""
        right = quantity(other)
        return Quantity(self.value * right.value, _combine(self.powers, right.powers, 1))

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> Quantity:
        """Divides values and units."""
        right = quantity(other)
        return Quantity(self.value / right.value, _combine(self.powers, right.powers, -1))

    def __rtruediv__(self, other: float) -> Quantity:
        """Divides a number by this."""
        return quantity(other) / self

    def __pow__(self, power: int) -> Quantity:
        """Raises to a whole power."""
        return Quantity(self.value**power, tuple((unit, n * power) for unit, n in self.powers if n * power))

    def _same(self, other: Number) -> Quantity:
        right = quantity(other)
        if sorted(right.powers) != sorted(self.powers):
            raise TypeError(f"`{self}` and `{right}` have different units: they cannot be added")
        return right

    def __add__(self, other: Number) -> Quantity:
        """Adds a quantity of the same unit."""
        return Quantity(self.value + self._same(other).value, self.powers)

    __radd__ = __add__

    def __sub__(self, other: Number) -> Quantity:
        """Subtracts a quantity of the same unit."""
        return Quantity(self.value - self._same(other).value, self.powers)

    def __rsub__(self, other: Number) -> Quantity:
        """Subtracts this from a quantity of the same unit."""
        return Quantity(self._same(other).value - self.value, self.powers)

    def __neg__(self) -> Quantity:
        """Changes the sign."""
        return Quantity(-self.value, self.powers)


Number = Union[int, float, Quantity]


def quantity(value: Number) -> Quantity:
    """Turns a number into a quantity without unit."""
    return value if isinstance(value, Quantity) else Quantity(float(value))


def _unit(symbol: str) -> Quantity:
    return Quantity(1.0, ((symbol, 1),))


m, s, kg, rad, K, N, Hz = (_unit(symbol) for symbol in ("m", "s", "kg", "rad", "K", "N", "Hz"))
mm, ms, deg = 1e-3 * m, 1e-3 * s, math.pi / 180 * rad
