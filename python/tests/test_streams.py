"""Values as arrays: samples, monitored values without loss, recordings."""

import asyncio
import csv
import math
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import numpy
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import rcc
from rcc._mcap import Clock

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


def test_a_watch_of_a_command_ends_with_the_net_and_has_its_last_values(cell):
    net = rcc.Net("ending")
    level = net.Input(initial=0.0, name="level")
    net.Termination(done=net.Greater(a=level.value, b=1.0).out)
    command = cell.start(net)
    samples = command.watch("level.value", rate=0.5)
    assert next(samples)["level.value"] == 0.0
    command.set({"level": 2.0})
    rest = list(samples)
    assert rest[-1]["level.value"] == 2.0 and command.state()["state"] == "terminated"
    assert [sample.cycle for sample in command.watch(rate=10)] == [rest[-1].cycle]


def test_a_wait_for_a_command_that_somebody_unloads_ends(cell, cell_name):
    command = cell.load(ramp("forgotten"))
    with rcc.connect(cell_name) as other, ThreadPoolExecutor() as pool:
        waiting = pool.submit(command.wait, 60)
        other.command(command.id).unload()
        with pytest.raises(rcc.RccError, match="not found"):
            waiting.result()


def test_a_wait_tells_how_a_net_ended_that_somebody_has_unloaded(cell, cell_name):
    command = cell.load(ramp("ended"))
    command.start()
    with rcc.connect(cell_name) as other:
        same = other.command(command.id)
        same.abort()
        same.wait(60)
        same.unload()
    assert command.wait(60).reason == "aborted"


def messages(file):
    """The messages of an MCAP file by topic, as a reader of others decodes them, with their times, s."""
    with open(file, "rb") as opened:
        read = make_reader(opened, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        found = {}
        for _, channel, message, decoded in read:
            found.setdefault(channel.topic, []).append((message.log_time / 1e9, channel.metadata, decoded))
        return found


def test_a_net_is_recorded_into_a_file_that_others_read(cell, programs, tmp_path):
    file = tmp_path / "move.mcap"
    motion = rcc.Arm("lwr").move(by=[0, 0, 0.02]).monitor("pose", "distance", "done", rate=100)
    begun = time.time()
    with cell.record(file, "move/*") as values:
        cell.run(motion)
    [(topic, rows)] = messages(file).items()
    assert topic == "/nets/move" and len(rows) == len(values)
    _, metadata, last = rows[-1]
    assert metadata["net"] == "move" and metadata["name.motion_sequence_pose"] == "motion_sequence.pose"
    assert numpy.array_equal(last.motion_sequence_pose, values.array("motion_sequence.pose")[-1])
    distances = [row.motion_sequence_distance for _, _, row in rows]
    assert distances == values.array("motion_sequence.distance").tolist()
    done = [row.motion_sequence_done for *_, row in rows]
    assert done == values.array("motion_sequence.done").tolist() and done[0] is False
    cycles = [row.cycle for *_, row in rows]
    assert cycles == sorted(set(cycles))
    times = [at for at, *_ in rows]
    assert times == sorted(times) and begun - 1 < times[0] < time.time() + 1
    told = subprocess.run([programs / "rcc-cli", "import", file], capture_output=True, text=True, check=True).stdout
    assert "/nets/move" in told and str(len(rows)) in told
    with pytest.raises(FileExistsError, match="name another file"), cell.record(file, "move/*"):
        pass


def test_null_is_nan_and_a_port_of_another_rate_has_a_topic_of_its_own(tmp_path):
    recording = rcc.Recording()
    recording.clock = Clock(100, 5_000_000_000, 1_000_000)
    scalars = [("a.out", 1, [1, None]), ("b.out", 1, [True, False])]
    for port, every, values in [*scalars, ("c.pose", 2, [None, [1.0, 2.0]])]:
        cycles = [100 + every * index for index in range(2)]
        recording.add(rcc.Batch("7-axis", 3, port, cycles, [0.0, 0.0], values))
    assert recording.to_mcap(tmp_path / "a.mcap") == 4
    found = messages(tmp_path / "a.mcap")
    assert list(found) == ["/nets/n_7_axis", "/nets/n_7_axis_2"]
    first, second = (row for *_, row in found["/nets/n_7_axis"])
    assert (first.a_out, first.b_out, first.command) == (1.0, True, 3) and math.isnan(second.a_out)
    slow = [row for *_, row in found["/nets/n_7_axis_2"]]
    assert [at for at, *_ in found["/nets/n_7_axis_2"]] == [5.0, 5.002]
    assert all(map(math.isnan, slow[0].c_pose)) and list(slow[1].c_pose) == [1.0, 2.0]
