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


def test_legs_wait_for_a_condition_and_end_by_one():
    def goal(z):
        return {"xyz": [0.538, 0, z], "rpy": [0, "deg(180)", 0]}

    touch = abs(arm.force.z) > 12 * rcc.N
    down = {"lin": goal(0.234), "velocity": "0.1 m/s", "until": touch}
    back = {"lin": goal(0.384), "velocity": "0.1 m/s"}
    path = arm.path([down, back]).net()
    met, missed = (path.simulate(**options).summary["cycles"] for options in ({"wall": "0,0,0.3,0,0,1"}, {}))
    assert met < missed
    waits = arm.path([{**back, "wait": arm.input("contact")}]).net()
    waits.check()
    assert waits.simulate(cancel_at="1s").summary["reason"] == "canceled"


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
    assert len(steps.nets()) == 3
    assert cell.run(steps).net == "lin"
    with pytest.raises(rcc.NetRejected):
        cell.run(rcc.sequence(lamp.pulse(0.05 * rcc.s), arm.lin([9, 9, 9]), lamp.pulse(60 * rcc.s)))
    with pytest.raises(TypeError, match="several nets"):
        cell.load(steps)
    with pytest.raises(TypeError, match="none in Python"):
        _ = arm.force.z > 1 and True


io = rcc.Device("io")
torch = arm.output("torch")
line = arm.lin([0.538, -0.15, 0.384])


def columns(action, **options):
    """Its outputs and the distance of its motion in each cycle of a simulation."""
    net = action.net()
    parts = net.document()["primitives"]
    names = {}
    for name, part in list(parts.items()):
        if part["type"] == "DigitalOutput":
            source = part["inputs"]["in"]
            net.Monitor(value=source, rate=1000)
            names[part["parameters"]["channel"]] = source
        if "Motion" in part["type"]:
            net.Monitor(value=f"{name}.distance", rate=1000)
            names["distance"] = f"{name}.distance"
    found = net.simulate(**options).columns
    return {key: next(found[column] for column in found if name in column) for key, name in names.items()}


def test_at_switches_at_a_part_of_the_path_and_at_a_distance():
    got = columns(line.at(path=0.3, do=torch.on).at(distance=100 * rcc.mm, do=torch.off))
    on = [at for at, value in zip(got["distance"], got["torch"], strict=True) if value]
    assert 0.045 < min(on) < 0.0455 and 0.099 < max(on) < 0.1
    # Before the first event nothing is commanded.
    assert got["torch"][0] is None and got["torch"][-1] == 0.0


def test_an_output_that_would_be_switched_off_goes_off_with_a_stop_and_another_one_stays():
    slow = arm.lin([0.538, -0.15, 0.384], velocity=0.1 * rcc.m / rcc.s)
    both = slow.at(path=0.1, do=torch.on).at(path=0.9, do=torch.off).at(path=0.2, do=io.lamp.on)
    got = columns(both, cancel_at="1s")
    assert got["distance"][-1] < 0.12, "it was stopped"
    still = [at for at, value in zip(got["distance"], got["torch"], strict=True) if not value and value is not None]
    assert len(still) > 10, "the torch is off while the arm brakes"
    assert got["lamp"][-1] == 1.0


def test_at_takes_pulses_and_refuses_what_it_cannot_do():
    got = columns(line.at(path=0.1, do=io.lamp.pulse(0.05)).at(path=0.95, do=io.lamp.pulse(0.1)))
    lamp = got["lamp"]
    assert sum(1 for value in lamp if value) == 150, "the net waits for the end of the last pulse"
    with pytest.raises(TypeError, match="either `path`"):
        line.at(do=torch.on)
    with pytest.raises(ValueError, match="not a part of the path"):
        line.at(path=1.0, do=torch.on)
    with pytest.raises(TypeError, match="not Motion"):
        line.at(path=0.5, do=line)
    with pytest.raises(ValueError, match="pulses and values"):
        line.at(path=0.5, do=io.lamp.pulse(0.1)).at(path=0.6, do=io.lamp.off).net()


def test_move_is_the_motion_that_fits_its_goal():
    kinds = {
        "LinearMotion": arm.move([0.538, 0.1, 0.384]),
        "JointMotion": arm.move([0, -0.5, 0, 1.5, 0, -1, 0]),
        "MotionSequence": arm.move(by=[0, 0, -0.05], frame="tool"),
    }
    for kind, action in kinds.items():
        assert action.kind == kind
        action.net().check()
    lifted = arm.move(by=[0, 0, 0.05]).monitor("pose").net().simulate()
    z = [values for name, values in lifted.columns.items() if "pose" in name and "z" in name or "[2]" in name][0]
    assert math.isclose(z[-1] - z[0], 0.05, abs_tol=1e-6)
    for wrong in ({}, {"to": [0.5, 0, 0.3], "by": [0, 0, 0.1]}, {"to": [0.5, 0, 0.3], "frame": "tool"}):
        with pytest.raises(TypeError):
            arm.move(**wrong)


def test_while_goes_on_as_long_as_the_condition_holds():
    down = arm.move([0.538, 0.1, 0.234]).while_(abs(arm.force.z) < 12 * rcc.N)
    assert down.net().simulate(wall="0,0,0.3,0,0,1").summary["outcome"] == "stopped"
    assert down.net().simulate().summary["outcome"] == "arrived"


def test_a_blended_sequence_is_one_motion_without_a_rest():
    corners = [arm.lin([0.538, 0.1, 0.384], velocity=0.2), arm.lin([0.538, 0.1, 0.3]), arm.ptp(HOME, scale=0.5)]
    blended = rcc.sequence(*corners, blend=20 * rcc.mm)
    [net] = blended.nets()
    assert [part["type"] for part in net.document()["primitives"].values()].count("MotionSequence") == 1
    simulated = blended.monitor("speed").net().simulate().columns
    speed = next(values for name, values in simulated.items() if "speed" in name)
    middle = speed[len(speed) // 10 : -len(speed) // 10]
    assert min(middle) > 0.01, "it rests at no corner"
    blended.until(abs(arm.force.z) > 12 * rcc.N).at(path=0.5, do=torch.on).net().check()
    with pytest.raises(TypeError, match="to the blended sequence"):
        rcc.sequence(corners[0].until(arm.force.z > 1), corners[1], blend=0.01)
    with pytest.raises(ValueError, match="left and right"):
        rcc.sequence(rcc.Arm("left").lin([0.5, 0, 0.4]), rcc.Arm("right").lin([0.5, 0, 0.4]), blend=0.01)
    with pytest.raises(ValueError, match="`time_optimal` of `lin`"):
        rcc.sequence(arm.lin([0.5, 0, 0.4], time_optimal=True), corners[1], blend=0.01)


def test_a_gripper_closes_and_opens_and_its_input_tells(cell):
    clamp = rcc.Gripper(io.clamp, closed=io.input("clamp_closed"), opened=~io.input("clamp_closed"))
    assert cell.run(clamp.close()).outcome == "closed"
    assert cell.run(rcc.sequence(clamp.open(), clamp.close())).outcome == "closed"
    assert cell.run(clamp.open()).outcome == "opened"
    both = line.at(path=0.3, do=clamp.close)
    assert set(both.net().failures) == {"timed_out"}
    both.net().check()


def test_a_gripper_that_does_not_close_ends_the_sequence(cell):
    stuck = rcc.Gripper(io.clamp, closed=io.input("door_closed"), time=0.2 * rcc.s)
    lamp = io.lamp.pulse(0.05)
    for action in (stuck.close(), rcc.parallel(lamp, stuck.close())):
        with pytest.raises(rcc.ActionFailed, match=r"io\.clamp did not close within 0\.2 s"):
            cell.run(rcc.sequence(action, arm.lin([9, 9, 9])))
    assert cell.commands() == []


def test_an_output_that_would_not_stay_on_is_refused(cell):
    with pytest.raises(rcc.RccError, match=r"io\.lamp would not stay on.*`safe: 0`"):
        cell.run(io.lamp.on())
    assert cell.run(io.lamp.off())
    assert cell.run(io.lamp.pulse()).cycles > 100
    assert cell.run(io.clamp.off())


def test_two_programs_that_want_the_same_arm(cell, cell_name, home):
    first = cell.start(arm.lin([0.538, 0.15, 0.384], velocity=0.02 * rcc.m / rcc.s))
    with rcc.connect(cell_name) as other, pytest.raises(rcc.Busy) as busy:
        other.run(arm.lin([0.538, 0.1, 0.384]))
    assert busy.value.holder == f"lin#{first.id}" and "lwr" in busy.value.message
    assert [view["id"] for view in cell.commands()] == [first.id], "what was refused is unloaded"
    first.cancel()
    assert first.wait(60).reason == "canceled"
