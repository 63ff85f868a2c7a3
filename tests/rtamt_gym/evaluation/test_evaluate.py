"""An evaluation counts like a loop by hand, for any way of playing its episodes."""

from __future__ import annotations

import json
import math
import pickle
import warnings
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from walks import SIGNALS, SPECS, Model, Walk, by_hand

from rtamt import InputError, InputTypeError, StateError, Verdict
from rtamt_gym import compare, evaluate_policy
from rtamt_gym.evaluation.sequential import RatioTest, Width
from rtamt_gym.judging.end_warnings import OpenEndWarning
from rtamt_gym.results import Evaluation
from rtamt_gym.results.intervals import IntervalKind, clopper_pearson, promise, wilson


def evaluation(policy: Any = None, env: Any = None, **options: Any) -> Evaluation:  # noqa: ANN401
    chosen: Any = {"episodes": 12, "seed": 3, "at_termination": "complete"} | options
    return evaluate_policy(policy or Model(), env or Walk, SPECS, SIGNALS, **chosen)


@settings(max_examples=examples(15), deadline=None)
@given(
    steps=st.integers(1, 9),
    goal=st.floats(0.2, 4.0),
    seed=st.integers(0, 1000),
    bound=st.floats(-0.5, 2.0),
    window=st.integers(0, 8),
    n_envs=st.integers(1, 4),
)
def test_it_counts_what_a_loop_by_hand_counts(
    steps: int, goal: float, seed: int, bound: float, window: int, n_envs: int
) -> None:
    specs = {"p": f"always(x < {bound})", "q": f"eventually[0:{window * 0.5}](x > {bound})"}
    expected = [by_hand(Walk(steps, goal), seed + i, specs) for i in range(5)]
    found = evaluate_policy(
        Model(),
        lambda: Walk(steps, goal),
        specs,
        SIGNALS,
        episodes=5,
        seed=seed,
        n_envs=n_envs,
        at_termination="complete",
    )
    assert found.returns.tolist() == [each["return"] for each in expected]
    assert found.lengths.tolist() == [each["steps"] * 0.5 for each in expected]
    assert [row.seed for row in found.record] == list(range(seed, seed + 5))
    for name, result in found.requirements.items():
        heights = [each[name][0] for each in expected]
        verdicts = [each[name][1] for each in expected]
        assert result.robustness.tolist() == heights
        assert result.satisfied == verdicts.count(Verdict.SATISFIED)
        assert result.violated == verdicts.count(Verdict.VIOLATED)
        assert result.undecided == verdicts.count(Verdict.UNDECIDED)
        assert result.rate == result.satisfied / 5
        ranked = sorted(zip(verdicts, heights, range(seed, seed + 5), strict=True))
        assert result.worst == tuple((number, height) for _, height, number in ranked)
        (worst,) = found.worst_runs[name]
        assert (worst.seed, worst.histories[name].final) == result.worst[0]
        assert worst.stop == "end"
    both = [each["p"][1] > 0 and each["q"][1] > 0 for each in expected]
    assert found.success.satisfied == sum(both)
    assert found.success.robustness.tolist() == [min(e["p"][0], e["q"][0]) for e in expected]


def test_first_violations_and_what_a_stop_saves_are_in_seconds() -> None:
    whole, stopped = evaluation(episodes=30), evaluation(episodes=30, stop="violation")
    assert len(whole.requirements["low"].first_violations) == whole.requirements["low"].violated > 3
    assert stopped.success.satisfied == whole.success.satisfied
    assert stopped.success.violated == whole.success.violated
    assert whole.success.saved == stopped.success.saved == 0.0  # no time limit is known
    for row in stopped.record:
        ends = [o.decided_at for o in row.outcomes.values() if o.verdict is Verdict.VIOLATED]
        assert row.ended != "violation" or row.simulated in ends


def test_a_violated_episode_is_worse_than_a_satisfied_one_of_less_robustness() -> None:
    found = evaluation(env=lambda: Walk(goal=0.9), episodes=30, at_termination="failure")
    fallen = {
        row.seed: row.outcomes["low"]
        for row in found.record
        if row.outcomes["low"].verdict is Verdict.VIOLATED and row.outcomes["low"].robustness > 0
    }
    low = found.requirements["low"]
    assert fallen
    assert max(each.robustness for each in fallen.values()) > min(
        height
        for row, height in zip(found.record, low.robustness, strict=True)
        if row.outcomes["low"].verdict is Verdict.SATISFIED
    )
    violating = {
        row.seed for row in found.record if row.outcomes["low"].verdict is Verdict.VIOLATED
    }
    assert {seed for seed, _ in low.worst[: len(violating)]} <= violating
    assert found.worst_runs["low"][0].histories["low"].verdict is Verdict.VIOLATED
    assert found.worst_runs["low"][0].seed == low.worst[0][0]
    assert f"{low.robustness.min():.3g}" in str(found)


def test_a_stop_at_all_verdicts_leaves_every_rate_as_it_is() -> None:
    whole = evaluation(episodes=30)
    stopped, early = (
        evaluation(episodes=30, stop="verdicts"),
        evaluation(episodes=30, stop="decided"),
    )
    assert stopped.lengths.sum() < whole.lengths.sum()
    for name, result in whole.requirements.items():
        kept = stopped.requirements[name]
        assert (kept.satisfied, kept.violated) == (result.satisfied, result.violated)
        assert np.array_equal(kept.first_violations, result.first_violations)
    assert any(early.requirements[name].undecided for name in whole.requirements)


@pytest.mark.slow
def test_the_result_does_not_depend_on_how_episodes_are_played(tmp_path: Path) -> None:
    expected = evaluation()
    for options in (
        {"n_envs": 2},
        {"n_envs": 5},
        {"n_envs": 50},
        {"n_jobs": 2, "n_envs": 3},
        {"folder": tmp_path / "f"},
    ):
        assert evaluation(**options) == expected
    assert evaluation(env=Walk()) == expected
    # Finished episodes are not played again.
    assert evaluation(folder=tmp_path / "f", n_envs=3) == expected


def test_a_folder_is_of_one_time_limit_and_of_one_way_to_act(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def again(
        name: str,
        policy: Any,  # noqa: ANN401
        limit: int,
        goal: float = 3.0,
        **options: Any,  # noqa: ANN401
    ) -> Evaluation:
        env = gym.make("Walk-v0", max_episode_steps=limit, goal=goal)
        return evaluation(policy, env, folder=tmp_path / name, episodes=3, **options)

    monkeypatch.setitem(gym.registry, "Walk-v0", EnvSpec("Walk-v0", "tests.support.walks:Walk"))

    way_out = "; give another folder, or remove this one"
    again("limit", "zero", 4)
    with pytest.raises(InputError) as refused:
        again("limit", "zero", 8)
    assert str(refused.value) == (
        f"{tmp_path / 'limit'} holds another campaign: its time limit is 2.0, not 4.0{way_out}"
    )
    again("arguments", "zero", 4, goal=2.0)
    with pytest.raises(InputError) as refused:
        again("arguments", "zero", 4, goal=3.0)
    assert str(refused.value) == (
        f"{tmp_path / 'arguments'} holds another campaign: its arguments of the system is "
        f'{{"goal": 2.0}}, not {{"goal": 3.0}}{way_out}'
    )
    again("acting", Model(), 4)
    with pytest.raises(InputError) as refused:
        again("acting", Model(), 4, deterministic=False)
    assert str(refused.value) == (
        f"{tmp_path / 'acting'} holds another campaign: its policy is "
        f'"Model Model", not "Model Model, actions drawn"{way_out}'
    )


def test_a_random_policy_is_that_of_the_seed_of_the_episode() -> None:
    whole = evaluation("random", episodes=6, seed=0)
    parts = [evaluation("random", episodes=1, seed=seed) for seed in range(6)]
    assert [row for part in parts for row in part.record] == list(whole.record)
    assert len(set(whole.returns)) == 6


def test_an_episode_that_an_error_ends_counts_as_not_satisfied() -> None:
    for n_envs in (1, 4):
        with pytest.warns(UserWarning, match="1 of 12 episodes failed, which counts as not"):
            found = evaluation(env=lambda: Walk(cursed=7), n_envs=n_envs)
        clean = evaluation()
        assert [row for row in found.record if row.seed != 7] == [
            row for row in clean.record if row.seed != 7
        ]
        row = found.record[4]
        assert (row.error, row.ended) == ("ValueError: a cursed step", "error")
        for result in (*found.requirements.values(), found.success):
            assert result.failed == 1
            assert math.isnan(result.robustness[4])
            assert result.satisfied + result.violated + result.undecided + 1 == result.episodes
            assert all(seed != 7 for seed, _ in result.worst)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("options", [{"until_width": 0.5}, {"target": 0.9, "margin": 0.3}])
def test_sequential_stopping_gives_the_shortest_prefix_that_has_the_answer(options: Any) -> None:  # noqa: ANN401
    whole = evaluation(episodes=60)
    rules: dict[str, Any] = {
        name: Width(0.5) if "until_width" in options else RatioTest(0.9, 0.05, 0.3)
        for name in SPECS
    }
    count = 0
    while any(rule.decision is None for rule in rules.values()):
        for name, rule in rules.items():
            rule.add(satisfied=whole.record[count].outcomes[name].verdict is Verdict.SATISFIED)
        count += 1
    assert 1 < count < 60
    for more in ({}, {"n_envs": 7}, {"n_jobs": 2} if "target" in options else {"n_envs": 2}):
        found = evaluation(episodes=60, **options, **more)
        assert found.record == whole.record[:count]
        assert found.decision == {name: rule.decision for name, rule in rules.items()}


def test_a_saved_evaluation_is_the_same_and_holds_its_worst_episodes(tmp_path: Path) -> None:
    found = evaluation(keep=2)
    found.save(tmp_path / "e.json")
    loaded = Evaluation.load(tmp_path / "e.json")
    assert loaded == found == pickle.loads(pickle.dumps(found))
    assert repr(loaded.record.columns()) == repr(found.record.columns())
    json.loads((tmp_path / "e.json").read_text(), parse_constant=pytest.fail)
    seed = found.requirements["low"].worst[1][0]
    assert loaded.replay(seed) == found.replay(seed) == found.worst_runs["low"][1]
    assert str(loaded.replay(seed).explain("low")) == str(found.replay(seed).explain("low"))
    other = next(r.seed for r in found.record if all(r.seed != w.seed for w in _kept(found)))
    assert found.replay(other).seed == other  # type: ignore[arg-type]  # it has one
    with pytest.raises(StateError, match=f"to play episode {other} again; it holds"):
        loaded.replay(other)  # type: ignore[arg-type]  # see above


def _kept(found: Evaluation) -> list[Any]:
    return [run for runs in found.worst_runs.values() for run in runs]


def test_an_open_end_is_told_once_and_only_where_it_settled_something() -> None:
    options: Any = {"episodes": 20, "signals": SIGNALS}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = evaluate_policy("zero", Walk(goal=0.9), {"p": "always(x < 5)"}, **options)
    assert [each.category for each in told] == [OpenEndWarning]
    assert "specification 'p' was open" in str(told[0].message)
    assert found.success.rate == 1.0
    # The last sample reaches the goal: the end decides nothing. Warnings are errors here.
    evaluate_policy("zero", Walk(goal=0.9), {"g": "eventually(abs(x) > 0.9)"}, **options)


def test_an_open_end_that_does_not_come_again_is_not_told() -> None:
    class Once(Walk):
        played: ClassVar[set[int | None]] = set()

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
            if seed in self.played:
                raise ValueError("once is enough")
            self.played.add(seed)
            return super().reset(seed=seed, options=options)

    found = evaluate_policy(
        "zero", Once(goal=0.9), {"p": "always(x < 5)"}, SIGNALS, episodes=20, keep=0
    )  # warnings are errors here
    assert found.success.rate == 1.0


def test_an_episode_that_cannot_begin_has_its_error_in_its_row() -> None:
    class Closed(Walk):
        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
            if seed in (4, 9):
                raise ValueError(f"no {seed}")
            return super().reset(seed=seed, options=options)

    records = []
    for n_envs in (1, 3):
        with pytest.warns(UserWarning, match="2 of 12 episodes failed, .* the first with seed 4: "):
            found = evaluation(env=Closed, n_envs=n_envs, keep=0)
        assert [(row.seed, row.error) for row in found.record if row.error] == [
            (4, "ValueError: no 4"),
            (9, "ValueError: no 9"),
        ]
        records.append(found.record.rows)
    assert records[0] == records[1]


def test_environments_beside_one_that_is_given_are_made_as_its_spec_says() -> None:
    given = gym.make("CartPole-v1")
    options: Any = {"episodes": 4, "at_termination": "complete", "keep": 0}
    found = [
        evaluate_policy(Still(), env, "always(x < 1)", {"x": "obs[0]"}, n_envs=count, **options)
        for env, count in ((given, 3), ("CartPole-v1", 1))
    ]
    assert found[0].record.rows == found[1].record.rows
    given.close()


class Still:
    """A model that never pushes to the right."""

    def predict(self, observation: Any, state: Any, *_: Any, **__: Any) -> tuple[Any, Any]:  # noqa: ANN401
        return np.zeros(len(observation) if np.ndim(observation) > 1 else (), np.int64), state


def test_an_evaluation_is_a_frame_of_its_episodes_and_equals_no_other_thing() -> None:
    found = evaluation(episodes=3)
    frame = found.to_frame()
    assert (frame.index.name, list(frame["seed"])) == ("episode", [3, 4, 5])
    assert found == evaluation(episodes=3)
    assert found != 3


def test_the_table_says_what_stopping_has_saved() -> None:
    options: Any = {"episodes": 2, "stop": "violation", "duration": 6.0}
    found = evaluate_policy("zero", Walk(goal=9.0), "always(x > 4)", SIGNALS, **options)
    assert str(found).splitlines()[-1] == (
        "return 0 on average, length 0 s on average, 12 s saved by stopping"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"episodes": 0}, "expected episodes= as 1 or more, got 0"),
        ({"keep": -1}, "expected keep= as a whole number, 0 or more, got -1"),
        ({"seed": -1}, "expected seed= as a whole number, 0 or more, got -1"),
        (
            {"until_width": 0.1, "target": 0.9},
            "expected one rule, got until_width=0.1 and target=0.9; omit one",
        ),
        ({"policy": "randm"}, "the policy: expected random, zero, baseline, sb3:FILE.zip or "),
        ({"policy": "baseline"}, "the policy baseline: expected a scenario, which has one, got "),
        ({"policy": 3}, "expected a policy: a model of Stable-Baselines3, a function from "),
        ({"env": 3}, "expected the id of an environment, a function that makes one, an "),
        (
            {"n_envs": 2},
            "n_envs=2 needs as many environments, and Walk cannot be constructed again; pass a ",
        ),
    ],
)
def test_mistakes_are_told_before_an_episode_is_played(change: Any, message: str) -> None:  # noqa: ANN401
    given = {"policy": Model(), "env": Walk(), "specs": SPECS, "signals": SIGNALS} | change
    with pytest.raises((InputError, InputTypeError)) as refused:
        evaluate_policy(**given)
    assert str(refused.value).startswith(message)


def test_the_seed_of_no_episode_is_refused() -> None:
    with pytest.raises(InputError) as refused:
        evaluation().replay(99)
    assert str(refused.value) == "expected the seed of an episode, from 3 to 14, got 99"


def test_no_random_number_of_the_program_is_drawn() -> None:
    before = np.random.get_state()[1].tolist()  # type: ignore[index]  # noqa: NPY002
    evaluation("random")
    assert np.random.get_state()[1].tolist() == before  # type: ignore[index]  # noqa: NPY002


def test_the_kind_of_intervals_is_kept_and_old_files_have_wilsons(tmp_path: Path) -> None:
    exact, wilsons = evaluation(), evaluation(interval="wilson")
    assert exact.interval == "exact"
    for found, ends in ((exact, clopper_pearson), (wilsons, wilson)):
        for result in (*found.requirements.values(), found.success):
            assert result.interval == ends(result.satisfied, result.episodes)
        found.save(tmp_path / "e.json")
        loaded = Evaluation.load(tmp_path / "e.json")
        assert loaded == found
        assert loaded.success.interval == found.success.interval
        assert promise(found.interval) in str(found)
        (row, *_) = found.statistics().to_dict("records")
        (first, *_) = found.requirements.values()
        assert (row["low"], row["high"]) == first.interval
        kept = json.loads((tmp_path / "e.json").read_text())
        assert {each["interval_kind"] for each in kept["results"].values()} == {found.interval}
    for each in kept["results"].values():
        del each["interval_kind"]
    (tmp_path / "old.json").write_text(json.dumps(kept))
    assert Evaluation.load(tmp_path / "old.json") == wilsons
    pair = compare(exact, Evaluation.load(tmp_path / "old.json")).success
    assert (pair.interval_a, pair.interval_b) == (exact.success.interval, wilsons.success.interval)
    with pytest.raises(InputError, match="expected interval='exact' or 'wilson', got 'exat'"):
        evaluation(interval="exat")


@pytest.mark.parametrize("kind", ["exact", "wilson"])
def test_an_evaluation_stops_at_the_width_of_its_own_intervals(kind: IntervalKind) -> None:
    found = evaluation(episodes=400, until_width=0.3, interval=kind)
    rules = {name: Width(0.3, kind=kind) for name in found.requirements}
    for row in found.record:
        assert any(rule.decision is None for rule in rules.values())
        for name, rule in rules.items():
            rule.add(row.outcomes[name].verdict is Verdict.SATISFIED)
    assert all(rule.decision == "known to 0.3" for rule in rules.values())
