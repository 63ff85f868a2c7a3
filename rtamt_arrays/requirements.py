"""Episodes of many environments under requirements, as pure functions of arrays.

`StepJudge` knows no simulator: it takes the signals, the rewards and the ends of a step, and
gives what a wrapper adds to it: the keys of infos, the shaped reward, the ends, and numbers for the
observation. Every one of these is that of `rtamt_gym`, by the same functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, get_args

from rtamt import InputError
from rtamt.errors import Argument
from rtamt.typing import Align, End, Period
from rtamt_arrays.monitor_set import ArrayMonitors, ArrayPanel, PanelState, Taken
from rtamt_arrays.operations import Operations, Tensor
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.infos import end_info, optional_keys, spec_state, step_info
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.specs import ConstantValue, SpecsLike, load_specs
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions, View
from rtamt_gym.shaping import Mode, Shaping, ShapingNumbers, clip, least, outcome, settle
from rtamt_gym.wrappers.observing import StateFeatures

OnViolation = Literal["terminate", "truncate", "report"]
"""What happens to an episode at a certain violation."""


_READ = ("period", "align", "view", "at_termination", "at_truncation")
"""The options that say how samples are judged."""


class RequirementOptions(ShapingNumbers, total=False):
    """The keyword arguments of every wrapper; each means what it means in `rtamt_gym.StlReward`.

    ``mode`` is None by default: the reward stays. ``details`` adds ``info["stl"]``, where verdicts
    are 1, -1 and 0. ``nan`` is None by default: a nan in a sample makes the robustness of its lane
    nan until the reset. With ``"hold"`` the variable keeps its last value, except at a reset.
    """

    period: Period | None
    align: Align | None
    constants: Mapping[str, ConstantValue] | None
    on_violation: OnViolation
    at_termination: AtTermination
    at_truncation: End
    view: View
    nan: Literal["hold"] | None
    cost: Cost | None
    details: bool
    observe: Literal["state"] | None
    mode: Mode | None


class RequirementState(NamedTuple):
    """What is known of the episodes; its arrays have the lanes as their last axis.

    Attributes:
        panel: What the monitors know.
        potential: What the shaping compares the next step with.
        outcome: What has been settled: 1 satisfied, -1 violated, 0 neither.
        violated_at: The sample that showed the first violation; -1 where there is none.
        samples: Samples since the reset.
    """

    panel: PanelState
    potential: Tensor
    outcome: Tensor
    violated_at: Tensor
    samples: Tensor


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
        monitors: Makes the monitors of one.
        operations: The operations of the array library.
        options: See `RequirementOptions`.

    Attributes:
        names: The names of the specifications.
        variables: The variables of all specifications.
        features: What ``observe="state"`` shows.
        observes: Whether it is to be shown.

    Raises:
        SpecificationError: As the monitors of `rtamt_gym` do.
        InputError: If an option is none of its choices.
    """

    def __init__(
        self,
        specs: SpecsLike,
        monitors: ArrayMonitors,
        operations: Operations,
        options: RequirementOptions,
    ) -> None:
        given: dict[str, Any] = {**options}
        read = [name for name in _READ if name in given]
        reading = EvaluationOptions(**{name: given.pop(name) for name in read})
        loaded = load_specs(specs, constants=given.pop("constants", None))
        for name, spec in loaded.items():
            if spec.timed and reading.period is None:
                raise InputError(
                    f"specification {name!r} has bounds, and the environment does not say how "
                    "long a step takes; pass ",
                    Argument("period", 0.02),
                    " in seconds, or ",
                    Argument("period", 1),
                    " for bounds in steps",
                )
        self._o = operations
        self.names = list(loaded)
        self.variables = tuple(dict.fromkeys(v for s in loaded.values() for v in s.variables))
        self._on_violation = given.pop("on_violation", "terminate")
        check_choice("on_violation", self._on_violation, get_args(OnViolation))
        cost = given.pop("cost", None)
        check_choice("cost", cost, (None, *get_args(Cost)))
        nan = given.pop("nan", None)
        check_choice("nan", nan, (None, "hold"))
        held = self.variables if nan == "hold" else ()
        self._panel = ArrayPanel(loaded, reading, cost, held, monitors, operations)
        self._of_instants = reading.view == "step"
        self._details = given.pop("details", False)
        observe = given.pop("observe", None)
        check_choice("observe", observe, (None, "state"))
        self.observes = observe is not None
        self._shapes = given.get("mode") is not None
        shown = given if self._shapes else {**given, "mode": "add"}
        self._shaping = Shaping.of(list(loaded), **shown)
        self.features = StateFeatures(
            self._shaping.weights,
            self._shaping.clip,
            self._panel.latencies,
            whole=self._shaping.mode == "terminal",
        )

    @property
    def keys(self) -> frozenset[str]:
        """The keys of the infos."""
        own = {"reward": 0} if self._shapes else {}
        states: Any = {} if self._details else None
        optional = _Optional(self._of_instants or None)
        info = step_info(own, 0, 0, 0, 0, optional, states=states) | end_info(0, 0, 0, 0)
        return frozenset(info) | self._panel.cost_keys

    @property
    def metric_keys(self) -> frozenset[str]:
        """The keys of `metrics`."""
        return frozenset({"robustness", "is_success"}) | self._panel.cost_keys

    def init(self, lanes: int) -> RequirementState:
        """Return the state before the first sample, which `begin` or `step` takes."""
        panel = self._panel.init(lanes)
        zero = self._o.full((lanes,), 0.0, panel.judges[0].rows.dtype)
        count = panel.judges[0].age
        return RequirementState(panel, zero, zero, count - 1, count)

    def reset(self, state: RequirementState, mask: Tensor) -> RequirementState:
        """Return the state in which the lanes of the mask have not taken a sample.

        Unlike `begin` it takes none: the next `step` takes the first sample of these lanes.

        Args:
            state: The state that `init`, `reset`, `begin` or `step` returned.
            mask: A boolean for each lane.
        """
        o = self._o
        return RequirementState(
            self._panel.reset(state.panel, mask),
            o.where(mask, 0.0, state.potential),
            o.where(mask, 0.0, state.outcome),
            o.where(mask, -1, state.violated_at),
            o.where(mask, 0, state.samples),
        )

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
        taken, never = self._panel.begin(state.panel, given, mask), mask & ~mask
        samples = o.where(mask, state.samples * 0 + 1, state.samples)
        values = self._panel.values(taken, samples, never, never)
        violated = self._violated(values)
        zero = o.full(lanes, 0.0, state.potential.dtype)
        before = o.as_integers(violated) - 1  # sample 0, where it is violated
        following = RequirementState(
            taken.panel,
            o.where(mask, self._potential(values), state.potential),
            o.where(mask, zero, state.outcome),
            o.where(mask, before, state.violated_at),
            samples,
        )
        costs = self._panel.unpaid(values)
        info = self._info(values, violated, following.violated_at, never, zero, costs)
        return following, JudgedStep(zero, never, never, info, self._shown(values))

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
        return self._panel.feed(state.panel, sample, state.samples)

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
        o, samples, certain = self._o, state.samples + 1, self.violated(taken)
        values = self._panel.values(taken, samples, terminated, truncated)
        panel, costs = self._panel.charged(taken, values)
        violated = self._violated(values)
        violated_at = o.where(violated & (state.violated_at < 0), state.samples, state.violated_at)
        if self._on_violation == "terminate":
            terminated = terminated | certain
        elif self._on_violation == "truncate":
            truncated = truncated | (certain & ~terminated)
        over = terminated | truncated
        potential = self._potential(values)
        settled = outcome(least(values.lower), least(values.upper))
        following = RequirementState(panel, potential, settled, violated_at, samples)
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
            self._info(values, violated, violated_at, over, reward, costs),
            self._shown(values),
        )

    def metrics(self, judged: JudgedStep) -> dict[str, Tensor]:
        """Numbers that are summed over an episode.

        Those of verdicts are of its last step, and 0 before it; costs are of every step.
        """
        o, over = self._o, judged.terminated | judged.truncated
        robustness = clip(judged.info["robustness"], self._shaping.clip)
        zero = robustness * 0.0
        success = o.where(judged.info["is_success"], zero + 1.0, zero)
        costs = {key: judged.info[key] for key in self._panel.cost_keys}
        return {"robustness": o.where(over, robustness, zero), "is_success": success, **costs}

    def _violated(self, values: MonitorValues[Any]) -> Tensor:
        return self._o.signbit(least(values.upper))

    def _potential(self, values: MonitorValues[Any]) -> Tensor:
        if self._shaping.mode == "progress":
            return self._shaping.middle(values.lower, values.upper)
        whole = self._shaping.mode == "terminal"
        return self._shaping.robustness(values.judged if whole else values.robustness)

    def _shown(self, values: MonitorValues[Any]) -> Tensor:
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
        of_instant = over | ~over if self._of_instants else None
        columns = (values.robustness, values.lower, values.upper, values.verdicts)
        states = {
            name: spec_state(*each, of_instant)
            for name, each in zip(self.names, zip(*columns, strict=True), strict=True)
        }
        own = {"reward": reward} if self._shapes else {}
        return step_info(
            own,
            least(values.robustness),
            least(values.lower),
            least(values.upper),
            violated,
            _Optional(of_instant),
            states=states if self._details else None,
            costs=costs,
        ) | end_info(violated_at, success, undecided, success)
