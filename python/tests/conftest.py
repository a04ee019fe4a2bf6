"""Starts one simulated cell of its own for all tests; its programs are in RCC_BIN, else in `target/debug`."""

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

import rcc

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(os.environ.get("RCC_BIN", ROOT / "target" / "debug"))
CELL = f"python-{os.getpid()}"


@pytest.fixture(scope="session", autouse=True)
def programs():
    """The folder of the programs; `rcc-cli` is found there."""
    os.environ["RCC_CLI"] = str(BIN / "rcc-cli")
    return BIN


@contextlib.contextmanager
def running(programs, name, config):
    """A running cell; afterwards nothing of it is left."""
    with tempfile.TemporaryDirectory(prefix="rcc-py") as folder, pytest.MonkeyPatch.context() as environment:
        environment.setenv("RCC_STATE_DIR", folder)
        log = Path(folder) / "up.log"
        with open(log, "w+") as out:
            command = [programs / "rcc-cli", "--cell", name, "up", ROOT / "configs/cells" / config]
            up = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
            try:
                await_ready(up, name, log)
                yield name
            finally:
                up.send_signal(signal.SIGINT)
                assert up.wait(60) == 0


@pytest.fixture(scope="session")
def runtime():
    """The folder of all cells of the tests."""
    with tempfile.TemporaryDirectory(prefix="rcc-py") as folder:
        os.environ["RCC_RUNTIME_DIR"] = folder
        yield folder


@pytest.fixture(scope="session")
def cell_name(programs, runtime):
    """A running demo cell."""
    with running(programs, CELL, "demo.yaml") as name:
        yield name


@pytest.fixture(scope="session")
def two_arms(programs, runtime):
    """A running cell with two arms."""
    with running(programs, f"{CELL}-two", "two-arms.yaml") as name:
        yield name


def await_ready(up, name, log):
    """Returns when all devices of the cell are ready."""
    limit = time.monotonic() + 120
    while True:
        assert up.poll() is None, f"rcc-cli up ended: {log.read_text()}"
        try:
            with rcc.connect(name) as cell:
                if all(device["state"] == "ready" for device in cell.devices()):
                    return
        except rcc.RccError:
            pass  # Not up yet.
        assert time.monotonic() < limit, log.read_text()
        time.sleep(0.05)


@pytest.fixture
def cell(cell_name):
    """A connection; whatever the test left behind is ended and unloaded."""
    with rcc.connect(cell_name) as connection:
        yield connection
        for view in connection.commands():
            command = connection.command(view["id"])
            if view["state"] in ("running", "canceling"):
                command.abort()
                command.wait(60)
            command.unload()
