"""Starts the demo cell, validates its OpenAPI document, generates a client from it, and runs a net with that client."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import httpx
from openapi_spec_validator import validate

ROOT = Path(__file__).resolve().parent.parent
NET = {
    "net": "round-trip",
    "primitives": {
        "clock": {"type": "Time"},
        "over": {"type": "Greater", "inputs": {"a": "clock.out", "b": "0.1 s"}},
        "end": {"type": "Termination", "inputs": {"done": "over.out"}},
    },
}
# The generator does not know these kinds of text; clients send and receive them as they are.
CONFIG = """content_type_overrides:
  application/yaml: application/octet-stream
  application/x-ndjson: application/octet-stream
  text/event-stream: application/octet-stream
"""


def wait_for(what, look):
    """Returns the first result of `look` that is not None."""
    limit = time.monotonic() + 60
    while (found := look()) is None:
        if time.monotonic() > limit:
            sys.exit(f"no {what} within 60 s")
        time.sleep(0.05)
    return found


def document(transport, up):
    """Returns the document when the loader serves it."""
    with httpx.Client(transport=transport, base_url="http://rcc") as client:

        def look():
            if up.poll() is not None:
                sys.exit(f"rcc-cli up ended with {up.returncode}")
            try:
                return client.get("/openapi.json").raise_for_status().json()
            except httpx.TransportError:
                return None

        return wait_for("loader", look)


def generate(described, folder):
    """Generates the package `rcc_client` in `folder`."""
    (folder / "openapi.json").write_text(json.dumps(described))
    (folder / "config.yaml").write_text(CONFIG)
    command = "openapi-python-client generate --meta none --fail-on-warning --overwrite".split()
    command += ["--path", "openapi.json", "--config", "config.yaml", "--output-path", "rcc_client"]
    subprocess.run(command, cwd=folder, check=True)
    sys.path.insert(0, str(folder))


def round_trip(transport):
    """Loads a net, runs it to its end, and unloads it."""
    from rcc_client import Client
    from rcc_client.api.cell import get_status
    from rcc_client.api.commands import get_command, load_command, start_command, unload_command
    from rcc_client.api.values import read_values
    from rcc_client.models import CommandState, EndReason, ErrorBody, LoadCommandJsonBody, Loaded, Start, StatusView

    client = Client(base_url="http://rcc", httpx_args={"transport": transport})
    body = LoadCommandJsonBody.from_dict(NET)
    # The loader serves its document before the executor has come.
    wait_for("status", lambda: status if isinstance(status := get_status.sync(client=client), StatusView) else None)
    command = load_command.sync(client=client, body=body)
    assert isinstance(command, Loaded), command
    name = str(command.id)

    def reaches(state):
        found = get_command.sync(name, client=client)
        return found if found.state == state else None

    wait_for("ready net", lambda: reaches(CommandState.READY))
    # Without a body the generated client of this version sends its mark for values that are not set.
    start_command.sync(name, client=client, body=Start())
    ended = wait_for("end of the net", lambda: reaches(CommandState.TERMINATED))
    assert ended.reason == EndReason.FINISHED, ended
    unload_command.sync(name, client=client)

    def is_gone():
        found = read_values.sync(name, client=client)
        assert isinstance(found, ErrorBody), found
        return found.code == "RCC3001"

    # The table that says so is published after the answer.
    wait_for("end of the command", is_gone)


def main():
    with tempfile.TemporaryDirectory(prefix="rcc-openapi-") as folder:
        folder = Path(folder)
        cell = ["--cell", "openapi"]
        program = [ROOT / "target/debug/rcc-cli", *cell, "up", ROOT / "configs/cells/demo.yaml"]
        environment = os.environ | {"RCC_RUNTIME_DIR": str(folder), "RCC_STATE_DIR": str(folder / "state")}
        with (folder / "log").open("w") as log:
            up = subprocess.Popen(program, env=environment, stdout=log, stderr=log)
        transport = httpx.HTTPTransport(uds=str(folder / "openapi/loader.sock"))
        try:
            described = document(transport, up)
            validate(described)
            generate(described, folder)
            round_trip(httpx.HTTPTransport(uds=str(folder / "openapi/loader.sock")))
        except BaseException:
            print((folder / "log").read_text(), file=sys.stderr)
            raise
        finally:
            up.send_signal(signal.SIGINT)
            up.wait(timeout=60)
    count = sum(len(methods) for methods in described["paths"].values())
    print(f"the OpenAPI document is valid; a client was generated from its {count} operations and ran a net")


main()
