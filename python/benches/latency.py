"""Measures how long it takes from the end of a net until the next one, which is loaded already, has its first cycle.

`python benches/latency.py [--nets N]` against the cell in RCC_CELL. Two ways: the program waits for the outcome and
starts the next net; or it hands over while the first one runs.
"""

import argparse

import rcc


def net(name: str, seconds: float) -> rcc.Net:
    """A net that ends after a time, or when it is canceled."""
    built = rcc.Net(name)
    built.Termination(done=(built.Time().out > seconds * rcc.s) | built.Cancel().requested)
    return built


#: Upper ends of the histogram's classes, ms; the last one has all above.
CLASSES_MS = (1, 2, 5, 10, 15, 20, 30, 50, 100, 200)


def shown(what: str, cycles: list[int], period_ms: float) -> None:
    """Prints a distribution: percentiles, then a histogram of the classes that are not empty."""
    times = [cycle * period_ms for cycle in sorted(cycles)]
    parts = {f"p{part}": times[int(part / 100 * (len(times) - 1))] for part in (10, 50, 90, 99)}
    told = "  ".join(f"{name} {time:6.1f} ms" for name, time in parts.items())
    print(f"{what:<32} {len(times):5} times  min {times[0]:6.1f} ms  {told}  max {times[-1]:6.1f} ms")
    begin = -1.0
    for end in (*CLASSES_MS, float("inf")):
        count = sum(begin < time <= end for time in times)
        if count:
            named = f"to {end} ms" if end < float("inf") else f"above {begin} ms"
            print(f"  {named:>13} {count:6}  {'#' * -(-50 * count // len(times))}")
        begin = end


def main() -> None:
    """Measures both ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nets", type=int, default=200)
    count = parser.parse_args().nets
    with rcc.connect() as cell:
        period_ms = cell.status()["executor"]["period_ns"] / 1e6
        gaps = []
        current = cell.load(net("first", 0.05))
        current.start()
        for number in range(count):
            following = cell.load(net(f"next-{number}", 0.05))
            assert current.wait(60)
            cycle = following.start()
            gaps.append(cycle - current.state()["ended_cycle"])
            current.unload()
            current = following
        current.wait(60)
        current.unload()
        shown("outcome to the next first cycle", gaps, period_ms)

        current = cell.load(net("first", 60))
        current.start()
        gaps = []
        for number in range(count):
            following = cell.load(net(f"next-{number}", 60))
            cycle = cell.switch([current], [following])
            gaps.append(cycle - current.state()["ended_cycle"])
            current.unload()
            current = following
        current.cancel()
        current.wait(60)
        current.unload()
        shown("hand-over: last to first cycle", gaps, period_ms)


if __name__ == "__main__":
    main()
