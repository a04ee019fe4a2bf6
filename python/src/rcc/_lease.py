"""A lease: how the cell knows that this program lives. Commands that are bound to it end with the program.

A thread of its own renews it, so that a program that computes, draws, or waits for a person keeps what it runs. The
executor counts the time since the last renewal: the death of the program, of the loader and of the network look the
same to it.
"""

from __future__ import annotations

import threading

import httpx

from . import _io

#: Renewals in the time after which a lease expires.
RENEWALS = 5
#: Code of the answer that the lease does not exist, or has expired.
UNKNOWN = "RCC3053"


class Lease:
    """Renews a lease that was granted, until it is ended or lost."""

    def __init__(self, address: _io.Address, number: int, expires_s: float) -> None:
        """Starts the thread."""
        self.number, self._pause_s = number, expires_s / RENEWALS
        transport = httpx.HTTPTransport(uds=address.socket)
        timeout = httpx.Timeout(expires_s)
        self._client = httpx.Client(transport=transport, base_url=address.url, headers=address.headers, timeout=timeout)
        self._ended = threading.Event()
        #: True when the cell has forgotten it: what was bound to it was canceled.
        self.is_lost = False
        self._thread = threading.Thread(target=self._renew, name="rcc-lease", daemon=True)
        self._thread.start()

    def _renew(self) -> None:
        while not self._ended.wait(self._pause_s):
            try:
                answer = self._client.post(f"/leases/{self.number}/renew")
            except httpx.TransportError:
                # The loader is being restarted, or slow: the executor decides when it has been too long.
                continue
            if answer.status_code >= 400 and _io.error_of(answer).code == UNKNOWN:
                self.is_lost = True
                break

    def end(self) -> None:
        """Stops renewing."""
        self._ended.set()
        self._thread.join()
        self._client.close()
