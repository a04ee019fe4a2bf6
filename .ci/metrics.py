"""Starts a cell with a net, reads its metrics in both formats, and lets Prometheus' own programs judge them."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = ROOT / "target/debug"
OPEN = "application/openmetrics-text; version=1.0.0"
LIMIT_S = 60


def scrape(address: str, accept: str) -> str:
    request = urllib.request.Request(address, headers={"accept": accept})
    with urllib.request.urlopen(request, timeout=LIMIT_S) as answer:
        return answer.read().decode()


def judge_open_metrics(text: str) -> int:
    try:
        from prometheus_client.openmetrics.parser import text_string_to_metric_families
    except ImportError:
        return 0
    families = list(text_string_to_metric_families(text))
    assert all(family.documentation for family in families), "a family without help"
    return len(families)


def judge_names(text: str) -> None:
    """Every metric that the alert rules and the dashboard use exists."""
    told = set(re.findall(r"^(rcc_\w+)", text, re.MULTILINE))
    folder = ROOT / "configs/monitoring"
    panels = json.loads((folder / "grafana.json").read_text())["panels"]
    used = [target["expr"] for panel in panels for target in panel["targets"]]
    used.append((folder / "alerts.yaml").read_text())
    unknown = set(re.findall(r"\brcc_\w+", " ".join(used))) - told
    # This one is absent while there is no limit.
    unknown.discard("rcc_cycle_budget_seconds")
    assert not unknown, f"not among the metrics: {sorted(unknown)}"


def run(environment: dict[str, str]) -> None:
    up = subprocess.Popen([BIN / "rcc-cli", "up", ROOT / "configs/cells/demo.yaml"], env=environment, stdout=subprocess.DEVNULL)
    server = None
    try:
        end = time.monotonic() + LIMIT_S
        net = ROOT / "configs/nets/line.yaml"
        while subprocess.run([BIN / "rcc-cli", "run", net], env=environment, capture_output=True).returncode:
            if time.monotonic() > end or up.poll() is not None:
                sys.exit("the cell does not run a net")
        # `run` unloads what it ran; nets that are loaded have metrics of their own.
        for verb in (["load", net], ["start", "line"]):
            subprocess.run([BIN / "rcc-cli", *verb], env=environment, check=True, stdout=subprocess.DEVNULL)
        command = [BIN / "rcc-monitor", "--cell", "demo", "serve", "--port", "0", "--metrics-open"]
        server = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        address = server.stdout.readline().split("/?")[0] + "/metrics"
        text = scrape(address, OPEN)
        judge_names(text)
        families = judge_open_metrics(text)
        print(f"OpenMetrics parser: {families} families" if families else "skipped: .ci/metrics, Python parser")
        if promtool := os.environ.get("PROMTOOL"):
            text = scrape(address, "text/plain")
            done = subprocess.run([promtool, "check", "metrics"], input=text, capture_output=True, text=True)
            if done.returncode or done.stderr or done.stdout:
                sys.exit(f"promtool check metrics: {done.stdout}{done.stderr}")
            print(f"promtool check metrics: {len(text.splitlines())} lines, no remark")
    finally:
        for process in (server, up):
            if process is not None:
                process.send_signal(signal.SIGINT)
                process.wait(LIMIT_S)


with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    names = {"RCC_RUNTIME_DIR": str(folder / "run"), "RCC_STATE_DIR": str(folder / "state")}
    run({**os.environ, **names, "RCC_CELL": "demo"})
