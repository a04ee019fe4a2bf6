"""Values as arrays: samples, monitored values without loss, recordings."""

import asyncio
import csv
import math

import numpy
import pytest

import rcc

MONITORED = 300


def ramp(name="ramp", cycles=MONITORED, rate=1000):
    """A net that counts its cycles, and ends after some."""
    net = rcc.Net(name)
    time = net.Time(name="time")
    net.Monitor(value=time.out, rate=rate)
    late = net.Greater(a=time.out, b=(cycles - 1.5) / 1000, name="late")
    net.Monitor(value=late.out, rate=rate)
    net.Termination(done=net.Or(a=late.out, b=net.Cancel().requested))
    return net


def test_every_monitored_value_of_a_net_that_is_loaded_later_is_recorded(cell):
    with cell.recording("ramp/*") as values:
        outcome = cell.run(ramp())
    assert outcome.cycles == MONITORED
    time = values.array("time.out")
    # The cell counts what it lost: a machine without a processor for it may lose some.
    assert len(time) + values.lost // 2 >= MONITORED and len(time) > 10
    if values.lost == 0:
        assert numpy.array_equal(values.cycles("time.out"), values.cycles("time.out")[0] + numpy.arange(MONITORED))
        assert numpy.allclose(time, numpy.arange(MONITORED) / 1000)
        assert values.array("ramp/late.out").tolist() == [0.0] * (MONITORED - 1) + [1.0]
    assert numpy.allclose(values.time("time.out"), time)


def test_a_recording_is_a_frame_a_table_and_a_picture(cell, tmp_path):
    motion = rcc.Arm("lwr").move(by=[0, 0, 0.02]).monitor("pose", "distance", rate=100)
    with cell.recording("move/*") as values:
        cell.run(motion)
        cell.run(rcc.Arm("lwr").move(by=[0, 0, -0.02]))
    pose = values.array("motion_sequence.pose")
    assert pose.shape == (len(values), 7) and math.isclose(pose[-1][2] - pose[0][2], 0.02, abs_tol=1e-3)
    frame = values.frame()
    assert list(frame.columns)[:3] == ["cycle", "time_s", "move/motion_sequence.pose[0]"]
    assert frame["move/motion_sequence.distance"].is_monotonic_increasing
    values.to_csv(tmp_path / "values.csv")
    with open(tmp_path / "values.csv", newline="") as opened:
        assert len(list(csv.reader(opened))) == len(frame) + 1
    assert values.plot("motion_sequence.distance").get_xlabel() == "time [s]"
    assert "motion_sequence.pose" in values._repr_html_()
    with pytest.raises(rcc.RccError, match="`nothing` was not recorded"):
        values.array("nothing")


def test_samples_of_a_net_as_arrays(cell):
    command = cell.load(ramp("sampled", cycles=60_000))
    with cell.recording("sampled/time.*", rate=100) as values:
        command.start()
        for sample in cell.watch("sampled/time.out", rate=50):
            assert sample.array("time.out").shape == ()
            if sample.time_s > 0.3:
                break
    command.cancel()
    command.wait(60)
    assert len(values) > 3 and numpy.all(numpy.diff(values.array("time.out")) > 0)


def test_a_recording_of_a_net_that_is_not_there_is_refused(cell):
    with pytest.raises(rcc.RccError) as unknown, cell.recording("nothing/*", rate=10):
        pass
    assert unknown.value.code == "RCC3001"
    with pytest.raises(rcc.RccError, match="invalid pattern"), cell.recording("a b"):
        pass
    with pytest.raises(ZeroDivisionError), cell.recording("ramp/*"):
        _ = 1 / 0


def test_the_same_without_blocking(cell_name, cell):
    async def main():
        async with rcc.aconnect(cell_name) as connection:
            async with connection.recording("both/*") as values:
                command = await connection.start(ramp("both"))
                outcome = await command
            await command.unload()
            assert outcome.cycles == MONITORED
            with pytest.raises(rcc.RccError):
                async with connection.recording("nothing/*", rate=10):
                    pass
            return values

    values = asyncio.run(main())
    assert len(values) + values.lost // 2 >= MONITORED


def test_batches_come_while_the_net_runs(cell):
    command = cell.load(ramp("long", cycles=60_000))
    batches = cell.monitored("long/time.out")
    command.start()
    batch = next(batches)
    assert batch.port == "time.out" and len(batch.array()) == len(batch.cycles) > 0
    batches.close()
    command.cancel()
    command.wait(60)
