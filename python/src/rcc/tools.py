"""Tools that need no cell: checking, drawing and simulating a net, by the program `rcc-cli`."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import errors
from ._generated.catalogue import Primitives
from .commands import text_of


def _cli(net: Net, *arguments: str, good: tuple[int, ...] = (0,)) -> str:
    program = os.environ.get("RCC_CLI", "rcc-cli")
    try:
        done = subprocess.run([program, *arguments], input=text_of(net)[0], capture_output=True, text=True)
    except FileNotFoundError as error:
        raise errors.RccError(
            "", f"program `{program}` not found", "put it into your PATH, or its path into RCC_CLI"
        ) from error
    if done.returncode not in good:
        raise errors.NetRejected("", (done.stderr or done.stdout).strip(), None)
    return done.stdout


@dataclass(frozen=True)
class Simulation:
    """Result of a simulation: how it ended, and the monitored values by name; `None` is null."""

    summary: dict[str, Any]
    columns: dict[str, list[float | None]]

    def array(self, column: str) -> Any:
        """A column as an array of numpy; null is nan."""
        import numpy

        return numpy.array(self.columns[column], dtype=float)

    def frame(self) -> Any:
        """All columns as a frame of pandas."""
        import pandas

        return pandas.DataFrame(self.columns)


class Net(Primitives):
    """A net: a method for each primitive, named as in the catalogue."""

    def check(self, config: str | None = None) -> None:
        """Checks the net against a cell's configuration (default: the demo cell); raises `NetRejected`."""
        _cli(self, "check", "-", *_config(config))

    def graph(self) -> str:
        """The net as SVG; notebooks draw it by themselves."""
        return _cli(self, "graph", "-", "--format", "svg")

    _repr_svg_ = graph

    def simulate(self, *, config: str | None = None, seconds: float | None = None, **options: str) -> Simulation:
        """Runs the net in virtual time; options are those of `rcc-cli simulate`: ``wall="0,0,0.3,0,0,1"``."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "values.csv"
            arguments = ["simulate", "-", "--csv", str(file), "--output", "json", *_config(config)]
            arguments += [] if seconds is None else ["--for", f"{seconds}s"]
            for name, value in options.items():
                arguments += [f"--{name.replace('_', '-')}", value]
            shown = _cli(self, *arguments, good=(0, 1))
            with file.open(newline="") as opened:
                rows = list(csv.DictReader(opened))
        columns = {name: [_number(row[name]) for row in rows] for name in (rows[0] if rows else {})}
        return Simulation(json.loads(shown), columns)


def _config(config: str | None) -> list[str]:
    return [] if config is None else ["--config", config]


def _number(text: str) -> float | None:
    if text in ("", "null"):
        return None
    return {"true": 1.0, "false": 0.0}.get(text) if text in ("true", "false") else float(text)
