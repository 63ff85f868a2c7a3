"""Formulas, traces and resets for the machines on arrays, compared bit by bit.

A compiler takes a second per formula, so each example compiles several formulas at once.
"""

from __future__ import annotations

import copy
from typing import NamedTuple, cast

import numpy as np
import strategies as s
from hypothesis import Phase, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rtamt import Formula, VectorEpisodeMonitor, VectorMonitor, evaluate
from rtamt.errors import SpecificationError
from rtamt.language.formula import make
from rtamt.language.node import Node
from rtamt_arrays.operations import Tensor

Floats = NDArray[np.float64]

BATCH = 8
ENTRIES = 3
SAMPLES = 14

ROUNDED = {"exp", "ln", "log", "pow"}
"""Functions that libraries round differently."""

# 200 formulas, and 2,000 with --hypothesis-profile=nightly.
# Every smaller example would be compiled again.
few = settings(
    max_examples=min(250, settings().max_examples // 2),
    phases=[phase for phase in Phase if phase is not Phase.shrink],
)


class Case(NamedTuple):
    """Formulas, and samples and resets of entries."""

    formulas: list[Formula]
    samples: Floats
    resets: NDArray[np.bool_]

    def online(self, formula: Formula) -> Floats:
        """Return the robustness of `rtamt.VectorMonitor`, a row for each sample."""
        monitor = VectorMonitor(formula, ENTRIES)
        places = [s.VARIABLES.index(name) for name in monitor.variables]
        rows = []
        for sample, mask in zip(self.samples, self.resets, strict=True):
            monitor.reset(mask)
            rows.append(monitor.update(sample[:, places]))
        return np.array(rows)

    def episode(
        self, formula: Formula, names: tuple[str, ...], *, cut: bool = False
    ) -> list[Floats]:
        """Return attributes of `rtamt.VectorEpisodeMonitor`, each with a row for each sample.

        With ``cut`` they belong to traces that are cut after each sample.
        """
        monitor = VectorEpisodeMonitor(formula, ENTRIES)
        places = [s.VARIABLES.index(name) for name in monitor.variables]
        rows: list[list[Floats]] = [[] for _ in names]
        for sample, mask in zip(self.samples, self.resets, strict=True):
            monitor.reset(mask)
            monitor.update(sample[:, places])
            shown = copy.deepcopy(monitor) if cut else monitor
            if cut:
                shown.finish(end="cut")
            for name, values in zip(names, rows, strict=True):
                values.append(getattr(shown, name))
        return [np.array(values) for values in rows]

    def offline(self, formula: Formula) -> Floats:
        """Return the values of `rtamt.evaluate`, a row for each entry."""
        signals = columns(formula, self.samples)
        return np.array(
            [
                evaluate(formula, {name: values[entry] for name, values in signals.items()})
                for entry in range(ENTRIES)
            ]
        )


def columns(formula: Node, samples: Tensor) -> dict[str, Tensor]:
    """Return the signals of a formula as one array of shape (entries, samples)."""
    return {name: samples[:, :, s.VARIABLES.index(name)].T for name in formula.variables}


def exactly_rounded(formula: Node) -> bool:
    """Return whether all libraries round the functions of a formula equally."""
    names = {formula.op.name} if formula.op else set()
    return not names & ROUNDED and all(map(exactly_rounded, formula.args))


@st.composite
def cases(draw: s.Draw, *, endless: bool = False, outermost: bool = True) -> Case:
    """Return formulas with variables, and samples with many zeros of either sign.

    Args:
        draw: The function of hypothesis.
        endless: Whether windows of the future may be unbounded.
        outermost: Whether a formula may be an outermost ``always``, which covers all samples so far
            in monitors and all later ones in offline evaluation.
    """
    usable = s.formulas(3, endless=endless).filter(
        lambda f: f.variables and exactly_rounded(f) and _fits(f)
    )
    formulas = [draw(usable) for _ in range(BATCH)]
    if outermost and draw(st.booleans()) and not endless:
        formulas[0] = _outermost(formulas[0])
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    values = draw(st.sampled_from([s.QUARTERS, s.INTEGERS]))
    samples = random.choice(np.array(values), (SAMPLES, ENTRIES, len(s.VARIABLES)))
    resets = random.random((SAMPLES, ENTRIES)) < 0.1
    return Case(formulas, samples, resets)


def _fits(formula: Formula) -> bool:
    """Return whether the nesting of unbounded operators is within the limit of episodes."""
    try:
        VectorEpisodeMonitor(formula, ENTRIES)
    except SpecificationError:
        return False
    return True


def _outermost(formula: Formula) -> Formula:
    return cast("Formula", make("always", (formula,), None))
