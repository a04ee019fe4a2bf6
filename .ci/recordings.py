"""Records a net with every type and nulls, live and as an incident, and compares what three independent readers find with
the tables that `rcc-cli` writes."""

import csv
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

ROOT = Path(__file__).resolve().parent.parent
BIN = ROOT / "target/debug"
# Each type, the value that it is set to, and its number of elements.
TYPES = {
    "real": ("Real", 0.1, 1),
    "integer": ("Int", -7, 1),
    "truth": ("Bool", True, 1),
    "vector": ("Vector3", [1.5, -2, 0.25], 3),
    "turn": ("Rotation", {"quat": [0, 0, 0, 1]}, 4),
    "pose": ("Pose", {"xyz": [0.1, 0.2, 0.3], "quat": [0, 1, 0, 0]}, 7),
    "twist": ("Twist", [1, 2, 3, 4, 5, 6], 6),
    "wrench": ("Wrench", [6, 5, 4, 3, 2, 1], 6),
    "reals": ("Real[2]", [1e300, -1e-300], 2),
    "truths": ("Bool[3]", [True, False, True], 3),
    "integers": ("Int[2]", [4503599627370497, -1], 2),
    "matrix": ("Real[2,2]", [[1, 2], [3, 4]], 4),
}


def net():
    """Inputs of every type, null until they are set; each has a monitor."""
    lines = ["net: every-type", "primitives:", "  clock: {type: Time}", "  cancel: {type: Cancel}"]
    lines += ["  late: {type: Greater, inputs: {a: clock.out, b: 1 s}}"]
    lines += ["  end: {type: Termination, inputs: {done: cancel.requested}}"]
    for name, (kind, _, _) in TYPES.items():
        lines += [f'  {name}: {{type: Input, parameters: {{type: "{kind}"}}}}']
    for name, port in [("clock", "out"), ("late", "out"), *((name, "value") for name in TYPES)]:
        lines += [f"  see_{name}: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: {name}.{port}}}}}"]
    return "\n".join(lines) + "\n"


def number(value):
    """A value as the tables have it: a float, or None for null."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    return float(value)


def flat(value):
    return [number(one) for one in value] if isinstance(value, (list, tuple)) else [number(value)]


def table(path):
    """The rows of a table by cycle, each with its values by name; empty cells are null."""
    found = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            values = {key: number_of(text) for key, text in row.items() if key.startswith("every-type/")}
            found[int(row["cycle"])] = values
    return found


def number_of(text):
    if text in ("true", "false"):
        return float(text == "true")
    return float(text) if text else None


def of_python(path):
    """Messages by topic, as Python's reader finds them, and the names of the fields."""
    names, rows = {}, []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            if schema.name.startswith("rcc/msg/"):
                names[channel.topic] = channel.metadata
                fields = {key: getattr(decoded, key) for key in decoded.__slots__}
                rows.append((channel.topic, message.log_time, fields))
            else:
                assert decoded is not None
                rows.append((channel.topic, message.log_time, None))
        attached = [one.name for one in reader.iter_attachments()]
    return names, rows, attached


def of_npm(path):
    lines = subprocess.run(["node", ROOT / ".ci/mcap.mjs", path], cwd=ROOT, check=True, capture_output=True).stdout
    return [tuple(json.loads(line)) for line in lines.splitlines()]


def compare(who, rows, names, expected, exact):
    """Every message of the net has the values of the table; returns how many values were compared and how many are null."""
    compared = nulls = 0
    seen = set()
    for topic, _, fields in rows:
        metadata = names.get(topic, {})
        if metadata.get("net") != "every-type":
            continue
        cycle = int(fields["cycle"])
        seen.add(cycle)
        if cycle not in expected:
            assert not exact, f"{who}: cycle {cycle} is not in the table"
            continue
        for key, value in fields.items():
            name = metadata.get(f"name.{key}")
            if name is None:
                continue
            values = flat(value)
            for index, one in enumerate(values):
                full = f"every-type/{name}" + (f"[{index}]" if len(values) > 1 else "")
                want = expected[cycle][full]
                assert one == want, f"{who}: {full} in cycle {cycle} is {one}, and {want} in the table"
                compared += 1
                nulls += one is None
    assert not exact or seen == set(expected), f"{who}: {len(seen)} of {len(expected)} cycles"
    assert compared and nulls and nulls < compared, (who, compared, nulls)
    print(f"{who}: {compared} values are the same, {nulls} of them null")


def of_rerun(path, folder, names):
    """The messages of tables, as Rerun finds them when it converts the file."""
    from rerun.experimental import RrdReader

    out = folder / "out.rrd"
    rerun = Path(sys.executable).parent / "rerun"
    subprocess.run([rerun, "mcap", "convert", path, "-o", out], check=True, capture_output=True)
    rows, topics = [], set()
    for chunk in RrdReader(out).stream().to_chunks():
        topic = chunk.entity_path
        topics.add(topic)
        if topic not in names:
            continue
        batch = chunk.to_record_batch()
        for column in batch.schema.names:
            if column.startswith("rcc.msg.") and column.endswith(":message"):
                rows += [(topic, 0, message) for messages in batch.column(column).to_pylist() for message in messages]
    return rows, topics


class Cell:
    """A simulated cell of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.environment = os.environ | {"RCC_RUNTIME_DIR": str(folder), "RCC_STATE_DIR": str(folder / "state")}
        self.log = (folder / "log").open("w")
        self.up = self.start("up", ROOT / "configs/cells/demo.yaml", output=self.log)

    def start(self, *arguments, output=subprocess.PIPE):
        program = [BIN / "rcc-cli", "--cell", "mcap", *arguments]
        return subprocess.Popen(program, env=self.environment, stdout=output, stderr=subprocess.STDOUT, text=True)

    def run(self, *arguments):
        process = self.start(*arguments)
        text, _ = process.communicate(timeout=120)
        return process.returncode, text

    def must(self, *arguments):
        code, text = self.run(*arguments)
        assert code == 0, f"{arguments}: {code}: {text}"
        return text

    def wait_for(self, what, look):
        limit = time.monotonic() + 60
        while not look():
            assert time.monotonic() < limit, f"no {what} within 60 s"
            assert self.up.poll() is None, "rcc-cli up has ended"
            time.sleep(0.05)

    def stop(self):
        self.up.send_signal(signal.SIGINT)
        self.up.wait(timeout=60)


def record(cell, folder):
    """Records while the inputs are null, set, and null again; then writes the same seconds as an incident."""
    cell.wait_for("cell", lambda: cell.run("status")[0] in (0, 1) and cell.run("ls")[0] == 0)
    (folder / "net.yaml").write_text(net())
    cell.must("load", folder / "net.yaml")
    live = folder / "live.mcap"
    recorder = cell.start("--output", "json", "record", live, "--nets", "every-type")
    cell.wait_for("recording", lambda: live.exists() and live.stat().st_size > 0)
    cell.must("start", "every-type")

    def rows(name):
        code, _ = cell.run("import", live, "--show", f"every-type/{name}", "--csv", folder / "look.csv")
        return table(folder / "look.csv") if code == 0 else {}

    def some(name, wanted):
        return lambda: any(wanted(value) for row in rows(name).values() for value in row.values())

    cell.wait_for("null", some("real.value", lambda value: value is None))
    for name, (_, value, _) in TYPES.items():
        cell.must("set", "every-type", f"{name}={json.dumps(value)}")
    cell.wait_for("values", some("integers.value", lambda value: value is not None))
    cell.must("set", "every-type", "real=null")
    cell.wait_for("true", some("late.out", lambda value: value == 1.0))
    recorder.send_signal(signal.SIGINT)
    text, _ = recorder.communicate(timeout=60)
    assert recorder.returncode == 0, text
    print("live:", text.strip())
    text = cell.must("--output", "json", "incidents", "record")
    return live, json.loads(text)["file"]


def main():
    readers = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="rcc-mcap-") as folder:
        folder = Path(folder)
        cell = Cell(folder)
        try:
            live, incident = record(cell, folder)
        except BaseException:
            print((folder / "log").read_text(), file=sys.stderr)
            raise
        finally:
            cell.stop()
        replayed = folder / "incident.mcap"
        columns = ["--show", "every-type/*"]
        cell.must("replay", incident, *columns, "--csv", folder / "incident.csv")
        cell.must("replay", incident, "--mcap", replayed)
        # All readers must find in both files the values that a replay computes again, bit for bit.
        expected = table(folder / "incident.csv")
        for path, exact in [(replayed, True), (live, False)]:
            names, rows, attached = of_python(path)
            assert any(name.startswith("every_type") for name in attached), attached
            compare(f"Python, {path.name}", rows, names, expected, exact)
            topics = {topic for topic, _, _ in rows}
            for topic in ["/tf", "/robot_description", "/lwr/measured/joint_states", "/lwr/commanded/pose"]:
                assert topic in topics, (topic, topics)
            if "npm" in readers:
                found = of_npm(path)
                assert len(found) == len(rows), (len(found), len(rows))
                compare(f"npm, {path.name}", found, names, expected, exact)
            if "rerun" in readers:
                found, converted = of_rerun(path, folder, names)
                assert set(names) <= converted, (set(names), converted)
                compare(f"Rerun, {path.name}", found, names, expected, exact)
            cell.must("import", path, "--csv", folder / "again.csv", *columns)
            again = table(folder / "again.csv")
            for cycle, values in again.items():
                for name, value in values.items():
                    want = expected.get(cycle, {}).get(name, value)
                    assert value == want, (name, cycle, value, want)
            cell.must("plot", path, "--out", folder / "plot.svg")


main()
