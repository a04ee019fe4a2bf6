"""The benchmarks, once and briefly: they still run."""

import re
import runpy
import sys
from pathlib import Path


def test_latency(cell_name, cell, monkeypatch, capsys):
    monkeypatch.setenv("RCC_CELL", cell_name)
    monkeypatch.setattr(sys, "argv", ["latency.py", "--nets", "3"])
    runpy.run_path(str(Path(__file__).parents[1] / "benches/latency.py"), run_name="__main__")
    outcome, hand_over = capsys.readouterr().out.splitlines()
    assert re.search(r"3 times  p50 +[1-9]", outcome)
    # In a hand-over the last cycle of one net is followed by the first of the other.
    assert re.search(r"3 times  p50 +[01]\.0 ms .* max +[01]\.0 ms", hand_over)


def test_streams(cell_name, cell, monkeypatch, capsys):
    monkeypatch.setenv("RCC_CELL", cell_name)
    monkeypatch.setattr(sys, "argv", ["streams.py", "--seconds", "0.3"])
    runpy.run_path(str(Path(__file__).parents[1] / "benches/streams.py"), run_name="__main__")
    slow, fast, *sent = capsys.readouterr().out.splitlines()
    for line, rate in ((slow, 100), (fast, 1000)):
        got, expected, gaps, lost = map(int, re.findall(r"(\d+) of +(\d+) values +gaps (\d+) +lost (\d+)", line)[0])
        assert expected >= 0.3 * rate - 1 and (got == expected and gaps == 0 or lost > 0), line
    assert all(re.search(r"[1-9]\d* sent  took effect [1-9]", line) for line in sent)
