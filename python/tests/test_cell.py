"""Against a running, simulated cell."""

import asyncio
import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest
from test_nets import line

import rcc


def waiting(name="waiting"):
    net = rcc.Net(name)
    level = net.Input(initial=0.0, name="level")
    net.Termination(done=net.Or(a=net.Cancel().requested, b=level.value > 1))
    net.discard(level.age)
    return net


def test_run_moves_the_arm_and_says_how_it_ended(cell):
    outcome = cell.run(line("there"))
    assert outcome and outcome.reason == "finished" and outcome.cycles > 1000
    assert cell.run(line("back", (0.538, 0.0, 0.384)))
    assert cell.commands() == []


def test_a_rejected_net_says_where(cell):
    with pytest.raises(rcc.NetRejected) as refused:
        cell.load("net: a\nprimitives:\n  t: {type: Tme}\n")
    assert "Tme" in str(refused.value) and refused.value.diagnostics[0]["place"]["line"] == 3


def test_a_wrong_name_has_code_and_remedy(cell):
    with pytest.raises(rcc.RccError) as unknown:
        cell.command("nothing")
    assert unknown.value.code == "RCC3001" and unknown.value.help


def test_another_cell_is_not_there():
    with pytest.raises(rcc.CellNotFound, match="rcc-cli up"), rcc.connect("no-such-cell"):
        pass


def test_set_wait_and_values(cell):
    command = cell.load(waiting())
    command.start()
    assert command.set({"level": 0.5}) > 0
    with pytest.raises(TimeoutError):
        command.wait(0.2)
    assert command.values("level.value")["level.value"] == 0.5
    command.set({"level": 2})
    assert command.wait(60).reason == "finished"
    command.unload()


def test_a_canceled_net_is_no_success(cell):
    command = cell.load(waiting())
    command.start()
    command.cancel()
    assert not command.wait(60)

    class Colleague:
        """Cancels the net as soon as it runs."""

        def __enter__(self):
            script = """
                import rcc, sys
                with rcc.connect(sys.argv[1]) as cell:
                    while True:
                        for view in cell.commands():
                            if view["net"] == "shared" and view["state"] == "running":
                                cell.command(view["id"]).cancel()
                                sys.exit()
            """
            program = [sys.executable, "-c", textwrap.dedent(script), cell._inner._address.name]
            self.process = subprocess.Popen(program)

        def __exit__(self, *_):
            assert self.process.wait(60) == 0

    with Colleague(), pytest.raises(rcc.NetCanceled):
        cell.run(waiting("shared"))


def test_ctrl_c_cancels_what_runs(cell):
    script = """
        import rcc, signal, sys
        from test_cell import waiting
        # A shell that runs the tests in the background has it ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with rcc.connect(sys.argv[1]) as cell:
            cell.run(waiting("mine"))
    """
    program = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script), cell._inner._address.name],
        cwd=os.path.dirname(__file__),
        stderr=subprocess.PIPE,
        text=True,
    )
    limit = time.monotonic() + 60
    while not any(view["state"] == "running" for view in cell.commands()):
        assert time.monotonic() < limit and program.poll() is None
        time.sleep(0.01)
    program.send_signal(signal.SIGINT)
    _, told = program.communicate(timeout=60)
    assert "KeyboardInterrupt" in told
    assert cell.commands() == []


def test_watch_and_set_points(cell):
    command = cell.load(waiting("followed"))
    command.start()
    samples = cell.watch("followed/level.value", rate=100)
    assert next(samples)["level.value"] == 0
    end = command.set_points({"level": step / 10} for step in range(10))
    assert (end["lines"], end["refused"], end["set"] + end["superseded"]) == (10, 0, 10)
    assert next(sample for sample in samples if sample["level.value"] == 0.9).time_s > 0
    samples.close()
    with pytest.raises(rcc.RccError, match="nonsense"):
        command.set_points([{"nonsense": 1}])
    command.cancel()
    command.wait(60)


def test_a_channel_sends_from_the_programs_own_loop(cell):
    command = cell.start(waiting("steered"))
    with command.channel() as channel:
        for step in range(1, 101):
            channel.set({"level": step / 1000})
            time.sleep(0.001)
    end = channel.end
    assert end["lines"] + channel.superseded == 100 and end["set"] > 0 and end["refused"] == 0
    assert command.values("level.value")["level.value"] == 0.1, "the last one is not lost"
    with pytest.raises(rcc.RccError, match="closed"):
        channel.set({"level": 1})
    with pytest.raises(rcc.RccError, match="nonsense"), command.channel() as channel:
        channel.set({"nonsense": 1})
    with pytest.raises(ZeroDivisionError), command.channel() as channel:
        channel.set({"level": 1 / 0})
    assert cell.set("steered", {"level": 2}) > 0
    assert command.wait(60)


def test_a_channel_of_a_net_that_ends_says_so(cell):
    command = cell.start(waiting("ending"))
    with pytest.raises(rcc.RccError, match="RCC3003"), command.channel() as channel:
        channel.set({"level": 2})
        assert command.wait(60)
        channel.set({"level": 3})


def test_a_hand_over(cell):
    first, second = cell.load(waiting("first")), cell.load(waiting("second"))
    first.start()
    cycle = cell.switch([first], [second])
    assert second.state()["started_cycle"] == cycle
    assert first.wait(60).reason in ("finished", "aborted")


def test_the_same_without_blocking(cell_name, cell):
    async def main():
        async with rcc.aconnect(cell_name) as connection:
            both = await asyncio.gather(connection.load(waiting("a")), connection.load(waiting("b")))
            for command in both:
                await command.start()
            with pytest.raises(TimeoutError):
                await both[0].wait(0.2)
            async for sample in connection.watch("a/level.value", rate=50):
                assert sample["level.value"] == 0
                break
            end = await both[0].set_points({"level": value} for value in (0.5, 2))
            assert end["lines"] == 2
            async with both[1].channel() as channel:
                channel.set({"level": 0.25})
            assert channel.end["set"] == 1 and (await both[1].values())["level.value"] == 0.25
            await both[1].set({"level": 2})
            return await asyncio.gather(*(command.wait(60) for command in both))

    assert [outcome.reason for outcome in asyncio.run(main())] == ["finished", "finished"]


def test_a_canceled_task_cancels_its_net(cell_name, cell):
    async def main():
        async with rcc.aconnect(cell_name) as connection:
            task = asyncio.create_task(connection.run(waiting("task")))
            while not any(view["state"] == "running" for view in await connection.commands()):
                await asyncio.sleep(0.01)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(main())
    assert cell.commands() == []


def test_devices_status_and_events(cell):
    assert {device["name"] for device in cell.devices()} == {"lwr", "io"}
    assert cell.status()["executor"]["period_ns"] == 1_000_000
    assert all(event["words"] for event in cell.events())


def test_an_armed_condition_records_once_and_is_listed(cell):
    command = cell.load(waiting("armed"))
    number = cell.arm("armed.level.value > 0.5")
    command.start()
    command.set({"level": 0.8})
    deadline = time.monotonic() + 60
    while (rule := cell.armed()[-1])["state"] != "fired":
        assert time.monotonic() < deadline, rule
        time.sleep(0.05)
    assert (rule["rule"], rule["recorded"]["recordings"]) == (number, 1)
    with pytest.raises(rcc.RccError, match="level.valu") as unknown:
        cell.arm("armed.level.valu > 0.5")
    assert unknown.value.code == "RCC3051"
    cell.disarm(number)
    assert cell.armed() == []
    command.cancel()
    command.wait(60)
    command.unload()
