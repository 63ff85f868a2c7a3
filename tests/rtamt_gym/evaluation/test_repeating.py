"""Seeds that do not repeat episodes are detected, reported, stored in files, and not paired."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from blinking import Blink, Wild

from rtamt import InputError, StateError
from rtamt_gym import compare, evaluate_policy
from rtamt_gym.evaluation.replays import (
    HOW_TO_REPEAT,
    UnrepeatedSeedWarning,
    alike,
    repeats,
)
from rtamt_gym.results import Evaluation

SPEC, SIGNALS = {"done": "eventually(ok >= 0.5)"}, {"ok": ("info['success']", 0.0)}
DIFFER = f"two resets with one seed begin differently; {HOW_TO_REPEAT}"


def evaluation(env: Any, **options: Any) -> Evaluation:  # noqa: ANN401
    return evaluate_policy("random", env, SPEC, SIGNALS, episodes=5, **options)


def wild(**options: Any) -> tuple[Evaluation, list[str]]:  # noqa: ANN401
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = evaluation(Wild(), **options)
    assert all(each.category is UnrepeatedSeedWarning for each in told)
    assert all(each.filename == __file__ for each in told)
    return found, [str(each.message) for each in told]


class Written(Blink):
    """An environment that writes each observation into the same array."""

    shown = np.zeros(1)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        self.shown[:] = super().reset(**options)[0] * np.random.default_rng().random()
        return self.shown, {}


@pytest.mark.parametrize(
    ("env", "expected"), [(Blink(), True), (Wild(), False), (Written(), False)]
)
def test_two_resets_with_one_seed_are_compared(env: Any, expected: bool) -> None:  # noqa: ANN401, FBT001
    assert repeats(env, 7) is expected
    envs = gym.vector.SyncVectorEnv([lambda: env] * 2)
    assert repeats(envs, 7) is expected


def test_a_reset_that_fails_says_nothing() -> None:
    class Fails(Blink):
        def reset(self, **_options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
            raise ValueError("no licence")

    assert repeats(Fails(), 0) is None


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1.0, 2.0]), np.array([1.0, 3.0]), False),
        (np.array([1.0]), np.array([1.0, 1.0]), False),
        ({"a": np.zeros(2), "b": (1, "x")}, {"a": np.zeros(2), "b": (1, "x")}, True),
        ({"a": 1}, {"b": 1}, False),
        ({"a": 1}, 1, False),
        ((1, 2), (1,), False),
        ("mission", "mission", True),
        ("mission", "other", False),
    ],
)
def test_observations_of_any_space_are_compared(a: Any, b: Any, expected: bool) -> None:  # noqa: ANN401, FBT001
    assert alike(a, b) is expected
    assert alike(b, a) is expected


def test_an_evaluation_says_whether_seeds_repeat_its_episodes(tmp_path: Path) -> None:
    kept = evaluation(Blink())
    assert kept.repeats is True
    assert "begin differently" not in str(kept)
    found, told = wild(seed=3)
    (text,) = told
    assert text == (
        "two resets of Wild with seed 3 begin differently: the same call plays other episodes, "
        f"none is played again, and compare refuses to pair them; {HOW_TO_REPEAT}"
    )
    assert found.repeats is False
    assert "note: two resets with one seed begin differently" in str(found)
    assert found.worst_runs == {"done": ()}
    with pytest.raises(StateError) as refused:
        found.replay(4)
    assert str(refused.value) == (
        f"cannot play episode 4 again: two resets of Wild with one seed begin differently; "
        f"{HOW_TO_REPEAT}"
    )
    for each in (kept, found):
        each.save(tmp_path / "e.json")
        assert Evaluation.load(tmp_path / "e.json") == each
    older = json.loads((tmp_path / "e.json").read_text())
    del older["repeats"]
    (tmp_path / "older.json").write_text(json.dumps(older))
    assert Evaluation.load(tmp_path / "older.json").repeats is None


def test_it_costs_two_resets_after_the_episodes() -> None:
    env = Wild()
    with pytest.warns(UnrepeatedSeedWarning):
        evaluation(env)
    assert env.resets == 5 + 2
    assert env.length == 7


def test_what_seeds_do_not_repeat_is_not_paired(tmp_path: Path) -> None:
    found, _ = wild()
    with pytest.raises(InputError) as refused:
        compare(found, found)
    assert str(refused.value) == f"cannot pair episodes of Wild by their seeds: {DIFFER}"
    env = Wild()
    with pytest.raises(InputError) as refused:
        compare("random", "zero", env, SPEC, SIGNALS, episodes=5)
    assert str(refused.value) == f"cannot pair episodes of Wild by their seeds: {DIFFER}"
    assert env.resets == 2  # before an episode was played
    with pytest.raises(InputError, match="of Wild-v0 by their seeds"):
        compare("random", "zero", "blinking:Wild-v0", SPEC, SIGNALS, episodes=5)
    evaluation(Blink()).save(tmp_path / "a.json")
    older = json.loads((tmp_path / "a.json").read_text())
    del older["repeats"]
    (tmp_path / "a.json").write_text(json.dumps(older))
    loaded = Evaluation.load(tmp_path / "a.json")
    assert len(compare(loaded, loaded, names=("A", "B")).seeds) == 5
    assert len(compare("random", "zero", Blink(), SPEC, SIGNALS, episodes=5).seeds) == 5


def test_the_own_success_of_an_environment_is_counted_beside(tmp_path: Path) -> None:
    found = evaluation(Blink(("success", "is_success")), seed=20)
    ends = [Blink.flags(_length(each.seed))[-1] for each in found.record]
    assert [row.reported for row in found.record] == [bool(each) for each in ends]
    assert found.reported == (sum(ends), 5)
    assert f"is_success of the environment itself: {100 * sum(ends) / 5:.1f}% of" in str(found)
    assert found.record.columns()["is_success"] == [bool(each) for each in ends]
    found.save(tmp_path / "e.json")
    assert Evaluation.load(tmp_path / "e.json").reported == found.reported
    found.record.save(tmp_path / "e.parquet")
    assert type(found.record).load(tmp_path / "e.parquet") == found.record
    silent = evaluation(Blink())
    assert silent.reported is None
    assert "is_success" not in silent.record.columns()
    assert "is_success" not in str(silent)


def _length(seed: int | None) -> int:
    env = Blink()
    env.reset(seed=seed)
    return env.length
