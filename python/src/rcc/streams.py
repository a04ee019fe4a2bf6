"""Live values: samples of ports, batches of monitored values, and recordings of both as arrays."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from . import _mcap, errors


@dataclass(frozen=True)
class Sample:
    """Values of a net's ports, all from one cycle."""

    net: str
    id: int
    cycle: int
    time_s: float
    values: dict[str, Any]
    #: Samples that were lost before this one, because the program reads too slowly or the cell is busy.
    lost: int = 0

    def __getitem__(self, port: str) -> Any:
        """The value of a port; `None` is null."""
        return self.values[port]

    def array(self, port: str) -> Any:
        """The value of a port as an array of numpy; null is nan."""
        return _array(self.values[port])


@dataclass(frozen=True)
class Batch:
    """Values of one port that a net monitors, one for each cycle of its monitor, in order."""

    net: str
    id: int
    port: str
    cycles: list[int]
    time_s: list[float]
    values: list[Any]
    #: Records that were lost before this batch.
    lost: int = 0

    def array(self) -> Any:
        """The values as an array of numpy, one row for each; null is nan."""
        return _rows(self.values)


@dataclass
class _Series:
    commands: list[int] = field(default_factory=list)
    cycles: list[int] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)


class Recording:
    """Values that were received over a time, as arrays of numpy; null is nan."""

    def __init__(self) -> None:
        """Empty."""
        #: Number of samples or records that were lost.
        self.lost = 0
        #: Makes times of the wall clock of cycles; set by the cell that is recorded.
        self.clock: _mcap.Clock | None = None
        self._series: dict[str, _Series] = {}

    def add(self, piece: Sample | Batch) -> None:
        """Adds a sample or a batch."""
        self.lost += piece.lost
        if isinstance(piece, Batch):
            series = self._series.setdefault(f"{piece.net}/{piece.port}", _Series())
            series.commands += [piece.id] * len(piece.cycles)
            series.cycles += piece.cycles
            series.time_s += piece.time_s
            series.values += piece.values
            return
        for port, value in piece.values.items():
            series = self._series.setdefault(f"{piece.net}/{port}", _Series())
            series.commands.append(piece.id)
            series.cycles.append(piece.cycle)
            series.time_s.append(piece.time_s)
            series.values.append(value)

    def __len__(self) -> int:
        """The largest number of values of a port."""
        return max((len(series.cycles) for series in self._series.values()), default=0)

    @property
    def ports(self) -> list[str]:
        """The recorded ports as `net/primitive.port`."""
        return list(self._series)

    def _of(self, port: str) -> _Series:
        found = [name for name in self._series if port in (name, name.split("/", 1)[1])]
        if len(found) != 1:
            what = f"`{port}` is of several nets" if found else f"`{port}` was not recorded"
            raise errors.RccError("", what, f"recorded: {', '.join(self._series) or 'nothing'}")
        return self._series[found[0]]

    def array(self, port: str) -> Any:
        """The values of a port, `primitive.port` or `net/primitive.port`: one row for each."""
        return _rows(self._of(port).values)

    def time(self, port: str) -> Any:
        """Logical times of the values since the net's START, s."""
        return _array(self._of(port).time_s)

    def cycles(self, port: str) -> Any:
        """Executor cycles of the values, as integers."""
        import numpy

        return numpy.array(self._of(port).cycles, dtype=numpy.int64)

    def _columns(self) -> Iterable[tuple[str, _Series, int | None]]:
        for name, series in self._series.items():
            width = next((len(value) for value in series.values if isinstance(value, list)), None)
            for index in range(width or 1):
                yield (name if width is None else f"{name}[{index}]"), series, (None if width is None else index)

    def _table(self) -> tuple[list[str], list[list[Any]]]:
        """A row for each cycle; a port without a value in that cycle has none."""
        columns = list(self._columns())
        rows: dict[tuple[int, float], list[Any]] = {}
        for place, (_, series, index) in enumerate(columns):
            for cycle, time, value in zip(series.cycles, series.time_s, series.values, strict=True):
                row = rows.setdefault((cycle, time), [None] * len(columns))
                row[place] = value if index is None or value is None else value[index]
        table = [[cycle, time, *row] for (cycle, time), row in sorted(rows.items())]
        return ["cycle", "time_s", *(name for name, _, _ in columns)], table

    def frame(self) -> Any:
        """All values as a frame of pandas, a row for each cycle."""
        import pandas

        names, rows = self._table()
        return pandas.DataFrame(rows, columns=names)

    def to_csv(self, file: str | Path) -> None:
        """Writes all values to a CSV file, a row for each cycle; null is empty."""
        names, rows = self._table()
        with open(file, "w", newline="") as out:
            writer = csv.writer(out)
            writer.writerow(names)
            writer.writerows(rows)

    def to_mcap(self, file: str | Path) -> int:
        """Writes all values to a new MCAP file, as `rcc-cli record` does; returns the number of messages.

        Null is NaN. The times are those of this machine's clock as it was when the recording began.
        """
        if self.clock is None:
            raise errors.RccError("", "the recording has no clock", "take one that `cell.recording` made")
        nets: dict[str, list[_mcap.Column]] = {}
        for name, series in self._series.items():
            net, port = name.split("/", 1)
            keys = zip(series.commands, series.cycles, strict=True)
            nets.setdefault(net, []).append(_mcap.Column(port, dict(zip(keys, series.values, strict=True))))
        return _mcap.write(file, nets, self.clock)

    def plot(self, *ports: str) -> Any:
        """Draws ports over time with matplotlib; returns the axes."""
        from matplotlib import pyplot

        _, axes = pyplot.subplots()
        for port in ports or self.ports:
            axes.plot(self.time(port), self.array(port), label=port)
        axes.set_xlabel("time [s]")
        axes.legend()
        return axes

    def _repr_html_(self) -> str:
        """Notebooks show what was recorded."""
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{len(series.values)}</td>"
            f"<td>{series.time_s[0]:.3f} s to {series.time_s[-1]:.3f} s</td></tr>"
            for name, series in self._series.items()
        )
        return f"<table><tr><th>port</th><th>values</th><th>time</th></tr>{rows}</table><p>lost: {self.lost}</p>"


def _array(values: Any) -> Any:
    import numpy

    return numpy.array(values, dtype=float)


def _rows(values: list[Any]) -> Any:
    """One row for each value; a composite that is null as a whole is a row of nan."""
    width = next((len(value) for value in values if isinstance(value, list)), None)
    if width is not None:
        values = [[None] * width if value is None else value for value in values]
    return _array(values)
