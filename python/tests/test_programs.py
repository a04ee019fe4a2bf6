"""Programs that want the same arm, and sequences whose program is killed: in each phase, and between two nets."""

import pytest
from client_programs import Program, states, until, until_running

import rcc

arm = rcc.Arm("lwr")

#: Wants the arm, is refused, waits for who has it, and tries again; says each time what it got.
WANTS = """
while True:
    try:
        say(f"moved {cell.run(arm.lin([0.538, 0.02, 0.384])).reason}")
        break
    except rcc.Busy as busy:
        say(f"{busy.code} {busy.holder} {busy.message}; {busy.help}".replace("\\n", " "))
        say(f"it ended: {cell.command(busy.holder).wait(60).reason}")
"""

#: Two motions, each slow enough to be killed in; `{how}` is what becomes of them.
SEQUENCE = """
there = arm.lin([0.538, 0.02, 0.384], velocity=0.02 * rcc.m / rcc.s)
back = arm.ptp({{"xyz": [0.538, 0.0, 0.384], "rpy": [0, 3.141592653589793, 0]}}, scale=0.02)
{hold}
cell.run(rcc.sequence(there, back){how})
say("the sequence ended")
"""
LOAD, START, UNLOAD = '"POST", "/commands"', r'"POST", r"/commands/\d+/start"', r'"DELETE", r"/commands/\d+"'
FIRST, SECOND = ("lin", "terminated", "finished"), ("ptp", "terminated", "finished")
#: Where the program is when it is killed, and what is there of its nets afterwards. Nets that have ended by themselves
#: have been unloaded by the program, unless it died before.
PHASES = {
    "before the first is loaded": (f"hold({LOAD})", []),
    "while the first is loaded": (f"hold({LOAD}, after=True)", [("lin", "ready", None)]),
    "before the first starts": (f"hold({START})", [("lin", "ready", None)]),
    "between: the first is there": (f"hold({UNLOAD})", [FIRST]),
    "between: the first is gone": (f"hold({LOAD}, count=2)", []),
    "between: the second is loaded": (f"hold({START}, count=2)", [("ptp", "ready", None)]),
    "at the end": (f"hold({UNLOAD}, count=2)", [SECOND]),
}


@pytest.fixture
def home(cell):
    """The arm is where the programs begin."""
    cell.run(arm.move([0.538, 0.0, 0.384], scale=0.5))


def lost(cell):
    """The leases that were lost lately: older ones are no longer told."""
    return [event for event in cell.events(1000) if event["kind"] == "lease-lost"]


def at_rest(cell):
    """Waits until nothing is loading, running or being canceled."""
    over = ("ready", "terminated", "rejected")
    until(lambda: all(state in over for _, state, _ in states(cell)), lambda: states(cell))


def test_the_second_program_is_refused_in_words_until_the_first_is_killed(cell, cell_name, home):
    first = Program(cell_name, "cell.start(slow); ready(); input()")
    holder = f"lin#{until_running(cell, 'lin')}"
    second = Program(cell_name, WANTS)
    told = second.line()
    assert told.startswith(f"RCC3004 {holder} ") and "lwr" in told, "who holds what"
    assert told.split("; ")[1] != "None", "what to do"
    running = [state for _, state, _ in states(cell) if state == "running"]
    assert running == ["running"], "the refusal changes nothing"
    first.kill()
    assert second.line() == "it ended: canceled"
    # The arm may still be coming to rest: then it is refused once more, by its device.
    assert second.line() == "moved finished"
    assert second.end() == 0


def test_what_goes_on_keeps_the_arm_from_the_second_program_although_the_first_is_killed(cell, cell_name, home):
    first = Program(
        cell_name,
        """
        short = arm.lin([0.538, 0.03, 0.384], velocity=0.01 * rcc.m / rcc.s)
        cell.start(short, on_client_loss="go on")
        ready()
        input()
        """,
    )
    holder = f"lin#{until_running(cell, 'lin')}"
    first.kill()
    second = Program(cell_name, WANTS)
    assert second.line().split()[1] == holder
    assert second.line() == "it ended: finished"
    assert second.line() == "moved finished"
    assert second.end() == 0


@pytest.mark.parametrize("phase", PHASES)
def test_a_sequence_that_is_killed_begins_nothing_more(cell, cell_name, home, phase):
    hold, left = PHASES[phase]
    before = lost(cell)
    Program(cell_name, SEQUENCE.format(hold=hold, how="")).kill()
    # A program that has started nothing has no lease to lose.
    if not phase.startswith(("before", "while")):
        until(lambda: any(event not in before for event in lost(cell)), lambda: cell.events(20))
    at_rest(cell)
    assert states(cell) == left


@pytest.mark.parametrize("net", ["lin", "ptp"])
def test_a_sequence_that_is_killed_in_a_motion_stops_on_its_path(cell, cell_name, home, net):
    program = Program(cell_name, SEQUENCE.format(hold="ready()", how=""))
    until_running(cell, net)
    program.kill()
    at_rest(cell)
    assert states(cell) == [(net, "terminated", "canceled")]


def test_a_sequence_that_goes_on_ends_its_net_and_begins_no_other(cell, cell_name, home):
    program = Program(cell_name, SEQUENCE.format(hold="ready()", how=', on_client_loss="go on"'))
    # A lease of a test before this one may be lost meanwhile; it stops nothing.
    stopped = [event for event in lost(cell) if event["fields"]["commands"]]
    until_running(cell, "lin")
    program.kill()
    at_rest(cell)
    assert states(cell) == [FIRST]
    assert all(event in stopped for event in lost(cell) if event["fields"]["commands"])


@pytest.mark.parametrize("after", [False, True])
def test_a_sequence_that_is_killed_while_it_cancels_is_canceled_all_the_same(cell, cell_name, home, after):
    hold = rf'hold("POST", r"/commands/\d+/cancel", after={after})'
    program = Program(cell_name, SEQUENCE.format(hold=hold, how=""))
    until_running(cell, "lin")
    program.interrupt()
    program.kill()
    at_rest(cell)
    assert states(cell) == [("lin", "terminated", "canceled")]
