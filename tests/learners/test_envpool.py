"""EnvPool below a vector monitor; the program is an example."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import envpool
import numpy as np
import pytest
from envpool.python.envpool import EnvPoolMixin
from programs import Ride, counts_of, run, shares_of

from rtamt_gym import VectorStlMonitor

pytestmark = pytest.mark.filterwarnings("ignore:.*precision lowered by casting")

STEPS = 15


def make(num: int = 6, **options: Any) -> Any:  # noqa: ANN401
    return envpool.make_gymnasium(
        "CartPole-v1", num_envs=num, seed=3, max_episode_steps=STEPS, **options
    )


def actions(num: int, steps: int) -> Any:  # noqa: ANN401
    return np.random.default_rng(4).integers(0, 2, (steps, num))


@contextmanager
def recorded() -> Iterator[list[Any]]:
    """Record the results of EnvPool's own ``reset`` and ``step``."""
    shown: list[Any] = []
    reset, step = EnvPoolMixin.reset, EnvPoolMixin.step

    def recorded_reset(self: Any, env_id: Any = None) -> Any:  # noqa: ANN401
        shown.append(reset(self, env_id))
        return shown[-1]

    def recorded_step(self: Any, action: Any, env_id: Any = None) -> Any:  # noqa: ANN401
        shown.append(step(self, action, env_id))
        return shown[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EnvPoolMixin, "reset", recorded_reset)
        patch.setattr(EnvPoolMixin, "step", recorded_step)
        yield shown


def rides_of(shown: list[Any]) -> list[Ride]:
    """Return the complete episodes in the order of their ends, from ``elapsed_step`` only."""
    (obs, info), *steps = shown
    num = len(obs)
    rides = [Ride(entry, [float(obs[entry, 0])]) for entry in range(num)]
    assert info["elapsed_step"].tolist() == [0] * num
    ended = []
    for at, (obs, _, terminated, truncated, info) in enumerate(steps):
        for entry in range(num):
            if info["elapsed_step"][entry] == 0:
                rides[entry] = Ride(entry, [])
            rides[entry].positions.append(float(obs[entry, 0]))
            if terminated[entry] or truncated[entry]:
                rides[entry].fell = bool(terminated[entry])
                rides[entry].last_step = at
                ended.append(rides[entry])
    return ended


def test_the_step_after_an_end_is_the_reset_and_ignores_its_action() -> None:
    one, other = make(), make()
    one.reset()
    other.reset()
    done, ends = np.zeros(6, np.bool_), 0
    for each in actions(6, 60):
        obs, rewards, terminated, truncated, infos = one.step(each)
        again, *_ = other.step(np.where(done, 1 - each, each))
        assert np.array_equal(obs, again)
        assert (infos["elapsed_step"] == 0).tolist() == done.tolist()
        assert rewards[done].tolist() == [0] * int(done.sum())
        assert infos["env_id"].tolist() == list(range(6))
        assert not (terminated & truncated).any()
        done = terminated | truncated
        ends += int(done.sum())
    assert ends > 10


def test_outcomes_are_those_of_episodes_that_elapsed_steps_tell_apart() -> None:
    with recorded() as shown:
        envs = VectorStlMonitor(
            make(), "always(abs(x) < 0.12)", {"x": "obs[0]"}, at_termination="failure", period=0.02
        )
        obs, _ = envs.reset()
        assert obs is shown[0][0]
        found = []
        for each in actions(6, 200):
            result = envs.step(each)
            assert all(a is b for a, b in zip(result[:4], shown[-1][:4], strict=True))
            infos, done = result[-1], result[2] | result[3]
            assert (infos["elapsed_step"] + 1).tolist() == envs.samples.tolist()
            for entry in np.flatnonzero(done):
                outcome = infos["stl_episode"]["spec"]
                found.append((outcome["robustness"][entry], bool(infos["is_success"][entry])))
        envs.close()
    rides = rides_of(shown)
    lows, successes = zip(*found, strict=True)
    assert lows == pytest.approx([min(ride.margins) for ride in rides])
    assert list(successes) == [ride.success for ride in rides]
    assert {ride.success for ride in rides} == {False, True}
    assert {ride.fell for ride in rides} == {False, True}


def test_an_asynchronous_pool_is_refused() -> None:
    with pytest.raises(ValueError, match="leave batch_size= out"):
        VectorStlMonitor(make(batch_size=3), "always(abs(x) < 0.12)", {"x": "obs[0]"})


def test_the_loop_counts_what_a_hand_count_gives(tmp_path: Path) -> None:
    with recorded() as shown:
        program, _ = run("EnvPool", tmp_path)
    ended = rides_of(shown)
    assert program["successes"] == [ride.success for ride in ended]
    paid = [ride.steps + sum(np.minimum.accumulate(ride.margins)[1:]) for ride in ended]
    assert program["returns"] == pytest.approx(paid, rel=1e-4)
    metrics = {**shares_of(ended[-100:]), **counts_of(ended)}
    assert program["training"].metrics() == pytest.approx(metrics)
    assert 0 < sum(program["successes"]) < len(ended)
