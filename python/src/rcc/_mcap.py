"""Recordings as MCAP files, as `rcc-cli record` writes nets: `cdr` with `ros2msg`, true names in the metadata."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import errors

#: Header of a CDR message: little endian (OMG DDS-XTypes 1.3, 7.6.3.1.2).
CDR_HEADER = b"\x00\x01\x00\x00"
#: Key of a row: command and cycle.
Key = tuple[int, int]


@dataclass(frozen=True)
class Clock:
    """Time of the clock of this machine in a cycle."""

    cycle: int
    time_ns: int
    period_ns: int

    def of(self, cycle: int) -> int:
        """The time of a cycle, ns since 1970."""
        return self.time_ns + (cycle - self.cycle) * self.period_ns


class Column:
    """The values of one port, by command and cycle; null is `None`."""

    def __init__(self, port: str, rows: dict[Key, Any]) -> None:
        """Finds type and width."""
        self.port, self.rows = port, rows
        lists = [value for value in rows.values() if isinstance(value, list)]
        #: Number of elements; `None` for a scalar.
        self.width = len(lists[0]) if lists else None
        elements = [element for value in rows.values() for element in self.elements(value)]
        kinds = {type(element) for element in elements}
        # A Bool or Int that was null is a number, so that null is NaN.
        self.kind = {frozenset({bool}): "bool", frozenset({int}): "int64"}.get(frozenset(kinds), "float64")
        known = kinds - {type(None)}
        self.type = {frozenset({bool}): "Bool", frozenset({int}): "Int"}.get(frozenset(known), "Real")
        if self.width is not None:
            self.type += f"[{self.width}]"

    def elements(self, value: Any) -> list[Any]:
        """The elements of a value; a composite that is null as a whole has null elements."""
        if self.width is None:
            return [value]
        return value if isinstance(value, list) else [None] * self.width

    def field(self, name: str) -> str:
        """The line of the message type."""
        return f"{self.kind}{'' if self.width is None else f'[{self.width}]'} {name}\n"


class Cdr:
    """A message as it is written."""

    def __init__(self) -> None:
        """Empty."""
        self.out = bytearray()

    def put(self, kind: str, value: Any) -> None:
        """Appends a value, aligned to its size."""
        code, size = {"bool": ("?", 1), "int64": ("q", 8), "uint64": ("Q", 8), "float64": ("d", 8)}[kind]
        self.out += bytes(-len(self.out) % size)
        self.out += struct.pack(f"<{code}", math.nan if value is None else float(value) if code == "d" else value)


def field_name(name: str, used: set[str]) -> str:
    """A name that ROS allows and that is not in use yet."""
    field = "_".join(re.findall("[a-zA-Z0-9]+", name)).lower()
    field = wanted = field if field[:1].isalpha() else f"n_{field}".rstrip("_")
    number = 2
    while field in used:
        field, number = f"{wanted}_{number}", number + 1
    used.add(field)
    return field


def tables(columns: Iterable[Column]) -> Iterator[list[Column]]:
    """Groups ports that have values in the same cycles: a value that is missing never looks like null."""
    groups: dict[frozenset[Key], list[Column]] = {}
    for column in columns:
        groups.setdefault(frozenset(column.rows), []).append(column)
    return iter(sorted(groups.values(), key=len, reverse=True))


def write(file: str | Path, nets: dict[str, list[Column]], clock: Clock) -> int:
    """Writes the columns of nets; returns the number of messages."""
    try:
        from mcap.writer import CompressionType, Writer
    except ImportError as error:
        raise errors.RccError("", "MCAP files need the package `mcap`", "pip install 'rcc-client[mcap]'") from error
    messages: list[tuple[int, int, int, bytes]] = []
    with open(file, "xb") as out:
        # Uncompressed, as the files of the recorder are.
        writer: Any = Writer(out, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="rcc for Python")
        used_topics: set[str] = set()
        for net, columns in nets.items():
            for table in tables(columns):
                channel, encoded = _table(writer, net, table, field_name(net, used_topics))
                messages += [(clock.of(cycle), channel, cycle, data) for cycle, data in encoded]
        for time_ns, channel, cycle, data in sorted(messages, key=lambda message: message[0]):
            writer.add_message(
                channel_id=channel, log_time=time_ns, publish_time=time_ns, sequence=cycle % 2**32, data=data
            )
        writer.finish()
    return len(messages)


def _table(writer: Any, net: str, columns: list[Column], topic: str) -> tuple[int, list[tuple[int, bytes]]]:
    """Registers a table; returns its channel, and its messages by cycle."""
    text, metadata, used = "uint64 cycle\nuint64 command\n", {"net": net}, {"cycle", "command"}
    for column in columns:
        field = field_name(column.port, used)
        text += column.field(field)
        metadata |= {f"name.{field}": column.port, f"type.{field}": column.type}
    kind = "".join(word[0].upper() + word[1:] for word in re.findall("[a-zA-Z0-9]+", net))
    kind = kind if kind[:1].isalpha() else f"Net{kind}"
    schema = writer.register_schema(name=f"rcc/msg/{kind}", encoding="ros2msg", data=text.encode())
    channel = writer.register_channel(
        topic=f"/nets/{topic}", message_encoding="cdr", schema_id=schema, metadata=metadata
    )
    return channel, [(cycle, _message(columns, (command, cycle))) for command, cycle in sorted(columns[0].rows)]


def _message(columns: list[Column], key: Key) -> bytes:
    message = Cdr()
    message.put("uint64", key[1])
    message.put("uint64", key[0])
    for column in columns:
        for element in column.elements(column.rows[key]):
            message.put(column.kind, element)
    return CDR_HEADER + bytes(message.out)
