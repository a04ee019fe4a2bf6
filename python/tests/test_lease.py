"""The lease of the client: requested, named at START, renewed beside the program, and ended."""

import asyncio
import threading
import time

import pytest
from fake_loader import FakeLoader

import rcc

NOT_THERE = {"code": "RCC3053", "message": "lease 1 does not exist, or has expired"}


class Loader(FakeLoader):
    """Answers as a loader does, as far as leases are concerned, and notes what it is asked."""

    def __init__(self, path):
        super().__init__(path)
        self.asked, self.granted, self.expired = [], 0, set()
        self.changed = threading.Condition()

    def until(self, holds):
        """Waits until the requests so far fulfil a condition."""
        with self.changed:
            assert self.changed.wait_for(lambda: holds(self.asked), 60), self.asked

    def answer(self, method, path, body):
        """The status and the body of an answer."""
        with self.changed:
            self.asked.append((method, path, body))
            self.changed.notify_all()
        if path == "/leases":
            self.granted += 1
            return 200, {"lease": self.granted, **body}
        if path.startswith("/leases/"):
            number = int(path.split("/")[2])
            return (404, NOT_THERE) if number in self.expired else (200, {"lease": number, "cycle": 1})
        if path.endswith("/start") or path == "/switch":
            return (404, NOT_THERE) if body.get("lease") in self.expired else (200, {"cycle": 7})
        return 200, {"id": 1, "net": "any", "state": "ready", "executor": {}}


@pytest.fixture
def loader(tmp_path, monkeypatch):
    """A loader of a cell of its own."""
    monkeypatch.setenv("RCC_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "told").mkdir()
    with Loader(tmp_path / "told/loader.sock").serving() as server:
        yield server


def starts(loader):
    return [(path, body.get("lease")) for _, path, body in loader.asked if "start" in path or path == "/switch"]


def ended(loader):
    return [path for method, path, _ in loader.asked if method == "DELETE"]


def renewals(asked, number=1):
    return sum(path == f"/leases/{number}/renew" for _, path, _ in asked)


def test_a_lease_is_granted_once_and_renewed_while_the_program_computes(loader):
    with rcc.connect("told", lost_after=0.2) as cell:
        first, second = cell.load("net: a"), cell.load("net: b")
        assert first.start(on_client_loss="cancel") == 7
        # It is not this thread that renews.
        limit = time.monotonic() + 60
        while renewals(loader.asked) < 3:
            assert time.monotonic() < limit
        cell.start("net: c")
        second.start()
    assert starts(loader) == [("/commands/1/start", 1), ("/commands/1/start", 1), ("/commands/1/start", None)]
    assert loader.granted == 1 and ("POST", "/leases", {"expires_ms": 200}) in loader.asked
    assert loader.asked[-1][:2] == ("DELETE", "/leases/1"), "to close is to be gone"


def test_what_goes_on_needs_no_lease(loader):
    with rcc.connect("told") as cell:
        cell.start("net: a", on_client_loss="go on")
        with pytest.raises(ValueError, match="neither `cancel` nor `go on`"):
            cell.start("net: a", on_client_loss="stop")
    assert loader.granted == 0 and [lease for _, lease in starts(loader)] == [None]


def test_a_hand_over_keeps_what_was_said_about_what_it_stops(loader):
    with rcc.connect("told") as cell:
        bound, free = cell.load("net: a"), cell.load("net: b")
        bound.start(on_client_loss="cancel")
        cell.switch([bound], [free])
        cell.switch([free], [bound], on_client_loss="go on")
        cell.switch([bound], [free])
    assert [lease for path, lease in starts(loader) if path == "/switch"] == [1, None, None]


def test_one_that_expired_is_asked_for_again(loader):
    with rcc.connect("told", lost_after=0.2) as cell:
        cell.start("net: a")
        loader.expired.add(1)
        # At once: the thread that renews has not noticed.
        cell.start("net: a")
        loader.until(lambda asked: renewals(asked, 2) > 1)
        loader.expired.add(2)
        loader.until(lambda asked: renewals(asked, 2) > 2)
        cell.start("net: a")
    granted = [lease for _, lease in starts(loader)]
    assert granted[0] == 1 and granted[-1] == 3 and 2 in granted
    assert ended(loader) == ["/leases/3"], "those that are known to have expired are forgotten"


def test_one_that_is_known_to_have_expired_is_not_ended(loader):
    with rcc.connect("told", lost_after=0.2) as cell:
        cell.start("net: a")
        loader.expired.add(1)
        cell._inner._lease._thread.join(60)
    assert loader.granted == 1 and ended(loader) == []


def test_the_same_without_blocking(loader):
    async def main():
        async with rcc.aconnect("told", lost_after=0.2) as cell:
            await cell.start("net: a")
            # A task that blocks the loop does not keep the lease from being renewed.
            loader.until(lambda asked: renewals(asked) > 2)

    asyncio.run(main())
    assert loader.asked[-1][:2] == ("DELETE", "/leases/1")
