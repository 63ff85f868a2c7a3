"""Controls of a unicycle from the gradient of robustness: two positions in time, no collision.

Adam maximizes standard robustness, and smooth robustness with a falling temperature; standard
robustness evaluates the results. Needs the extras `jax` and `plot`.

Run: python examples/unicycle.py --plot docs/examples/unicycle.png
"""

import argparse
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
from matplotlib.patches import Circle

import rtamt
import rtamt_arrays.jax

TASK = "always(clear > 0) and eventually[0:3](first > 0) and eventually[0:5] always[0:1](last > 0)"
CIRCLES = {"clear": (1.6, 0.8, 0.7), "first": (0.6, 2.0, 0.4), "last": (3.2, 1.2, 0.4)}
STEPS, PERIOD, SAMPLES = 300, 0.1, 61


def path(controls: Any) -> Any:
    """Return the positions of a unicycle, one more than controls."""
    speed, turn = 2.0 * jax.nn.sigmoid(controls[0]), 3.0 * jnp.tanh(controls[1])
    heading = jnp.cumsum(turn) * PERIOD
    moves = PERIOD * speed * jnp.stack([jnp.cos(heading), jnp.sin(heading)])
    return jnp.concatenate([jnp.zeros((2, 1)), jnp.cumsum(moves, axis=1)], axis=1)


def signals(positions: Any) -> dict[str, Any]:
    """Return the distance of each position to the obstacle, and into the other circles."""
    gaps = {
        n: jnp.hypot(positions[0] - x, positions[1] - y) - r for n, (x, y, r) in CIRCLES.items()
    }
    return {name: gap if name == "clear" else -gap for name, gap in gaps.items()}


def robustness(controls: Any, **more: Any) -> Any:
    """Return the robustness of the task at the start."""
    return rtamt_arrays.jax.evaluate(TASK, signals(path(controls)), period=PERIOD, **more)[0]


def ascend(start: Any, *, smooth: bool) -> tuple[Any, Any]:
    """Return the controls after all steps of Adam, and the standard robustness before each step."""

    def step(carried: Any, i: Any) -> Any:
        controls, mean, square = carried
        more = {"semantics": "smooth", "temperature": 0.2 * 0.05 ** (i / STEPS)} if smooth else {}
        slope = jax.grad(robustness)(controls, **more)
        mean, square = 0.9 * mean + 0.1 * slope, 0.999 * square + 0.001 * slope**2
        size = jnp.sqrt(square / (1 - 0.999 ** (i + 1.0))) + 1e-8
        new = controls + 0.05 * mean / (1 - 0.9 ** (i + 1.0)) / size
        return (new, mean, square), robustness(controls)

    (result, *_), history = jax.lax.scan(step, (start, 0.0 * start, 0.0 * start), jnp.arange(STEPS))
    return result, history


def main(argv: list[str] | None = None) -> None:
    """Compute controls with both gradients, and print their robustness."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="draw the paths into this file")
    plot = parser.parse_args(argv).plot
    plt.style.use(Path(__file__).parent / "paper.mplstyle")
    figure, (way, curve) = plt.subplots(1, 2, width_ratios=(3, 2))
    for name, (x, y, radius) in CIRCLES.items():
        way.add_patch(Circle((x, y), radius, color="0.75" if name == "clear" else "#CDE8DC"))
        way.annotate("obstacle" if name == "clear" else name, (x, y), ha="center", va="center")
    start = 0.3 * jax.random.normal(jax.random.key(1), (2, SAMPLES - 1))
    print(f"{'gradient of':>12}{'robustness':>12}{'verdict':>12}{'below 0 at':>13}")
    for smooth, label in (False, "standard"), (True, "smooth"):
        controls, history = jax.jit(ascend, static_argnames="smooth")(start, smooth=smooth)
        final = rtamt.evaluate(TASK, signals(path(controls)), period=PERIOD)[0]
        verdict = "SATISFIED" if rtamt.holds(final) else "VIOLATED"
        print(f"{label:>12}{final:12.3f}{verdict:>12}{(history < 0).sum():>7} steps")
        way.plot(*path(controls), label=label)
        curve.plot(history, label=label)
    way.plot(*path(start), color="0.6", linestyle=":", label="first guess", zorder=0)
    way.set(title="The way, by the gradient of ...", aspect="equal", xlabel="m", ylabel="m")
    way.legend(loc="lower left")
    curve.axhline(0, color="0.6", linewidth=0.6, zorder=0)
    curve.set(title="Standard robustness, m", xlabel="step")
    figure.savefig(plot) if plot else None


if __name__ == "__main__":
    main()
