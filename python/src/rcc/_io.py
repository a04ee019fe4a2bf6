"""One implementation for blocking and asynchronous programs.

Everything above this module is written with `async`. The blocking transport's coroutines never suspend, so that
`run` can drive them without an event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar
from urllib.parse import quote

import httpx

from . import errors

T = TypeVar("T")
#: Work in the background: it gets a transport, and calls the function when it has begun.
Work = Callable[["Io", Callable[[], None]], Coroutine[Any, Any, None]]


class Background(Protocol):
    """Work beside the program."""

    def is_over(self) -> bool:
        """True if it has ended, or failed."""

    async def stop(self) -> None:
        """Ends it; raises the error that it ended with."""

    async def finish(self) -> None:
        """Waits for its own end; raises the error that it ended with."""


class Io(Protocol):
    """Functions that the client needs from a transport."""

    async def send(self, request: httpx.Request, timeout: float | None) -> httpx.Response:
        """Sends a request and reads the whole answer."""

    def lines(self, request: httpx.Request, opened: Callable[[], None] = ...) -> AsyncIterator[str]:
        """Sends a request and reads the answer line by line; calls `opened` when it begins."""

    async def background(self, address: Address, work: Work) -> Background:
        """Does `work` beside the program, until it is stopped; returns when the work has called `opened`."""

    async def pause(self, time_s: float) -> None:
        """Waits for a time."""

    def build(self, method: str, path: str, **parts: Any) -> httpx.Request:
        """Builds a request."""

    async def within(self, timeout: float | None, work: Coroutine[Any, Any, T]) -> T:
        """Waits for `work`; raises `TimeoutError` after that many seconds."""

    async def finish(self, work: Coroutine[Any, Any, None]) -> None:
        """Does `work` to its end, also in a task that is being canceled."""

    async def close(self) -> None:
        """Closes all connections."""


def run(work: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine over the blocking transport, which never suspends."""
    try:
        work.send(None)
    except StopIteration as done:
        result: T = done.value
        return result
    work.close()
    raise RuntimeError("an operation of the blocking client was suspended")


def iterate(values: AsyncIterator[T]) -> Iterator[T]:
    """Iterates over an asynchronous iterator of the blocking transport."""

    async def following() -> list[T]:
        try:
            return [await values.__anext__()]
        except StopAsyncIteration:
            return []

    try:
        while found := run(following()):
            yield found[0]
    finally:
        close = getattr(values, "aclose", None)
        if close is not None:
            run(close())


class _Limits(threading.local):
    """When the work of `within` must be done, for each thread that uses a transport; by `time.monotonic`."""

    deadline: float | None = None

    def left(self) -> float | None:
        """The time that is left, s; `None` if it has no limit."""
        # An answer gets a moment in any case, so that `wait(0)` asks once.
        return None if self.deadline is None else max(ASK_S_MIN, self.deadline - time.monotonic())


def _shut(response: httpx.Response) -> None:
    """Ends the connection of a stream, which may be read by another thread."""
    stream = response.extensions.get("network_stream")
    connection = stream.get_extra_info("socket") if stream is not None else None
    if connection is not None:
        # It may be closed already.
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


@contextlib.contextmanager
def _shut_at(deadline: float | None, response: httpx.Response) -> Iterator[threading.Event]:
    """Ends the connection of a stream at its deadline, and sets the event.

    The read timeout of httpx counts from the last bytes, and cannot shrink while a stream is read: the keep-alive of
    the loader, every 5 s, and each change of any command would extend it.
    """
    is_late = threading.Event()

    def end() -> None:
        is_late.set()
        _shut(response)

    if deadline is None:
        yield is_late
        return
    timer = threading.Timer(max(0.0, deadline - time.monotonic()), end)
    timer.daemon = True
    timer.start()
    try:
        yield is_late
    finally:
        timer.cancel()


class BlockingIo:
    """The transport of blocking programs."""

    def __init__(self, address: Address) -> None:
        """Opens no connection yet."""
        transport = httpx.HTTPTransport(uds=address.socket)
        self._client = httpx.Client(transport=transport, base_url=address.url, headers=address.headers)
        self._limits = _Limits()
        self._live: list[httpx.Response] = []
        self._is_cut = False

    async def within(self, timeout: float | None, work: Coroutine[Any, Any, T]) -> T:
        """Waits for `work`; raises `TimeoutError` after that many seconds."""
        if timeout is None:
            return await work
        self._limits.deadline = time.monotonic() + timeout
        try:
            return await work
        except (httpx.ReadTimeout, TimeoutError) as error:
            raise TimeoutError(f"not within {timeout} s") from error
        finally:
            self._limits.deadline = None

    async def finish(self, work: Coroutine[Any, Any, None]) -> None:
        """Does `work` to its end."""
        await work

    def build(self, method: str, path: str, **parts: Any) -> httpx.Request:
        """Builds a request."""
        return self._client.build_request(method, path, **parts)

    async def send(self, request: httpx.Request, timeout: float | None) -> httpx.Response:
        """Sends a request and reads the whole answer."""
        left = self._limits.left()
        limit = min((limit for limit in (timeout, left) if limit is not None), default=None)
        request.extensions["timeout"] = httpx.Timeout(limit).as_dict()
        try:
            return self._client.send(request)
        except httpx.TimeoutException as error:
            if limit == timeout:
                raise
            raise TimeoutError from error

    async def lines(self, request: httpx.Request, opened: Callable[[], None] = lambda: None) -> AsyncIterator[str]:
        """Sends a request and reads the answer line by line; calls `opened` when it begins."""
        deadline = self._limits.deadline
        if deadline is not None and time.monotonic() >= deadline:
            raise TimeoutError
        request.extensions["timeout"] = httpx.Timeout(self._limits.left(), connect=STEP_S).as_dict()
        response = self._client.send(request, stream=True)
        self._live.append(response)
        try:
            with _shut_at(deadline, response) as is_late:
                if response.status_code >= 400:
                    response.read()
                    raise error_of(response)
                opened()
                for line in response.iter_lines():
                    if is_late.is_set():
                        break
                    yield line
        except httpx.TransportError:
            if not self._is_cut and not is_late.is_set():
                raise
        finally:
            self._live.remove(response)
            response.close()
        if is_late.is_set():
            raise TimeoutError

    def cut(self) -> None:
        """Ends the streams that another thread reads."""
        self._is_cut = True
        for response in list(self._live):
            _shut(response)

    async def background(self, address: Address, work: Work) -> Background:
        """Does `work` in a thread."""
        thread = _Thread(address, work)
        thread.await_opened()
        return thread

    async def pause(self, time_s: float) -> None:
        """Waits for a time."""
        time.sleep(time_s)

    async def close(self) -> None:
        """Closes all connections."""
        self._client.close()


class _Thread:
    """Work in a thread, with a transport of its own."""

    def __init__(self, address: Address, work: Work) -> None:
        self._io = BlockingIo(address)
        self._begun = threading.Event()
        self._work = work
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="rcc-stream", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            run(self._work(self._io, self._begun.set))
        except BaseException as error:
            self._error = error
        finally:
            self._begun.set()
            run(self._io.close())

    def await_opened(self) -> None:
        """Waits until the work has begun; raises its error."""
        self._begun.wait()
        if self._error is not None:
            raise self._error

    def is_over(self) -> bool:
        """True if it has ended, or failed."""
        return not self._thread.is_alive()

    async def stop(self) -> None:
        """Ends it; raises the error that it ended with."""
        self._io.cut()
        await self.finish()

    async def finish(self) -> None:
        """Waits for its own end; raises the error that it ended with."""
        self._thread.join()
        if self._error is not None:
            raise self._error


class AsyncIo:
    """The transport of asynchronous programs."""

    def __init__(self, address: Address) -> None:
        """Opens no connection yet."""
        transport = httpx.AsyncHTTPTransport(uds=address.socket)
        self._client = httpx.AsyncClient(transport=transport, base_url=address.url, headers=address.headers)

    async def within(self, timeout: float | None, work: Coroutine[Any, Any, T]) -> T:
        """Waits for `work`; raises `TimeoutError` after that many seconds."""
        try:
            return await asyncio.wait_for(work, timeout)
        except asyncio.TimeoutError as error:
            raise TimeoutError(f"not within {timeout} s") from error

    async def finish(self, work: Coroutine[Any, Any, None]) -> None:
        """Does `work` to its end, also in a task that is being canceled."""
        await asyncio.shield(work)

    def build(self, method: str, path: str, **parts: Any) -> httpx.Request:
        """Builds a request."""
        content = parts.get("content")
        if content is not None and not isinstance(content, (str, bytes)):
            parts["content"] = _slowly(content)
        return self._client.build_request(method, path, **parts)

    async def send(self, request: httpx.Request, timeout: float | None) -> httpx.Response:
        """Sends a request and reads the whole answer."""
        request.extensions["timeout"] = httpx.Timeout(timeout).as_dict()
        return await self._client.send(request)

    async def lines(self, request: httpx.Request, opened: Callable[[], None] = lambda: None) -> AsyncIterator[str]:
        """Sends a request and reads the answer line by line; calls `opened` when it begins."""
        request.extensions["timeout"] = httpx.Timeout(None, connect=STEP_S).as_dict()
        response = await self._client.send(request, stream=True)
        try:
            if response.status_code >= 400:
                await response.aread()
                raise error_of(response)
            opened()
            async for line in response.aiter_lines():
                yield line
        finally:
            await response.aclose()

    async def background(self, address: Address, work: Work) -> Background:
        """Does `work` in a task."""
        opened = asyncio.Event()
        task = asyncio.create_task(work(self, opened.set))
        waiting = asyncio.create_task(opened.wait())
        await asyncio.wait((task, waiting), return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if task.done() and not opened.is_set():
            task.result()
        return _Task(task)

    async def pause(self, time_s: float) -> None:
        """Waits for a time."""
        await asyncio.sleep(time_s)

    async def close(self) -> None:
        """Closes all connections."""
        await self._client.aclose()


class _Task:
    """Work in a task."""

    def __init__(self, task: asyncio.Task[None]) -> None:
        self._task = task

    def is_over(self) -> bool:
        """True if it has ended, or failed."""
        return self._task.done()

    async def stop(self) -> None:
        """Ends it; raises the error that it ended with."""
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task

    async def finish(self) -> None:
        """Waits for its own end; raises the error that it ended with."""
        await self._task


async def _slowly(parts: Iterable[bytes]) -> AsyncIterator[bytes]:
    """Takes each part in a thread: a program's own iterator may wait."""
    iterator, end = iter(parts), object()
    while (part := await asyncio.to_thread(next, iterator, end)) is not end:
        assert isinstance(part, bytes)
        yield part


#: Longest time for one answer, s.
STEP_S = 10.0
#: Least time for one answer, also when the time of `within` is over, s.
ASK_S_MIN = 0.1


class Address:
    """Where a cell's loader listens."""

    def __init__(self, cell: str | None, url: str | None, token: str | None) -> None:
        """A cell on this machine by name, or a loader by URL with its token."""
        url = url or (None if cell else os.environ.get("RCC_URL"))
        self.name = url or cell or os.environ.get("RCC_CELL", "demo")
        self.url = url or "http://rcc"
        self.socket = None if url else str(_folder() / self.name / "loader.sock")
        token = token or os.environ.get("RCC_TOKEN")
        self.headers = {"authorization": f"Bearer {token}"} if url and token else {}

    def not_found(self, error: Exception) -> errors.CellNotFound:
        """The error for a loader that does not answer."""
        at = self.socket or self.url
        return errors.CellNotFound(
            "", f"cell {self.name} does not answer at {at}: {error}", "start it with `rcc-cli up FILE`"
        )


def _folder() -> Path:
    """The runtime folder, as all programs of RCC find it."""
    if named := os.environ.get("RCC_RUNTIME_DIR"):
        return Path(named)
    if os.geteuid() == 0:
        return Path("/run/rcc")
    if user := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(user) / "rcc"
    return Path(f"/tmp/rcc-{os.geteuid()}")


def error_of(response: httpx.Response) -> errors.RccError:
    """The error in an answer."""
    try:
        body = response.json()
    except ValueError:
        body = None
    return errors.of_body(response.status_code, body)


async def call(io: Io, address: Address, method: str, path: str, timeout: float | None, **parts: Any) -> Any:
    """Sends a request; returns the JSON of the answer, or raises the error in it."""
    try:
        response = await io.send(io.build(method, path, **parts), timeout)
    except httpx.ConnectError as error:
        raise address.not_found(error) from None
    except httpx.TransportError as error:
        what = f"{method} {path}: {type(error).__name__} {error}".rstrip()
        raise errors.RccError("", f"cell {address.name} gave no answer: {what}", "see `rcc-cli status`") from error
    if response.status_code >= 400:
        raise error_of(response)
    return response.json()


def segment(text: str | int) -> str:
    """A part of a path."""
    return quote(str(text), safe="")

