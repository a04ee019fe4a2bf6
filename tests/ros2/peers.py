"""A cell among nodes that are not ours: `rclpy` (Fast DDS) for topics, services and parameters, Cyclone DDS for the action
FollowJointTrajectory, whose types the wheels of rclpy lack.

Runs in a network namespace of its own, with the folder of the programs as its argument.
"""

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger

from trajectory_peer import ABORTED, CANCELED, SUCCEEDED, Tolerance, TrajectoryClient, goal

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.argv[1])
CELL = "ros2"
DOMAIN = 0
JOINTS = [f"arm_joint_{number}" for number in range(1, 7)]
REST = [0.0, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0]
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

CONFIG = f"""cell: {CELL}
period: 1 ms
stale_after: 250 ms
executor: {{priority: 80}}
devices:
  arm:
    driver: ideal-arm
    robot: {ROOT}/configs/robots/ur5e.yaml
    first_tolerance: deg(0.1)
    delay: 80 ms
    settings:
      start: [0, -90 deg, 90 deg, -90 deg, -90 deg, 0]
"""
# A node that subscribes and goes.
NODE = """
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("passer")
found = []
node.create_subscription(JointState, "/joint_states", found.append, 10)
while not found:
    rclpy.spin_once(node, timeout_sec=0.1)
"""
GIVE = """net: give-2
primitives:
  speed:  {type: Input, parameters: {unit: m/s, initial: 0.25 m/s, at_most: 1 m/s}}
  open:   {type: Input, parameters: {initial: true}}
  send:   {type: Publish, parameters: {topic: belt/speed}, inputs: {in: speed.value}}
  door:   {type: Publish, parameters: {topic: door/open}, inputs: {in: open.value}}
  cancel: {type: Cancel}
  end:    {type: Termination, inputs: {done: cancel.requested}}
"""


def hold(joints):
    """A net that holds the arm."""
    goal = ", ".join(f"{joint!r}" for joint in joints)
    return f"""net: hold
primitives:
  cancel: {{type: Cancel}}
  move:   {{type: JointGoal, parameters: {{device: arm}}, inputs: {{goal: [{goal}], stop: cancel.requested}}}}
  robot:  {{type: JointPositionCommand, parameters: {{device: arm}}, inputs: {{position: move.position}}}}
  end:    {{type: Termination, inputs: {{done: "= cancel.requested and move.done"}}}}
"""


def until(what, ask, limit_s=60.0):
    """Asks until there is an answer; each attempt is a request or waits for a message."""
    end = time.monotonic() + limit_s
    while True:
        answer = ask()
        if answer:
            return answer
        assert time.monotonic() < end, f"not within {limit_s:.0f} s: {what}"


def computed(pid):
    """Time that a process has computed, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def get(path, address):
    """GET from a loader."""
    with socket.socket(socket.AF_UNIX) as stream:
        stream.connect(str(path))
        stream.sendall(f"GET {address} HTTP/1.1\r\nhost: rcc\r\nconnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: stream.recv(65536), b""))
    return json.loads(answer.split(b"\r\n\r\n", 1)[1])


class RunningCell:
    """A simulated cell, and the gateways beside it."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "cell.yaml").write_text(CONFIG)
        self.log = open(folder / "up.log", "w+")
        command = [BIN / "rcc-cli", "--cell", CELL, "up", "--parent-death", folder / "cell.yaml"]
        self.up = subprocess.Popen(command, stdout=self.log, stderr=subprocess.STDOUT)
        until("the arm to be ready", lambda: "ready" in self.cli("devices", check=False))

    def cli(self, *arguments, check=True):
        command = [BIN / "rcc-cli", "--cell", CELL, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 or not check, (arguments, done.stdout, done.stderr)
        return done.stdout

    def load(self, text):
        file = self.folder / "net.yaml"
        file.write_text(text)
        self.cli("load", str(file))

    def states(self):
        return {row["net"]: row["state"] for row in json.loads(self.cli("state", "--output", "json"))}

    def status(self):
        """Empty while there is no executor."""
        return json.loads(self.cli("status", "--output", "json", check=False) or "{}")

    def pid(self, role):
        rows = self.status().get("processes", [])
        return next((row["pid"] for row in rows if row["role"] == role and row["alive"]), None)

    def lateness(self, seconds):
        """Late cycles and wake-ups (µs) of the executor in the next seconds."""
        self.cli("status", "--acknowledge")
        end = time.monotonic() + seconds
        yield lambda: time.monotonic() < end
        status = self.status()["executor"]
        wake = get(self.folder / "run" / CELL / "loader.sock", "/timing")["wake"]
        late = status["late"] - status["late_acknowledged"]
        row = [round(wake[key] / 1000) for key in ("p50_ns", "p99_ns", "p999_ns", "max_ns")]
        yield f"{wake['count']} cycles, {late} late, wake-up p50 {row[0]} p99 {row[1]} p99.9 {row[2]} max {row[3]} µs"

    def gateway(self, *arguments):
        # Nothing of it is left if a check fails.
        command = [BIN / "rcc-ros2", "--cell", CELL, f"--domain={DOMAIN}", "--parent-death", *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        line = process.stdout.readline()
        assert line.startswith("node /"), line
        return process

    def end(self):
        self.up.send_signal(signal.SIGINT)
        assert self.up.wait(60) == 0, (self.folder / "up.log").read_text()


@contextlib.contextmanager
def running():
    with tempfile.TemporaryDirectory(prefix="rcc-ros2") as name:
        folder = Path(name)
        os.environ["RCC_RUNTIME_DIR"] = str(folder / "run")
        os.environ["RCC_STATE_DIR"] = str(folder / "state")
        (folder / "run").mkdir()
        cell = RunningCell(folder)
        try:
            yield cell
        except BaseException:
            print((folder / "up.log").read_text()[-4000:], file=sys.stderr)
            cell.up.send_signal(signal.SIGINT)
            cell.up.wait(60)
            raise
        cell.end()


def ends(process):
    """SIGTERM ends a gateway in order."""
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 0


class RosPeer:
    """A node of rclpy."""

    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("peer")

    def spin_until(self, what, ask, limit_s=60.0):
        def attempt():
            rclpy.spin_once(self.node, timeout_sec=0.1)
            return ask()

        return until(what, attempt, limit_s)

    def next(self, ty, topic, qos, holds=lambda message: True):
        """Returns the next message for which it holds."""
        found = []
        subscription = self.node.create_subscription(
            ty, topic, lambda message: found.append(message) if holds(message) else None, qos
        )
        message = self.spin_until(f"a message on {topic}", lambda: found and found[0])
        self.node.destroy_subscription(subscription)
        return message

    def subscribed(self, ty, topic, qos):
        """Returns a list that grows while the node spins."""
        found = []
        self.node.create_subscription(ty, topic, found.append, qos)
        return found

    def call(self, service):
        client = self.node.create_client(Trigger, service)
        self.spin_until(f"the service {service}", client.service_is_ready)
        answer = self.done(client.call_async(Trigger.Request()), service)
        self.node.destroy_client(client)
        return answer

    def done(self, future, what):
        self.spin_until(f"the answer of {what}", future.done)
        return future.result()


def joint_states_are_received(peer, cell):
    for qos in (10, qos_profile_sensor_data):
        state = peer.next(JointState, "/joint_states", qos)
        assert list(state.name) == JOINTS, state.name
        assert all(abs(a - b) < 1e-6 for a, b in zip(state.position, REST)), state.position
        assert state.header.stamp.sec > 0
    times = []
    subscription = peer.node.create_subscription(JointState, "/joint_states", lambda _: times.append(time.monotonic()), 100)
    peer.spin_until("200 joint states", lambda: len(times) >= 200)
    peer.node.destroy_subscription(subscription)
    print(f"   {(len(times) - 1) / (times[-1] - times[0]):.1f} joint states a second")


def the_other_topics_are_received(peer, cell):
    description = peer.next(String, "/robot_description", LATCHED).data
    assert description.startswith("<?xml") or "<robot" in description, description[:80]
    assert all(f'name="{joint}"' in description for joint in JOINTS), description[:400]
    wrench = peer.next(WrenchStamped, "/arm/wrench", 10)
    assert wrench.header.frame_id == "arm_flange", wrench.header.frame_id
    health = peer.next(DiagnosticArray, "/diagnostics", 10)
    assert {"executor", "device arm"} <= {row.name for row in health.status}, health


def topics_of_nets_are_received(peer, cell):
    cell.load(GIVE)
    cell.cli("start", "give-2")
    speed = peer.next(Float64, "/ros2/topics/belt/speed", 10)
    assert speed.data == 0.25, speed
    assert peer.next(Bool, "/ros2/topics/door/open", 10).data is True
    cell.cli("set", "give-2", "speed=0.5 m/s")
    peer.next(Float64, "/ros2/topics/belt/speed", 10, lambda message: message.data == 0.5)
    # Null is NaN, never the last value.
    cell.cli("set", "give-2", "speed=null")
    peer.next(Float64, "/ros2/topics/belt/speed", 10, lambda message: math.isnan(message.data))
    cell.cli("cancel", "give-2", "--wait", check=False)
    cell.cli("unload", "give-2")


def nets_are_started_and_canceled(peer, cell):
    cell.load(GIVE)
    answer = peer.call("/ros2/give_2/start")
    assert answer.success and "start in cycle" in answer.message, answer
    assert cell.states()["give-2"] == "running"
    again = peer.call("/ros2/give_2/start")
    assert not again.success and "RCC3" in again.message, again
    answer = peer.call("/ros2/give_2/cancel")
    assert answer.success, answer
    assert cell.states()["give-2"] == "terminated"
    cell.cli("unload", "give-2")


class Parameters:
    """The parameters of a gateway."""

    def __init__(self, peer, node):
        self.peer = peer
        self.client = AsyncParameterClient(peer.node, node)
        peer.spin_until("parameter services", self.client.services_are_ready)

    def get(self, name):
        return self.peer.done(self.client.get_parameters([name]), "get_parameters").values[0]

    def set(self, name, value):
        parameter = Parameter(name, value=value)
        return self.peer.done(self.client.set_parameters([parameter]), "set_parameters").results[0]


def without_control_nothing_is_started(peer, cell):
    gateway = cell.gateway("--node=viewer", "--localhost-only")
    cell.load(GIVE)
    cell.cli("start", "give-2")
    parameters = Parameters(peer, "/viewer")
    until("the parameter", lambda: parameters.get("give_2.speed").double_value == 0.25)
    refused = parameters.set("give_2.speed", 0.5)
    assert not refused.successful and "--control" in refused.reason, refused
    assert parameters.get("give_2.speed").double_value == 0.25
    # CANCEL is always offered, and nothing else.
    assert peer.call("/viewer/give_2/cancel").success
    names = [name for name, _ in peer.node.get_service_names_and_types_by_node("viewer", "/")]
    offered = [name for name in names if name.startswith("/viewer/give_2") or "follow_joint" in name]
    assert offered == ["/viewer/give_2/cancel"], names
    cell.cli("unload", "give-2")
    ends(gateway)


def inputs_are_parameters(peer, cell):
    cell.load(GIVE)
    cell.cli("start", "give-2")
    parameters = Parameters(peer, "/ros2")
    get, set_one = parameters.get, parameters.set
    until("the parameter", lambda: get("give_2.speed").double_value == 0.25)
    assert get("give_2.open").bool_value is True
    refused = set_one("give_2.speed", 2.0)
    assert not refused.successful and "RCC" in refused.reason, refused
    done = set_one("give_2.speed", 0.75)
    assert done.successful, done
    assert "0.75" in cell.cli("set", "give-2"), cell.cli("set", "give-2")
    until("the new value", lambda: get("give_2.speed").double_value == 0.75)
    unknown = set_one("give_2.colour", 1.0)
    assert not unknown.successful and "give_2.colour" in unknown.reason, unknown
    cell.cli("cancel", "give-2", "--wait", check=False)
    cell.cli("unload", "give-2")
    until("the parameter to go", lambda: get("give_2.speed").type == 0)


def a_restarted_executor_is_followed(peer, cell):
    dead = cell.pid("executor")
    os.kill(dead, signal.SIGKILL)
    until("another executor", lambda: cell.pid("executor") not in (None, dead))
    stamp = peer.node.get_clock().now().to_msg().sec
    peer.next(JointState, "/joint_states", 10, lambda state: state.header.stamp.sec > stamp)
    until("the arm to be ready", lambda: "ready" in cell.cli("devices", check=False))


def a_trajectory_moves_the_arm(peer, cell, client):
    target = [REST[0] + 0.3, *REST[1:]]
    client.feedback()
    goal_id, accepted = client.send(goal(JOINTS, (0.0, REST), (2.0, target)))
    assert accepted, client.result(goal_id)
    status, code, words = client.result(goal_id)
    assert (status, code) == (SUCCEEDED, 0), (status, code, words)
    received = client.feedback()
    told = [one for one in received if list(one.goal_id) == goal_id]
    assert len(told) >= 10, received
    assert list(told[0].joint_names) == JOINTS
    for one in told:
        for desired, actual, error in zip(one.desired.positions, one.actual.positions, one.error.positions):
            assert abs(desired - actual - error) < 1e-12
    moved = [one.desired.positions[0] for one in told]
    assert moved == sorted(moved) and moved[-1] > 0.1, moved
    print(f"   {len(told)} messages of feedback, the last at {moved[-1]:.3f} rad")
    assert_at(peer, target)
    return target


def assert_at(peer, target):
    def at(message):
        return all(abs(a - b) < 1e-4 for a, b in zip(message.position, target))

    peer.next(JointState, "/joint_states", 10, at)


def position(peer):
    return list(peer.next(JointState, "/joint_states", 10).position)


def a_goal_is_refused_with_words(peer, cell, client):
    here = position(peer)
    there = [here[0] + 1.0, *here[1:]]
    cases = [
        (goal(JOINTS, (0.0, here), (0.2, there)), -1, "exceeds"),
        (goal(["wrist"], (0.0, [0.0]), (1.0, [0.1])), -2, "arm_joint_1"),
        (goal(JOINTS, (0.0, there), (5.0, here)), -1, "RCC3"),
        (goal(JOINTS, (0.0, here), (5.0, there), path_tolerance=[Tolerance("arm_joint_1", 0.0, 0.1, 0.0)]), -1, "path_tolerance"),
    ]
    for wanted, wanted_code, wanted_words in cases:
        logged = peer.subscribed(Log, "/rosout", LATCHED)
        goal_id, accepted = client.send(wanted)
        assert not accepted
        peer.spin_until("the words in /rosout", lambda: any(wanted_words in one.msg for one in logged))
        status, code, words = client.result(goal_id)
        print(f"   refused: {words.splitlines()[0][:150]}")
        assert (status, code) == (ABORTED, wanted_code) and wanted_words in words, (status, code, words)
    assert_at(peer, here)
    assert not [net for net, state in cell.states().items() if net.startswith("ros2-goal") and state == "running"]


def cancel_stops_on_the_path(peer, cell, client):
    here = position(peer)
    there = [here[0] + 0.6, *here[1:]]
    goal_id, accepted = client.send(goal(JOINTS, (0.0, here), (6.0, there)))
    assert accepted
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] > here[0] + 0.05)
    code, canceling = client.cancel(goal_id)
    assert code == 0 and canceling == [goal_id], (code, canceling)
    status, code, words = client.result(goal_id)
    assert (status, code) == (CANCELED, 0), (status, code, words)
    rest = position(peer)
    assert here[0] + 0.05 < rest[0] < there[0], rest
    assert_at(peer, rest)
    # It has ended.
    assert client.cancel(goal_id)[0] == 3


def cancel_reaches_goals_that_are_not_started_yet(peer, cell, client):
    here = position(peer)
    there = [here[0] + 0.6, *here[1:]]
    first, accepted = client.send(goal(JOINTS, (0.0, here), (6.0, there)))
    assert accepted, client.result(first)
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] > here[0] + 0.05)
    # It does not continue the first one: before it begins the arm comes to rest, and a minute of motion is rehearsed.
    second, number = client.begin(goal(JOINTS, (60.0, here)))
    again = client.goals.send(second, goal(JOINTS, (60.0, here)))
    until("CANCEL of all to reach the second goal", lambda: second in client.cancel_all()[1])
    assert client.goals.answer(number).accepted
    assert not client.goals.answer(again).accepted
    status, code, words = client.result(second)
    assert (status, code) == (CANCELED, 0) and "before it was started" in words, (status, code, words)
    status, code, words = client.result(first)
    assert (status, code) == (CANCELED, 0), (status, code, words)
    rest = position(peer)
    assert here[0] + 0.05 < rest[0] < there[0], rest
    assert_at(peer, rest)
    assert not [net for net in cell.states() if net.startswith("ros2-goal")], cell.states()


def a_new_goal_replaces_the_running_one(peer, cell, client):
    here = position(peer)
    there = [here[0] - 0.6, *here[1:]]
    first, accepted = client.send(goal(JOINTS, (0.0, here), (6.0, there)))
    assert accepted
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] < here[0] - 0.05)
    # Without a point at 0 s it begins where the arm comes to rest.
    second, accepted = client.send(goal(JOINTS, (3.0, here)))
    assert accepted, client.result(second)
    status, code, words = client.result(first)
    assert status == CANCELED and "replaced" in words, (status, code, words)
    status, code, words = client.result(second)
    assert (status, code) == (SUCCEEDED, 0), (status, code, words)
    assert_at(peer, here)
    # Nothing is left of what has ended.
    assert not [net for net in cell.states() if net.startswith("ros2-goal")], cell.states()


def a_goal_that_continues_takes_over_without_a_gap(peer, cell, client):
    # The first one dwells, so that the second begins where it is.
    here = position(peer)
    there = [here[0] + 0.1, *here[1:]]
    first, accepted = client.send(goal(JOINTS, (0.0, here), (20.0, [here[0] + 1e-4, *here[1:]])))
    assert accepted, client.result(first)
    second, accepted = client.send(goal(JOINTS, (0.0, here), (2.0, there)))
    assert accepted, client.result(second)
    assert client.result(first)[0] == CANCELED
    status, code, words = client.result(second)
    assert (status, code) == (SUCCEEDED, 0), (status, code, words)
    stopped = [line for line in cell.cli("events").splitlines() if "ros2-goal" in line][-4:]
    print("   " + "\n   ".join(stopped))


def what_the_cell_does_ends_the_goal(peer, cell, client):
    here = position(peer)
    there = [here[0] - 0.4, *here[1:]]
    # Somebody cancels the net.
    goal_id, accepted = client.send(goal(JOINTS, (0.0, here), (6.0, there)))
    assert accepted, client.result(goal_id)
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] < here[0] - 0.02)
    cell.cli("cancel", "ros2-goal-arm", "--wait", check=False)
    status, code, words = client.result(goal_id)
    assert (status, code) == (ABORTED, -4) and "canceled at the cell" in words, (status, code, words)
    # While a net of the cell holds the arm, a goal does not get it.
    here = position(peer)
    cell.load(hold(here))
    cell.cli("start", "hold")
    goal_id, accepted = client.send(goal(JOINTS, (0.0, here), (3.0, there)))
    assert not accepted
    words = client.result(goal_id)[2]
    assert "hold" in words and "RCC3004" in words, words
    cell.cli("cancel", "hold", "--wait", check=False)
    cell.cli("unload", "hold")
    # The loader dies: the executor moves the arm. If it is not back in time, the lease is lost, and the net is canceled.
    goal_id, accepted = client.send(goal(JOINTS, (0.0, here), (4.0, there)))
    assert accepted, client.result(goal_id)
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] < here[0] - 0.02)
    os.kill(cell.pid("loader"), signal.SIGKILL)
    status, code, words = client.result(goal_id)
    print(f"   the loader was killed: status {status} {words}")
    assert (status, code) in ((SUCCEEDED, 0), (ABORTED, -4)), (status, code, words)
    # The executor dies: its net is gone, the driver brings the arm to rest, and the next executor starts nothing.
    here = position(peer)
    there = [here[0] + 0.5, *here[1:]]
    goal_id, accepted = client.send(goal(JOINTS, (0.0, here), (6.0, there)))
    assert accepted, client.result(goal_id)
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] > here[0] + 0.02)
    dead = cell.pid("executor")
    os.kill(dead, signal.SIGKILL)
    status, code, words = client.result(goal_id)
    assert (status, code) == (ABORTED, -4) and words, (status, code, words)
    until("another executor", lambda: cell.pid("executor") not in (None, dead))
    until("the arm to be ready", lambda: "ready" in cell.cli("devices", check=False))
    rest = position(peer)
    assert here[0] < rest[0] < there[0] - 0.1, rest
    assert not cell.states(), cell.states()


def a_killed_gateway_moves_nothing(peer, cell, client, gateway):
    here = position(peer)
    there = [here[0] + 0.9, *here[1:]]
    _, accepted = client.send(goal(JOINTS, (0.0, here), (9.0, there)))
    assert accepted
    peer.next(JointState, "/joint_states", 10, lambda state: state.position[0] > here[0] + 0.05)
    gateway.kill()
    gateway.wait()
    until("the net to end", lambda: "terminated" in [s for n, s in cell.states().items() if n.startswith("ros2-goal")])
    # A new life starts nothing.
    successor = cell.gateway("--control", "--rmw=cyclonedds")
    try:
        rest = position(peer)
        assert here[0] + 0.05 < rest[0] < there[0] - 0.1, rest
        again = TrajectoryClient(DOMAIN, "arm")
        again.await_server()
        assert_at(peer, rest)
        assert "running" not in cell.states().values(), cell.states()
    finally:
        ends(successor)


def discovery_beside_the_cycle(cell, seconds):
    """Prints late cycles without any node of ROS, and while a gateway and nodes come and go: a load that is measured, not judged."""
    quiet = cell.lateness(seconds)
    lasts = next(quiet)
    while lasts():
        time.sleep(0.1)
    print(f"   without nodes: {next(quiet)}", flush=True)
    gateway = cell.gateway("--control")
    busy = cell.lateness(seconds)
    lasts, nodes, used, begun = next(busy), 0, computed(gateway.pid), time.monotonic()
    while lasts():
        subprocess.run([sys.executable, "-c", NODE], check=True, timeout=60)
        nodes += 1
    print(f"   with the gateway and {nodes} nodes that came and went: {next(busy)}", flush=True)
    share = (computed(gateway.pid) - used) / (time.monotonic() - begun)
    print(f"   the gateway computed {100 * share:.1f} % of the time of a core", flush=True)
    ends(gateway)


def main():
    with running() as cell:
        print("discovery beside the cycle", flush=True)
        discovery_beside_the_cycle(cell, float(os.environ.get("RCC_ROS2_SECONDS", "5")))
        peer = RosPeer()
        gateways = [cell.gateway("--control")]
        try:
            for check in (
                joint_states_are_received,
                the_other_topics_are_received,
                topics_of_nets_are_received,
                nets_are_started_and_canceled,
                inputs_are_parameters,
                without_control_nothing_is_started,
                a_restarted_executor_is_followed,
            ):
                print(check.__name__.replace("_", " "), flush=True)
                check(peer, cell)
            ends(gateways[0])
            # Fast DDS and Cyclone DDS carry services in different ways.
            gateways.append(cell.gateway("--control", "--rmw=cyclonedds"))
            client = TrajectoryClient(DOMAIN, "arm")
            client.await_server()
            for check in (
                a_trajectory_moves_the_arm,
                a_goal_is_refused_with_words,
                cancel_stops_on_the_path,
                cancel_reaches_goals_that_are_not_started_yet,
                a_new_goal_replaces_the_running_one,
                a_goal_that_continues_takes_over_without_a_gap,
                what_the_cell_does_ends_the_goal,
            ):
                print(check.__name__.replace("_", " "), flush=True)
                check(peer, cell, client)
            print("a killed gateway moves nothing", flush=True)
            a_killed_gateway_moves_nothing(peer, cell, client, gateways[1])
        finally:
            for gateway in gateways:
                gateway.kill()
                gateway.wait()
            peer.node.destroy_node()
            rclpy.shutdown()
    print("ok")


main()
