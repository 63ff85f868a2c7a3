"""The choice among policies of one training: the best evaluation, and a test of a target."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.sequential import MARGIN, RatioTest
from rtamt_gym.learners.metrics import mean_return


class Best:
    """The best of several evaluations.

    It has the largest share of episodes that satisfied all requirements, then the largest mean
    return, then it came first. Compare evaluations of the same episodes only, on the same seeds.

    The best of many looks better than it is, because the choice is partly chance. Report another
    evaluation of it, on seeds that took no part in the choice.

    Attributes:
        evaluation: The best so far; None before the first.
    """

    def __init__(self) -> None:
        self.evaluation: Evaluation | None = None

    def add(self, evaluation: Evaluation) -> bool:
        """Add an evaluation; return whether it is better than all before."""
        better = self.evaluation is None or _score(evaluation) > _score(self.evaluation)
        if better:
            self.evaluation = evaluation
        return better


def _score(evaluation: Evaluation) -> tuple[float, float]:
    returns = mean_return(evaluation)
    return evaluation.success.rate, -math.inf if returns is None else returns


MOST: Final = 1000
"""The maximum number of episodes of a test; without a decision by then, the policy fails."""


class Target:
    """Tests policies one after the other; a training errs with probability ``alpha`` at most.

    Tests of every policy at the level alpha would err more often, because each test is another
    chance. Therefore test number k runs at ``alpha / (k (k + 1))``, and the sum of these is
    ``alpha``, however many tests there are and however similar the policies. Each is a sequential
    ratio test (`RatioTest`) on its own seeds, which took no part in any choice.

    Args:
        target: The required rate.
        alpha: The maximum probability that any policy with the rate ``target - margin`` or less
            passes.
        margin: How far below the target a rate must be refused.
        seed: The first seed of the tests; they use the following ones.

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
        """Test a policy; return the test if it has passed.

        Args:
            play: Plays some episodes with consecutive seeds from a first one, and returns which
                have satisfied all requirements.
        """
        self.tests += 1
        test = self._test(self._alpha / (self.tests * (self.tests + 1)))
        while test.decision is None and test.episodes < MOST:
            played = play(self.seed)
            self.seed += len(played)
            for satisfied in played:
                test.add(satisfied)
        return test if test.decision == self._passed else None
