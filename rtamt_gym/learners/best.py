"""Chooses the best of several evaluations: by satisfaction, among equals by return.

`Target`: whether a policy that learns meets a target, asked again and again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.sequential import MARGIN, RatioTest
from rtamt_gym.learners.metrics import mean_return


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


MOST: Final = 1000
"""The most episodes of a test; without an answer until then the policy has not passed."""


class Target:
    """Tests policies one after the other, and errs but once in ``1 / alpha`` trainings.

    Whoever tests every policy of a training at the level alpha errs more often than alpha says, for
    each test is one more chance. So test number k runs at ``alpha / (k (k + 1))``; these sum up to
    ``alpha``, however many tests there are and however alike the policies. Each is a sequential
    ratio test (`RatioTest`) on episodes that nothing has been chosen by: on seeds of its own.

    Args:
        target: The rate to be met.
        alpha: The greatest chance that any policy ever passes whose rate is ``target - margin`` or
            less.
        margin: How far below the target a rate must be refused.
        seed: The first seed of the tests; they use those that follow.

    Attributes:
        tests: The number of tests so far.
        seed: The next seed.

    Raises:
        InputError: As `RatioTest` does.

    Example:
        >>> target = Target(0.9, seed=500)
        >>> test = target.met_by(lambda seed: [True] * 20)
        >>> test.decision, test.episodes, target.seed
        ('meets 0.9', 65, 580)
    """

    def __init__(
        self, target: float, alpha: float = 0.05, margin: float = MARGIN, *, seed: int
    ) -> None:
        self._test = partial(RatioTest, target, margin=margin)
        self._passed = f"meets {target:g}"
        self._alpha = alpha
        self._test(alpha)  # refuses numbers out of their ranges
        self.tests = 0
        self.seed = seed

    def met_by(self, play: Callable[[int], Sequence[bool]]) -> RatioTest | None:
        """Tests a policy; returns the test if it has passed.

        Args:
            play: Plays some episodes from a seed on, each with a seed that is one more, and returns
                which have satisfied all requirements.
        """
        self.tests += 1
        test = self._test(self._alpha / (self.tests * (self.tests + 1)))
        while test.decision is None and test.episodes < MOST:
            played = play(self.seed)
            self.seed += len(played)
            for satisfied in played:
                test.add(satisfied)
        return test if test.decision == self._passed else None
