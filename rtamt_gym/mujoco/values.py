"""The robustness, bounds and verdicts of a `StepMonitor`, for modules that run without MuJoCo."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from rtamt import Verdict
from rtamt_gym.judging.monitor_set import Monitors, MonitorSet

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track


class MonitorSetValues:
    """The values of a monitor set as read-only attributes.

    Attributes:
        monitor_set: The monitors of all specifications.
    """

    monitor_set: MonitorSet
    _live: Track | None = None

    @property
    def shown_live(self) -> bool:
        """Whether a live view shows the samples."""
        return self._live is not None

    @property
    def robustness(self) -> float:
        """The minimum robustness over all specifications if the run ended now.

        It is nan before sample 0. With ``view="step"`` it is the minimum robustness at the newest
        instant with a complete horizon.
        """
        return self.monitor_set.robustness

    @property
    def lower(self) -> float:
        """The lower bound of the robustness."""
        return self.monitor_set.lower

    @property
    def upper(self) -> float:
        """The upper bound of the robustness; negative, -0.0 included: a violation is certain."""
        return self.monitor_set.upper

    @property
    def verdict(self) -> Verdict:
        """The verdict on all specifications together."""
        return min(judge.verdict for _, judge in self.monitor_set.monitors.values())

    @property
    def violated_by(self) -> str | None:
        """The specification that was violated first; None without a violation."""
        return self.monitor_set.violated_by

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None without a violation."""
        return self.monitor_set.violated_at

    @property
    def samples(self) -> int:
        """The number of samples since the reset, including sample 0."""
        return self.monitor_set.samples

    @property
    def period(self) -> Fraction | None:
        """Time between samples, in seconds."""
        return self.monitor_set.period

    @property
    def details(self) -> dict[str, dict[str, Any]]:
        """``{spec: {"robustness", "lower", "upper", "verdict"}}`` of the samples so far."""
        return self.monitor_set.describe()

    @property
    def outcomes(self) -> dict[str, dict[str, Any]]:
        """``{spec: {"robustness", "verdict", "satisfied", "decided_at"}}`` of the samples so far.

        ``decided_at`` is the sample that decided the verdict; it is absent while the verdict is
        open. If only the end decided it, ``ended_at`` is the last sample.
        """
        return self.monitor_set.outcomes()

    @property
    def monitors(self) -> Monitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self.monitor_set.monitors)
