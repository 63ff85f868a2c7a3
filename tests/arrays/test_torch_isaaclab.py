"""Terms of Isaac Lab judge the steps of a stand-in like recorded signals."""

from __future__ import annotations

import gc
import sys
import weakref
from collections.abc import Mapping
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from array_requirements import RequirementContract
from isaaclab.managers import ManagerTermBase, StandInEnv, TermCfg

from rtamt import InputError, InputTypeError, VectorEpisodeMonitor
from rtamt_arrays.judging import StepJudge
from rtamt_arrays.monitor_set import ArrayLibrary
from rtamt_arrays.operations import Tensor
from rtamt_arrays.torch import episode, isaaclab, online
from rtamt_arrays.torch.isaaclab import Violated, first_sample, monitor_state, shaped_reward
from rtamt_arrays.torch.operations import TorchOperations

ENTRIES = 7
SPEC = "always(x > -1.2 and (abs(u) < 1.4 or eventually[0:0.2](x > 0)))"


class Torch:
    """torch in eager mode."""

    def judge(self, specs: Any, options: Any) -> StepJudge:  # noqa: ANN401
        doubles = {"dtype": torch.float64, "device": "cpu"}
        makers = partial(episode, **doubles), partial(online, **doubles)
        return StepJudge(specs, ArrayLibrary(*makers, TorchOperations("cpu")), options)

    def tensor(self, values: object) -> Tensor:
        return torch.from_numpy(np.array(values))

    def compiled(self, function: Any) -> Any:  # noqa: ANN401
        return function


class TestRequirements(RequirementContract):
    library = Torch()


def position(env: StandInEnv) -> torch.Tensor:
    return env.points.x


def body(env: StandInEnv) -> torch.Tensor:
    return env.points.body_x


def violated(
    specs: object = "always(x > 0)",
    x: object = position,
    *,
    time_out: bool = False,
    **options: object,
) -> TermCfg:
    params = {"specs": specs, "signals": {"x": x}, "options": options}
    return TermCfg(Violated, params, time_out)


def made(device: str = "cpu", computes: int = 1) -> StandInEnv:
    params = {
        "specs": SPEC,
        "signals": {"x": position, "u": (lambda env: env.action, 0.0)},
        "options": {"period": "100ms", "mode": "add", "cost": "latched"},
    }
    return StandInEnv(
        ENTRIES,
        {"violated": TermCfg(Violated, params)},
        {"shaped": TermCfg(shaped_reward)},
        {"monitors": TermCfg(monitor_state)},
        device=device,
        computes=computes,
    )


@pytest.mark.parametrize("computes", [1, 2])
def test_terms_equal_recorded_signals(computes: int) -> None:
    torch.set_default_dtype(torch.float64)
    env = made(computes=computes)
    env.reset()
    monitor = VectorEpisodeMonitor(SPEC, ENTRIES, period=0.1)
    x = torch.full((ENTRIES,), 0.1)
    monitor.update(_table(monitor, x, x * 0))
    generator, ends, open_ends = torch.Generator().manual_seed(0), 0, 0
    for _ in range(60):
        action = torch.randn(ENTRIES, generator=generator)
        obs, reward, over = env.step(action)
        x = x + action
        monitor.update(_table(monitor, x, action))
        manager = env.termination_manager
        violated, fallen = np.signbit(monitor.upper), manager.dones["fallen"].numpy()
        info = {key: value.numpy() for key, value in env.extras["stl"].items()}
        np.testing.assert_array_equal(manager.dones["violated"].numpy(), violated)
        monitor.finish(fallen & ~violated)
        monitor.finish(manager.time_outs.numpy(), end="cut")
        for key, name in (("", "robustness"), ("stl_", "lower"), ("stl_", "upper")):
            np.testing.assert_array_equal(info[key + name], getattr(monitor, name))
        np.testing.assert_array_equal(info["cost"], monitor.verdict < 0)
        open_ends += ((monitor.verdict == 0) & manager.time_outs.numpy()).sum()
        np.testing.assert_array_equal(reward.numpy(), np.clip(monitor.robustness, -1.0, 1.0))
        mask = over.numpy()
        if mask.any():
            ends += mask.sum()
            x = torch.where(over, 0.1, x)
            monitor.reset(mask)
            monitor.update(_table(monitor, x, x * 0), mask)
        np.testing.assert_allclose(
            obs[:, 1].numpy(), np.clip(monitor.robustness, -1, 1), atol=1e-12
        )
    assert ends > ENTRIES
    assert open_ends  # windows that extend beyond an end
    torch.set_default_dtype(torch.float32)


def _table(monitor: VectorEpisodeMonitor, x: Any, u: Any) -> Any:  # noqa: ANN401
    columns = {"x": x.numpy(), "u": u.numpy()}
    return np.stack([columns[name] for name in monitor.variables], axis=1)


ENVS, STEPS = 64, 150
BODY = "always(abs(x) < 1 and (x > -0.5 or eventually[0:0.3](x > 0)))"


def certain(samples: list[float]) -> bool:
    """Return whether samples certainly violate ``BODY``, by definition; 0.3 s are three samples."""
    for i, x in enumerate(samples):
        if abs(x) >= 1:
            return True
        if x <= -0.5 and len(samples) > i + 3 and max(samples[i : i + 4]) <= 0:
            return True
    return False


class Hasty(Violated):
    """A term that reads the sample of a reset at once."""

    def reset(self, env_ids: Any = None) -> None:  # noqa: ANN401
        super().reset(env_ids)
        self.take_first()


def differences(
    func: type[Violated], observations: Mapping[str, TermCfg], *, at_reset: bool = True
) -> tuple[int, int, int]:
    """Compare ends with the true samples of bodies.

    Returns:
        The number of differing ends, of episodes, and of episodes of one step.
    """
    numbers = np.random.default_rng(5)

    def start(ids: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(numbers.uniform(-1.05, 1.05, len(ids)).astype(np.float32))

    term = violated(BODY, body)
    term.func = func
    env = StandInEnv(
        ENVS, {"violated": term}, observations=observations, length=40, start=start, computes=2
    )
    env.reset()
    x = env.points.x.numpy()
    truth = [[value] if at_reset else [] for value in x]
    wrong = episodes = short = 0
    for _ in range(STEPS):
        action = numbers.normal(0.0, 0.3, ENVS).astype(np.float32)
        ages = env.steps.numpy() + 1
        _, _, over = env.step(torch.from_numpy(action))
        for samples, value in zip(truth, x + action / 2, strict=True):
            samples.append(value)
        expected = np.array([certain(samples) for samples in truth])
        wrong += (env.termination_manager.dones["violated"].numpy() != expected).sum()
        episodes += over.sum().item()
        short += (over.numpy() & (ages == 1)).sum()
        x = env.points.x.numpy()
        for entry in np.flatnonzero(over):
            truth[entry] = [x[entry]] if at_reset else []
    return wrong, episodes, short


@pytest.mark.parametrize("term", [first_sample, monitor_state])
def test_first_sample_is_of_the_new_episode(term: Any) -> None:  # noqa: ANN401
    wrong, episodes, short = differences(Violated, {"term": TermCfg(term)})
    assert wrong == 0
    assert episodes > 10 * ENVS
    assert 0 < short < episodes / 4  # episodes that start outside


def test_sample_at_the_reset_is_stale() -> None:
    wrong, episodes, short = differences(Hasty, {"term": TermCfg(first_sample)})
    assert wrong > 10 * ENVS
    assert short > episodes / 3


def test_first_step_without_observation_term() -> None:
    wrong, episodes, _ = differences(Violated, {}, at_reset=False)
    assert wrong == 0
    assert episodes > 10 * ENVS


@pytest.mark.parametrize(
    ("ids", "chosen"),
    [
        (None, [0, 1, 2, 3]),
        (slice(None), [0, 1, 2, 3]),
        (slice(1, 3), [1, 2]),
        ([1, 3], [1, 3]),
        ([], []),
        (range(2), [0, 1]),
        (torch.tensor([3, 0]), [0, 3]),
        (torch.tensor([2], dtype=torch.int32), [2]),
        (torch.tensor([False, True, True, False]), [1, 2]),
        (np.array([1, 2]), [1, 2]),
        (np.array([True, False, False, True]), [0, 3]),
    ],
)
def test_a_reset_takes_ids_of_every_kind(ids: Any, chosen: list[int]) -> None:  # noqa: ANN401
    env = StandInEnv(4, {"violated": violated()}, length=99)
    term = env.termination_manager.get_term_cfg("violated").func
    env.points.x = torch.full((4,), -1.0)
    assert term(env, **violated().params).all()
    term.reset(ids)
    env.points.x = torch.full((4,), 1.0)
    held = ~term(env, **violated().params)
    assert held.nonzero()[:, 0].tolist() == chosen


@pytest.mark.parametrize(
    ("ids", "error", "text"),
    [
        ([4], InputError, "env_ids has an index without an environment: [4]"),
        ([True, False], InputError, "env_ids has (2,) booleans, expected one for each of the 4"),
        ([0.5], InputTypeError, "expected env_ids as indices of environments, a boolean for each"),
        ("all", InputTypeError, "got 'all'"),
    ],
)
def test_wrong_ids_leave_the_episodes_as_they_were(
    ids: Any,  # noqa: ANN401
    error: type[Exception],
    text: str,
) -> None:
    env = StandInEnv(4, {"violated": violated()}, length=99)
    term = env.termination_manager.get_term_cfg("violated").func
    env.points.x = torch.full((4,), -1.0)
    term(env, **violated().params)
    with pytest.raises(error) as raised:
        term.reset(ids)
    assert text in str(raised.value)
    env.points.x = torch.full((4,), 1.0)
    assert term(env, **violated().params).all()


def test_partial_reset() -> None:
    env = StandInEnv(4, {"violated": violated()}, observations={"first": TermCfg(first_sample)})
    env.reset()
    env.points.start = lambda ids: torch.full(ids.shape, -1.0)
    env.reset(torch.tensor([2]))
    env.step(torch.full((4,), 1.5))
    assert env.termination_manager.terminated.tolist() == [False, False, True, False]


def test_repeated_terms_change_nothing() -> None:
    env = made()
    env.reset()
    for _ in range(3):
        _, reward, _ = env.step(torch.full((ENTRIES,), -0.1))
        info = {key: value.clone() for key, value in env.extras["stl"].items()}
        again = env.reward_manager.values()["shaped"]
        assert torch.equal(again, reward)
        env.observation_manager.compute()
        for key, value in info.items():
            assert torch.equal(env.extras["stl"][key], value)
    assert env.extras["stl"]["robustness"].tolist() == pytest.approx([1.0] * ENTRIES)


@pytest.mark.parametrize("time_out", [False, True])
def test_time_out_decides_how_a_violation_ends(time_out: bool) -> None:  # noqa: FBT001
    term = violated(time_out=time_out, mode="potential", gamma=0.5)
    observe = {"first": TermCfg(first_sample)}
    env = StandInEnv(1, {"violated": term}, {"reward": TermCfg(shaped_reward)}, observe)
    env.reset()
    _, reward, over = env.step(torch.tensor([-0.5]))
    assert over.item()
    assert env.termination_manager.time_outs.item() is time_out
    # gamma * after - before: after is 0 at a termination, and the robustness at a truncation.
    assert reward.item() == pytest.approx((0.5 * -0.4 if time_out else 0.0) - 0.1)


def test_several_terms_are_read_by_name() -> None:
    terms = {"low": violated("always(x > 0)"), "high": violated("always(x < 0.5)", mode="add")}
    reward = {name: TermCfg(shaped_reward, {"term": name}) for name in ("low", "high")}
    observe = {
        "state": TermCfg(monitor_state, {"term": "high"}),
        "first": TermCfg(first_sample),
    }
    env = StandInEnv(2, terms, reward, observe)
    env.reset()
    obs, rewards, over = env.step(torch.tensor([0.2, 0.6]))
    assert env.extras["stl"]["low"]["robustness"].tolist() == pytest.approx([0.1, 0.1])
    assert env.extras["stl"]["high"]["robustness"].tolist() == pytest.approx([0.2, -0.2])
    assert rewards.tolist() == pytest.approx([0.2, -0.2])
    assert over.tolist() == [False, True]
    assert obs[:, 1].tolist() == pytest.approx([0.2, 0.4])
    for func in (shaped_reward, monitor_state):
        with pytest.raises(InputError) as error:
            func(env)
        assert str(error.value) == (
            f"{func.__name__} does not name a term, and several have func=Violated: 'low', 'high'. "
            f"Add one {func.__name__} for each, with params={{'term': NAME}}."
        )
        with pytest.raises(InputError, match=r"term='hihg'\. The terms with func=Violated are"):
            func(env, term="hihg")


def test_base_without_isaac_lab(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("isaaclab", "isaaclab.managers"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [each for each in sys.path if Path(each).name != "support"])
    assert isaaclab.__file__
    spec = spec_from_file_location("terms_of_mjlab", isaaclab.__file__)
    assert spec
    assert spec.loader
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert not issubclass(module.Violated, ManagerTermBase)
    env = StandInEnv(2, {})
    term = module.Violated(cfg=violated(), env=env)
    term.reset(slice(None))
    env.points.x = torch.tensor([1.0, -1.0])
    assert term(env, **violated().params).tolist() == [False, True]


def test_an_environment_is_freed() -> None:
    env = made()
    env.reset()
    env.step(torch.zeros(ENTRIES))
    reference = weakref.ref(env)
    del env
    gc.collect()
    assert reference() is None


def test_no_step_asks_a_tensor_for_a_number() -> None:
    with torch.device("meta"):
        env = made("meta")
        env.reset()
        obs, reward, _ = env.step(torch.zeros(ENTRIES))
        env.termination_manager.reset(torch.zeros(2, dtype=torch.int64))
        env.step(torch.zeros(ENTRIES))
    assert obs.shape == (ENTRIES, 6)
    assert reward.shape == (ENTRIES,)


@pytest.mark.parametrize(
    ("options", "time_out", "text"),
    [
        ({"on_violation": "report"}, False, "time_out=False means on_violation='terminate'"),
        ({"on_violation": "truncate"}, False, "time_out=False means on_violation='terminate'"),
        ({"on_violation": "terminate"}, True, "time_out=True means on_violation='truncate'"),
        ({"observe": "state"}, False, "Violated has no observe='state'. Add monitor_state"),
        ({"modes": "add"}, False, "No option 'modes'."),
    ],
)
def test_an_option_without_effect_is_refused(
    options: dict[str, Any],
    time_out: bool,  # noqa: FBT001
    text: str,
) -> None:
    with pytest.raises(InputError) as error:
        StandInEnv(2, {"violated": violated(time_out=time_out, **options)})
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("signals", "error", "text"),
    [
        ({"y": position}, InputError, "variable 'x' has no signal; the signals are y"),
        ([position], InputTypeError, "expected signals as a dictionary from variable to function"),
        ({"x": "obs[0]"}, InputTypeError, "expected signal 'x' as a function of the environment"),
        (
            {"x": (0.0, position)},
            InputTypeError,
            "or as a pair of a function and a number for resets",
        ),
        (
            {"x": (position, None)},
            InputTypeError,
            "or as a pair of a function and a number for resets",
        ),
        (
            {"x": (position, 0.0, 1)},
            InputTypeError,
            "or as a pair of a function and a number for resets",
        ),
    ],
)
def test_wrong_signals_are_refused_at_once(
    signals: object, error: type[Exception], text: str
) -> None:
    params = {"specs": "always(x > 0)", "signals": signals}
    with pytest.raises(error) as raised:
        StandInEnv(2, {"violated": TermCfg(Violated, params)})
    assert text in str(raised.value)


def test_a_signal_has_one_number_for_each_environment() -> None:
    env = StandInEnv(2, {"violated": violated(x=lambda env: env.points.x[:, None])})
    env.reset()
    with pytest.raises(InputError) as error:
        env.step(torch.zeros(2))
    assert str(error.value) == (
        "Signal 'x' has the shape (2, 1), expected (2,). Return one number for each environment, "
        "such as values[:, 0]."
    )


def test_the_value_of_a_reset_may_be_an_integer() -> None:
    env = StandInEnv(
        2,
        {"violated": violated(x=(position, -1))},
        observations={"first": TermCfg(first_sample)},
    )
    env.reset()
    env.step(torch.zeros(2))
    assert env.termination_manager.terminated.all()


def test_a_period_other_than_the_step_is_warned_about() -> None:
    with pytest.warns(UserWarning, match="bounds last 2 times as long as written"):
        StandInEnv(2, {"violated": violated(period=0.05)})
    StandInEnv(2, {"violated": violated(period=1)})


def test_what_is_missing_is_reported() -> None:
    with pytest.raises(InputError) as error:
        StandInEnv(2, {"violated": TermCfg(Violated, {"signals": {}})})
    assert str(error.value) == "The params of Violated have no 'specs'."
    with pytest.raises(InputError) as error:
        StandInEnv(2, {"violated": violated("always(x < u)")})
    assert str(error.value) == "variable 'u' has no signal; the signals are x"
    bare = StandInEnv(2, {})
    for func in (shaped_reward, monitor_state, first_sample):
        with pytest.raises(InputError) as error:
            func(bare)
        assert str(error.value) == (
            "The environment has no termination term with func=Violated, which judges its "
            "episodes. Add one; its params are the specifications and their signals."
        )
    both = {"a": "always(x > 0)", "b": "always(x < 9)"}
    observe = {"state": TermCfg(monitor_state)}
    env = StandInEnv(2, {"violated": violated(both)}, observations=observe)
    with pytest.raises(InputError) as error:
        env.reset()
    assert str(error.value) == (
        "monitor_state has features=5, and its specifications have 10. "
        "Pass params={'features': 10}."
    )
