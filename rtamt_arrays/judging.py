"""Requirements on the episodes of many environments, as pure functions of arrays.

`StepJudge` is independent of simulators: from the signals, rewards and ends of a step it computes
the results that a wrapper adds. It calls functions of `rtamt_gym`, so the results are equal.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, get_args

from rtamt import InputError
from rtamt.errors import Argument
from rtamt.typing import Align, End, Period
from rtamt_arrays.monitor_set import (
    ArrayLibrary,
    ArrayMonitorSet,
    MonitorSetState,
    MonitorSetUpdate,
    NamedSample,
)
from rtamt_arrays.operations import Tensor
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.infos import end_info, optional_keys, spec_state, step_info
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.specs import ConstantValue, SpecsLike, load_specs
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions, View
from rtamt_gym.shaping import Mode, Shaping, ShapingNumbers, clip, least, outcome, settle
from rtamt_gym.wrappers.monitoring import Violations, violation_words
from rtamt_gym.wrappers.observing import StateFeatures

_EVALUATION = ("period", "align", "view", "at_termination", "at_truncation")


class RequirementOptions(ShapingNumbers, total=False):
    """The keyword arguments of every wrapper, with the same meaning as in `rtamt_gym.StlReward`.

    ``mode`` is None by default, which does not change the reward. ``details`` adds ``info["stl"]``,
    where verdicts are 1, -1 and 0. ``nan`` is None by default: after a nan in a sample, the
    robustness of its environment is nan until the reset. With ``"hold"`` the variable keeps its
    last value, except at a reset.
    """

    period: Period | None
    align: Align | None
    constants: Mapping[str, ConstantValue] | None
    on_violation: Violations
    at_termination: AtTermination
    at_truncation: End
    view: View
    nan: Literal["hold"] | None
    cost: Cost | None
    details: bool
    observe: Literal["state"] | None
    mode: Mode | None


class RequirementState(NamedTuple):
    """The state of a `StepJudge`; environments are the last axis of its arrays.

    Attributes:
        monitors: The state of the monitors.
        potential: The potential of the shaping, which the next step is compared with.
        outcome: 1 if all specifications are certainly satisfied, -1 if one is violated; otherwise,
            0.
        violated_at: The sample that showed the first violation; -1 before a violation.
        samples: The number of samples since the reset.
    """

    monitors: MonitorSetState
    potential: Tensor
    outcome: Tensor
    violated_at: Tensor
    samples: Tensor


class JudgedStep(NamedTuple):
    """The results of a step of the environments.

    Attributes:
        reward: The shaped reward.
        terminated: Where an episode is terminated, by the environment or by a violation.
        truncated: Where an episode is truncated.
        info: The keys for the info.
        features: The state of the monitors for observations, of shape (environments, features).
    """

    reward: Tensor
    terminated: Tensor
    truncated: Tensor
    info: dict[str, Any]
    features: Tensor


class _Optional(NamedTuple):
    """The attributes of a monitor set that optional keys of infos need; see `step_info`."""

    of_instant: Any

    @property
    def optional_keys(self) -> tuple[tuple[str, str], ...]:
        return optional_keys(self)


class StepJudge:
    """The requirements of an environment.

    Args:
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        library: The array library.
        options: See `RequirementOptions`.

    Attributes:
        names: The names of the specifications.
        variables: The variables of all specifications.
        features: The features of ``observe="state"``.
        observes: Whether the observation has these features.

    Raises:
        SpecificationError: As the monitors of `rtamt_gym` do.
        InputError: If an option has an unknown value.
    """

    def __init__(
        self, specs: SpecsLike, library: ArrayLibrary, options: RequirementOptions
    ) -> None:
        remainder: dict[str, Any] = {**options}
        evaluation = EvaluationOptions(
            **{n: remainder.pop(n) for n in _EVALUATION if n in remainder}
        )
        loaded = load_specs(specs, constants=remainder.pop("constants", None))
        for name, spec in loaded.items():
            if spec.timed and evaluation.period is None:
                raise InputError(
                    f"Specification {name!r} has bounds, and the duration of a step is unknown. "
                    "Pass ",
                    Argument("period", 0.02),
                    " in seconds, or ",
                    Argument("period", 1),
                    " for bounds in steps.",
                )
        self._o = library.operations
        self.names = list(loaded)
        self.variables = tuple(dict.fromkeys(v for s in loaded.values() for v in s.variables))
        self._on_violation = violation_words(remainder.pop("on_violation", "terminate"), loaded)
        cost = remainder.pop("cost", None)
        check_choice("cost", cost, (None, *get_args(Cost)))
        nan = remainder.pop("nan", None)
        check_choice("nan", nan, (None, "hold"))
        hold = self.variables if nan == "hold" else ()
        self._monitors = ArrayMonitorSet(loaded, evaluation, cost, hold, library)
        self._by_step = evaluation.view == "step"
        self._details = remainder.pop("details", False)
        observe = remainder.pop("observe", None)
        check_choice("observe", observe, (None, "state"))
        self.observes = observe is not None
        self._shapes = remainder.get("mode") is not None
        self._shaping = Shaping.of(
            list(loaded), **remainder if self._shapes else {**remainder, "mode": "add"}
        )
        self.features = StateFeatures(
            self._shaping.weights,
            self._shaping.clip,
            self._monitors.latencies,
            whole_episode=self._shaping.pays_episode,
        )

    @property
    def keys(self) -> frozenset[str]:
        """The keys of the infos."""
        own = {"reward": 0} if self._shapes else {}
        states: Any = {} if self._details else None
        optional = _Optional(self._by_step or None)
        info = step_info(own, 0, 0, 0, 0, optional, states=states) | end_info(0, 0, 0, 0)
        return frozenset(info) | self._monitors.cost_keys

    @property
    def metric_keys(self) -> frozenset[str]:
        """The keys of `metrics`."""
        return frozenset({"robustness", "is_success"}) | self._monitors.cost_keys

    def init(self, count: int) -> RequirementState:
        """Return the state of ``count`` environments before their first sample."""
        monitors = self._monitors.init(count)
        zero = self._o.full((count,), 0.0, monitors.judges[0].rows.dtype)
        age = monitors.judges[0].age
        return RequirementState(monitors, zero, zero, age - 1, age)

    def reset(self, state: RequirementState, mask: Tensor) -> RequirementState:
        """Return the state in which the masked environments have no samples.

        Unlike `begin` it takes no sample; the next `step` takes the first sample.
        """
        o = self._o
        return RequirementState(
            self._monitors.reset(state.monitors, mask),
            o.where(mask, 0.0, state.potential),
            o.where(mask, 0.0, state.outcome),
            o.where(mask, -1, state.violated_at),
            o.where(mask, 0, state.samples),
        )

    def begin(
        self, state: RequirementState, sample: Mapping[str, Tensor | float], mask: Tensor
    ) -> tuple[RequirementState, JudgedStep]:
        """Start episodes: the masked environments take their first sample.

        Args:
            state: The state that `init`, `begin` or `step` returned.
            sample: For each variable an array of shape (environments,), or one number for all.
            mask: A boolean for each environment.

        Returns:
            The next state, and the result of the reset in the masked environments.
        """
        o, shape, dtype = self._o, tuple(mask.shape), state.potential.dtype
        arrays = {
            name: o.full(shape, value, dtype) if isinstance(value, float) else value
            for name, value in sample.items()
        }
        update, never = self._monitors.begin(state.monitors, arrays, mask), mask & ~mask
        samples = o.where(mask, state.samples * 0 + 1, state.samples)
        values = self._monitors.values(update, samples, never, never)
        violated = o.signbit(least(values.upper))
        zero = o.full(shape, 0.0, dtype)
        first = o.as_integers(violated) - 1  # sample 0 if it is violated, otherwise -1
        following = RequirementState(
            update.state,
            o.where(mask, self._potential(values), state.potential),
            o.where(mask, zero, state.outcome),
            o.where(mask, first, state.violated_at),
            samples,
        )
        costs = self._monitors.no_costs(values)
        info = self._info(values, violated, following.violated_at, never, zero, costs)
        return following, JudgedStep(zero, never, never, info, self._features(values))

    def step(
        self,
        state: RequirementState,
        sample: NamedSample,
        reward: Tensor,
        terminated: Tensor,
        truncated: Tensor,
    ) -> tuple[RequirementState, JudgedStep]:
        """Judge a step in every environment.

        Args:
            state: The state that `begin` or `step` returned.
            sample: An array of shape (environments,) for each variable. Where an episode ended, it
                is the sample of its last state, not of the state after the reset.
            reward: The environment's own reward.
            terminated: Where the environment has terminated the episode, as booleans.
            truncated: Where a time limit has ended the episode; a termination takes precedence.
        """
        return self.conclude(state, self.update(state, sample), reward, terminated, truncated)

    def update(self, state: RequirementState, sample: NamedSample) -> MonitorSetUpdate:
        """Take a sample in every environment, the part of `step` before the ends are known."""
        return self._monitors.update(state.monitors, sample, state.samples)

    def violated(self, update: MonitorSetUpdate) -> Tensor:
        """Return where a specification is certainly violated."""
        return self._o.signbit(least([reading.upper for reading in update.readings]))

    def conclude(
        self,
        state: RequirementState,
        update: MonitorSetUpdate,
        reward: Tensor,
        terminated: Tensor,
        truncated: Tensor,
    ) -> tuple[RequirementState, JudgedStep]:
        """Return the result of `step` after `update` of the same state."""
        o, samples = self._o, state.samples + 1
        values = self._monitors.values(update, samples, terminated, truncated)
        monitors, costs = self._monitors.charge(update, values)
        violated = o.signbit(least(values.upper))
        violated_at = o.where(violated & (state.violated_at < 0), state.samples, state.violated_at)
        for action in ("terminate", "truncate"):
            words = zip(update.readings, self._on_violation.values(), strict=True)
            uppers = [reading.upper for reading, word in words if word == action]
            if uppers and action == "terminate":
                terminated = terminated | o.signbit(least(uppers))
            elif uppers:
                truncated = truncated | (o.signbit(least(uppers)) & ~terminated)
        over = terminated | truncated
        potential = self._potential(values)
        settled = outcome(least(values.lower), least(values.upper))
        following = RequirementState(monitors, potential, settled, violated_at, samples)
        shaped = reward
        if self._shapes:
            zero, shaping = potential * 0.0, self._shaping
            ends = (o.where(end, zero + 1.0, zero) for end in (terminated, over))
            shaped = shaping.reward(reward, state.potential, potential, *ends)
            if shaping.settles:
                shaped = shaped + settle(state.outcome, settled, shaping.bonus, shaping.penalty)
        info = self._info(values, violated, violated_at, over, reward, costs)
        return following, JudgedStep(shaped, terminated, truncated, info, self._features(values))

    def metrics(self, judged: JudgedStep) -> dict[str, Tensor]:
        """Return numbers to sum over an episode: verdicts of the last step, costs of every step."""
        o, over = self._o, judged.terminated | judged.truncated
        robustness = clip(judged.info["robustness"], self._shaping.clip)
        zero = robustness * 0.0
        success = o.where(judged.info["is_success"], zero + 1.0, zero)
        costs = {key: judged.info[key] for key in self._monitors.cost_keys}
        return {"robustness": o.where(over, robustness, zero), "is_success": success, **costs}

    def _potential(self, values: MonitorValues[Any]) -> Tensor:
        if self._shaping.pays_bounds:
            return self._shaping.middle(values.lower, values.upper)
        paying = values.judged if self._shaping.pays_episode else values.robustness
        return self._shaping.robustness(paying)

    def _features(self, values: MonitorValues[Any]) -> Tensor:
        return self._o.stack(self.features.rows(values)).swapaxes(0, 1)

    def _info(
        self,
        values: MonitorValues[Any],
        violated: Tensor,
        violated_at: Tensor,
        over: Tensor,
        reward: Tensor,
        costs: Mapping[str, Tensor],
    ) -> dict[str, Any]:
        success, undecided = over, over & ~over
        for verdict in values.verdicts:
            success = success & (verdict > 0)
            undecided = undecided | (over & (verdict == 0))
        of_instant = over | ~over if self._by_step else None
        columns = (values.robustness, values.lower, values.upper, values.verdicts)
        states = {
            name: spec_state(*row, of_instant)
            for name, row in zip(self.names, zip(*columns, strict=True), strict=True)
        }
        return step_info(
            {"reward": reward} if self._shapes else {},
            least(values.robustness),
            least(values.lower),
            least(values.upper),
            violated,
            _Optional(of_instant),
            states=states if self._details else None,
            costs=costs,
        ) | end_info(violated_at, success, undecided, success)
