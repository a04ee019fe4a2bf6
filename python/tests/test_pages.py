"""The programs of the pages run as they are printed."""

import re
from pathlib import Path

import pytest

import rcc

ROOT = Path(__file__).resolve().parents[2]


def programs(page):
    """The Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)


@pytest.mark.parametrize("page", ["docs/python.md", "python/README.md", "README.md"])
def test_the_first_program_moves_the_arm(page, cell_name, cell, monkeypatch, capsys):
    monkeypatch.setenv("RCC_CELL", cell_name)
    exec(compile(programs(page)[0], page, "exec"), {})
    assert "finished" in capsys.readouterr().out


def test_the_other_programs_are_valid(cell_name):
    built = {"rcc": rcc}
    exec(compile(programs("docs/python.md")[1], "docs/python.md", "exec"), built)
    kinds = [part["type"] for part in built["net"].document()["primitives"].values()]
    assert kinds == ["ForceTorque", "Abs", "Greater"]
    exec(compile(programs("docs/python.md")[2], "docs/python.md", "exec"), built)
    assert [net.name for net in built["all_of_it"].nets()] == ["lin", "parallel", "lin"]
    for net in built["all_of_it"].nets():
        net.check()
    for program in programs("docs/python.md")[3:]:
        compile(program, "docs/python.md", "exec")
