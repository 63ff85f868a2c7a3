"""A model saved by Stable-Baselines3: the content of the file identifies its algorithm."""

from __future__ import annotations

import json
import pickle
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from zipfile import ZipFile

import gymnasium as gym
import numpy as np
import pytest

from rtamt import InputError
from rtamt_gym.systems import policies
from rtamt_gym.systems.policies import Statistics, policy_of

# The arguments of the constructors, which the files contain, as listed in the manuals.
ALL = "gamma learning_rate seed verbose use_sde observation_space action_space n_envs"
ON_POLICY = f"{ALL} n_steps gae_lambda ent_coef vf_coef max_grad_norm normalize_advantage"
CLIPPED = f"{ON_POLICY} batch_size n_epochs clip_range clip_range_vf target_kl"
OFF_POLICY = f"{ALL} buffer_size learning_starts batch_size tau train_freq gradient_steps"
REPLAYED = f"{OFF_POLICY} replay_buffer_class replay_buffer_kwargs optimize_memory_usage"
Q_LEARNING = f"{REPLAYED} target_update_interval exploration_fraction exploration_initial_eps"
ENTROPY = f"{REPLAYED} ent_coef target_entropy"
DELAYED = f"{REPLAYED} policy_delay target_policy_noise target_noise_clip"

PACKAGES = {
    "stable_baselines3": ("A2C", "PPO", "DQN", "SAC", "TD3", "DDPG"),
    "sb3_contrib": ("RecurrentPPO", "MaskablePPO", "TRPO", "ARS", "TQC", "CrossQ", "QRDQN"),
}
COMMON = "stable_baselines3.common.policies"
FILES = {
    "A2C": (ON_POLICY, COMMON),
    "PPO": (CLIPPED, COMMON),
    "DQN": (Q_LEARNING, "stable_baselines3.dqn.policies"),
    "SAC": (f"{ENTROPY} target_update_interval", "stable_baselines3.sac.policies"),
    "TD3": (DELAYED, "stable_baselines3.td3.policies"),
    "RecurrentPPO": (CLIPPED, "sb3_contrib.common.recurrent.policies"),
    "TRPO": (f"{ON_POLICY} batch_size cg_max_steps cg_damping target_kl", COMMON),
    "ARS": (f"{ALL} n_delta n_top delta_std_schedule zero_policy", "sb3_contrib.ars.policies"),
    "TQC": (f"{ENTROPY} top_quantiles_to_drop_per_net", "sb3_contrib.tqc.policies"),
    "CrossQ": (f"{ENTROPY} policy_delay", "sb3_contrib.crossq.policies"),
    "QRDQN": (f"{Q_LEARNING} n_quantiles", "sb3_contrib.qrdqn.policies"),
}


class Model:
    """Stands for a model: adds its memory to the observation, for an action."""

    loaded: tuple[Any, ...] = ()

    @classmethod
    def load(cls, path: Path, **options: Any) -> Model:  # noqa: ANN401
        Model.loaded = (cls.__name__, path.name, options)
        if "broken" in path.name:
            raise RuntimeError("the weights have another shape")
        return cls()

    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float32)
    action_space = gym.spaces.Discrete(2)

    def predict(self, obs: Any, state: Any, episode_start: Any, deterministic: Any) -> Any:  # noqa: ANN401
        assert deterministic is True
        assert episode_start.tolist() == [state is None]
        count = 0 if state is None else state
        return np.array((int(obs[0]) + count) % 2), count + 1


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with packages that have the algorithms of the table."""
    monkeypatch.chdir(tmp_path)
    for name, classes in PACKAGES.items():
        package = ModuleType(name)
        package.__spec__ = ModuleSpec(name, None)
        package.__dict__.update({item: type(item, (Model,), {}) for item in classes})
        monkeypatch.setitem(sys.modules, name, package)


def write(file: str, attributes: str, module: str = COMMON) -> str:
    held = dict.fromkeys(attributes.split()) | {"policy_class": {"__module__": module}}
    with ZipFile(file, "w") as archive:
        archive.writestr("data", json.dumps(held))
    return file


def cart_pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1")


def refusal(text: str) -> str:
    with pytest.raises(InputError) as refused:
        policy_of(text, cart_pole())
    return str(refused.value)


@pytest.mark.parametrize("name", FILES)
def test_the_algorithm_is_told_by_the_attributes_that_were_saved(name: str) -> None:
    attributes, module = FILES[name]
    write("best.zip", attributes, module)
    for text in ("sb3:best.zip", "sb3:best", f"sb3:{Path.cwd() / 'best'}"):
        policy_of(text, cart_pole())
        algorithm, file, options = Model.loaded
        assert (algorithm, file, options["device"]) == (name, "best.zip", "cpu")
        # Memory for the steps of a training is not used.
        expected: dict[str, Any] = {
            "buffer_size": 1,
            "replay_buffer_class": None,
            "replay_buffer_kwargs": {},
        }
        off_policy = "buffer_size" in attributes
        assert options["custom_objects"] == (expected if off_policy else {})


@pytest.mark.parametrize("name", ["A2C", "PPO", "DQN", "SAC", "TD3", "TRPO", "TQC", "CrossQ"])
def test_a_policy_class_of_the_user_hides_no_algorithm(name: str) -> None:
    policy_of(f"sb3:{write('own.zip', FILES[name][0], 'my_policies')}", cart_pole())
    assert Model.loaded[0] == name


def test_every_algorithm_of_the_table_is_tested_and_known() -> None:
    assert {*FILES, "DDPG", "MaskablePPO"} == set(policies.ALGORITHMS)
    assert {name: row[0] for name, row in policies.ALGORITHMS.items()} == {
        name: package for package, names in PACKAGES.items() for name in names
    }


def test_the_algorithm_may_be_given() -> None:
    write("odd.zip", ALL)
    for text, name in (("SAC", "SAC"), ("DDPG", "DDPG"), ("sb3_contrib.TQC", "TQC")):
        policy_of(f"sb3:{text}:odd.zip", cart_pole())
        assert Model.loaded[:2] == (name, "odd.zip")


def test_a_policy_remembers_during_an_episode_and_forgets_between_episodes() -> None:
    make_policy = policy_of(f"sb3:{write('best.zip', CLIPPED)}", cart_pole())
    first, second = make_policy(0), make_policy(1)
    obs = np.zeros(4)
    assert [first(obs).item() for _ in range(3)] == [0, 1, 0]
    assert [second(obs).item() for _ in range(2)] == [0, 1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "sb3:odd.zip",
            (
                "the algorithm of odd.zip is unknown; write sb3:ALGORITHM:odd.zip, where ALGORITHM "
                f"is {', '.join(policies.ALGORITHMS)} or module.Class"
            ),
        ),
        (
            "sb3:SAK:odd.zip",
            (
                f"expected an algorithm of Stable-Baselines3, {', '.join(policies.ALGORITHMS)}, or "
                "module.Class, got 'SAK'; did you mean 'SAC'?"
            ),
        ),
        ("sb3:json.dumps:odd.zip", "expected a class of models as json.dumps, got "),
        (
            "sb3:text.zip",
            (
                "text.zip is not a model of Stable-Baselines3; expected the file that model.save() "
                "writes"
            ),
        ),
        (
            "sb3:other.zip",
            (
                "other.zip is not a model of Stable-Baselines3; expected the file that "
                "model.save() writes"
            ),
        ),
        (
            "sb3:list.zip",
            (
                "list.zip is not a model of Stable-Baselines3; expected the file that model.save() "
                "writes"
            ),
        ),
        (
            "sb3:broken.zip",
            (
                "cannot load broken.zip as a model of PPO: RuntimeError: the weights have another "
                "shape; for a model of another algorithm, write sb3:ALGORITHM:broken.zip"
            ),
        ),
        (
            "sb3:masked.zip",
            (
                "masked.zip is a model of MaskablePPO, which needs the mask of allowed actions; "
                "write a function that passes the mask, and give --policy module:function"
            ),
        ),
    ],
)
def test_what_is_no_model_is_refused_with_the_way_out(text: str, message: str) -> None:
    write("odd.zip", ALL)
    write("broken.zip", CLIPPED)
    write("masked.zip", CLIPPED, "sb3_contrib.common.maskable.policies")
    Path("text.zip").write_text("a model")
    with ZipFile("other.zip", "w") as archive:
        archive.writestr("notes", "none")
    with ZipFile("list.zip", "w") as archive:
        archive.writestr("data", "[1]")
    assert refusal(text).startswith(message)


@pytest.mark.parametrize(
    ("attribute", "space", "message"),
    [
        (
            "observation_space",
            gym.spaces.Box(-1, 1, (3,), np.float32),
            (
                "best.zip was trained with the observation space Box(shape=(3,), dtype=float32), "
                "and CartPole-v1 has Box(shape=(4,), dtype=float32)"
            ),
        ),
        (
            "action_space",
            gym.spaces.Discrete(3),
            (
                "best.zip was trained with the action space Discrete(3), and CartPole-v1 has "
                "Discrete(2)"
            ),
        ),
    ],
)
def test_a_model_of_another_environment_is_refused(
    monkeypatch: pytest.MonkeyPatch, attribute: str, space: gym.spaces.Space[Any], message: str
) -> None:
    monkeypatch.setattr(Model, attribute, space)
    assert refusal(f"sb3:{write('best.zip', CLIPPED)}") == message


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies, "find_spec", lambda _name: None)
    assert refusal(f"sb3:{write('t.zip', *FILES['TRPO'])}") == (
        "a model of TRPO needs sb3-contrib: pip install sb3-contrib"
    )
    assert refusal(f"sb3:{write('p.zip', CLIPPED)}") == (
        "a model of PPO needs stable-baselines3: pip install stable-baselines3"
    )


class Normalizer:
    """Stands for a `VecNormalize`, which cannot be pickled again after loading."""

    shift = 0

    def __init__(self, shift: int) -> None:
        self.shift = shift
        self.obs_rms: Any = None
        self.venv = "of the training"

    def __getstate__(self) -> dict[str, Any]:
        state = {**self.__dict__}
        del state["venv"]
        return state

    def normalize_obs(self, obs: Any) -> Any:  # noqa: ANN401
        return obs + self.shift


def test_the_statistics_that_lie_beside_a_model_normalise_what_it_sees() -> None:
    write("best.zip", CLIPPED)
    env, obs = cart_pole(), np.zeros(4)
    assert policy_of("sb3:best.zip", env)(0)(obs) == 0
    Path("best_vecnormalize.pkl").write_bytes(pickle.dumps(Normalizer(1)))
    for text in ("sb3:best.zip", "sb3:best", f"sb3:PPO:{Path.cwd() / 'best.zip'}"):
        made = policy_of(text, env)
        act = made(0)
        assert [int(act(obs)) for _ in range(3)] == [1, 0, 1]


def test_statistics_that_were_loaded_go_to_workers() -> None:
    held = pickle.dumps(Normalizer(2))
    normalize = pickle.loads(pickle.dumps(Statistics(held).normalize_obs))
    assert normalize(1) == 3


def test_models_with_other_statistics_are_told_apart() -> None:
    def fingerprint(*means: float) -> str:
        normalizer = Normalizer(1)
        seen = {str(i): SimpleNamespace(mean=mean, var=1.0) for i, mean in enumerate(means)}
        normalizer.obs_rms = seen if len(seen) > 1 else seen.get("0")
        statistics = Statistics(pickle.dumps(normalizer))
        return policies.Model(SimpleNamespace(name="PPO"), statistics=statistics).fingerprint

    result = [fingerprint(), fingerprint(0.0), fingerprint(0.5), fingerprint(0.5, 0.0)]
    assert result[0] == "PPO"
    assert len(set(result)) == 4
    assert fingerprint(0.5, 0.0) == result[3]


def test_statistics_that_cannot_be_loaded_are_refused() -> None:
    write("best.zip", CLIPPED)
    Path("best_vecnormalize.pkl").write_bytes(pickle.dumps([1.0]))
    assert refusal("sb3:best.zip") == (
        "cannot load best_vecnormalize.pkl as the VecNormalize of best.zip: AttributeError: "
        "'list' object has no attribute 'normalize_obs'; expected the file that its save() "
        "writes, or none of this name"
    )
