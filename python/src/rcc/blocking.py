"""Cells and commands for blocking programs: each method runs the one of the same name in `commands.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from pathlib import Path

from ._generated import api
from ._io import T, iterate, run
from .blocks import Value
from .commands import AsyncCell, AsyncCommand, OnClientLoss, Outcome, Text
from .set_points import Channel
from .streams import Batch, Recording, Sample


class Cell:
    """A connection to a cell."""

    def __init__(self, inner: AsyncCell) -> None:
        """Made by `rcc.connect`."""
        self._inner = inner

    def __enter__(self) -> Cell:
        """Proves that the cell answers."""
        run(self._inner.__aenter__())
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the connection: to what runs this is the loss of its client."""
        self.close()

    def close(self) -> None:
        """Closes the connection: to what runs this is the loss of its client."""
        run(self._inner.close())

    def status(self) -> api.StatusView:
        """The executor's health and the cell's processes."""
        return run(self._inner.status())

    def devices(self) -> list[api.DeviceView]:
        """The devices with their channels."""
        return run(self._inner.devices())

    def commands(self) -> list[api.CommandView]:
        """All commands, by id."""
        return run(self._inner.commands())

    def events(self, limit: int = 100) -> list[api.EventView]:
        """The newest events of the cell's log."""
        return run(self._inner.events(limit))

    def incident(self) -> str:
        """Writes the last seconds of the flight recorder to a file of the cell, and returns its name."""
        return run(self._inner.incident())

    def arm(self, condition: str, *, times: int = 1, distance: float = 10.0, edge: bool = False) -> int:
        """Writes the last seconds of the flight recorder when a condition such as `ft.fz > 30` becomes true."""
        return run(self._inner.arm(condition, times=times, distance=distance, edge=edge))

    def armed(self) -> list[api.RuleView]:
        """The conditions of `arm`, and those that have fired, with what they recorded."""
        return run(self._inner.armed())

    def disarm(self, number: int) -> None:
        """Disarms a condition."""
        run(self._inner.disarm(number))

    def load(self, net: Text) -> Command:
        """LOAD: returns the command when it is ready; raises `NetRejected` with all faults."""
        return Command(run(self._inner.load(net)))

    def command(self, name: str | int) -> Command:
        """A loaded command, by id or by the name of its net (then the newest)."""
        return Command(run(self._inner.command(name)))

    def set(self, net: str | int, values: Mapping[str, Value]) -> int:
        """Sets inputs of a command, by id or by the name of its net (then the newest); as `Command.set`."""
        return run(self._inner.set(net, values))

    def run(self, net: Text, timeout: float | None = None, *, on_client_loss: OnClientLoss = "cancel") -> Outcome:
        """Loads, starts and follows a net, and unloads it; Ctrl-C cancels it.

        A program that is killed leaves what `on_client_loss` says. Raises `NetFault`, `NetCanceled` or `ActionFailed`
        for every other end than `finished`.
        """
        return run(self._inner.run(net, timeout, on_client_loss=on_client_loss))

    def start(self, net: Text, *, on_client_loss: OnClientLoss = "cancel") -> Command:
        """Loads and starts a net, to be waited for, canceled and unloaded by this program."""
        return Command(run(self._inner.start(net, on_client_loss=on_client_loss)))

    def switch(
        self, stop: Sequence[Command], start: Sequence[Command], *, on_client_loss: OnClientLoss | None = None
    ) -> int:
        """Hand-over: stops some commands and starts others between the same two cycles; returns the cycle.

        Without `on_client_loss` those that start are canceled with this program if one that stops would have been.
        """
        ended, begun = ([one._inner for one in some] for some in (stop, start))
        return run(self._inner.switch(ended, begun, on_client_loss=on_client_loss))

    def watch(self, *ports: str, rate: float = 10.0) -> Iterator[Sample]:
        """Values of ports such as ``line/*`` or ``belt/soft.out``, at a rate, Hz (0.1 to the rate of the cell).

        A name also stands for commands that are loaded later: it goes on when a net ends. `Command.watch` ends with it.
        """
        return iterate(self._inner.watch(*ports, rate=rate))

    def monitored(self, *ports: str) -> Iterator[Batch]:
        """Every value of ports that a `Monitor` observes, such as ``line/*``, at its rate, in batches; from now on."""
        return iterate(self._inner.monitored(*ports))

    @contextmanager
    def recording(self, *ports: str, rate: float | None = None) -> Iterator[Recording]:
        """Records ports while the block runs: `with cell.recording("line/*", rate=100) as values:`.

        Without `rate` it has every value of the ports that a `Monitor` observes; these may belong to nets that are
        loaded later. With a rate, Hz (0.1 to the rate of the cell), it has samples of ports of loaded nets.
        """
        yield from _entered(self._inner.recording(*ports, rate=rate))

    @contextmanager
    def record(self, file: str | Path, *ports: str, rate: float | None = None) -> Iterator[Recording]:
        """Records ports into a new MCAP file while the block runs: `with cell.record("line.mcap", "line/*"):`.

        As `recording`; the file is written when the block ends, also by an error.
        """
        yield from _entered(self._inner.record(file, *ports, rate=rate))


def _entered(inner: AbstractAsyncContextManager[T]) -> Iterator[T]:
    """The same as a generator of a blocking context manager."""
    entered = run(inner.__aenter__())
    try:
        yield entered
    except BaseException as error:
        if not run(inner.__aexit__(type(error), error, error.__traceback__)):
            raise
    else:
        run(inner.__aexit__(None, None, None))


class Command:
    """A loaded net."""

    def __init__(self, inner: AsyncCommand) -> None:
        """Made by `Cell.load`."""
        self._inner, self.id = inner, inner.id

    def state(self) -> api.CommandView:
        """STATE: everything that is known about it, but its text."""
        return run(self._inner.state())

    def start(self, *, on_client_loss: OnClientLoss = "go on") -> int:
        """START; returns the first cycle. A program that is killed leaves what `on_client_loss` says."""
        return run(self._inner.start(on_client_loss=on_client_loss))

    def cancel(self) -> None:
        """CANCEL: asks the net to end in its own way."""
        run(self._inner.cancel())

    def abort(self) -> None:
        """ABORT: ends the net at once; the drivers bring its arms to rest."""
        run(self._inner.abort())

    def unload(self) -> None:
        """UNLOAD."""
        run(self._inner.unload())

    def wait(self, timeout: float | None = None) -> Outcome:
        """Waits until the command has ended; raises `TimeoutError` after that many seconds."""
        return run(self._inner.wait(timeout))

    def set(self, values: Mapping[str, Value]) -> int:
        """Sets inputs, all in the same cycle, which is returned; `None` unsets."""
        return run(self._inner.set(values))

    def set_points(self, values: Iterable[Mapping[str, Value]]) -> api.ChannelEnd:
        """Sends sets of values over one connection as the iterator gives them; the latest wins."""
        return run(self._inner.set_points(values))

    @contextmanager
    def channel(self) -> Iterator[Channel]:
        """A set-point channel for the block: `with command.channel() as channel:`, then `channel.set({…})`.

        For a loop of the program's own, at up to the rate of the cell; `set` does not wait for the cell. When the block
        ends, `channel.end` tells what became of all lines, and the first error is raised.
        """
        yield from _entered(self._inner.channel())

    def values(self, *ports: str) -> Sample:
        """Values of ports (all without arguments) as of the last evaluation."""
        return run(self._inner.values(*ports))

    def watch(self, *ports: str, rate: float = 10.0) -> Iterator[Sample]:
        """Values of its ports such as ``move.distance`` (all without arguments), at a rate, Hz, until it has ended.

        The last sample has its last values.
        """
        return iterate(self._inner.watch(*ports, rate=rate))
