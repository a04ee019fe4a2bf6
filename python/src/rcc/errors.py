"""Errors: each says what happened, where, and what to do about it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any


class RccError(Exception):
    """An error of the cell, with its code (``RCC3001``), and a remedy if there is one."""

    def __init__(
        self, code: str, message: str, help: str | None = None, diagnostics: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        """Keeps all parts; the text of the exception has them too."""
        self.code = code
        self.message = message
        self.help = help
        self.diagnostics = list(diagnostics)
        lines = [f"{code}: {message}" if code else message]
        lines += [str(finding["rendered"]).rstrip() for finding in self.diagnostics if finding.get("rendered")]
        if help:
            lines.append(f"help: {help}")
        super().__init__("\n".join(lines))


class CellNotFound(RccError):
    """No loader answers at the address."""


class NetRejected(RccError):
    """The net has errors; `diagnostics` has each one with its place."""


class NetFault(RccError):
    """A net ended with a fault, or was aborted."""


class NetCanceled(RccError):
    """A net was canceled: what should follow it must not begin."""


class ActionFailed(RccError):
    """An action did not do what it should, such as a gripper that did not close: what should follow must not begin."""


class Busy(RccError):
    """Another command holds an arm or an output that the net needs; `holder` is its name, `net#id`."""

    @property
    def holder(self) -> str | None:
        """The command that holds it."""
        found = re.search(r"[^\s,]+#\d+(?= holds)", self.message)
        return found.group() if found else None


#: Classes of errors by their codes.
CLASSES: dict[str, type[RccError]] = {"RCC3004": Busy}


def of_body(status: int, body: object) -> RccError:
    """The error in the body of an answer."""
    if not isinstance(body, dict) or "code" not in body:
        return RccError("", f"unexpected answer with status {status}", "use a client of the cell's version")
    kind = NetRejected if body.get("diagnostics") else CLASSES.get(str(body["code"]), RccError)
    return kind(str(body["code"]), str(body["message"]), body.get("help"), body.get("diagnostics") or ())
