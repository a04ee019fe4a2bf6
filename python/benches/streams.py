"""Measures streams into arrays of numpy at 100 Hz and 1 kHz: monitored values, samples, set-points, and what was lost.

`python benches/streams.py [--seconds S]` against the cell in RCC_CELL. Its nets command nothing.
"""

import argparse
import time

import numpy

import rcc

RATES = (100, 1000)


def counting(rate: int) -> rcc.Net:
    """A net whose time is monitored, until it is canceled."""
    net = rcc.Net(f"counting-{rate}")
    net.Monitor(value=net.Time(name="time").out, rate=rate)
    net.Termination(done=net.Cancel().requested)
    return net


def taking() -> rcc.Net:
    """A net with an input of seven numbers."""
    net = rcc.Net("taking")
    goal = net.Input(initial=[0.0] * 7, name="goal")
    net.Monitor(value=goal.value, rate=1000)
    net.Termination(done=net.Cancel().requested)
    net.discard(goal.age)
    return net


def monitored(cell: rcc.Cell, rate: int, seconds: float) -> None:
    """Every value of a monitor."""
    with cell.recording(f"counting-{rate}/*") as values:
        command = cell.start(counting(rate))
        time.sleep(seconds)
        command.cancel()
        cycles = command.wait(60).cycles
        command.unload()
    got, period = values.cycles("time.out"), cell.status()["executor"]["period_ns"] / 1e9
    expected = -(-cycles * period * rate // 1)
    gaps = int((numpy.diff(got) > round(1 / rate / period)).sum())
    print(f"monitored at {rate:4} Hz   {len(got):6} of {expected:6.0f} values  gaps {gaps}  lost {values.lost}")


def sampled(cell: rcc.Cell, rate: int, seconds: float) -> None:
    """Samples of a port without a monitor, and the time between two of them as they arrive."""
    command = cell.start(counting(rate))
    values, arrived, lost, net_cycles = [], [], 0, []
    begin = time.monotonic()
    for sample in command.watch("time.out", rate=rate):
        values.append(sample["time.out"])
        arrived.append(time.monotonic())
        net_cycles.append(sample.cycle)
        lost += sample.lost
        if arrived[-1] - begin > seconds:
            break
    command.cancel()
    command.wait(60)
    command.unload()
    period = cell.status()["executor"]["period_ns"] / 1e9
    expected = round((net_cycles[-1] - net_cycles[0]) * period * rate) + 1
    between = numpy.percentile(numpy.diff(arrived) * 1000, (1, 50, 99, 100))
    told = "  ".join(f"{name} {ms:.1f}" for name, ms in zip(("p1", "p50", "p99", "max"), between, strict=True))
    array = numpy.array(values)
    gaps = int((numpy.diff(array) > 1.5 / rate).sum())
    print(f"sampled at {rate:6} Hz   {len(array):6} of {expected:6} values  gaps {gaps}  lost {lost}  apart: {told} ms")


def sent(cell: rcc.Cell, rate: int, seconds: float) -> None:
    """Set-points from Python."""

    def points():  # noqa: ANN202
        begin = time.monotonic()
        for step in range(int(rate * seconds)):
            time.sleep(max(0.0, begin + step / rate - time.monotonic()))
            yield {"goal": [float(step)] * 7}

    with cell.recording("taking/*") as values:
        command = cell.start(taking())
        end = command.set_points(points())
        command.cancel()
        command.wait(60)
        command.unload()
    seen = len(numpy.unique(values.array("goal.value")[:, 0]))
    print(
        f"set-points at {rate:4} Hz  {end['lines']:6} sent  took effect {end['set']}  superseded {end['superseded']}  "
        f"seen {seen}"
    )


def main() -> None:
    """Measures both ways at both rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    with rcc.connect() as cell:
        for rate in RATES:
            monitored(cell, rate, seconds)
        for rate in RATES:
            sampled(cell, rate, seconds)
        for rate in RATES:
            sent(cell, rate, seconds)


if __name__ == "__main__":
    main()
