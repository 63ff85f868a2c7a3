"""The figures and the table of times of the RTAMT paper, computed with this library.

The elevator of an aircraft follows the pilot, loses two circuits, and gets commands that are too
fast; a map shows the limit. For four pairs of request and grant, robustness shows the cause of a
violation. The table lists the time per sample on this machine as the bound of a formula grows.

Run: python examples/paper_figures.py --plot docs/examples
"""

import argparse
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import rtamt
from rtamt_gym import Parameter, simulate, sweep

GRANTED = "input float req; output float gnt; always(req >= 3 implies eventually[0:5](gnt >= 3))"
FOLLOWS = "historically(rise(pc >= 0.9) implies eventually[0:1](always[0:1](abs(pc - lep) <= 3)))"
DRIVEN = "historically(eventually[0:0.1](max(lo_mode, li_mode) >= 3.5))"
FLIGHTS: dict[str, tuple[str, dict[str, float]]] = {
    "expected": (FOLLOWS, {}),
    "H1 lost at 4 s, H2 at 6 s": (DRIVEN, {"H1": 4, "H2": 6}),
    "0.8 Hz, 1.75 cm": (FOLLOWS, {"frequency": 0.8, "amplitude": 1.75}),
}
SERVERS = {"a": {}, "b": {"height": 2}, "c": {"limit": 1}, "d": {"height": 4, "limit": 1}}
SEMANTICS = ("standard", "output-robustness", "input-vacuity")


def run(name: str, spec: str, parameters: Any, **options: Any) -> tuple[Any, Any]:
    """Simulate a scenario under its baseline; return the run and the robustness over time."""
    env: Any = gym.make(f"rtamt_envs:rtamt/{name}-v0", parameters=parameters)
    own = {"signals": env.unwrapped.signals, "policy": env.unwrapped.baseline}
    result = simulate(env, {"out": spec}, **own, stop="end", **options)
    return result, result.histories["out"].robustness


def draw_flights() -> Any:
    """Draw the command, the elevator and the robustness so far of three flights."""
    figure, axes = plt.subplots(2, 3, sharex=True, sharey="row", height_ratios=[1.6, 1])
    for (title, (spec, parameters)), (top, low) in zip(FLIGHTS.items(), axes.T, strict=True):
        flight, robustness = run("AircraftElevator", spec, parameters, view="step")
        print(f"{title:28}{robustness[-1]:10.2f}")
        top.step(flight.times, flight.signals["pc"], "0.6", where="pre", label="command in cm")
        top.plot(flight.times, flight.signals["lep"], label="left elevator in cm")
        low.plot(flight.times, robustness, "C1" if robustness[-1] < 0 else "C2")
        low.axhline(0, color="0.6", linewidth=0.6)
        top.set(title=title)
        low.set(xlabel="time in s")
    axes[0, 1].legend(loc="lower left")
    axes[0, 0].set(ylim=(-4.6, 3.2))
    axes[1, 0].set(ylabel="robustness")
    return figure


def draw_servers() -> Any:
    """Draw four pairs of request and grant with their robustness under three semantics."""
    figure, axes = plt.subplots(1, 4, sharey=True)
    for (title, parameters), ax in zip(SERVERS.items(), axes, strict=True):
        runs = [run("RequestGrant", GRANTED, parameters, semantics=name) for name in SEMANTICS]
        values = [robustness[-1] for _, robustness in runs]
        print(f"{title:10}" + "".join(f"{value:20.0f}" for value in values))
        for name, style in (("req", "-"), ("gnt", "-.")):
            first = runs[0][0]
            ax.step(first.times, first.signals[name], linestyle=style, where="post", label=name)
        ax.axhline(3, color="0.6", linestyle="--", linewidth=0.8)
        text = "standard {:.0f}\noutput {:.0f}\nvacuity {:.0f}".format(*values)
        ax.set(title=f"({title})", xlim=(0, 10), ylim=(0, 8), xticks=(0, 5, 10), xlabel="time in s")
        ax.text(9.8, 7.8, text, ha="right", va="top")
    axes[1].legend(loc="center right")
    return figure


def cost(monitor: Any, rows: Any, *, dense: bool) -> float:
    """Return nanoseconds per sample with a full window: the minimum of ten blocks of 50 samples."""
    a, b = (list(enumerate(column)) if dense else column for column in rows.T.tolist())
    (monitor.update if dense else monitor.update_many)({"a": a[:-500], "b": b[:-500]})
    times = []
    for block in range(len(a) - 500, len(a), 50):
        pairs = zip(a[block : block + 50], b[block : block + 50], strict=True)
        samples = [{"a": [x], "b": [y]} if dense else {"a": x, "b": y} for x, y in pairs]
        start = perf_counter()
        for sample in samples:
            monitor.update(sample)
        times.append(perf_counter() - start)
    return min(times) / 50 * 1e9


def main(argv: list[str] | None = None) -> None:
    """Simulate, print robustness and times, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="draw the figures into this folder")
    folder = parser.parse_args(argv).plot
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    print(f"{'flight':28}robustness")
    flights = draw_flights()
    print("\nserver  " + "".join(f"{semantics:>20}" for semantics in SEMANTICS))
    servers = draw_servers()
    space = [Parameter("frequency", 0.2, 0.8), Parameter("amplitude", 1, 1.75)]
    grid = sweep("rtamt/AircraftElevator-v0", "follows_left", space, samples=4, sampler="grid")
    print(f"\n{grid}\n")
    if folder:
        flights.savefig(folder / "paper_flights.png")
        servers.savefig(folder / "paper_servers.png")
        grid.heat_map(folder / "paper_map.png")
    rng = np.random.default_rng(0)
    backends: list[Any] = ["python", "native"] if rtamt.BACKEND == "native" else ["python"]
    kinds = [(kind, backend) for kind in ("discrete", "dense") for backend in backends]
    print("bound   ns:" + "".join(f"{' '.join(kind):>17}" for kind in kinds))
    for bound in (100, 1000, 10_000, 100_000):
        line, rows = f"[0:{bound}]".ljust(11), rng.uniform(-1, 1, (bound + 500, 2))
        for kind, backend in kinds:
            make = rtamt.dense.Monitor if kind == "dense" else rtamt.Monitor
            monitor = make(f"always[0:{bound}](a + b > -2)", backend=backend)
            line += f"{cost(monitor, rows, dense=kind == 'dense'):17.0f}"
        print(line)


if __name__ == "__main__":
    main()
