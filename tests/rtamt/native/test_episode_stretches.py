"""Episodes that are long compared with their windows: C++ against Python, sample by sample.

The formulas are generated: each operator inside each other, windows of one and of two samples,
bounded and unbounded, responses and their duals. Formulas chosen by hand are in
test_native_episode.py; short traces, against the definition, in test_episode.py.
"""

from __future__ import annotations

import copy
import random
from typing import get_args

import pytest
from bits import bits

from rtamt import EpisodeMonitor
from rtamt.machines.protocols import End

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

NAMES = ("x", "y", "z")
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
SAMPLES = 70
ROOTS = ("", "always", "eventually", "always[0:30]", "always[1:inf]", "not always")


def atom(rng: random.Random) -> str:
    return f"({rng.choice(NAMES)} {rng.choice(COMPARISONS)} {rng.randint(-1, 1)})"


def window(rng: random.Random, *, endless: bool) -> str:
    begin = rng.choice((0, 0, 0, 1, 2, 5))
    end = begin + rng.choice((0, 1, 1, 2, 7, 12))
    return f"[{begin}:{'inf' if endless and rng.random() < 0.25 else end}]"


def formula(rng: random.Random, depth: int) -> str:
    """Formulas of every operator."""
    if not depth or rng.random() < 0.1:
        return atom(rng)
    p, q = (formula(rng, depth - 1) for _ in range(2))
    w = window(rng, endless=True)
    return rng.choice(
        [
            f"not({p})",
            f"(prev {p})",
            f"(next {p})",
            f"rise({p})",
            f"({p} {rng.choice(('and', 'or', 'implies', 'iff', 'xor'))} {q})",
            f"({p} {rng.choice(('and', 'or', 'implies'))} {q})",
            f"(historically{w} {p})",
            f"(once{w} {p})",
            f"(always{w} {p})",
            f"(eventually{w} {p})",
            f"({p} since{w} {q})",
            f"({p} until{w} {q})",
            f"({p} unless{w} {q})",
        ]
    )


def response(rng: random.Random) -> str:
    """Formulas with machines of their own: an answer within a time, or for a time."""
    p, q = atom(rng), rng.choice((atom(rng), f"(once{window(rng, endless=True)} {atom(rng)})"))
    late = rng.choice(("eventually", "always")) + window(rng, endless=False)
    inner = rng.choice(("", "", rng.choice(("eventually", "always")) + window(rng, endless=False)))
    both = rng.choice((f"{p} {rng.choice(('and', 'or'))} ", "")) + q
    joined = f"(({both}) {rng.choice(('implies', 'and', 'or'))} {late} {inner} {atom(rng)})"
    return f"{rng.choice(ROOTS)} {joined}"


# Their minima or maxima follow from another value, without single values.
JOINED = (
    "eventually((x > 0) or eventually[0:5](y > 0))",
    "always((x > 0) and once[0:3] always[0:5](y > 0))",
    "eventually(historically(x > 0) or next(historically(y > 0)))",
    "eventually(historically(x > 0) or eventually[5:5](historically(y > 0)))",
    "always(once(x > 0) and next(once(y > 0)))",
    "always((x > 0) and (once(z > 0) or eventually[2:3](y > 0)))",
    # An answer that is late itself, or whose unseen values are unknown.
    "always((x > 0) or eventually[0:4](always[0:2](eventually[0:3](y > 0))))",
    "eventually((x > 0) and always[1:4](eventually[0:2](always[0:3](y > 0))))",
    "always((x > 0) or eventually[0:4](always[0:2](historically(y > 0))))",
    "always((x > 0) or eventually[0:4](always[0:2](once(y > 0))))",
    "eventually((x > 0) and always[0:4](eventually[0:2](once(y > 0))))",
    "eventually((x > 0) and always[0:4](eventually[0:2](historically(y > 0))))",
    "always(eventually[0:4](historically(y > 0)))",
    "always(eventually[0:4](once(y > 0)))",
    "eventually(eventually[0:4](historically(y > 0)))",
    "eventually(always[0:4](once(y > 0)))",
    "always(always[0:4](historically(y > 0)))",
    # One formula whose minimum and maximum are both needed.
    "g = (x > 0) or eventually[0:5](y > 0); always(g) and eventually(g)",
    "g = (x > 0) or eventually[0:5](y > 0); always(g) or eventually((z > 0) or g)",
    "g = (x > 0) and always[0:5](y > 0); always((z > 0) and g) or eventually(g)",
    # An unbounded window inside one of the past.
    "once(eventually(x > 0))",
    "historically[0:3](always(x > 0)) or always[0:5](prev(eventually(y > 0)))",
    "(eventually(x > 0)) since (always(y > 0))",
    "once(eventually(next(x > 0)))",
    "historically[0:3](always(eventually[0:2](x > 0)))",
    "once[0:3]((x > 0) until (next(y > 0)))",
)


def offered(monitor: EpisodeMonitor) -> list[int]:
    """Return robustness, lower and upper bound, bit by bit."""
    return bits([monitor.robustness, monitor.lower, monitor.upper])


def compare(rng: random.Random, text: str) -> None:
    """Compare both back-ends on a trace: after each sample, after each copy, at an end."""
    native, python = (EpisodeMonitor(text, backend=b) for b in ("native", "python"))
    most, pace = rng.choice((1, 2, 5)), rng.choice((0.0, 0.5, 0.9))
    row = dict.fromkeys(NAMES, 0.0)
    for _ in range(rng.randint(1, SAMPLES)):
        for name in NAMES:
            if rng.random() >= pace:
                row[name] = rng.choice((-0.0, 0.0, *map(float, range(-most, most + 1))))
        sample = {name: row[name] for name in native.variables}
        assert bits([native.update(sample)]) == bits([python.update(sample)]), text
        assert offered(native) == offered(python), text
        if rng.random() < 0.1:
            native = copy.copy(native)
    end = rng.choice(get_args(End))
    assert bits([native.finish(end)]) == bits([python.finish(end)]), (text, end)
    assert offered(native) == offered(python), (text, end)


@pytest.mark.slow(keep=60)
@pytest.mark.parametrize("seed", range(200))
def test_of_every_operator(seed: int) -> None:
    rng = random.Random(seed)
    compare(rng, f"{rng.choice(ROOTS)} {formula(rng, 3)}")


@pytest.mark.slow(keep=40)
@pytest.mark.parametrize("seed", range(200))
def test_of_responses(seed: int) -> None:
    rng = random.Random(seed)
    compare(rng, response(rng))


@pytest.mark.slow(keep=30)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("text", JOINED)
def test_of_joined_parts(text: str, seed: int) -> None:
    compare(random.Random(seed), text)
