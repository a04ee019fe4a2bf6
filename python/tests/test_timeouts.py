"""A timeout of the blocking client ends the waiting in time, whatever the stream of states tells meanwhile."""

import select
import threading

import pytest
from fake_loader import FakeLoader
from test_cell import waiting

import rcc


class Loader(FakeLoader):
    """Answers as a loader does: its command runs for ever, and its stream of states gives signs of life."""

    def __init__(self, path):
        super().__init__(path)
        #: Time between two signs of life, s; and their number, after which the stream ends.
        self.every, self.signs = 0.01, 500
        #: Signs of life of a stream that has ended; `None` while there is none.
        self.given, self.streamed = None, threading.Event()
        #: Answers to questions wait for it, if they are to be late.
        self.answers = threading.Event()
        self.answers.set()
        self.asked = threading.Event()

    def answer(self, _method, path, _body):
        """The command, of which questions may be answered late."""
        if path.startswith("/commands"):
            self.asked.set()
            self.answers.wait(60)
        return 200, {"id": 1, "net": "any", "state": "running", "executor": {}}

    def stream(self, request):
        """Gives signs of life until the client has gone, or the last one is given."""
        request.close_connection = True
        request.send_response(200)
        request.end_headers()
        given = 0
        while given < self.signs and not select.select([request.connection], [], [], self.every)[0]:
            request.wfile.write(b": alive\n\n")
            given += 1
        self.given = given
        self.streamed.set()


@pytest.fixture
def loader(tmp_path, monkeypatch):
    """A loader of a cell of its own."""
    monkeypatch.setenv("RCC_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "told").mkdir()
    with Loader(tmp_path / "told/loader.sock").serving() as server:
        yield server
        server.answers.set()


@pytest.mark.parametrize(
    ("every", "signs", "timeout", "most"),
    [
        # Lines that keep arriving do not extend it.
        (0.01, 500, 0.3, 499),
        # Nor does one that arrives shortly before the end, and after which the stream is silent.
        (1.5, 3, 1.6, 1),
    ],
)
def test_a_wait_ends_in_time_whatever_the_stream_tells(loader, every, signs, timeout, most):
    loader.every, loader.signs = every, signs
    with rcc.connect("told") as cell, pytest.raises(TimeoutError, match=f"not within {timeout} s"):
        cell.command(1).wait(timeout)
    assert loader.streamed.wait(60)
    assert loader.given <= most, "the client has not waited for the next sign of life"


def test_a_wait_ends_in_time_if_the_loader_does_not_answer(loader):
    with rcc.connect("told") as cell:
        command = cell.command(1)
        loader.answers.clear()
        with pytest.raises(TimeoutError, match="not within"):
            command.wait(0.3)


def test_a_timeout_is_of_the_thread_that_waits(loader):
    with rcc.connect("told") as cell:
        command = cell.command(1)
        loader.answers.clear()
        loader.asked.clear()
        late = []

        def wait():
            try:
                command.wait(0.3)
            except TimeoutError as error:
                late.append(error)

        waiter = threading.Thread(target=wait)
        waiter.start()
        assert loader.asked.wait(60)
        # It is answered when the other thread has given up.
        threading.Thread(target=lambda: (waiter.join(), loader.answers.set())).start()
        command.cancel()
        waiter.join()
        assert len(late) == 1


class Changing(threading.Thread):
    """Loads and unloads nets over a connection of its own, which changes states all the time; has an end."""

    ROUNDS = 1000

    def __init__(self, cell_name):
        super().__init__()
        self.cell_name, self.rounds = cell_name, 0
        self.began, self.stopped = threading.Event(), threading.Event()

    def run(self):
        with rcc.connect(self.cell_name) as cell:
            while not self.stopped.is_set() and self.rounds < self.ROUNDS:
                cell.load(waiting("changing")).unload()
                self.rounds += 1
                self.began.set()

    def __enter__(self):
        self.start()
        assert self.began.wait(60.0)
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.join()


def test_a_wait_ends_in_time_while_other_commands_change(cell, cell_name):
    command = cell.start(waiting("waited"))
    with Changing(cell_name) as changing:
        with pytest.raises(TimeoutError):
            command.wait(0.5)
        assert changing.is_alive() and changing.rounds < changing.ROUNDS


def test_a_run_that_takes_too_long_is_canceled_while_other_commands_change(cell, cell_name):
    with Changing(cell_name) as changing:
        with pytest.raises(TimeoutError):
            cell.run(waiting("run"), timeout=0.5)
        assert changing.is_alive() and changing.rounds < changing.ROUNDS
    assert cell.commands() == []
