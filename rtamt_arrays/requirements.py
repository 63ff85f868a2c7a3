"""Episodes of many environments under requirements, as pure functions of arrays.

`StepJudge` knows no simulator: it takes the signals, the rewards and the ends of a step, and
gives what a wrapper adds to it: the keys of infos, the shaped reward, the ends, and numbers for the
observation. Every one of these is that of `rtamt_gym`, by the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol, get_args

from rtamt import Align, End, InputError, Period, Specification
from rtamt.errors import Argument
from rtamt.program.instructions import Window
from rtamt.program.program import Program
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.worlds import BoundsReading, EpisodeState
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.judging.constants import ConstantValue
from rtamt_gym.judging.ends import AtTermination
from rtamt_gym.judging.infos import end_info, spec_state, step_info
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.shaping import Mode, Shaping, ShapingNumbers, clip, least, outcome, settle
from rtamt_gym.wrappers.features import StateFeatures

__all__ = [
    "JudgedStep",
    "OnViolation",
    "RequirementOptions",
    "RequirementState",
    "StepJudge",
    "Taken",
]

OnViolation = Literal["terminate", "truncate", "report"]
"""What happens to an episode at a certain violation."""


class RequirementOptions(ShapingNumbers, total=False):
    """The keyword arguments of every wrapper; each means what it means in `rtamt_gym.StlReward`.

    ``mode`` is None by default: the reward stays. ``details`` adds ``info["stl"]``, where verdicts
    are 1, -1 and 0.
    """

    period: Period | None
    align: Align | None
    constants: Mapping[str, ConstantValue] | None
    on_violation: OnViolation
    at_termination: AtTermination
    at_truncation: End
    details: bool
    observe: Literal["state"] | None
    mode: Mode | None


class RequirementState(NamedTuple):
    """What is known of the episodes; its arrays have the lanes as their last axis.

    Attributes:
        monitors: The state of the monitor of each specification.
        potential: What the shaping compares the next step with.
        outcome: What has been settled: 1 satisfied, -1 violated, 0 neither.
        violated_at: The sample that showed the first violation; -1 where there is none.
        samples: Samples since the reset.
    """

    monitors: tuple[EpisodeState, ...]
    potential: Tensor
    outcome: Tensor
    violated_at: Tensor
    samples: Tensor


class Taken(NamedTuple):
    """A sample that was taken in.

    Attributes:
        monitors: The state of each monitor after it.
        readings: The reading of each specification.
        cut: The same if the trace is cut there.
    """

    monitors: tuple[EpisodeState, ...]
    readings: tuple[BoundsReading, ...]
    cut: tuple[BoundsReading, ...]


class JudgedStep(NamedTuple):
    """What a step of the environments is with the requirements.

    Attributes:
        reward: The shaped reward.
        terminated: Where an episode is terminated, by the environment or by a violation.
        truncated: Where it is truncated.
        info: The keys for the info.
        features: The monitors' state for the observation, of shape (lanes, features).
    """

    reward: Tensor
    terminated: Tensor
    truncated: Tensor
    info: dict[str, Any]
    features: Tensor


class MakesEpisodes(Protocol):
    """The function ``episode`` of an array library."""

    def __call__(
        self, spec: Specification, period: Period | None, *, align: Align | None
    ) -> EpisodeArrays:
        """The monitor of a specification."""


class StepJudge:
    """The requirements of an environment.

    Args:
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        episode: Makes the monitor of one.
        operations: The operations of the array library.
        options: See `RequirementOptions`.

    Attributes:
        variables: The variables of all specifications.
        features: What ``observe="state"`` shows.
        observes: Whether it is to be shown.

    Raises:
        SpecificationError: As the monitors do.
        InputError: If an option is none of its choices.
    """

    def __init__(
        self,
        specs: SpecsLike,
        episode: MakesEpisodes,
        operations: Operations,
        options: RequirementOptions,
    ) -> None:
        given: dict[str, Any] = {**options}
        period, align = given.pop("period", None), given.pop("align", None)
        loaded = load_specs(specs, constants=given.pop("constants", None))
        for name, spec in loaded.items():
            if spec.timed and period is None:
                raise InputError(
                    f"specification {name!r} has bounds, and the environment does not say how "
                    "long a step takes; pass ",
                    Argument("period", 0.02),
                    " in seconds, or ",
                    Argument("period", 1),
                    " for bounds in steps",
                )
        self._o = operations
        self._monitors = {name: episode(s, period, align=align) for name, s in loaded.items()}
        programs = {name: monitor.program for name, monitor in self._monitors.items()}
        self.variables = tuple(dict.fromkeys(v for s in loaded.values() for v in s.variables))
        self._on_violation = given.pop("on_violation", "terminate")
        check_choice("on_violation", self._on_violation, get_args(OnViolation))
        self._at_termination = given.pop("at_termination", "complete")
        check_choice("at_termination", self._at_termination, get_args(AtTermination))
        self._at_truncation = given.pop("at_truncation", "cut")
        check_choice("at_truncation", self._at_truncation, get_args(End))
        cuts = "cut" in {self._at_termination, self._at_truncation}
        self._cuts = [cuts and _cut_by_an_end(program) for program in programs.values()]
        self._details = given.pop("details", False)
        observe = given.pop("observe", None)
        check_choice("observe", observe, (None, "state"))
        self.observes = observe is not None
        self._shapes = given.get("mode") is not None
        self._optional = {"stl": self._details, "reward": self._shapes}
        shown = given if self._shapes else {**given, "mode": "add"}
        self._shaping = Shaping.of(list(loaded), **shown)
        self.features = StateFeatures(
            self._shaping.weights,
            self._shaping.clip,
            tuple(program.latency for program in programs.values()),
        )

    @property
    def names(self) -> list[str]:
        """The names of the specifications."""
        return list(self._monitors)

    @property
    def keys(self) -> frozenset[str]:
        """The keys of the infos."""
        blank: dict[str, Any] = {**step_info({}, 0, 0, 0, 0), **end_info(0, 0, 0, 0)}
        added = [name for name, is_there in self._optional.items() if is_there]
        return frozenset([*blank, *added])

    metric_keys = frozenset({"robustness", "is_success"})
    """The keys of `metrics`."""

    def init(self, lanes: int) -> RequirementState:
        """The state before the first sample; `begin` is to take that in every lane."""
        o, monitors = self._o, tuple(each.init(lanes) for each in self._monitors.values())
        zero = o.full((lanes,), 0.0, monitors[0].kept.dtype)
        count = monitors[0].age
        return RequirementState(monitors, zero, zero, count - 1, count)

    def begin(
        self, state: RequirementState, sample: Mapping[str, Tensor | float], mask: Tensor
    ) -> tuple[RequirementState, JudgedStep]:
        """Begins episodes: the lanes of the mask forget theirs and take their first sample.

        Args:
            state: What `init`, `begin` or `step` gave.
            sample: For each variable an array of shape (lanes,), or a number for all.
            mask: A boolean for each lane.

        Returns:
            The next state, and what a reset is with the requirements, in the lanes of the mask.
        """
        o, lanes = self._o, tuple(mask.shape)
        given = {
            name: o.full(lanes, value, state.potential.dtype) if isinstance(value, float) else value
            for name, value in sample.items()
        }
        pairs = zip(self._all, state.monitors, strict=True)
        begun, readings, _ = self._taken(
            [monitor.reset(each, mask) for monitor, each in pairs], given, [False] * len(self._all)
        )
        samples = o.where(mask, state.samples * 0 + 1, state.samples)
        values = _values(readings, samples)
        violated = self._violated(values)
        zero = state.potential * 0.0
        fresh = RequirementState(
            begun,
            self._potential(values),
            zero,
            o.as_integers(violated) - 1,  # sample 0, where it is violated
            samples,
        )
        never = mask & ~mask
        judged = JudgedStep(
            zero,
            never,
            never,
            self._info(values, violated, fresh.violated_at, never, zero),
            self._shown(values),
        )
        return _where(o, mask, fresh, state), judged

    def step(
        self,
        state: RequirementState,
        sample: Mapping[str, Tensor],
        reward: Tensor,
        terminated: Tensor,
        truncated: Tensor,
    ) -> tuple[RequirementState, JudgedStep]:
        """Judges a step in every lane.

        Args:
            state: What `begin` or `step` gave.
            sample: An array of shape (lanes,) for each variable: of the state in which an episode
                ended, where one did, not of that which it was reset to.
            reward: The environment's own reward.
            terminated: Where the environment has terminated the episode, as booleans.
            truncated: Where a limit of time has; a termination counts before it.
        """
        return self.conclude(state, self.take(state, sample), reward, terminated, truncated)

    def take(self, state: RequirementState, sample: Mapping[str, Tensor]) -> Taken:
        """Take in a sample in every lane: the part of `step` that asks for no ends."""
        return self._taken(state.monitors, sample, self._cuts)

    def violated(self, taken: Taken) -> Tensor:
        """Where a specification is certainly violated, however the episode goes on."""
        return self._o.signbit(least([reading.upper for reading in taken.readings]))

    def conclude(
        self,
        state: RequirementState,
        taken: Taken,
        reward: Tensor,
        terminated: Tensor,
        truncated: Tensor,
    ) -> tuple[RequirementState, JudgedStep]:
        """The rest of `step`, after `take` of the same state; the arguments are those of `step`."""
        o, ended, certain = self._o, terminated | truncated, self.violated(taken)
        pairs = zip(taken.readings, taken.cut, strict=True)
        found = [self._at_end(*each, terminated, ended) for each in pairs]
        values = _values(found, state.samples + 1)
        violated = self._violated(values)
        violated_at = o.where(violated & (state.violated_at < 0), state.samples, state.violated_at)
        if self._on_violation == "terminate":
            terminated = terminated | certain
        elif self._on_violation == "truncate":
            truncated = truncated | certain
        over = terminated | truncated
        potential = self._potential(values)
        settled = outcome(least(values.lower), least(values.upper))
        following = RequirementState(
            taken.monitors, potential, settled, violated_at, state.samples + 1
        )
        shaped = reward
        if self._shapes:
            one, zero = potential * 0.0 + 1.0, potential * 0.0
            shaping = self._shaping
            shaped = shaping.reward(
                reward,
                state.potential,
                potential,
                o.where(terminated, one, zero),
                o.where(over, one, zero),
            )
            if shaping.settles:
                shaped = shaped + settle(state.outcome, settled, shaping.bonus, shaping.penalty)
        return following, JudgedStep(
            shaped,
            terminated,
            truncated,
            self._info(values, violated, violated_at, over, reward),
            self._shown(values),
        )

    def metrics(self, judged: JudgedStep) -> dict[str, Tensor]:
        """Numbers that are summed over an episode: those of its last step, and 0 before it."""
        o, over = self._o, judged.terminated | judged.truncated
        robustness = clip(judged.info["robustness"], self._shaping.clip)
        zero = robustness * 0.0
        success = o.where(judged.info["is_success"], zero + 1.0, zero)
        return {"robustness": o.where(over, robustness, zero), "is_success": success}

    @property
    def _all(self) -> Sequence[EpisodeArrays]:
        return tuple(self._monitors.values())

    def _taken(
        self, states: Sequence[EpisodeState], sample: Mapping[str, Tensor], cuts: Sequence[bool]
    ) -> Taken:
        found = []
        for monitor, state, cut in zip(self._all, states, cuts, strict=True):
            if cut:
                found.append(monitor.update_and_cut(state, sample))
            else:
                following, reading = monitor.update(state, sample)
                found.append((following, reading, self._complete(reading)))
        return Taken(*zip(*found, strict=True))

    def _at_end(
        self, reading: BoundsReading, cut: BoundsReading, terminated: Tensor, ended: Tensor
    ) -> BoundsReading:
        """The reading where the environment has ended an episode, read as the options say."""
        found = reading
        for lanes, end in (
            (terminated, self._at_termination),
            (ended & ~terminated, self._at_truncation),
        ):
            if end in {"complete", "cut"}:
                closed = self._complete(reading) if end == "complete" else cut
                found = _where(self._o, lanes, closed, found)
            elif end == "failure":
                failed = lanes & (reading.verdict == 0)
                upper = self._o.where(failed, -0.0, found.upper)
                verdict = self._o.where(failed, found.verdict * 0 - 1, found.verdict)
                found = found._replace(upper=upper, verdict=verdict)
        return found

    def _complete(self, reading: BoundsReading) -> BoundsReading:
        """The reading if the trace is all there is; of a nan it stays open."""
        o, known = self._o, ~reading.nan
        sign = 1 - 2 * o.as_integers(o.signbit(reading.robustness))
        return reading._replace(
            lower=o.where(known, reading.robustness, reading.lower),
            upper=o.where(known, reading.robustness, reading.upper),
            verdict=o.where(known, sign, reading.verdict),
        )

    def _violated(self, values: MonitorValues[Any]) -> Tensor:
        return self._o.signbit(least(values.upper))

    def _potential(self, values: MonitorValues[Any]) -> Tensor:
        if self._shaping.mode == "progress":
            return self._shaping.middle(values.lower, values.upper)
        return self._shaping.robustness(values.robustness)

    def _shown(self, values: MonitorValues[Any]) -> Tensor:
        return self._o.stack(self.features.rows(values)).swapaxes(0, 1)

    def _info(
        self,
        values: MonitorValues[Any],
        violated: Tensor,
        violated_at: Tensor,
        over: Tensor,
        reward: Tensor,
    ) -> dict[str, Any]:
        success, undecided = over, over & ~over
        for verdict in values.verdicts:
            success = success & (verdict > 0)
            undecided = undecided | (over & (verdict == 0))
        columns = (values.robustness, values.lower, values.upper, values.verdicts)
        states = {
            name: spec_state(*each) for name, *each in zip(self._monitors, *columns, strict=True)
        }
        own = {"reward": reward} if self._shapes else {}
        return step_info(
            own,
            least(values.robustness),
            least(values.lower),
            least(values.upper),
            violated,
            states if self._details else None,
        ) | end_info(violated_at, success, undecided, success)


def _values(readings: Sequence[BoundsReading], samples: Tensor) -> MonitorValues[Any]:
    robustness = [each.robustness for each in readings]
    return MonitorValues(
        robustness,
        robustness,
        [each.lower for each in readings],
        [each.upper for each in readings],
        [each.verdict for each in readings],
        samples,
    )


def _where(o: Operations, mask: Tensor, new: Any, old: Any) -> Any:  # noqa: ANN401 - parts of states
    """The new state in the lanes of the mask, and the old one in the others."""
    if not isinstance(new, tuple):
        return o.where(mask, new, old)
    parts = [_where(o, mask, x, y) for x, y in zip(new, old, strict=True)]
    make: Callable[..., Any] = getattr(type(new), "_make", tuple)
    return make(parts)


def _cut_by_an_end(program: Program) -> bool:
    """Whether a window can reach past an end, so that a cut trace is not read as a complete one."""
    windows = [each for each in program.instructions if isinstance(each, Window)]
    return any(each.lo != 0 if each.hi is None else each.hi > 0 for each in windows)
