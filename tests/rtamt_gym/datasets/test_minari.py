"""`relabel` writes new datasets of Minari, part by part."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import minari
import numpy as np
import pytest
from minari.data_collector import EpisodeBuffer
from recordings import Raw, difference, monitored, record

from rtamt.errors import InputError, InputTypeError
from rtamt_gym import relabel
from rtamt_gym.datasets import relabel as module

SPECS = {
    "upright": "always(abs(angle) < 0.1)",
    "back": "always(x > 0.1 implies eventually[0:0.1](x < 0.1))",
}
SIGNALS = {"angle": "obs[2]", "x": "obs[0]"}
OPTIONS: dict[str, Any] = {"at_termination": "complete", "mode": "add", "cost": "violation"}


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the empty folder of all datasets."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


def episodes(count: int = 12) -> tuple[list[Raw], list[Raw]]:
    env = monitored(gym.make("CartPole-v1", max_episode_steps=40), SPECS, SIGNALS, **OPTIONS)
    env.action_space.seed(1)
    pairs = [record(env, seed, lambda _: env.action_space.sample()) for seed in range(count)]
    return [raw for raw, _ in pairs], [message for _, message in pairs]


@pytest.fixture
def carts() -> Any:  # noqa: ANN401 - Minari is not typed
    raw, _ = episodes()
    return dataset_of(raw)


def dataset_of(raw: list[Raw], name: str = "cart/random-v0", **options: Any) -> Any:  # noqa: ANN401
    with pytest.warns(UserWarning, match="is set to None"):
        return minari.create_dataset_from_buffers(
            name,
            [EpisodeBuffer(**each) for each in raw],
            env="CartPole-v1",
            author="A. Nonym",
            author_email="a@example.org",
            code_permalink="https://example.org",
            description="Random carts.",
            ref_min_score=1.0,
            ref_max_score=500.0,
            **options,
        )


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("samples", [1, 60, 1 << 18])
@pytest.mark.parametrize("data_format", ["hdf5", "arrow"])
def test_new_dataset_equals_online_monitors(
    monkeypatch: pytest.MonkeyPatch, samples: int, data_format: str
) -> None:
    monkeypatch.setattr(module, "SAMPLES", samples)
    raw, message = episodes()
    source = dataset_of(raw, data_format=data_format)
    made = relabel(source, SPECS, SIGNALS, dataset_id="cart/added-v0", **OPTIONS)
    assert isinstance(made, minari.MinariDataset)
    assert (made.id, made.total_episodes, made.total_steps) == (
        "cart/added-v0",
        source.total_episodes,
        source.total_steps,
    )
    again = minari.load_dataset("cart/added-v0")
    for result, old, expected in zip(again, source, message, strict=True):
        assert np.array_equal(result.observations, old.observations)
        assert np.array_equal(result.actions, old.actions)
        assert np.array_equal(result.rewards, expected["rewards"])
        assert np.array_equal(result.infos["reward"][1:], old.rewards)
        for key in ("robustness", "stl_lower", "stl_upper", "stl_violated", "cost", "stl_success"):
            assert np.array_equal(result.infos[key], expected[key])
    assert difference(relabel(source, SPECS, SIGNALS, **OPTIONS), message) == ""


def test_metadata_of_a_new_dataset(carts: Any) -> None:  # noqa: ANN401
    made = relabel(carts, SPECS, SIGNALS, dataset_id="cart/satisfied-v0", keep="satisfied")
    old, new = carts.storage.metadata, made.storage.metadata
    assert new["rtamt"] == {
        "specs": {
            name: text.replace("x > 0.1 implies", "x > 0.1 implies") for name, text in SPECS.items()
        },
        "signals": SIGNALS,
        "mode": None,
        "period": 0.02,
    }
    for key in (
        "author",
        "author_email",
        "description",
        "env_spec",
        "ref_max_score",
        "data_format",
    ):
        assert new[key] == old[key]
    assert made.env_spec == carts.env_spec
    assert made.recover_environment().spec.id == "CartPole-v1"
    shaping: Any = {"mode": "terminal", "clip": 2.0, "weights": {"back": 0.25}}
    shaped = relabel(carts, SPECS, SIGNALS, dataset_id="cart/shaped-v0", **shaping)
    message = shaped.storage.metadata
    assert "ref_max_score" not in message
    assert {name: message["rtamt"][name] for name in shaping} == shaping


@pytest.mark.parametrize("data_format", ["hdf5", "arrow"])
def test_details_of_every_specification_are_kept(data_format: str) -> None:
    source = dataset_of(episodes(3)[0], data_format=data_format)
    relabel(source, SPECS, SIGNALS, dataset_id="cart/told-v0", details=True, **OPTIONS)
    relabelled = relabel(source, SPECS, SIGNALS, details=True, **OPTIONS)
    for result, expected in zip(minari.load_dataset("cart/told-v0"), relabelled, strict=True):
        stl = result.infos["stl"]
        for name in SPECS:
            for key in ("robustness", "lower", "upper"):
                if data_format == "arrow":  # Minari reads a mapping for each sample
                    values = [each[name][key] for each in stl]
                else:
                    values = stl[name][key]
                assert np.array_equal(values, expected.infos["stl"][name][key])


def test_satisfied_episodes_keep_seeds(carts: Any) -> None:  # noqa: ANN401
    made = relabel(carts, SPECS, SIGNALS, dataset_id="cart/satisfied-v0", keep="satisfied")
    kept = relabel(carts, SPECS, SIGNALS, keep="satisfied")
    assert 0 < len(kept) < carts.total_episodes
    seeds = [message["seed"] for message in made.storage.get_episode_metadata(made.episode_indices)]
    assert seeds == [each.seed for each in kept]
    env = gym.make("CartPole-v1")
    for seed, episode in zip(seeds, made, strict=True):
        obs, _ = env.reset(seed=seed)
        assert np.array_equal(obs, episode.observations[0])
        assert episode.infos["stl_success"][-1]
    again = minari.load_dataset("cart/satisfied-v0")
    assert len(again.filter_episodes(lambda each: each.infos["stl_success"][-1])) == len(kept)


def test_datasets_from_parts_and_lists(carts: Any) -> None:  # noqa: ANN401
    whole = relabel(carts, SPECS, SIGNALS)
    short = carts.filter_episodes(lambda each: len(each) < 20)
    made = relabel(short, SPECS, SIGNALS, dataset_id="cart/short-v0")
    expected = [each for each in whole if len(each) < 20]
    assert [len(each) for each in made] == [len(each) for each in expected]
    for left, right in zip(made, expected, strict=True):
        assert np.array_equal(left.infos["robustness"], right.infos["robustness"])

    raw, _ = episodes(3)
    made = relabel(raw, SPECS, SIGNALS, dataset_id="cart/list-v0", period=0.02)
    assert made.env_spec is None
    assert made.observation_space.shape == (4,)
    assert [len(each) for each in made] == [len(each["rewards"]) for each in raw]


def test_observations_that_are_dictionaries_stay_so() -> None:
    space = gym.spaces.Dict(a=gym.spaces.Box(-9, 9, (2,)), b=gym.spaces.Discrete(3))
    observations = {"a": np.ones((4, 2), np.float32), "b": np.array([0, 1, 2, 0])}
    flags = {"terminations": np.zeros(3, bool), "truncations": np.array([False, False, True])}
    raw = {
        "observations": observations,
        "actions": np.zeros((3, 1)),
        "rewards": np.ones(3),
        **flags,
    }
    with pytest.warns(UserWarning, match="is set to None|env_spec is None"):
        source = minari.create_dataset_from_buffers(
            "dict-v0",
            [EpisodeBuffer(**raw)],
            observation_space=space,
            action_space=gym.spaces.Box(-1, 1, (1,)),
        )
    signals = {"a": "obs['a'][1]", "b": "obs['b']"}
    made = relabel(source, "always(a > b)", signals, dataset_id="dict/made-v0")
    (result,) = made
    assert result.infos["robustness"].tolist() == [1.0, 0.0, -1.0, -1.0]
    assert np.array_equal(result.observations["b"], observations["b"])


def test_after_an_error_nothing_is_written(carts: Any, root: Path, monkeypatch: Any) -> None:  # noqa: ANN401
    monkeypatch.setattr(module, "SAMPLES", 30)
    before = sorted(root.rglob("*"))

    def fails(episode: Any) -> bool:  # noqa: ANN401
        if episode.number == 9:
            raise RuntimeError
        return True

    with pytest.raises(RuntimeError):
        relabel(carts, SPECS, SIGNALS, dataset_id="cart/new-v0", keep=fails)
    with pytest.raises(InputError) as none:
        relabel(carts, SPECS, SIGNALS, dataset_id="cart/new-v0", keep=lambda _: False)
    assert str(none.value) == (
        "no episode is left for 'cart/new-v0': there are no episodes, or keep= rejects all; no "
        "dataset was written"
    )
    with pytest.raises(InputError) as taken:
        relabel(carts, SPECS, SIGNALS, dataset_id="cart/random-v0")
    assert str(taken.value) == (
        "expected dataset_id= as a new name, got 'cart/random-v0', which is in "
        f"{root / 'cart' / 'random-v0'}; choose another name, or call "
        "minari.delete_dataset('cart/random-v0')"
    )
    for name in ("no version", "cart"):
        with pytest.raises(InputError) as wrong:
            relabel(carts, SPECS, SIGNALS, dataset_id=name)
        assert str(wrong.value) == (
            f'expected dataset_id= as Minari writes names, such as "cart/safe-v0", got {name!r}'
        )
    assert sorted(root.rglob("*")) == before


def test_the_name_of_a_dataset_is_no_dataset() -> None:
    with pytest.raises(InputTypeError) as name:
        relabel("cart/random-v0", SPECS, SIGNALS, period=1)
    assert str(name.value) == (
        "expected a dataset of Minari or an iterable of episodes, got cart/random-v0; load it: "
        "minari.load_dataset(...)"
    )


def test_period_of_the_dataset_environment(carts: Any, root: Path) -> None:  # noqa: ANN401
    given = relabel(carts, SPECS, SIGNALS, period=0.02)
    read = relabel(carts, SPECS, SIGNALS)
    assert [each.outcomes for each in given] == [each.outcomes for each in read]
    path = root / "cart" / "random-v0" / "data" / "metadata.json"
    message = json.loads(path.read_text())
    message["env_spec"] = message["env_spec"].replace("CartPoleEnv", "NoEnv")
    path.write_text(json.dumps(message))
    lost = minari.load_dataset("cart/random-v0")
    with pytest.raises(AttributeError) as missing:
        relabel(lost, SPECS, SIGNALS)
    assert missing.value.__notes__ == [
        "when the environment of the dataset was made, to read its period;",
        "give period=, which needs none",
    ]
    assert len(relabel(lost, SPECS, SIGNALS, period=0.02)) == 12


def test_without_minari_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    raw = {
        "observations": np.ones((2, 1)),
        "actions": np.zeros((1, 1)),
        "rewards": np.ones(1),
        "terminations": np.array([True]),
        "truncations": np.array([False]),
    }
    with pytest.raises(ModuleNotFoundError) as extra:
        relabel([raw], "always(x > 0)", {"x": "obs[0]"}, dataset_id="a-v0")
    assert str(extra.value) == (
        "relabel(dataset_id=) needs minari, which is not installed; from the checkout: "
        "pip install '.[minari]'"
    )
    assert relabel([raw], "always(x > 0)", {"x": "obs[0]"})[0].satisfied
