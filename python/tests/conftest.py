"""Starts one simulated cell of its own for all tests; its programs are in RCC_BIN, else in `target/debug`."""

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


@pytest.fixture(scope="session")
def cell_name(programs):
    """A running cell; afterwards nothing of it is left."""
    with tempfile.TemporaryDirectory(prefix="rcc-py") as folder:
        os.environ["RCC_RUNTIME_DIR"] = folder
        os.environ["RCC_STATE_DIR"] = folder
        config = ROOT / "configs/cells/demo.yaml"
        with open(Path(folder) / "up.log", "w+") as log:
            up = subprocess.Popen(
                [programs / "rcc-cli", "--cell", CELL, "up", config], stdout=log, stderr=subprocess.STDOUT
            )
            try:
                await_ready(up, Path(folder) / "up.log")
                yield CELL
            finally:
                up.send_signal(signal.SIGINT)
                assert up.wait(60) == 0


def await_ready(up, log):
    """Returns when all devices of the cell are ready."""
    limit = time.monotonic() + 120
    while True:
        assert up.poll() is None, f"rcc-cli up ended: {log.read_text()}"
        try:
            with rcc.connect(CELL) as cell:
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
