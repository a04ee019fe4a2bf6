"""Programs of their own, in processes of their own, that are killed at a known place."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

#: Begins every program: an arm, a slow motion, a connection, and ways to say that it is where it is to be killed.
HEAD = """
import rcc, re, sys
arm = rcc.Arm("lwr")
slow = arm.lin([0.538, 0.15, 0.384], velocity=0.01 * rcc.m / rcc.s)
cell = rcc.connect(sys.argv[1], lost_after=0.5)


def say(line):
    sys.stdout.write(line + "\\n")
    sys.stdout.flush()


def ready():
    say("ready")


def hold(method, path, count=1, after=False):
    # Says so when a request is about to be sent the `count`th time, or has been answered, and goes no further.
    ask, seen = cell._inner._ask, []

    async def asked(verb, to, *arguments, **parts):
        is_it = verb == method and re.fullmatch(path, to) is not None
        seen.extend([to] if is_it else [])
        if is_it and len(seen) == count and not after:
            ready()
            sys.stdin.readline()
        answer = await ask(verb, to, *arguments, **parts)
        if is_it and len(seen) == count and after:
            ready()
            sys.stdin.readline()
        return answer

    cell._inner._ask = asked
"""


class Program:
    """A program in a process of its own, which says when it is ready to be killed."""

    def __init__(self, cell_name, text):
        self.process = subprocess.Popen(
            [sys.executable, "-c", HEAD + textwrap.dedent(text), cell_name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parent,
        )

    def line(self):
        """The next line of its output; an empty text if it has ended."""
        return self.process.stdout.readline().rstrip("\n")

    def interrupt(self):
        """Ctrl-C."""
        self.process.send_signal(signal.SIGINT)

    def kill(self, after=0.0, also=None):
        """SIGKILL, some time after it is ready; also to another process."""
        assert self.line() == "ready"
        time.sleep(after)
        self.process.kill()
        if also is not None:
            os.kill(also, signal.SIGKILL)
        self.end()

    def end(self):
        """Waits for its end; returns the exit code."""
        code = self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()
        return code


def states(cell):
    """All commands, with their states and how they ended."""
    return [(view["net"], view["state"], view.get("reason")) for view in cell.commands()]


def until(holds, told):
    """Returns what `holds` returns when that is true."""
    limit = time.monotonic() + 60
    while not (found := holds()):
        assert time.monotonic() < limit, told()
        time.sleep(0.01)
    return found


def until_running(cell, net):
    """Waits until a net runs; returns the id of its command."""

    def running():
        return next((v["id"] for v in cell.commands() if v["net"] == net and v["state"] == "running"), None)

    return until(running, lambda: states(cell))

