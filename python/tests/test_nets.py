"""Building nets, offline."""

import math

import pytest

import rcc


def line(name="line", to=(0.538, 0.15, 0.384), **options):
    net = rcc.Net(name)
    cancel = net.Cancel()
    move = net.LinearMotion(
        device="lwr",
        to={"xyz": to, "rpy": [0, math.pi, 0]},
        velocity=0.15 * rcc.m / rcc.s,
        acceleration="0.5 m/s^2",
        jerk=5 * rcc.m / rcc.s**3,
        stop=cancel.requested,
        name="move",
        **options,
    )
    joints = net.InverseKinematics(device="lwr", pose=move.pose)
    net.JointPositionCommand(device="lwr", position=joints.joints)
    net.Termination(done=move.done)
    net.Monitor(value=move.distance, rate=1000)
    return net


def test_quantities_are_written_with_their_unit():
    assert str(0.1 * rcc.m / rcc.s) == "0.1 m/s"
    assert str(5 * rcc.m / rcc.s**3) == "5.0 m/s^3"
    assert str(1 / rcc.s) == "1.0 1/s"
    assert str(20 * rcc.mm + 1 * rcc.m) == "1.02 m"
    assert (90 * rcc.deg).value == pytest.approx(math.pi / 2)
    assert rcc.m / rcc.m == rcc.Quantity(1.0)
    with pytest.raises(TypeError, match="different units"):
        _ = rcc.m + rcc.s


def test_a_net_is_what_a_person_would_write():
    document = line().document()["primitives"]
    assert document["move"]["parameters"]["velocity"] == "0.15 m/s"
    assert document["move"]["inputs"] == {"stop": "cancel.requested"}
    assert document["joint_position_command"]["inputs"] == {"position": "inverse_kinematics.joints"}
    line().check()


def test_operators_become_primitives():
    net = rcc.Net("sum")
    clock = net.Time(name="clock")
    level = abs(2 * clock.out - 0.1 * rcc.s) / 2
    net.Termination(done=(level > 0.4 * rcc.s) & ~(level < 0.1 * rcc.s))
    kinds = [part["type"] for part in net.document()["primitives"].values()]
    assert kinds == ["Time", "Multiply", "Subtract", "Abs", "Divide", "Greater", "Less", "Not", "And", "Termination"]
    result = net.simulate()
    # |2 t − 0.1| / 2 > 0.4 begins after t = 0.45 s.
    assert result.summary["reason"] == "finished"
    assert result.summary["cycles"] in (452, 453)


def test_a_port_has_no_value_in_python():
    net = rcc.Net("wrong")
    with pytest.raises(TypeError, match="none in Python"):
        _ = net.Time().out > 1 and True
    with pytest.raises(ValueError, match="belongs to net other"):
        net.Abs(in_=rcc.Net("other").Time().out)
    with pytest.raises(ValueError, match="already"):
        net.Time(name="time")
    with pytest.raises(TypeError):
        net.Time(speed=1)


def test_a_wrong_net_is_refused_with_its_place():
    net = rcc.Net("wrong")
    net.Termination(done=net.Greater(a=net.Time().out, b=1 * rcc.m))
    with pytest.raises(rcc.NetRejected, match="greater"):
        net.check()


def test_a_simulation_gives_arrays():
    numpy = pytest.importorskip("numpy")
    result = line().simulate()
    (name,) = [column for column in result.columns if "distance" in column]
    distance = result.array(name)
    assert distance[0] == 0
    assert (numpy.diff(distance) >= 0).all()
    assert distance[-1] == pytest.approx(0.15, abs=1e-3)
    assert result.summary["reason"] == "finished"


def test_a_net_draws_itself():
    assert line()._repr_svg_().lstrip().startswith("<svg")


def test_named_outcomes():
    net = rcc.Net("named")
    net.Termination(outcomes={"late": net.Time().out > 0.01 * rcc.s})
    assert net.simulate().summary["outcome"] == "late"
