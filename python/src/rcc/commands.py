"""Cells and commands for asynchronous programs; `blocking.py` has the same for blocking ones."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from typing import Any, Union, cast

from . import _io, errors
from ._generated import api
from .blocks import Action, Net, Value, constant

Text = Union[Net, Action, str, Mapping[str, Any]]
#: States of a command that has ended.
ENDED = ("terminated", "rejected")


@dataclass(frozen=True)
class Outcome:
    """How a command ended. It is true if the net finished by itself."""

    net: str
    id: int
    reason: str
    outcome: str | None
    words: str
    cycles: int

    def __bool__(self) -> bool:
        """True for `finished`."""
        return self.reason == "finished"

    def __str__(self) -> str:
        """One line for people."""
        return f"{self.net}#{self.id}  {self.words or self.reason}"


@dataclass(frozen=True)
class Sample:
    """Values of a net's ports, all from one cycle."""

    net: str
    id: int
    cycle: int
    time_s: float
    values: dict[str, Any]

    def __getitem__(self, port: str) -> Any:
        """The value of a port; `None` is null."""
        return self.values[port]


class AsyncCell:
    """A connection to a cell."""

    def __init__(self, address: _io.Address, io: _io.Io) -> None:
        """Made by `rcc.aconnect`."""
        self._address, self._io = address, io

    async def __aenter__(self) -> AsyncCell:
        """Proves that the cell answers."""
        await self.status()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Closes the connection; what runs goes on."""
        await self._io.close()

    async def _ask(self, method: str, path: str, timeout: float | None = _io.STEP_S, **parts: Any) -> Any:
        return await _io.call(self._io, self._address, method, path, timeout, **parts)

    async def status(self) -> api.StatusView:
        """The executor's health and the cell's processes."""
        return cast(api.StatusView, await self._ask("GET", "/status"))

    async def devices(self) -> list[api.DeviceView]:
        """The devices with their channels."""
        return cast("list[api.DeviceView]", await self._ask("GET", "/devices"))

    async def commands(self) -> list[api.CommandView]:
        """All commands, by id."""
        return cast("list[api.CommandView]", await self._ask("GET", "/commands"))

    async def events(self, limit: int = 100) -> list[api.EventView]:
        """The newest events of the cell's log."""
        page = cast(api.EventPage, await self._ask("GET", "/events", params={"limit": limit}))
        return page["events"]

    async def record(self) -> str:
        """Writes the last seconds of the flight recorder to a file, and returns its name."""
        frozen = cast(api.Frozen, await self._ask("POST", "/incidents", timeout=60.0))
        return frozen["file"]

    async def load(self, net: Text) -> AsyncCommand:
        """LOAD: returns the command when it is ready; raises `NetRejected` with all faults."""
        text, kind = text_of(net)
        headers = {"content-type": kind}
        loaded = cast(
            api.Loaded, await self._ask("POST", "/commands", content=text, headers=headers, timeout=60.0)
        )
        command = AsyncCommand(self, loaded["id"])
        view = await command._until(lambda state: state != "loading")
        if view["state"] == "rejected":
            raise errors.NetRejected(
                "", f"net {view['net']} is not valid", None, cast(Any, view.get("diagnostics", []))
            )
        return command

    async def command(self, name: str | int) -> AsyncCommand:
        """A loaded command, by id or by the name of its net (then the newest)."""
        view = await self._ask("GET", f"/commands/{_io.segment(name)}", params={"brief": "true"})
        return AsyncCommand(self, view["id"])

    async def run(self, net: Text, timeout: float | None = None) -> Outcome:
        """Loads, starts and follows a net, and unloads it; a program that is interrupted cancels it.

        Raises `NetFault` or `NetCanceled` for every other end than `finished`. The nets of a sequence are run one after
        the other; the outcome is that of the last one, and `timeout` is for each.
        """
        first, *others = net.steps() if isinstance(net, Action) else [net]
        outcome = await self._run(first, timeout)
        for step in others:
            outcome = await self._run(step, timeout)
        return outcome

    async def _run(self, net: Text, timeout: float | None) -> Outcome:
        command = await self.load(net)
        try:
            await command.start()
            outcome = await command.wait(timeout)
        except BaseException:
            # Also Ctrl-C, a timeout and a canceled task: what this program runs does not go on without it.
            await self._io.finish(command._end())
            raise
        await command.unload()
        return finished(outcome)

    async def switch(self, stop: Sequence[AsyncCommand], start: Sequence[AsyncCommand]) -> int:
        """Hand-over: stops some commands and starts others between the same two cycles; returns the cycle."""
        ids = {"stop": [one.id for one in stop], "start": [one.id for one in start]}
        return int((await self._ask("POST", "/switch", json=ids))["cycle"])

    async def watch(self, *ports: str, rate: float = 10.0) -> AsyncIterator[Sample]:
        """Values of ports such as ``line/*`` or ``belt/soft.out``, at a rate, Hz (0.1 to 250)."""
        params = {"ports": ",".join(ports), "rate": rate}
        async with aclosing(self._stream(params)) as stream:
            async for event, data in stream:
                if event == "values":
                    values = data["values"]
                    yield Sample(data["net"], data["id"], data["cycle"], data["time_s"], values)

    async def _stream(self, params: Mapping[str, Any]) -> Any:
        event = ""
        request = self._io.build("GET", "/stream", params=dict(params))
        async with aclosing(cast(Any, self._io.lines(request))) as lines:
            async for line in lines:
                if line.startswith("event: "):
                    event = line[7:]
                elif line.startswith("data: "):
                    yield event, json.loads(line[6:])


class AsyncCommand:
    """A loaded net."""

    def __init__(self, cell: AsyncCell, id: int) -> None:
        """Made by `AsyncCell.load`."""
        self._cell, self.id = cell, id

    async def _do(self, method: str, what: str = "", **parts: Any) -> Any:
        return await self._cell._ask(method, f"/commands/{self.id}{what}", **parts)

    async def state(self) -> api.CommandView:
        """STATE: everything that is known about it, but its text."""
        return cast(api.CommandView, await self._do("GET", params={"brief": "true"}))

    async def start(self) -> int:
        """START; returns the first cycle."""
        return int((await self._do("POST", "/start", timeout=60.0))["cycle"])

    async def cancel(self) -> None:
        """CANCEL: asks the net to end in its own way."""
        await self._do("POST", "/cancel")

    async def abort(self) -> None:
        """ABORT: ends the net at once; the drivers bring its arms to rest."""
        await self._do("POST", "/abort")

    async def unload(self) -> None:
        """UNLOAD."""
        await self._do("DELETE")

    async def wait(self, timeout: float | None = None) -> Outcome:
        """Waits until the command has ended; raises `TimeoutError` after that many seconds."""
        view = await self._until(lambda state: state in ENDED, timeout)
        reason, words = str(view.get("reason")), str(view.get("words") or "")
        return Outcome(view["net"], self.id, reason, view.get("outcome"), words, view["cycles"])

    async def set(self, values: Mapping[str, Value]) -> int:
        """Sets inputs, all in the same cycle, which is returned; `None` unsets."""
        body = {name: constant(value) for name, value in values.items()}
        return int((await self._do("PUT", "/inputs", json=body))["cycle"])

    async def set_points(self, values: Iterable[Mapping[str, Value]]) -> api.ChannelEnd:
        """Sends sets of values over one connection as the iterator gives them; the latest wins.

        Returns what became of them; raises the first error, if a line was refused.
        """
        lines = (json.dumps({k: constant(v) for k, v in each.items()}).encode() + b"\n" for each in values)
        path = f"/commands/{self.id}/inputs/stream"
        request = self._cell._io.build("POST", path, content=lines)
        end: Any = None
        async with aclosing(cast(Any, self._cell._io.lines(request))) as answers:
            async for line in answers:
                answer = json.loads(line)
                if "error" in answer:
                    raise errors.of_body(400, answer["error"])
                end = answer
        return cast(api.ChannelEnd, end)

    async def values(self, *ports: str) -> Sample:
        """Values of ports (all without arguments) as of the last evaluation."""
        params = {"ports": ",".join(ports)} if ports else {}
        view = cast(api.ValuesView, await self._do("GET", "/values", params=params))
        values = {value["port"]: cast(Any, value)["value"] for value in cast(Any, view["values"])}
        return Sample(view["net"], view["id"], view["cycle"], view["time_s"], values)

    async def _until(self, holds: Any, timeout: float | None = None) -> api.CommandView:
        async def follow() -> api.CommandView:
            view = await self.state()
            if holds(view["state"]):
                return view
            # The stream begins with the state of now: nothing is missed in between.
            async with aclosing(self._cell._stream({"states": "true"})) as stream:
                async for event, data in stream:
                    if event == "state" and data["id"] == self.id and holds(data["state"]):
                        return await self.state()
            raise errors.RccError("", "the cell ended its stream of states", "look at `rcc-cli status`")

        return await self._cell._io.within(timeout, follow())

    async def _end(self) -> None:
        """CANCEL, or ABORT if it cannot be canceled; waits for the end and unloads."""
        try:
            view = await self.state()
            if view["state"] in ("running", "canceling"):
                await (self.cancel() if view["can_cancel"] else self.abort())
                await self.wait(60.0)
            await self.unload()
        except errors.RccError:
            pass  # The error that led here is the one to tell.


def text_of(net: Text) -> tuple[str, str]:
    """The text of a net and its media type."""
    if isinstance(net, str):
        return net, "application/yaml"
    if isinstance(net, Action):
        first, *others = net.steps()
        if others:
            raise TypeError("a sequence becomes several nets: give it to `cell.run`")
        net = first
    document = net.document() if isinstance(net, Net) else cast(Any, net)
    return json.dumps(document), "application/json"


def finished(outcome: Outcome) -> Outcome:
    """The outcome of a net that finished; raises for any other."""
    if outcome:
        return outcome
    if outcome.reason == "canceled":
        raise errors.NetCanceled("", f"{outcome}", "what should follow was not begun")
    raise errors.NetFault("", f"{outcome}", "see `cell.events()`, and `rcc-cli replay` for the last seconds")
