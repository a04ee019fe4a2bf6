"""Cells and commands for asynchronous programs; `blocking.py` has the same for blocking ones."""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator, Callable, Generator, Iterable, Mapping, Sequence
from contextlib import aclosing, asynccontextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Union, cast

from . import _io, errors
from ._generated import api
from ._lease import UNKNOWN, Lease
from ._mcap import Clock
from .blocks import Action, Net, Value, constant
from .set_points import Channel
from .streams import Batch, Recording, Sample

Text = Union[Net, Action, str, Mapping[str, Any]]
#: Time after which a program that gives no sign of life counts as lost, s.
LOST_AFTER_S = 1.0
#: States of a command that has ended.
ENDED = ("terminated", "rejected")
#: State in a stream of a command that is there no more.
GONE = "unloaded"


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


#: What becomes of a command whose program dies: it is canceled (aborted without `Cancel`), or goes on to its own end.
OnClientLoss = Literal["cancel", "go on"]
#: Longest time between two questions about a command, s.
ASK_EVERY_S = 0.05
#: Time after which a command is asked about beside the stream that tells its changes, s.
ASK_AGAIN_S = 1.0
#: Code of a refusal because of too many requests: nets that end at once would open too many streams.
TOO_MANY = "RCC4010"
#: Code of a refusal because the command does not exist.
UNKNOWN_COMMAND = "RCC3001"
#: Time after a cycle within which its monitored values have arrived at the loader, s.
READ_AFTER_S = 0.1


@dataclass
class Progress:
    """How far a stream is."""

    cycle: int = 0


class AsyncCell:
    """A connection to a cell."""

    def __init__(self, address: _io.Address, io: _io.Io, lost_after: float = LOST_AFTER_S) -> None:
        """Made by `rcc.aconnect`."""
        self._address, self._io, self._lost_after = address, io, lost_after
        self._lease: Lease | None = None

    async def __aenter__(self) -> AsyncCell:
        """Proves that the cell answers."""
        await self.status()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Closes the connection: to what runs this is the loss of its client."""
        await self.close()

    async def close(self) -> None:
        """Closes the connection: to what runs this is the loss of its client."""
        lease, self._lease = self._lease, None
        try:
            if lease is not None:
                lease.end()
                # One that is known to be lost has had its effect. So has one that is not known to be, and the end of
                # the cell: then the answer is an error.
                if not lease.is_lost:
                    with suppress(errors.RccError):
                        await self._ask("DELETE", f"/leases/{lease.number}")
        finally:
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

    async def incident(self) -> str:
        """Writes the last seconds of the flight recorder to a file of the cell, and returns its name."""
        frozen = cast(api.Frozen, await self._ask("POST", "/incidents", timeout=60.0))
        return frozen["file"]

    async def arm(self, condition: str, *, times: int = 1, distance: float = 10.0, edge: bool = False) -> int:
        """Writes the last seconds of the flight recorder when a condition such as `ft.fz > 30` becomes true.

        The executor judges it in every cycle. It records `times` times, at least `distance` seconds apart; with `edge`
        not if it is true already. Returns the number for `disarm`.
        """
        record: api.RecordBody = {"times": times, "distance_ms": round(distance * 1000), "edge": edge}
        rule: api.RuleBody = {"when": condition, "record": record, "on_client_loss": "go on"}
        installed = cast(api.RulesInstalled, await self._ask("POST", "/rules", json={"rules": [rule]}))
        return installed["rules"][0]["rule"]

    async def armed(self) -> list[api.RuleView]:
        """The conditions of `arm`, and those that have fired, with what they recorded."""
        rules = cast("list[api.RuleView]", await self._ask("GET", "/rules"))
        return [rule for rule in rules if rule.get("record")]

    async def disarm(self, number: int) -> None:
        """Disarms a condition."""
        await self._ask("DELETE", f"/rules/{number}")

    async def load(self, net: Text) -> AsyncCommand:
        """LOAD: returns the command when it is ready; raises `NetRejected` with all faults."""
        await self._check_held(net)
        return await self._load(net)

    async def _load(self, net: Text) -> AsyncCommand:
        text, kind = text_of(net)
        request: dict[str, Any] = {"content": text, "headers": {"content-type": kind}, "params": {"wait_ms": 5000}}
        loaded = cast(api.Loaded, await self._ask("POST", "/commands", timeout=60.0, **request))
        command = AsyncCommand(self, loaded["id"])
        view = await command._loaded()
        if view["state"] == "rejected":
            # Nobody has a use for it: the error has all that it knows.
            await command._unload_ended()
            raise errors.NetRejected(
                "", f"net {view['net']} is not valid", None, cast(Any, view.get("diagnostics", []))
            )
        return command

    async def command(self, name: str | int) -> AsyncCommand:
        """A loaded command, by id or by the name of its net (then the newest)."""
        view = await self._ask("GET", f"/commands/{_io.segment(name)}", params={"brief": "true"})
        return AsyncCommand(self, view["id"])

    async def set(self, net: str | int, values: Mapping[str, Value]) -> int:
        """Sets inputs of a command, by id or by the name of its net (then the newest); as `AsyncCommand.set`."""
        return await self._set(net, values)

    async def _set(self, command: str | int, values: Mapping[str, Value]) -> int:
        body = {name: constant(value) for name, value in values.items()}
        return int((await self._ask("PUT", f"/commands/{_io.segment(command)}/inputs", json=body))["cycle"])

    async def run(
        self, net: Text, timeout: float | None = None, *, on_client_loss: OnClientLoss = "cancel"
    ) -> Outcome:
        """Loads, starts and follows a net, and unloads it; a program that is interrupted cancels it.

        A program that is killed leaves what `on_client_loss` says. Raises `NetFault`, `NetCanceled` or `ActionFailed`
        for every other end than `finished`. The nets of a sequence are run one after the other; the outcome is that of
        the last one, and `timeout` is for each.
        """
        await self._check_held(net)
        outcome: Outcome | None = None
        for step in net.nets() if isinstance(net, Action) else [net]:
            outcome = await self._run(step, timeout, on_client_loss)
        assert outcome is not None, "an action has a net"
        return outcome

    async def start(self, net: Text, *, on_client_loss: OnClientLoss = "cancel") -> AsyncCommand:
        """Loads and starts a net, to be awaited, canceled and unloaded by this program."""
        command = await self.load(net)
        try:
            await command.start(on_client_loss=on_client_loss)
        except BaseException:
            await self._io.finish(command._end())
            raise
        return command

    async def _check_held(self, net: Text) -> None:
        """Refuses an output that would lose its value with the end of its net."""
        held = net.held() if isinstance(net, Action) else []
        if not held:
            return
        devices = {device["name"]: device for device in await self.devices()}
        for each in held:
            channels = devices[each.device]["channels"] if each.device in devices else []
            released = next((one.get("on_release") for one in channels if one["name"] == each.channel), "hold")
            if released not in ("hold", f"safe: {int(each.value)}"):
                output = f"{each.device}.{each.channel}"
                raise errors.RccError(
                    "",
                    f"{output} would not stay {'on' if each.value else 'off'}: its `on_release` is `{released}`, "
                    "which applies at the end of the net",
                    f"use `pulse`, or `rcc.parallel({output}.on(), …)`, or configure `on_release: hold`",
                )

    async def _run(self, net: Text, timeout: float | None, on_client_loss: OnClientLoss) -> Outcome:
        command = await self._load(net)
        try:
            await command.start(on_client_loss=on_client_loss)
            outcome = await command.wait(timeout)
        except BaseException:
            # Also Ctrl-C, a timeout and a canceled task: what this program runs does not go on without it.
            await self._io.finish(command._end())
            raise
        await command._unload_ended()
        return finished(outcome, net.failures if isinstance(net, Net) else {})

    async def switch(
        self,
        stop: Sequence[AsyncCommand],
        start: Sequence[AsyncCommand],
        *,
        on_client_loss: OnClientLoss | None = None,
    ) -> int:
        """Hand-over: stops some commands and starts others between the same two cycles; returns the cycle.

        Without `on_client_loss` those that start are canceled with this program if one that stops would have been.
        """
        if on_client_loss is None:
            on_client_loss = "cancel" if any(one._is_bound for one in stop) else "go on"
        body = {"stop": [one.id for one in stop], "start": [one.id for one in start]}
        cycle = await self._begin("/switch", body, on_client_loss)
        for one in start:
            one._is_bound = on_client_loss == "cancel"
        return cycle

    async def _begin(self, path: str, body: dict[str, Any], on_client_loss: OnClientLoss) -> int:
        """Starts commands, bound to this program if its loss is to cancel them; returns the first cycle."""
        if on_client_loss not in ("cancel", "go on"):
            raise ValueError(f"on_client_loss: `{on_client_loss}` is neither `cancel` nor `go on`")
        lease = await self._lease_number() if on_client_loss == "cancel" else None
        try:
            return await self._post_start(path, body, lease)
        except errors.RccError as error:
            if lease is None or error.code != UNKNOWN:
                raise
        # The lease expired unnoticed: this program was stopped for a while, or the executor was restarted.
        if self._lease is not None:
            self._lease.is_lost = True
        return await self._post_start(path, body, await self._lease_number())

    async def _post_start(self, path: str, body: dict[str, Any], lease: int | None) -> int:
        sent = body if lease is None else {**body, "lease": lease}
        return int((await self._ask("POST", path, timeout=60.0, json=sent))["cycle"])

    async def _lease_number(self) -> int:
        """The lease of this program, which is granted when it is first needed."""
        if self._lease is not None and self._lease.is_lost:
            self._lease.end()
            self._lease = None
        if self._lease is None:
            expires_ms = round(1000 * self._lost_after)
            granted = await self._ask("POST", "/leases", json={"expires_ms": expires_ms})
            self._lease = Lease(self._address, granted["lease"], self._lost_after)
        return self._lease.number

    async def watch(self, *ports: str, rate: float = 10.0) -> AsyncIterator[Sample]:
        """Values of ports such as ``line/*`` or ``belt/soft.out``, at a rate, Hz (0.1 to the rate of the cell).

        A name also stands for commands that are loaded later: it goes on when a net ends. `Command.watch` ends with it.
        """
        lost = 0
        async for piece in self._pieces({"ports": ",".join(ports), "rate": rate}):
            lost += piece.lost
            if isinstance(piece, Sample) and piece.net:
                yield replace(piece, lost=lost)
                lost = 0

    async def monitored(self, *ports: str) -> AsyncIterator[Batch]:
        """Every value of ports that a `Monitor` observes, such as ``line/*``, at its rate, in batches; from now on."""
        lost = 0
        async for piece in self._pieces({"monitors": ",".join(ports)}):
            lost += piece.lost
            if isinstance(piece, Batch):
                yield replace(piece, lost=lost)
                lost = 0

    @asynccontextmanager
    async def recording(self, *ports: str, rate: float | None = None) -> AsyncIterator[Recording]:
        """Records ports while the block runs: `async with cell.recording("line/*", rate=100) as values:`.

        Without `rate` it has every value of the ports that a `Monitor` observes; these may belong to nets that are
        loaded later. With a rate, Hz (0.1 to the rate of the cell), it has samples of ports of loaded nets.
        """
        params: dict[str, Any] = {"monitors": ",".join(ports)}
        if rate is not None:
            params = {"ports": ",".join(ports), "rate": rate}
        recording, seen = Recording(), Progress()
        executor = (await self.status())["executor"]
        recording.clock = Clock(executor["cycle"], time.time_ns(), executor["period_ns"])

        async def follow(io: _io.Io, opened: Callable[[], None]) -> None:
            async for piece in AsyncCell(self._address, io)._pieces(params, opened):
                recording.add(piece)
                if isinstance(piece, Sample):
                    seen.cycle = max(seen.cycle, piece.cycle)

        background = await self._io.background(self._address, follow)
        try:
            yield recording
            if rate is None:
                await self._await_cycle(seen, background)
        finally:
            await background.stop()

    @asynccontextmanager
    async def record(
        self, file: str | Path, *ports: str, rate: float | None = None
    ) -> AsyncIterator[Recording]:
        """Records ports into a new MCAP file while the block runs: `async with cell.record("line.mcap", "line/*"):`.

        As `recording`; the file is written when the block ends, also by an error.
        """
        if Path(file).exists():
            raise FileExistsError(f"{file} exists and is kept: name another file")
        recording: Recording | None = None
        try:
            async with self.recording(*ports, rate=rate) as recording:
                yield recording
        finally:
            if recording is not None:
                recording.to_mcap(file)

    async def _await_cycle(self, seen: Progress, background: _io.Background) -> None:
        """Waits until the values of all cycles before now have been received."""
        view = (await self.status())["executor"]
        last = view["cycle"] + int(READ_AFTER_S * 1e9 / view["period_ns"])
        while seen.cycle < last and not background.is_over():
            await self._io.pause(0.01)

    async def _pieces(
        self, params: Mapping[str, Any], opened: Callable[[], None] = lambda: None
    ) -> AsyncIterator[Sample | Batch]:
        """The pieces of a stream; a sample without net tells what was lost, or how far the stream is."""
        async with aclosing(self._stream(params, opened)) as stream:
            async for event, data in stream:
                if event == "values":
                    yield Sample(data["net"], data["id"], data["cycle"], data["time_s"], data["values"])
                elif event == "lost":
                    yield Sample("", 0, 0, 0.0, {}, data.get("samples", 0) + data.get("records", 0))
                elif event == "monitored":
                    for batch in data["batches"]:
                        start, period = batch["started_cycle"], data["period_s"]
                        times = [(cycle - start) * period for cycle in batch["cycles"]]
                        yield Batch(batch["net"], batch["id"], batch["port"], batch["cycles"], times, batch["values"])
                    yield Sample("", 0, data["cycle"], 0.0, {})

    async def _stream(self, params: Mapping[str, Any], opened: Callable[[], None] = lambda: None) -> Any:
        event = ""
        request = self._io.build("GET", "/stream", params=dict(params))
        async with aclosing(cast(Any, self._io.lines(request, opened))) as lines:
            async for line in lines:
                if line.startswith("event: "):
                    event = line[7:]
                elif line.startswith("data: "):
                    yield event, json.loads(line[6:])
                elif line.startswith(":"):
                    yield "", {}  # Nothing to tell for some seconds.


class AsyncCommand:
    """A loaded net; `await command` awaits its outcome."""

    def __init__(self, cell: AsyncCell, id: int) -> None:
        """Made by `AsyncCell.load`."""
        self._cell, self.id = cell, id
        #: True if it ends with this program.
        self._is_bound = False

    def __await__(self) -> Generator[Any, None, Outcome]:
        """Waits until the command has ended."""
        return self.wait().__await__()

    async def _do(self, method: str, what: str = "", **parts: Any) -> Any:
        return await self._cell._ask(method, f"/commands/{self.id}{what}", **parts)

    async def state(self) -> api.CommandView:
        """STATE: everything that is known about it, but its text."""
        return cast(api.CommandView, await self._do("GET", params={"brief": "true"}))

    async def _state_even_unloaded(self) -> api.CommandView:
        return cast(api.CommandView, await self._do("GET", params={"unloaded": "true"}))

    async def start(self, *, on_client_loss: OnClientLoss = "go on") -> int:
        """START; returns the first cycle. A program that is killed leaves what `on_client_loss` says."""
        cycle = await self._cell._begin(f"/commands/{self.id}/start", {}, on_client_loss)
        self._is_bound = on_client_loss == "cancel"
        return cycle

    async def cancel(self) -> None:
        """CANCEL: asks the net to end in its own way."""
        await self._do("POST", "/cancel")

    async def abort(self) -> None:
        """ABORT: ends the net at once; the drivers bring its arms to rest."""
        await self._do("POST", "/abort")

    async def unload(self) -> None:
        """UNLOAD."""
        await self._do("DELETE")

    async def _unload_ended(self) -> None:
        """UNLOAD of a command that has ended; somebody else may have unloaded it."""
        try:
            await self.unload()
        except errors.RccError as error:
            if error.code != UNKNOWN_COMMAND:
                raise

    async def wait(self, timeout: float | None = None) -> Outcome:
        """Waits until the command has ended; raises `TimeoutError` after that many seconds."""
        view = await self._until(lambda state: state in ENDED, timeout)
        reason, words = str(view.get("reason")), str(view.get("words") or "")
        return Outcome(view["net"], self.id, reason, view.get("outcome"), words, view["cycles"])

    async def set(self, values: Mapping[str, Value]) -> int:
        """Sets inputs, all in the same cycle, which is returned; `None` unsets."""
        return await self._cell._set(self.id, values)

    @asynccontextmanager
    async def channel(self) -> AsyncIterator[Channel]:
        """A set-point channel for the block: `async with command.channel() as channel:`, then `channel.set({…})`.

        For a loop of the program's own, at up to the rate of the cell; `set` does not wait for the cell. When the block
        ends, `channel.end` tells what became of all lines, and the first error is raised.
        """
        channel = Channel()

        async def send(io: _io.Io, opened: Callable[[], None]) -> None:
            opened()
            try:
                command = AsyncCommand(AsyncCell(self._cell._address, io), self.id)
                channel.end = await command.set_points(channel.lines())
            except BaseException as error:
                channel.fail(error)
                raise

        background = await self._cell._io.background(self._cell._address, send)
        try:
            yield channel
        finally:
            channel.close()
            await background.finish()

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

    async def watch(self, *ports: str, rate: float = 10.0) -> AsyncIterator[Sample]:
        """Values of its ports such as ``move.distance`` (all without arguments), at a rate, Hz, until it has ended.

        The last sample has its last values.
        """
        named = [f"#{self.id}/{port}" for port in ports or ("*",)]
        async with aclosing(cast(Any, self._cell.watch(*named, rate=rate))) as samples:
            async for sample in samples:
                yield sample

    async def _until(self, holds: Any, timeout: float | None = None) -> api.CommandView:
        async def follow() -> api.CommandView:
            view = await self._state_even_unloaded()
            if holds(view["state"]):
                return view
            # The stream begins with the state of now: nothing is missed in between, but that it is unloaded then.
            asked = time.monotonic()
            async with aclosing(self._cell._stream({"states": "true"})) as stream:
                async for event, data in stream:
                    is_own = event == "state" and data["id"] == self.id
                    if (is_own and (holds(data["state"]) or data["state"] == GONE)) or (
                        not is_own and time.monotonic() - asked > ASK_AGAIN_S
                    ):
                        # Raises that it is not there, if somebody unloaded it before it had ended.
                        view, asked = await self._state_even_unloaded(), time.monotonic()
                        if holds(view["state"]):
                            return view
            raise errors.RccError("", "the cell ended its stream of states", "look at `rcc-cli status`")

        async def follow_patiently() -> api.CommandView:
            while True:
                try:
                    return await follow()
                except errors.RccError as error:
                    if error.code != TOO_MANY:
                        raise
                await self._cell._io.pause(ASK_EVERY_S)

        return await self._cell._io.within(timeout, follow_patiently())

    async def _loaded(self) -> api.CommandView:
        """Waits until the net is ready or rejected, which it nearly always is: asks, instead of opening a stream."""
        while (view := await self.state())["state"] == "loading":
            await self._cell._io.pause(ASK_EVERY_S)
        return view

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
        first, *others = net.nets()
        if others:
            raise TypeError("a sequence becomes several nets: give it to `cell.run`")
        net = first
    document = net.document() if isinstance(net, Net) else cast(Any, net)
    return json.dumps(document), "application/json"


def finished(outcome: Outcome, failures: Mapping[str, str]) -> Outcome:
    """The outcome of a net that finished; raises for any other, and for an outcome that means failure."""
    if outcome:
        if why := failures.get(outcome.outcome or ""):
            raise errors.ActionFailed("", f"{why} ({outcome})", "what should follow was not begun")
        return outcome
    if outcome.reason == "canceled":
        raise errors.NetCanceled("", f"{outcome}", "what should follow was not begun")
    raise errors.NetFault("", f"{outcome}", "see `cell.events()`, and `rcc-cli replay` for the last seconds")
