"""`Questions`: how often runs put the implications of specifications to the test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rtamt
from rtamt import Asked, End, Evidence, Implications, Verdict
from rtamt_gym.options.evaluation import AtTermination, Reading

__all__ = ["Questions"]


class Questions:
    """Counts how often runs put specifications to the test, compiled once for many runs.

    It is false if none of them has an implication: then nobody needs to keep samples.

    Args:
        specs: The specifications by name.
        reading: How samples are judged, with their period.

    Example:
        >>> specs = {"answered": rtamt.parse("always(req > 3 implies gnt > 3)")}
        >>> questions = Questions(specs, Reading())
        >>> verdicts = {"answered": rtamt.Verdict.SATISFIED}
        >>> samples = {"req": [0.0, 5.0], "gnt": [0.0, 4.0]}
        >>> found = questions.answers(samples, 2, "cut", verdicts)
        >>> found["answered"].asked[0].occasions
        1
    """

    def __init__(self, specs: Mapping[str, rtamt.Specification], reading: Reading) -> None:
        step = reading.view == "step"  # the verdict is on every instant
        self._of = {
            name: Implications(specs[name].always() if step else specs[name], **options)
            for name, options in reading.of_monitors(specs).items()
        }
        self._any = any(map(bool, self._of.values()))
        self._unasked = {
            name: asked.evidence({}, verdict=Verdict.UNDECIDED)
            for name, asked in self._of.items()
            if not asked
        }

    def __bool__(self) -> bool:
        return self._any

    def answers(
        self,
        samples: Mapping[str, Any],
        n: int | None,
        end: AtTermination | End | None,
        verdicts: Mapping[str, Verdict],
    ) -> Mapping[str, Evidence[Asked]]:
        """What verdicts stand on, for each specification.

        Args:
            samples: The values of every variable, by name; where there is no implication they are
                not read, and there need be none.
            n: The number of samples; None: as many as there are values.
            end: How the end of the run was read; None: it was stopped, and has none.
            verdicts: The verdict on each specification.
        """
        if not self._any:
            return self._unasked
        # Where an end is a failure, the samples are all there is.
        read: End = "complete" if end == "failure" else end or "open"
        return {
            name: self._of[name].evidence(samples, read, verdict, n=n)
            for name, verdict in verdicts.items()
        }
