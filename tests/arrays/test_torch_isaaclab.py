"""Terms of Isaac Lab judge the steps of a stand-in as recorded signals are judged."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from array_requirements import RequirementContract
from isaaclab.managers import StandInEnv, TermCfg

from rtamt import InputError, VectorEpisodeMonitor
from rtamt_arrays.monitors import ArrayMonitors
from rtamt_arrays.operations import Tensor
from rtamt_arrays.requirements import StepJudge
from rtamt_arrays.torch import episode, online
from rtamt_arrays.torch.isaaclab import Violated, monitor_state, shaped_reward
from rtamt_arrays.torch.operations import TorchOperations

LANES = 7
SPEC = "always(x > -1.2 and (abs(u) < 1.4 or eventually[0:0.2](x > 0)))"


class Torch:
    """torch in eager mode."""

    def judge(self, specs: Any, options: Any) -> StepJudge:  # noqa: ANN401
        doubles = {"dtype": torch.float64, "device": "cpu"}
        made = ArrayMonitors(partial(episode, **doubles), partial(online, **doubles))
        return StepJudge(specs, made, TorchOperations("cpu"), options)

    def tensor(self, values: object) -> Tensor:
        return torch.from_numpy(np.array(values))

    def compiled(self, function: Any) -> Any:  # noqa: ANN401
        return function


class TestRequirements(RequirementContract):
    library = Torch()


def made(device: str = "cpu", **options: Any) -> StandInEnv:  # noqa: ANN401
    chosen = {"period": "100ms", "mode": "add", "cost": "latched", **options}
    signals = {"x": lambda env: env.x, "u": (lambda env: env.action, 0.0)}
    params = {"specs": SPEC, "signals": signals, "options": chosen}
    return StandInEnv(LANES, TermCfg(Violated, params), shaped_reward, monitor_state, device)


def test_terms_equal_a_monitor_of_recorded_signals_over_resets() -> None:
    torch.set_default_dtype(torch.float64)
    env = made()
    env.reset()
    monitor = VectorEpisodeMonitor(SPEC, LANES, period=0.1)
    monitor.update(_table(monitor, env.x * 0, env.x * 0))
    generator, ends, open_ends, x = torch.Generator().manual_seed(0), 0, 0, env.x
    for _ in range(60):
        action = torch.randn(LANES, generator=generator)
        obs, reward, over = env.step(action)
        x = x + action
        monitor.update(_table(monitor, x, action))
        violated, fallen = np.signbit(monitor.upper), env.fallen.numpy()
        info = {key: value.numpy() for key, value in env.extras["stl"].items()}
        np.testing.assert_array_equal(env.violated.numpy(), violated)
        monitor.finish(fallen & ~violated)
        monitor.finish(env.time_outs.numpy(), end="cut")
        for key, name in (("", "robustness"), ("stl_", "lower"), ("stl_", "upper")):
            np.testing.assert_array_equal(info[key + name], getattr(monitor, name))
        np.testing.assert_array_equal(info["cost"], monitor.verdict < 0)
        open_ends += ((monitor.verdict == 0) & env.time_outs.numpy()).sum()
        np.testing.assert_array_equal(reward.numpy(), np.clip(monitor.robustness, -1.0, 1.0))
        mask = over.numpy()
        if mask.any():
            ends += mask.sum()
            x = torch.where(over, 0.1, x)
            monitor.reset(mask)
            monitor.update(_table(monitor, x, x * 0), mask)
        np.testing.assert_allclose(
            obs[:, 0].numpy(), np.clip(monitor.robustness, -1, 1), atol=1e-12
        )
    assert ends > LANES
    assert open_ends  # windows that reach past an end
    torch.set_default_dtype(torch.float32)


def _table(monitor: VectorEpisodeMonitor, x: Any, u: Any) -> Any:  # noqa: ANN401
    columns = {"x": x.numpy(), "u": u.numpy()}
    return np.stack([columns[name] for name in monitor.variables], axis=1)


def test_no_step_asks_a_tensor_for_a_number() -> None:
    with torch.device("meta"):
        env = made("meta")
        env.reset()
        obs, reward, _ = env.step(torch.zeros(LANES))
        env.term.reset(torch.zeros(2, dtype=torch.int64))
    assert obs.shape == (LANES, 5)
    assert reward.shape == (LANES,)


def test_what_is_missing_is_said() -> None:
    params = {"specs": "always(x < u)", "signals": {"x": lambda env: env.x}}
    with pytest.raises(InputError) as error:
        StandInEnv(LANES, TermCfg(Violated, params), shaped_reward, monitor_state)
    assert str(error.value) == "variable 'u' has no signal; the signals are x"
    bare = StandInEnv(2, TermCfg(lambda *_: None), shaped_reward, monitor_state)
    with pytest.raises(InputError) as error:
        shaped_reward(bare)
    assert str(error.value) == (
        "expected a termination term with func=Violated, which judges the episodes, got none; "
        "its params say the specifications and their signals"
    )
