"""A program that gets SIGKILL leaves what `on_client_loss` says, in each phase."""

import time

import pytest
from client_programs import Program, states

import rcc

arm = rcc.Arm("lwr")


@pytest.fixture
def home(cell):
    """The arm is where the programs begin."""
    cell.run(arm.move([0.538, 0.0, 0.384], scale=0.5))


def ended(cell, count=1):
    """The outcomes of all commands, when they have ended."""
    commands = [cell.command(view["id"]) for view in cell.commands()]
    assert len(commands) == count
    return [command.wait(60) for command in commands]


def test_before_load_and_loaded_nothing_moves(cell, cell_name):
    Program(cell_name, "ready(); cell.load(slow); input()").kill()
    Program(cell_name, "command = cell.load(slow); ready(); input()").kill()
    assert all(state == "ready" for _, state, _ in states(cell)) and states(cell)


def test_what_runs_is_canceled_on_its_path(cell, cell_name, home):
    running = """
        import threading
        threading.Thread(target=cell.run, args=[slow]).start()
        while not any(view["state"] == "running" for view in cell.commands()):
            pass
        ready()
    """
    Program(cell_name, running).kill(after=1.0)
    [outcome] = ended(cell)
    assert outcome.reason == "canceled"
    device = next(device for device in cell.devices() if device["name"] == "lwr")
    assert device["state"] in ("ready", "stopping")


def test_what_goes_on_goes_on(cell, cell_name, home):
    program = """
        short = arm.lin([0.538, 0.03, 0.384], velocity=0.02 * rcc.m / rcc.s)
        cell.start(short, on_client_loss="go on")
        ready()
        input()
    """
    Program(cell_name, program).kill()
    [outcome] = ended(cell)
    assert outcome.reason == "finished"


def test_a_net_without_cancel_is_aborted(cell, cell_name):
    program = """
        net = rcc.Net("endless")
        net.Termination(done=net.Time().out > 3600 * rcc.s)
        cell.start(net)
        ready()
        input()
    """
    Program(cell_name, program).kill()
    [outcome] = ended(cell)
    assert outcome.reason == "aborted"


@pytest.mark.parametrize("after", [0.0, 0.05, 0.11])
def test_in_the_middle_of_hand_overs_nothing_goes_on(cell, cell_name, after):
    program = """
        def net(name):
            built = rcc.Net(name)
            built.Termination(done=built.Cancel().requested)
            return built

        current = cell.start(net("first"))
        ready()
        for number in range(100000):
            following = cell.load(net(f"next-{number}"))
            cell.switch([current], [following])
            current.unload()
            current = following
    """
    Program(cell_name, program).kill(after)
    limit = time.monotonic() + 60
    while any(state in ("loading", "running", "canceling") for _, state, _ in states(cell)):
        assert time.monotonic() < limit, states(cell)
        time.sleep(0.05)


def test_what_has_ended_stays_as_it_ended(cell, cell_name, home):
    program = """
        command = cell.start(arm.move(by=[0, 0, 0.01]))
        assert command.wait(60)
        ready()
        input()
    """
    Program(cell_name, program).kill(after=1.0)
    assert states(cell) == [("move", "terminated", "finished")]


def test_the_loader_dies_with_the_program(cell, cell_name, home):
    loader = next(one for one in cell.status()["processes"] if one["role"] == "loader")
    Program(cell_name, "cell.start(slow); ready(); input()").kill(also=loader["pid"])
    limit = time.monotonic() + 60
    while True:
        try:
            if all(state == "terminated" for _, state, _ in states(cell)):
                break
        except rcc.RccError:
            pass  # The loader is being restarted.
        assert time.monotonic() < limit
        time.sleep(0.05)
    assert [reason for *_, reason in states(cell)] == ["canceled"]


def test_a_program_that_computes_keeps_what_it_runs_and_closing_ends_it(cell, cell_name, home):
    with rcc.connect(cell_name, lost_after=0.3) as other:
        command = other.start(arm.lin([0.538, 0.15, 0.384], velocity=0.01 * rcc.m / rcc.s))
        limit = time.monotonic() + 2
        while time.monotonic() < limit:
            sum(range(1000))
        assert command.state()["state"] == "running"
    assert cell.command(command.id).wait(60).reason == "canceled"
    with pytest.raises(ValueError, match="neither `cancel` nor `go on`"):
        cell.start(arm.move(by=[0, 0, 0.01]), on_client_loss="stop")
