"""Chooses the best of several evaluations: by satisfaction, among equals by return."""

from __future__ import annotations

import math

from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.learners.metrics import mean_return

__all__ = ["Best"]


class Best:
    """Keeps the best of the evaluations that it is shown.

    The best is the one with the greatest share of episodes that satisfied all requirements; of
    equal shares the one with the greatest mean return, and of equal returns the first. Compare
    evaluations of the same episodes only, on the same seeds.

    The best of many looks better than it is, for chance took part in the choice: what is reported
    comes from another evaluation of it, on seeds that no choice has seen.

    Attributes:
        evaluation: The best so far; None before the first.
    """

    def __init__(self) -> None:
        self.evaluation: Evaluation | None = None

    def add(self, evaluation: Evaluation) -> bool:
        """Whether an evaluation is better than all before; the best is kept then."""
        better = self.evaluation is None or _score(evaluation) > _score(self.evaluation)
        if better:
            self.evaluation = evaluation
        return better


def _score(evaluation: Evaluation) -> tuple[float, float]:
    found = mean_return(evaluation)
    return evaluation.success.rate, -math.inf if found is None else found
