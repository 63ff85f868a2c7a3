"""The contract of requirements on arrays: infos, rewards and ends of `rtamt_gym.VectorStlReward`.

Both judge the same recorded steps. A new episode starts after each end, also after a violation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, get_args

import gymnasium as gym
import numpy as np
import pytest
from bits import bits
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from replay import shaping_options

from rtamt_arrays.judging import StepJudge
from rtamt_arrays.operations import Tensor
from rtamt_gym import VectorStlReward
from rtamt_gym.judging.infos import end_info
from rtamt_gym.shaping import Mode

__all__ = ["RequirementContract", "RequirementLibrary"]

ENTRIES, STEPS = 5, 40
QUARTERS = np.arange(-12, 13) / 4.0


class RequirementLibrary(Protocol):
    """The functions of an array library that the contract needs."""

    def judge(self, specs: Any, options: Mapping[str, Any]) -> StepJudge:  # noqa: ANN401
        """Return the requirements on its arrays of doubles."""

    def tensor(self, values: object) -> Tensor:
        """Return an array of doubles, or of booleans for boolean values."""

    def compiled(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function as the library compiles it, if it does."""


class Recorded(gym.vector.VectorEnv[Any, Any, Any]):
    """Points with recorded steps; a mask resets environments."""

    single_observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    single_action_space = spaces.Box(-1.0, 1.0, (1,), np.float64)

    def __init__(self, seed: int, *, holes: bool) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.num_envs = ENTRIES
        self.observation_space = gym.vector.utils.batch_space(
            self.single_observation_space, ENTRIES
        )
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, ENTRIES)
        random = np.random.default_rng(seed)
        self.samples = random.choice(QUARTERS, (STEPS, 2, ENTRIES, 2))  # of a step, and of a reset
        if holes:
            self.samples[:, 0][random.random((STEPS, ENTRIES, 2)) < 0.2] = np.nan
        self.rewards = random.normal(size=(STEPS, ENTRIES))
        self.terminated, self.truncated = random.random((2, STEPS, ENTRIES)) < 0.08
        self.at, self.obs = 0, self.samples[0, 1]

    def reset(
        self,
        *,
        seed: Any = None,  # noqa: ANN401, ARG002
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        mask = np.ones(ENTRIES, bool) if options is None else options["reset_mask"]
        self.obs = np.where(mask[:, None], self.samples[self.at, 1], self.obs)
        return self.obs, {}

    def step(self, actions: object) -> tuple[Any, Any, Any, Any, dict[str, Any]]:  # noqa: ARG002
        self.at, t = self.at + 1, self.at + 1
        self.obs = self.samples[t, 0]
        return self.obs, self.rewards[t], self.terminated[t], self.truncated[t], {}


RESPONDS = "always((x > -2) implies eventually[0:3](x + y < 1))"
LATE = "always[2:inf](x >= -2.5) and eventually(y > 2 and once[1:2](x <= 0))"
SEVERAL = {"responds": RESPONDS, "late": LATE, "near": "always(x < 2.75)"}
DEMANDS = {
    "within": "always[2:9](x < 2 or once[1:3](y > 0))",
    "soon": "eventually[0:4](x > 2.5) and always(historically[0:1](y > -2))",
}
INSTANTS = {"responds": "(x > 0) implies eventually[0:2](y > 0)", "near": "abs(x) <= 2.5"}
WORDS = {"responds": "report", "late": "truncate", "near": "terminate"}
CASES: list[tuple[Any, dict[str, Any]]] = [
    (RESPONDS, {"mode": "add", "on_violation": "report"}),
    (RESPONDS, {"mode": "progress", "at_termination": "cut", "on_violation": "truncate"}),
    (RESPONDS, {"mode": "potential", "at_termination": "failure", "at_truncation": "open"}),
    ("eventually[0:9](always[0:3](x < 2))", {"mode": "terminal", "on_violation": "report"}),
    (LATE, {"mode": "replace", "at_termination": "cut", "on_violation": "report"}),
    (SEVERAL, {"mode": "add", "weights": {"late": 0.25}, "bonus": 5.0, "penalty": 2.0}),
    (RESPONDS, {"mode": "add", "cost": "violation"}),
    (DEMANDS, {"mode": "add", "cost": "violation", "on_violation": "report"}),
    (DEMANDS, {"mode": "add", "cost": "depth", "on_violation": "report"}),
    (SEVERAL, {"mode": "add", "cost": "latched", "on_violation": "report"}),
    (SEVERAL, {"mode": "add", "cost": "first", "at_termination": "failure"}),
    (SEVERAL, {"mode": "add", "on_violation": WORDS}),
    (DEMANDS, {"mode": "add", "cost": "depth", "nan": "hold", "on_violation": "report"}),
    (INSTANTS, {"mode": "add", "view": "step", "cost": "depth", "on_violation": "report"}),
    (INSTANTS, {"mode": "progress", "view": "step", "on_violation": "truncate"}),
    (INSTANTS, {"mode": "terminal", "view": "step", "at_termination": "cut"}),
]
"""Specifications and options; the modes of shaping without a row here follow below."""
_SHAPED = {options.get("mode") for _, options in CASES}
CASES += [
    (SEVERAL, {**shaping_options(mode, *SEVERAL), "on_violation": "report"})
    for mode in get_args(Mode)
    if mode not in _SHAPED
]


class RequirementContract:
    """The contract of `rtamt_arrays.judging.StepJudge`."""

    library: RequirementLibrary

    @pytest.mark.parametrize(("specs", "options"), CASES)
    def test_steps_equal_vector_environments(
        self,
        specs: Any,  # noqa: ANN401
        options: dict[str, Any],
    ) -> None:
        given = {"on_violation": "terminate", "at_termination": "complete", "period": 1}
        options = {**given, "observe": "state", "clip": 3.0, **options}
        recorded = Recorded(seed=len(str(options)), holes="nan" in options)
        tensor = self.library.tensor
        envs = VectorStlReward(recorded, specs, {"x": "obs[0]", "y": "obs[1]"}, **options)
        judge = self.library.judge(specs, options)
        step, begin = self.library.compiled(judge.step), self.library.compiled(judge.begin)

        def sample(obs: NDArray[np.float64]) -> dict[str, Tensor]:
            columns = {"x": obs[:, 0], "y": obs[:, 1]}
            return {name: tensor(columns[name]) for name in judge.variables}

        obs, infos = envs.reset()
        state, judged = begin(judge.init(ENTRIES), sample(recorded.obs), tensor([True] * ENTRIES))
        assert judged.info.keys() == judge.keys - {"stl"}
        self.compare(judged, obs, infos, np.zeros(ENTRIES, bool))
        ended = 0
        for t in range(1, STEPS):
            obs, reward, terminated, truncated, infos = envs.step(np.zeros((ENTRIES, 1)))
            ends = tensor(recorded.terminated[t]), tensor(recorded.truncated[t])
            state, judged = step(state, sample(recorded.obs), tensor(recorded.rewards[t]), *ends)
            over = terminated | truncated
            self.compare(judged, obs, infos, over)
            assert np.array_equal(judged.terminated, terminated)
            assert np.array_equal(judged.truncated, truncated)
            np.testing.assert_allclose(judged.reward, reward, rtol=1e-12, atol=1e-12)
            if over.any():
                obs, infos = envs.reset(options={"reset_mask": over})
                state, judged = begin(state, sample(recorded.obs), tensor(over))
                self.compare(judged, obs, infos, np.zeros(ENTRIES, bool), of=over)
            ended += over.sum()
        assert ended > ENTRIES

    @pytest.mark.parametrize(("specs", "options"), CASES[2::3])  # one of them has nan="hold"
    def test_step_after_reset_takes_sample_0(
        self,
        specs: Any,  # noqa: ANN401
        options: dict[str, Any],
    ) -> None:
        judge = self.library.judge(specs, {"period": 1, **options})
        step, begin = self.library.compiled(judge.step), self.library.compiled(judge.begin)
        reset = self.library.compiled(judge.reset)
        random, tensor = np.random.default_rng(1), self.library.tensor
        signals = random.choice(QUARTERS, (12, 2, ENTRIES))
        if "nan" in options:
            signals[random.random(signals.shape) < 0.2] = np.nan
        samples = [
            {name: tensor(row["xy".index(name)]) for name in judge.variables} for row in signals
        ]
        zero, never = tensor(np.zeros(ENTRIES)), tensor(np.zeros(ENTRIES, bool))
        init = judge.init(ENTRIES)
        state = init
        for sample in samples[:6]:
            state, _ = step(state, sample, zero, never, never)
        some = random.random(ENTRIES) < 0.5
        for before, mask in [(init, np.ones(ENTRIES, bool)), (state, some)]:
            begun, expected = begin(before, samples[6], tensor(mask))
            _, others = step(before, samples[6], zero, never, never)
            after, stepped = step(reset(before, tensor(mask)), samples[6], zero, never, never)
            self.compare_infos(stepped, expected, mask)
            self.compare_infos(stepped, others, ~mask)
            for sample in samples[7:]:
                begun, expected = step(begun, sample, zero, never, never)
                after, stepped = step(after, sample, zero, never, never)
                self.compare_infos(stepped, expected, mask)
                rewards = [np.asarray(each.reward)[mask] for each in (stepped, expected)]
                np.testing.assert_array_equal(rewards[0], rewards[1])

    def test_nan_ends_with_its_episode(self) -> None:
        options = {"period": 1, "mode": "add", "bonus": 5.0, "penalty": 2.0}
        judge, tensor = self.library.judge("eventually(x > 1)", options), self.library.tensor
        zero, never = tensor(np.zeros(ENTRIES)), tensor(np.zeros(ENTRIES, bool))
        rewards = []
        for before in (0.0, np.nan):
            state, sample = judge.init(ENTRIES), {"x": tensor(np.full(ENTRIES, before))}
            state, _ = judge.begin(state, sample, ~never)
            state, _ = judge.step(state, sample, zero, never, never)
            state, _ = judge.begin(state, {"x": zero}, ~never)
            state, judged = judge.step(state, {"x": zero + 2.0}, zero, never, never)
            rewards.append(np.asarray(judged.reward))
        assert np.array_equal(rewards[0], rewards[1])
        assert np.array_equal(rewards[0], np.full(ENTRIES, 6.0))

    def compare_infos(self, judged: Any, expected: Any, mask: NDArray[np.bool_]) -> None:  # noqa: ANN401
        """Compare verdicts in the environments of a mask; a reset has cost 0, which is left out."""
        for key in ("robustness", "stl_lower", "stl_upper", "stl_violated_at"):
            values = [np.asarray(each.info[key])[mask] for each in (judged, expected)]
            np.testing.assert_array_equal(values[0], values[1], key)
        shown = [np.asarray(each.features)[mask] for each in (judged, expected)]
        np.testing.assert_array_equal(shown[0], shown[1])

    def compare(
        self,
        judged: Any,  # noqa: ANN401
        obs: NDArray[np.float64],
        infos: Mapping[str, Any],
        over: NDArray[np.bool_],
        of: NDArray[np.bool_] | None = None,
    ) -> None:
        """Compare judged steps with infos and observations, in the environments of a mask."""
        found = {key: np.asarray(value) for key, value in judged.info.items()}
        mask = np.ones(ENTRIES, bool) if of is None else of
        assert ("stl_of_instant" in found) == ("stl_of_instant" in infos)
        for key in found.keys() - end_info(0, 0, 0, 0).keys():
            # The infos of Gymnasium's resets have no reward and cost; these have 0.
            assert key in infos or key == "reward" or key.startswith("cost"), key
            expected = infos.get(key, np.zeros(ENTRIES))
            assert bits(found[key][mask]) == bits(expected[mask]), key
        shown = np.asarray(judged.features)[mask]
        np.testing.assert_allclose(shown, obs[mask, 2:], rtol=1e-6, atol=1e-7)
        for key in ("stl_success", "is_success", "stl_undecided"):
            expected = infos[key] & over if over.any() else over
            assert np.array_equal(found[key][mask], expected[mask]), key
        if over.any():
            there = infos.get("_stl_violated_at", np.zeros(ENTRIES, bool))
            at = np.where(there, infos.get("stl_violated_at", -1), -1)
            assert np.array_equal(found["stl_violated_at"][over], at[over])
