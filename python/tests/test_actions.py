"""Actions, and the paper's figures with them."""

import math
import subprocess
from pathlib import Path

import pytest

import rcc

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
HOME = {"xyz": [0.538, 0.0, 0.384], "rpy": [0, math.pi, 0]}
arm = rcc.Arm("lwr")


@pytest.fixture
def home(cell):
    """The arm is where the figures begin."""
    cell.run(arm.ptp(HOME, scale=0.5))


def figure(number, cell_name, monkeypatch):
    """Runs an example, which is at most ten lines long."""
    text = (EXAMPLES / f"figure{number}.py").read_text()
    assert len([line for line in text.splitlines() if line and not line.startswith('"""')]) <= 10
    monkeypatch.setenv("RCC_CELL", cell_name)
    exec(compile(text, f"figure{number}.py", "exec"), {})


def test_figure_3_is_a_line(home, cell, cell_name, monkeypatch, capsys):
    figure(3, cell_name, monkeypatch)
    assert "finished" in capsys.readouterr().out
    assert cell.load(arm.lin([0.538, 0.15, 0.384], velocity=0.1 * rcc.m / rcc.s)).state()["rehearsal"]["time_s"] < 0.1


def test_figure_4_stops_on_contact(home, cell, cell_name, programs, monkeypatch, capsys):
    fault = [programs / "rcc-cli", "--cell", cell_name, "fault"]
    subprocess.run([*fault, "lwr", "wall", "--point", "0", "0", "0.3", "--normal", "0", "0", "1"], check=True)
    try:
        figure(4, cell_name, monkeypatch)
        assert "stopped" in capsys.readouterr().out
    finally:
        subprocess.run([*fault, "clear", "lwr"], check=True)


def test_figure_5_switches_the_torch_on_a_part_of_the_path(home, cell, cell_name, monkeypatch, capsys):
    figure(5, cell_name, monkeypatch)
    assert "finished" in capsys.readouterr().out


def test_an_output_is_on_between_the_distances_only():
    weld = arm.lin([0.538, -0.15, 0.384]).switch(arm.output("torch"), on=50 * rcc.mm, off=100 * rcc.mm)
    net = weld.net()
    out = next(part for part in net.document()["primitives"].values() if part["type"] == "DigitalOutput")
    move = next(name for name, part in net.document()["primitives"].items() if part["type"] == "LinearMotion")
    net.Monitor(value=out["inputs"]["in"], rate=1000)
    net.Monitor(value=f"{move}.distance", rate=1000)
    columns = net.simulate().columns
    burns, way = (next(columns[name] for name in columns if part in name) for part in (out["inputs"]["in"], "distance"))
    on = [at for at, is_on in zip(way, burns, strict=True) if is_on]
    assert 0.05 < min(on) < 0.051 and 0.099 < max(on) < 0.1
    assert len(on) == sum(0.05 < at < 0.1 for at in way)


def test_a_condition_names_the_outcome():
    down = arm.lin([0.538, 0.1, 0.234], until=abs(arm.force.z) > 12 * rcc.N)
    assert down.net().simulate(wall="0,0,0.3,0,0,1").summary["outcome"] == "stopped"
    assert down.net().simulate().summary["outcome"] == "arrived"
    arm.lin([0.538, 0.1, 0.234]).until(arm.force.x > 12 * rcc.N).until(arm.input("contact")).net().check()


def test_a_canceled_motion_rests_on_its_path_and_its_output_is_off():
    weld = arm.lin([0.538, -0.15, 0.384], velocity=0.1 * rcc.m / rcc.s)
    result = weld.switch(arm.output("torch"), on=0 * rcc.m, off=1 * rcc.m).net().simulate(cancel_at="1s")
    assert result.summary["reason"] == "canceled"


def test_parallel_is_one_net_with_each_sensor_once(cell):
    both = rcc.parallel(
        arm.lin([0.538, 0.05, 0.384], until=(arm.force.z > 50 * rcc.N) | (arm.force.x > 50 * rcc.N)),
        rcc.Output("io", "lamp").pulse(0.2 * rcc.s),
    )
    kinds = [part["type"] for part in both.net().document()["primitives"].values()]
    assert kinds.count("ForceTorque") == kinds.count("Cancel") == kinds.count("Termination") == 1
    assert cell.run(both)


def test_a_sequence_ends_with_the_first_action_that_does_not_finish(cell, home):
    lamp = rcc.Output("io", "lamp")
    steps = rcc.sequence(arm.lin([0.538, 0.05, 0.384]), lamp.pulse(0.05 * rcc.s), arm.lin([0.538, 0.0, 0.384]))
    assert len(steps.steps()) == 3
    assert cell.run(steps).net == "lin"
    with pytest.raises(rcc.NetRejected):
        cell.run(rcc.sequence(lamp.pulse(0.05 * rcc.s), arm.lin([9, 9, 9]), lamp.pulse(60 * rcc.s)))
    with pytest.raises(TypeError, match="several nets"):
        cell.load(steps)
    with pytest.raises(TypeError, match="none in Python"):
        _ = arm.force.z > 1 and True
