"""The benchmarks, once and briefly: they still run."""

import re
import runpy
import sys
from pathlib import Path


def test_latency(cell_name, cell, monkeypatch, capsys):
    monkeypatch.setenv("RCC_CELL", cell_name)
    monkeypatch.setattr(sys, "argv", ["latency.py", "--nets", "3"])
    runpy.run_path(str(Path(__file__).parents[1] / "benches/latency.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    outcome, hand_over = (line for line in lines if "times" in line)
    assert re.search(r"3 times  min +[1-9]", outcome)
    # In a hand-over the last cycle of one net is followed by the first of the other.
    assert re.search(r"3 times  min +[01]\.0 ms .* max +[01]\.0 ms", hand_over)
    # Each of them is in one class of its histogram.
    counts = [int(re.findall(r"ms +(\d+)  #", line)[0]) for line in lines if "#" in line]
    assert sum(counts) == 6, lines


def test_streams(cell_name, cell, monkeypatch, capsys):
    monkeypatch.setenv("RCC_CELL", cell_name)
    monkeypatch.setattr(sys, "argv", ["streams.py", "--seconds", "0.3"])
    runpy.run_path(str(Path(__file__).parents[1] / "benches/streams.py"), run_name="__main__")
    slow, fast, *sampled, sent_slow, sent_fast = capsys.readouterr().out.splitlines()
    assert all(re.search(r"sampled at .* values .* lost \d+  apart: p1 .* max", line) for line in sampled)
    assert len(sampled) == 2
    for line, rate in ((slow, 100), (fast, 1000)):
        got, expected, gaps, lost = map(int, re.findall(r"(\d+) of +(\d+) values +gaps (\d+) +lost (\d+)", line)[0])
        # Of a stream that begins late, fewer are expected.
        assert expected >= 0.1 * rate and (got == expected and gaps == 0 or lost > 0), line
    assert all(re.search(r"[1-9]\d* sent  took effect [1-9]", line) for line in (sent_slow, sent_fast))
