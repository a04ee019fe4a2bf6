"""A set-point channel: inputs of one net, sent from the program's own loop over one connection."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping

from . import errors
from ._generated import api
from .blocks import Value


class Channel:
    """Sends inputs of a net while its `with` block runs; made by `Command.channel`. May be used by any thread."""

    def __init__(self) -> None:
        """Sends nothing yet."""
        self._changed = threading.Condition()
        self._waiting: dict[str, Value] = {}
        self._is_closed = False
        self._error: BaseException | None = None
        #: Calls of `set` whose values newer ones overtook before they were sent.
        self.superseded = 0
        #: What became of all lines that were sent, after the block.
        self.end: api.ChannelEnd | None = None

    def set(self, values: Mapping[str, Value]) -> None:
        """Sends inputs, and does not wait for the cell; the latest values win.

        Raises the error that ended the channel. One that the cell refuses a value with is raised at the end of the
        block, unless the channel ends by it.
        """
        with self._changed:
            if self._error is not None:
                raise self._error
            if self._is_closed:
                raise errors.RccError("", "the set-point channel is closed", "use it in its `with` block")
            self.superseded += bool(self._waiting)
            self._waiting |= values
            self._changed.notify()

    def close(self) -> None:
        """Sends what waits, and ends the channel."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def fail(self, error: BaseException) -> None:
        """Notes the error that ended the channel."""
        with self._changed:
            self._error = error

    def lines(self) -> Iterator[Mapping[str, Value]]:
        """The values that are to be sent, as they come, until the channel is closed."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._waiting) or self._is_closed)
                values, self._waiting = self._waiting, {}
            if not values:
                return
            yield values
