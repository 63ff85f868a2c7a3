"""Policies that Stable-Baselines3 and sb3-contrib have saved, for the command line.

The file that ``model.save`` writes names the class of the policy, but not of the algorithm, which
is needed to load it. The attributes of the algorithm are there: `ALGORITHMS` says which of
them tell it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import gymnasium as gym

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.simulation.imported import find_object
from rtamt_gym.simulation.models import WITHOUT_TRAINING, Model, Statistics, check_spaces

__all__ = ["ALGORITHMS", "algorithm_of", "load_policy"]

ALGORITHMS: dict[str, tuple[str, str, frozenset[str]]] = {
    name: (module, policies, frozenset(attributes))
    for name, module, policies, attributes in (
        ("RecurrentPPO", "sb3_contrib", "sb3_contrib.common.recurrent", ["clip_range"]),
        ("MaskablePPO", "sb3_contrib", "sb3_contrib.common.maskable", ["clip_range"]),
        ("TRPO", "sb3_contrib", "", ["cg_max_steps"]),
        ("ARS", "sb3_contrib", "", ["n_delta"]),
        ("TQC", "sb3_contrib", "", ["top_quantiles_to_drop_per_net"]),
        ("CrossQ", "sb3_contrib", "", ["policy_delay", "target_entropy"]),
        ("QRDQN", "sb3_contrib", "", ["n_quantiles"]),
        ("TD3", "stable_baselines3", "", ["policy_delay"]),
        ("DDPG", "stable_baselines3", "", ["policy_delay"]),
        ("SAC", "stable_baselines3", "", ["target_entropy"]),
        ("DQN", "stable_baselines3", "", ["exploration_fraction"]),
        ("PPO", "stable_baselines3", "", ["clip_range"]),
        ("A2C", "stable_baselines3", "", ["gae_lambda"]),
    )
}
"""The package of each algorithm, where its policies are defined if that must be known to tell it,
and the attributes that tell it from those below. A file of DDPG is read as one of TD3, of which it
is a case: both act alike."""


def load_policy(text: str, env: gym.Env[Any, Any]) -> Model:
    """Loads ``FILE.zip`` or ``ALGORITHM:FILE.zip``; the policy gives the deterministic action.

    Observations are normalised by the ``VecNormalize`` in ``FILE_vecnormalize.pkl``, if that lies
    beside it. Both files hold pickled Python objects, which can do anything when they are loaded.

    Args:
        text: The path of the file; ahead of it, where the file does not tell the algorithm, its
            name, or ``module.Class``.
        env: The environment whose observations and actions the model must have.

    Returns:
        What makes the policy of an episode.

    Raises:
        InputError: If the file is no model, its algorithm is not known, it or the ``VecNormalize``
            cannot be loaded, or it was trained in other spaces.
        OSError: If the file cannot be opened.
    """
    # A path may begin with the letter of a drive.
    given, file = re.fullmatch(r"(?:([\w.]{2,}):)?(.+)", text, re.DOTALL).groups()  # type: ignore[union-attr]  # it matches any text
    path = Path(file)
    if not path.exists() and path.suffix != ".zip":
        path = path.with_name(f"{path.name}.zip")  # as Stable-Baselines3 does
    attributes, policy_module = _read(path)
    name = given or algorithm_of(attributes, policy_module)
    if name is None:
        raise InputError(
            f"{path} does not tell its algorithm; write sb3:ALGORITHM:{file}, where ALGORITHM is "
            f"{', '.join(ALGORITHMS)} or module.Class"
        )
    model = _load(name, path, attributes, file)
    check_spaces(model, env, str(path))
    beside = path.with_name(f"{path.stem}_vecnormalize.pkl")
    files = (path, beside) if beside.exists() else (path,)
    return Model(model, statistics=_statistics(path, beside), files=files)


def _statistics(path: Path, beside: Path) -> Statistics | None:
    """Return the ``VecNormalize`` in a file next to a model; None if there is no such file."""
    if not beside.exists():
        return None
    held = beside.read_bytes()
    try:
        return Statistics(held)
    except Exception as error:  # whatever the pickled objects raise
        raise InputError(
            f"cannot load {beside} as the VecNormalize of {path.name}: {type(error).__name__}: "
            f"{error}; expected the file that its save() writes, or none of this name"
        ) from error


def algorithm_of(attributes: Collection[str], policy_module: str) -> str | None:
    """The name of the algorithm that has some attributes; None if it is not known.

    Args:
        attributes: The names of the attributes that were saved.
        policy_module: The name of the module that defines the class of the policy.
    """
    for name, (_, policies, telling) in ALGORITHMS.items():
        if telling.issubset(attributes) and policy_module.startswith(policies):
            return name
    return None


def _read(path: Path) -> tuple[Collection[str], str]:
    """The names of the attributes that a file holds, and the module of the policy's class."""
    try:
        with ZipFile(path) as archive:
            held = json.loads(archive.read("data"))
        return held.keys(), str(held["policy_class"].get("__module__"))
    except (BadZipFile, KeyError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is no model of Stable-Baselines3; expected the file that model.save() writes"
        ) from error


def _load(name: str, path: Path, attributes: Collection[str], file: str) -> Any:  # noqa: ANN401
    if name == "MaskablePPO":
        raise InputError(
            f"{path} is a model of MaskablePPO, which needs to be told the actions that are "
            "allowed; write a function that does, and --policy module:function"
        )
    found = _class_of(name)
    instead = {key: value for key, value in WITHOUT_TRAINING.items() if key in attributes}
    try:
        return found.load(path, device="cpu", custom_objects=instead)
    except Exception as error:
        raise InputError(
            f"cannot load {path} as a model of {name}: {type(error).__name__}: {error}; if it is "
            f"one of another algorithm, write sb3:ALGORITHM:{file}"
        ) from error


def _class_of(name: str) -> Any:  # noqa: ANN401
    if name in ALGORITHMS:
        package = ALGORITHMS[name][0]
        if not find_spec(package):
            needed = {"sb3_contrib": "sb3-contrib"}.get(package, "stable-baselines3")
            raise InputError(f"a model of {name} needs {needed}: pip install {needed}")
        return find_object(package, name)
    module, dot, of = name.rpartition(".")
    if not dot:
        raise InputError(
            f"expected an algorithm of Stable-Baselines3, {', '.join(ALGORITHMS)}, or "
            f"module.Class, got {name!r}{nearest(name, ALGORITHMS)}"
        )
    found = find_object(module, of)
    if not callable(getattr(found, "load", None)):
        raise InputError(f"expected a class of models as {name}, got {found!r}, which cannot load")
    return found
