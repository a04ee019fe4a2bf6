"""Nets as Python objects: blocks, their ports, and operators on ports."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, Union

from .units import Quantity


class _Unset:
    def __repr__(self) -> str:
        return "UNSET"


#: An argument that was not given: the primitive's default applies.
UNSET: Any = _Unset()

Value = Union[None, bool, int, float, str, Quantity, Sequence[Any], Mapping[str, Any]]
Source = Union["Port", "Block", Value]
Outcomes = Mapping[str, Source]
B = TypeVar("B", bound="Block")


def constant(value: Any) -> Any:
    """A value as nets write it: quantities become text such as ``0.1 m/s``."""
    if isinstance(value, Quantity):
        return str(value) if value.powers else value.value
    if isinstance(value, Mapping):
        return {str(key): constant(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [constant(part) for part in value]
    if hasattr(value, "tolist"):  # an array or a number of numpy
        return constant(value.tolist())
    return value


class _Operators:
    """Operators add the primitive that computes them to the net of their operands."""

    def _port(self) -> Port:
        raise NotImplementedError

    def _with(self, kind: str, a: Source, b: Source) -> Block:
        net = self._port().block.net
        return net._add(Block, None, {}, {"a": a, "b": b}, kind)

    def _of(self, kind: str) -> Block:
        return self._port().block.net._add(Block, None, {}, {"in": self._port()}, kind)

    def __add__(self, other: Source) -> Block:
        """Adds (`Add`)."""
        return self._with("Add", self._port(), other)

    def __radd__(self, other: Source) -> Block:
        """Adds (`Add`)."""
        return self._with("Add", other, self._port())

    def __sub__(self, other: Source) -> Block:
        """Subtracts (`Subtract`)."""
        return self._with("Subtract", self._port(), other)

    def __rsub__(self, other: Source) -> Block:
        """Subtracts (`Subtract`)."""
        return self._with("Subtract", other, self._port())

    def __mul__(self, other: Source) -> Block:
        """Multiplies (`Multiply`)."""
        return self._with("Multiply", self._port(), other)

    def __rmul__(self, other: Source) -> Block:
        """Multiplies (`Multiply`)."""
        return self._with("Multiply", other, self._port())

    def __truediv__(self, other: Source) -> Block:
        """Divides (`Divide`)."""
        return self._with("Divide", self._port(), other)

    def __rtruediv__(self, other: Source) -> Block:
        """Divides (`Divide`)."""
        return self._with("Divide", other, self._port())

    def __gt__(self, other: Source) -> Block:
        """Compares (`Greater`)."""
        return self._with("Greater", self._port(), other)

    def __lt__(self, other: Source) -> Block:
        """Compares (`Less`)."""
        return self._with("Less", self._port(), other)

    def __and__(self, other: Source) -> Block:
        """Joins truth values (`And`)."""
        return self._with("And", self._port(), other)

    def __or__(self, other: Source) -> Block:
        """Joins truth values (`Or`)."""
        return self._with("Or", self._port(), other)

    def __invert__(self) -> Block:
        """Inverts a truth value (`Not`)."""
        return self._of("Not")

    def __neg__(self) -> Block:
        """Changes the sign (`Negate`)."""
        return self._of("Negate")

    def __abs__(self) -> Block:
        """Takes the absolute value (`Abs`)."""
        return self._of("Abs")

    def __bool__(self) -> bool:
        """Refuses: the value exists in the cycle only, not in Python."""
        raise TypeError(
            f"`{self._port()}` has a value in each cycle of the running net, none in Python: "
            "use `&`, `|`, `~` or `net.Select(…)` instead of `and`, `or`, `not`, `if`"
        )


class Port(_Operators):
    """An output of a block."""

    def __init__(self, block: Block, name: str) -> None:
        """Names an output; the cell checks that the block has it."""
        self.block, self.name = block, name

    def _port(self) -> Port:
        return self

    def __str__(self) -> str:
        """As nets write it: ``move.done``."""
        return f"{self.block.name}.{self.name}"

    __repr__ = __str__


class Block(_Operators):
    """An instance of a primitive; where a port is expected it stands for its output `out`."""

    def __init__(self, net: Net, name: str, kind: str) -> None:
        """Made by the methods of `Net`."""
        self.net, self.name, self.kind = net, name, kind

    def _port(self) -> Port:
        return self["out"]

    def __getitem__(self, output: str) -> Port:
        """An output by its name."""
        return Port(self, output)

    def __getattr__(self, output: str) -> Port:
        """An output of a block that operators made."""
        if output.startswith("_"):
            raise AttributeError(output)
        return Port(self, output.rstrip("_"))

    def __repr__(self) -> str:
        """Type and name."""
        return f"<{self.kind} {self.name} of net {self.net.name}>"


class Net:
    """A net: blocks that are evaluated together in each cycle."""

    def __init__(self, name: str, description: str = "") -> None:
        """An empty net; names begin with a letter."""
        self.name, self.description = name, description
        self._primitives: dict[str, dict[str, Any]] = {}
        self._discard: list[str] = []
        self._extra: dict[str, Any] = {}
        #: Outcomes that mean failure, with their descriptions: `cell.run` raises `ActionFailed` for them.
        self.failures: dict[str, str] = {}

    def discard(self, *ports: Port) -> None:
        """Says that these outputs are left unread on purpose."""
        self._discard += [str(port) for port in ports]

    def set(self, key: str, value: Value) -> None:
        """Sets a property of the whole net, such as `rate` or `on_device_loss`."""
        self._extra[key] = constant(value)

    def add(self, kind: str, name: str | None = None, /, **arguments: Any) -> Block:
        """Adds a fragment or a primitive by its type's name: `parameters={…}`, `inputs={…}`."""
        unknown = set(arguments) - {"parameters", "inputs"}
        if unknown:
            raise TypeError(f"`{kind}`: unknown argument {sorted(unknown)}: give `parameters` and `inputs`")
        return self._add(Block, name, arguments.get("parameters", {}), arguments.get("inputs", {}), kind)

    def remove_unread(self, *kinds: str) -> None:
        """Removes primitives of these types whose output nothing reads."""
        while True:
            given = self._primitives.values()
            read = str([(part.get("inputs"), part.get("parameters", {}).get("path")) for part in given])
            unread = [
                name
                for name, part in self._primitives.items()
                if part["type"] in kinds and f"'{name}.out'" not in read
            ]
            if not unread:
                return
            for name in unread:
                del self._primitives[name]

    def document(self) -> dict[str, Any]:
        """The net as JSON, which the cell loads."""
        net: dict[str, Any] = {"net": self.name}
        if self.description:
            net["description"] = self.description
        net.update(self._extra)
        net["primitives"] = self._primitives
        if self._discard:
            net["discard"] = self._discard
        return net

    def _add(
        self,
        block: type[B],
        name: str | None,
        parameters: Mapping[str, Any],
        inputs: Mapping[str, Any],
        kind: str | None = None,
    ) -> B:
        kind = kind or block.__name__
        name = self._free(kind) if name is None else name
        if name in self._primitives:
            raise ValueError(f"net {self.name} has a primitive `{name}` already: choose another name")
        body: dict[str, Any] = {"type": kind}
        if given := {key: self._parameter(value) for key, value in parameters.items() if value is not UNSET}:
            body["parameters"] = given
        if linked := {key: self._source(value) for key, value in inputs.items() if value is not UNSET}:
            body["inputs"] = linked
        self._primitives[name] = body
        return block(self, name, kind)

    def _free(self, kind: str) -> str:
        base = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", kind).lower()
        taken = self._primitives
        if base not in taken:
            return base
        return next(name for n in range(2, len(taken) + 3) if (name := f"{base}_{n}") not in taken)

    def _parameter(self, value: Any) -> Any:
        """A constant; the conditions of legs in it are sources."""
        if isinstance(value, (list, tuple)) and any(isinstance(part, Mapping) for part in value):
            return [self._leg(part) if isinstance(part, Mapping) else constant(part) for part in value]
        return constant(value)

    def _leg(self, leg: Mapping[str, Any]) -> dict[str, Any]:
        conditions = ("wait", "until")
        return {str(key): self._source(part) if key in conditions else constant(part) for key, part in leg.items()}

    def _source(self, value: Any) -> Any:
        if isinstance(value, (Port, Block)):
            port = value._port()
            if port.block.net is not self:
                raise ValueError(f"`{port}` belongs to net {port.block.net.name}, not to {self.name}: use Publish")
            return str(port)
        if isinstance(value, Mapping):
            return {str(key): self._source(part) for key, part in value.items()}
        if isinstance(value, (list, tuple)):
            return [self._source(part) for part in value]
        return constant(value)


@dataclass(frozen=True)
class Held:
    """An output that must keep a value after its net."""

    device: str
    channel: str
    value: bool


class Action(ABC):
    """Something to do that becomes one net, or several one after the other."""

    @abstractmethod
    def nets(self) -> list[Any]:
        """Its nets, one after the other."""

    def held(self) -> list[Held]:
        """Outputs that must keep a value after its net, which needs `on_release: hold`."""
        return []

    def _repr_html_(self) -> str:
        """Notebooks draw its nets."""
        return "\n".join(f"<div>{net.graph()}</div>" for net in self.nets())
