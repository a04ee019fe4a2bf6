"""Brings `ethercat-sim` to OP with SOEM and exchanges data: process image, SDO, watchdog, cable, power.

Runs in a network namespace of its own, with the path of the simulator as its argument.
"""

import json
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pysoem

# Vendor, product, bytes of outputs, bytes of inputs.
LINE = [
    ("EL1008", 0x03F03052, 0, 1),
    ("EL2008", 0x07D83052, 1, 0),
    ("EL3064", 0x0BF83052, 0, 16),
    ("EL4004", 0x0FA43052, 8, 0),
]
# A busy machine pauses for longer than SOEM's 2 ms.
PATIENCE_US = 100_000
# The drive's interpolation period.
CYCLE_S = 1e-3
OUTPUTS_COUNTER = 2 + 2
INPUTS_COUNTER = 1 + 1


class Simulator:
    """The process and its control port."""

    def __init__(self, program: str, nic: str, folder: Path, *arguments: str):
        control = folder / "line.sock"
        command = [program, f"--nic={nic}", f"--control={control}", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        ready = self.process.stdout.readline()
        assert ready.startswith("ethercat-sim ready"), ready
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(control))
        self.lines = self.socket.makefile("rw")

    def ask(self, **command):
        self.lines.write(json.dumps(command) + "\n")
        self.lines.flush()
        answer = json.loads(self.lines.readline())
        assert "error" not in answer, (command, answer)
        return answer

    def terminal(self, number: int):
        return self.ask(state=None)["terminals"][number - 1]

    def end(self):
        self.ask(quit=None)
        assert self.process.wait(timeout=30) == 0


def until(what: str, holds, limit_s: float = 30.0):
    """Repeats until it holds; each attempt is an exchange or a request, which takes its time."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        if holds():
            return
    raise AssertionError(f"not within {limit_s:.0f} s: {what}")


def exchange(master) -> int:
    master.send_processdata()
    return master.receive_processdata(PATIENCE_US)


def all_in(master, state: int) -> bool:
    return master.state_check(state, 500_000) == state


def to_op(master, counter: int = OUTPUTS_COUNTER + INPUTS_COUNTER):
    """From what `config_init` has found to OP."""
    master.config_map()
    assert all_in(master, pysoem.SAFEOP_STATE), states(master)
    assert master.expected_wkc == counter, master.expected_wkc
    # Outputs must flow before OP, or the watchdog of a slow machine trips at once.
    exchange(master)
    master.state = pysoem.OP_STATE
    master.write_state()
    until("OP", lambda: exchange(master) and all_in_op(master))


def all_in_op(master) -> bool:
    master.read_state()
    return all(slave.state == pysoem.OP_STATE for slave in master.slaves)


def states(master):
    master.read_state()
    return [(slave.name, hex(slave.state), hex(slave.al_status)) for slave in master.slaves]


def check_identity(master):
    assert master.config_init() == len(LINE)
    for slave, (name, product, _, _) in zip(master.slaves, LINE):
        assert (slave.man, slave.id) == (2, product), (slave.name, hex(slave.id))
        assert name in slave.name, slave.name


def check_process_data(master, simulator):
    for slave, (name, _, outputs, inputs) in zip(master.slaves, LINE):
        assert (len(slave.output), len(slave.input)) == (outputs, inputs), name
    digital_in, digital_out, analog_in, analog_out = master.slaves
    for bit in range(8):
        digital_out.output = bytes([1 << bit])
        analog_out.output = struct.pack("<4h", bit * 1000, -bit, 32767, -32768)
        simulator.ask(set={"terminal": 1, "channel": bit + 1, "value": 1})
        simulator.ask(set={"terminal": 3, "channel": bit % 4 + 1, "value": 100 * bit - 350})
        assert exchange(master) == master.expected_wkc
        state = simulator.ask(state=None)["terminals"]
        assert state[1]["outputs"] == [int(other == bit) for other in range(8)], state[1]
        assert state[3]["outputs"] == [bit * 1000, -bit, 32767, -32768], state[3]
        assert digital_in.input == bytes([(2 << bit) - 1]), digital_in.input
        channel = struct.unpack("<" + "Hh" * 4, analog_in.input)[bit % 4 * 2 :]
        assert channel[:2] == (0, 100 * bit - 350), channel
    simulator.ask(set={"terminal": 3, "channel": 1, "value": 40000})
    assert exchange(master) == master.expected_wkc
    assert struct.unpack("<Hh", analog_in.input[:4]) == (0x42, 32767), "overrange"


def check_sdo(master):
    _, _, analog_in, analog_out = master.slaves
    assert struct.unpack("<I", analog_in.sdo_read(0x1018, 2)) == (LINE[2][1],)
    assert analog_in.sdo_read(0x1008, 0) == b"EL3064"
    analog_in.sdo_write(0x8010, 0x06, b"\x01")
    assert analog_in.sdo_read(0x8010, 0x06) == b"\x01"
    analog_out.sdo_write(0x8000, 0x13, struct.pack("<h", 1234))
    for access, code in [
        (lambda: analog_in.sdo_read(0x2000, 0), 0x06020000),
        (lambda: analog_in.sdo_read(0x1018, 9), 0x06090011),
        (lambda: analog_in.sdo_write(0x1018, 1, bytes(4)), 0x06010002),
    ]:
        try:
            access()
        except pysoem.SdoError as error:
            assert error.abort_code == code, hex(error.abort_code)
        else:
            raise AssertionError(f"no abort {code:#010x}")


def check_watchdog(master, simulator):
    """Without process data the outputs go off; the inputs' terminals stay in OP."""
    until("the watchdog", lambda: simulator.terminal(2)["state"] == "SAFEOP")
    until("the other watchdog", lambda: simulator.terminal(4)["state"] == "SAFEOP")
    assert simulator.terminal(2)["outputs"] == [0] * 8
    assert simulator.terminal(4)["outputs"] == [1234, 0, 0, 0], "the value without communication"
    master.read_state()
    found = [(slave.state, slave.al_status) for slave in master.slaves]
    tripped = (pysoem.SAFEOP_STATE | pysoem.STATE_ERROR, 0x1B)
    assert found == [(8, 0), tripped, (8, 0), tripped], found
    # The error is acknowledged, then outputs flow again.
    for slave in (master.slaves[1], master.slaves[3]):
        slave.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
        slave.write_state()
    exchange(master)
    for slave in (master.slaves[1], master.slaves[3]):
        slave.state = pysoem.OP_STATE
        slave.write_state()
    until("OP again", lambda: exchange(master) and all_in_op(master))


def check_cable(master, simulator):
    """A pulled cable is a lower working counter, or none at all; put back, everything is as before."""
    simulator.ask(pull=3)
    assert exchange(master) == 1 + 2, "the first two only"
    simulator.ask(pull=1)
    master.send_processdata()
    assert master.receive_processdata(10_000) == -1
    simulator.ask(plug=None)
    until("the whole line", lambda: exchange(master) > 0)
    simulator.ask(kill=3)
    assert exchange(master) == 1 + 2
    simulator.ask(start=3)
    assert simulator.terminal(3)["state"] == "INIT"


def count_cycles(master, cycles: int):
    """Returns how many exchanges had a wrong working counter, and the mean time of one."""
    begun = time.monotonic()
    wrong = sum(exchange(master) != master.expected_wkc for _ in range(cycles))
    return wrong, (time.monotonic() - begun) / cycles


def check_drive(master, simulator):
    """A drive (CiA 402): enabled state by state, follows its target, quick stop, following error, reset."""
    assert master.config_init() == 1
    drive = master.slaves[0]
    assert (drive.man, drive.id) == (0xFFFFFFFE, 0x402), (hex(drive.man), hex(drive.id))
    drive.sdo_write(0x6060, 0, b"\x08")
    drive.sdo_write(0x6065, 0, struct.pack("<I", 1000))
    to_op(master, 3)
    target = 0

    def word(controlword: int) -> int:
        drive.output = struct.pack("<Hi", controlword, target)
        assert exchange(master) == master.expected_wkc
        return struct.unpack("<HiH", drive.input)[0] & 0x6F

    for controlword, state in [(0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)]:
        until(hex(state), lambda: word(controlword) == state)
    # One target a cycle: as fast as a machine can exchange, the axis would lag by more than its window.
    for target in range(0, 100_000, 500):
        assert word(0x0F) == 0x27
        time.sleep(CYCLE_S)
    until("the target", lambda: word(0x0F) == 0x27 and simulator.terminal(1)["drive"]["position"] == target)
    assert struct.unpack("<b", drive.sdo_read(0x6061, 0)) == (8,)
    until("a quick stop", lambda: word(0x02) & 0x4F == 0x40)
    for controlword, state in [(0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)]:
        until(hex(state), lambda: word(controlword) == state)
    simulator.ask(block={"terminal": 1, "on": True})
    target += 2000
    until("the following error", lambda: word(0x0F) & 0x4F == 0x08)
    assert struct.unpack("<HiH", drive.input)[2] == 0x8611
    simulator.ask(block={"terminal": 1, "on": False})
    until("no more of the fault's edge", lambda: word(0x00) & 0x4F == 0x08)
    until("the reset", lambda: word(0x80) & 0x4F == 0x40)


def check_clocks(master, simulator):
    """Two drives, whose clocks deviate, agree, and have SYNC0."""
    assert master.config_init() == 2
    assert master.config_dc(), "no distributed clock"
    for drive in master.slaves:
        drive.dc_sync(True, 1_000_000)
    to_op(master, 6)

    def agree() -> bool:
        assert exchange(master) == master.expected_wkc
        clocks = [simulator.terminal(number)["clock"] for number in (1, 2)]
        assert [clock["sync0_ns"] for clock in clocks] == [1_000_000] * 2, clocks
        return master.dc_time > 0 and all(abs(clock["difference_ns"]) < 1000 for clock in clocks)

    until("clocks that agree", agree)


def main():
    for command in [
        "ip link add ecat0 type veth peer name ecat1",
        "ip link set ecat0 up",
        "ip link set ecat1 up",
    ]:
        subprocess.run(command.split(), check=True)
    with tempfile.TemporaryDirectory() as folder:
        simulator = Simulator(sys.argv[1], "ecat1", Path(folder) / "control")
        master = pysoem.Master()
        master.open("ecat0")
        try:
            check_identity(master)
            to_op(master)
            check_process_data(master, simulator)
            check_sdo(master)
            check_watchdog(master, simulator)
            wrong, mean_s = count_cycles(master, 10_000)
            assert wrong == 0, f"{wrong} of 10000 exchanges"
            check_cable(master, simulator)
            # From any state into OP again, as after a restart of the MainDevice.
            master.close()
            master.open("ecat0")
            check_identity(master)
            to_op(master)
            assert exchange(master) == master.expected_wkc
        finally:
            master.close()
            simulator.end()
        simulator = Simulator(sys.argv[1], "ecat1", Path(folder) / "drive", "--terminals=CiA402")
        master = pysoem.Master()
        master.open("ecat0")
        try:
            check_drive(master, simulator)
        finally:
            master.close()
            simulator.end()
        simulator = Simulator(sys.argv[1], "ecat1", Path(folder) / "clocks", "--terminals=CiA402,CiA402")
        master = pysoem.Master()
        master.open("ecat0")
        try:
            check_clocks(master, simulator)
        finally:
            master.close()
            simulator.end()
    print(f"SOEM: 4 terminals in OP; 10000 exchanges, {mean_s * 1e6:.0f} µs each; a drive; two clocks")


main()
