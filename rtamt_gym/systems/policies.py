"""Policies: by name, of trained models, and as `evaluate_policy` takes them.

To add an algorithm for saved models in ``rtamt run``, add a row to `ALGORITHMS`.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import pickle
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile, ZipFile

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array

from rtamt import InputError, InputTypeError, RtamtError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.sources import described
from rtamt_gym.systems.registry import find_object, line_in, module_of
from rtamt_gym.systems.system import Policy, exited

SeededPolicy = Callable[[int], Policy]
"""Makes the policy of an episode from the seed of the episode."""


def policy_of(text: str, env: gym.Env[Any, Any], *, option: str = "--policy") -> SeededPolicy:
    """Make the policy that a text names, for an environment.

    The names are ``random``, ``zero``, ``baseline``, ``sb3:FILE.zip`` (see `load_policy`),
    ``module:function``, a function from observation to action, and ``module:Class``, a class of
    these functions, constructed for each episode.

    Raises:
        InputError: If the text does not name a policy, it cannot be loaded, or it does not fit the
            environment; from the policy, if it raises or returns something else than an action.
    """
    if text in _UNTRAINED:
        return _UNTRAINED[text](env.action_space, option)
    if text == "baseline":
        baseline = getattr(env.unwrapped, "baseline", None)
        if not callable(baseline):
            raise InputError(f"{option} baseline: expected a scenario, which has one, got {env}")
        return lambda _seed: baseline
    kind, colon, remainder = text.partition(":")
    if not (kind and colon and remainder):
        raise InputError(
            f"{option}: expected random, zero, baseline, sb3:FILE.zip or module:function, got "
            f"{text!r}{_meant(text)}"
        )
    if kind == "sb3":
        return load_policy(remainder, env)
    if kind.endswith(".py"):
        raise InputError(
            f"{option}: expected module:function, got the name of a file; write "
            f"{module_of(kind)}:{remainder}"
        )
    target = find_object(kind, remainder)
    if isinstance(target, type):
        make = PolicyClass.of(target, f"{option} {text}")
        return lambda seed: _checked(text, make(seed), env.action_space)
    policy = _checked(text, _function(text, target, option), env.action_space)
    return lambda _seed: policy


@dataclass(frozen=True)
class PolicyClass:
    """A class of policies, with a new instance for each episode."""

    kind: type
    seeded: bool

    @classmethod
    def of(cls, kind: type, name: str) -> PolicyClass:
        """Return the class after a check; errors call it ``name``."""
        if not any("__call__" in vars(base) for base in kind.__mro__):
            way_out = ""
            if hasattr(kind, "predict"):
                way_out = ", or save a model and write sb3:FILE.zip"
            raise InputError(
                f"{name}: expected a class with a method __call__(observation), got none; add "
                f"__call__, which returns the action{way_out}"
            )
        try:
            parameters = inspect.signature(kind).parameters
        except ValueError:  # some classes in C have no signature
            return cls(kind, seeded=False)
        needed = [
            parameter.name
            for parameter in parameters.values()
            if parameter.default is parameter.empty
            and parameter.kind not in {parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD}
            and parameter.name != "seed"
        ]
        if needed:
            raise InputError(
                f"{name}: expected a class with a constructor without arguments, or with seed= "
                f"only, got a constructor that needs {listing(needed)}; write a function in the "
                "module that constructs it and returns the action"
            )
        return cls(kind, seeded="seed" in parameters)

    def __call__(self, seed: int) -> Policy:
        """Return the policy of an episode."""
        policy: Policy = self.kind(seed=seed) if self.seeded else self.kind()
        return policy


def _meant(text: str) -> str:
    if text.endswith(".zip"):
        return f"; write sb3:{text}"
    module = text.rstrip(":")
    if module == "sb3" or not module.replace(".", "").isidentifier():
        return ""
    return (
        nearest(text, [*_UNTRAINED, "baseline"])
        or f"; write {module}:FUNCTION for a function of a module"
    )


def _function(text: str, target: Any, option: str) -> Callable[[Any], Any]:  # noqa: ANN401
    if callable(target):
        function: Callable[[Any], Any] = target
        return function
    way_out = ""
    if hasattr(target, "predict"):
        way_out = "; write a function that returns model.predict(obs, deterministic=True)[0]"
    raise InputError(
        f"{option} {text}: expected a function from observation to action, got {target!r}{way_out}"
    )


def _checked(text: str, function: Callable[[Any], Any], space: spaces.Space[Any]) -> Policy:
    """Wrap a policy: its errors and invalid actions raise errors that name it."""

    def act(obs: Any) -> Any:  # noqa: ANN401
        try:
            action = function(obs)
        except RtamtError:
            raise
        except SystemExit as end:
            where = line_in(str(function.__module__), end)
            raise exited(f"the policy {text}", end, where) from end
        except Exception as error:
            where = line_in(str(function.__module__), error)
            raise InputError(
                f"the policy {text} raised {type(error).__name__}: {error}"
                f"{where or '; it is called with the observation'}"
            ) from error
        if not _fits(action, space):
            raise InputError(
                f"the policy {text} gave {action!r}; expected an action of {described(space)}"
            )
        return action

    return act


def _fits(action: Any, space: spaces.Space[Any]) -> bool:  # noqa: ANN401
    """Return whether a value is an action; other precisions and bounds are not checked."""
    if not isinstance(space, spaces.Box):
        return space.contains(action)
    try:
        return np.asarray(action, np.float64).shape == space.shape
    except (TypeError, ValueError):
        return False


def _random(space: spaces.Space[Any], _option: str) -> SeededPolicy:
    def make_policy(seed: int) -> Policy:
        own = deepcopy(space)  # simultaneous episodes must not share a generator
        own.seed(seed)
        return lambda _obs: own.sample()

    return make_policy


def _zero(space: spaces.Space[Any], option: str) -> SeededPolicy:
    match space:
        case spaces.Box():
            action: Any = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        case spaces.Discrete():
            action = int(space.start)
        case spaces.MultiDiscrete() | spaces.MultiBinary():
            action = np.zeros(space.shape, space.dtype)
        case _:
            raise InputError(f"{option} zero: expected a space of numbers, got {space}")
    return lambda _seed: lambda _obs: action


_UNTRAINED: Mapping[str, Callable[[spaces.Space[Any], str], SeededPolicy]] = {
    "random": _random,
    "zero": _zero,
}
"""Functions that make untrained policies for a space of actions, by name."""


@dataclass(frozen=True)
class Evaluated:
    """A policy to evaluate: its name, and a function from a seed to the policy of an episode."""

    name: str
    make: SeededPolicy | None

    @property
    def identity(self) -> str:
        """The identity of the policy: the weights of a model, the name of a function."""
        if isinstance(self.make, Model):
            draws = "" if self.make.deterministic else ", actions drawn"
            return f"{self.name} {self.make.fingerprint}{draws}"
        return self.name


def evaluated(policy: Any, env: gym.Env[Any, Any], *, deterministic: bool) -> Evaluated:  # noqa: ANN401
    """Return the policy that a caller passes for an environment."""
    if isinstance(policy, Evaluated):
        return policy
    if isinstance(policy, str):
        make: SeededPolicy | None = policy_of(policy, env, option="the policy")
        if isinstance(make, Model):
            make.deterministic = deterministic
        return Evaluated(policy, None if policy == "baseline" else make)
    if hasattr(policy, "predict") and not isinstance(policy, type):
        check_spaces(policy, env, f"the model of {type(policy).__name__}")
        model = Model(policy, deterministic=deterministic)
        return Evaluated(model.name, model)
    if isinstance(policy, type):
        return Evaluated(_name(policy), PolicyClass.of(policy, f"the policy {_name(policy)}"))
    if not callable(policy):
        raise InputTypeError(
            "expected a policy: a model of Stable-Baselines3, a function from observation to "
            "action, a class of these functions, 'random', 'zero', 'baseline' or 'sb3:FILE.zip', "
            f"got {policy!r}"
        )
    return Evaluated(_name(policy), _Same(policy))


def check_name_of_policy(name: object) -> None:
    """Raise InputError unless a name is None or one line of printable text."""
    if name is not None and not (isinstance(name, str) and name.strip() and name.isprintable()):
        raise InputError(
            "expected ", Argument("name"), f" as a text in one line, such as 'before', got {name!r}"
        )


@dataclass(frozen=True)
class _Same:
    """A function that acts in all episodes."""

    function: Callable[..., Any]

    def __call__(self, _seed: int) -> Callable[..., Any]:
        """Return the function."""
        return self.function


def _name(policy: Callable[..., Any]) -> str:
    name = getattr(policy, "__qualname__", None) or type(policy).__qualname__
    return str(name).rpartition("<locals>.")[2]


WITHOUT_TRAINING: Final[Mapping[str, Any]] = {
    "buffer_size": 1,
    "replay_buffer_class": None,
    "replay_buffer_kwargs": {},
}
"""Replacements for the replay memory, which only training needs, when a model is loaded."""


class Model:
    """Makes the policy of an episode from its seed and a model of Stable-Baselines3.

    The model may be any object with ``predict(observation, state, episode_start,
    deterministic=...)`` that returns an action and the next state, for one observation or a batch.
    A recurrent state starts again with every episode. Observations are normalized if the model was
    trained with a ``VecNormalize``. Random actions come from generators of the
    episode; the global generators of Torch and NumPy do not change.

    Attributes:
        deterministic: Whether it returns the best action, and not a random one.
        files: The files that it was loaded from; empty for a model in memory.
    """

    def __init__(
        self,
        model: Any,  # noqa: ANN401 - not imported
        *,
        deterministic: bool = True,
        statistics: Statistics | None = None,
        files: tuple[Path, ...] = (),
    ) -> None:
        self.files = files
        self.name = str(getattr(model, "name", type(model).__name__))
        self.deterministic = deterministic
        self._model = model
        normalizer = statistics or getattr(model, "get_vec_normalize_env", lambda: None)()
        self._shown = (lambda obs: obs) if normalizer is None else normalizer.normalize_obs
        self._statistics = _numbers(getattr(normalizer, "obs_rms", None))

    def __call__(self, seed: int) -> Policy:
        """Return the policy of an episode."""
        dice = None if self.deterministic else _Dice(seed, self._model)
        memory: Any = None
        begins = np.ones(1, np.bool_)

        def act(obs: Any) -> Any:  # noqa: ANN401
            nonlocal memory, begins
            if dice is None:
                action, memory = self._predict(obs, memory, begins)
            else:
                with dice.thrown():
                    action, memory = self._predict(obs, memory, begins)
            begins = np.zeros(1, np.bool_)
            return action

        return act

    def batch(self, space: spaces.Space[Any], count: int) -> PolicyBatch:
        """Return the policy of ``count`` simultaneous episodes; only for a deterministic model."""
        return PolicyBatch(self._predict, space, count)

    @property
    def kind(self) -> type:
        """The class of the model."""
        return type(self._model)

    @property
    def fingerprint(self) -> str:
        """A text that identifies weights and statistics; the name of a model without them."""
        network = getattr(self._model, "policy", None)
        state: Mapping[str, Any] = getattr(network, "state_dict", dict)()
        hashed = hashlib.sha256()
        for name, weights in state.items():
            hashed.update(name.encode())
            hashed.update(np.ascontiguousarray(weights.detach().cpu().numpy()).tobytes())
        hashed.update(self._statistics)
        known = state or self._statistics
        return f"{self.name} {hashed.hexdigest()[:32]}" if known else self.name

    def _predict(self, obs: Any, memory: Any, begins: Any) -> tuple[Any, Any]:  # noqa: ANN401
        result: tuple[Any, Any] = self._model.predict(
            self._shown(obs), memory, begins, deterministic=self.deterministic
        )
        return result

    def __getstate__(self) -> dict[str, Any]:
        """Replace the model by the file that it saves, without the memory for training."""
        state = {**self.__dict__}
        if hasattr(self._model, "save") and hasattr(type(self._model), "load"):
            file = BytesIO()
            self._model.save(file)
            state["_model"] = _File(type(self._model), file.getvalue())
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if isinstance(self._model, _File):
            self._model = self._model.load()


class PolicyBatch:
    """The policy of simultaneous episodes."""

    def __init__(self, predict: Any, space: spaces.Space[Any], count: int) -> None:  # noqa: ANN401
        self._predict = predict
        self._space = space
        self._memory: Any = None
        self._begins = np.ones(count, np.bool_)

    def begin(self, place: int) -> None:
        """Forget the episode of a place: another one starts there."""
        self._begins[place] = True

    def act(self, observations: Sequence[Any]) -> Any:  # noqa: ANN401
        """Return the actions for a list of observations, one per episode."""
        space, count = self._space, len(self._begins)
        room: Any = create_empty_array(space, count)
        return self.of(concatenate(space, observations, room))

    def of(self, observations: Any) -> Any:  # noqa: ANN401
        """Return the actions for a batch of observations."""
        actions, self._memory = self._predict(observations, self._memory, self._begins)
        self._begins = np.zeros_like(self._begins)
        return actions


class Statistics:
    """A ``VecNormalize`` as the bytes of the file that it saves, which workers load again."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        loaded = pickle.loads(content)  # noqa: S301 - as the model is
        self._normalize: Any = loaded.normalize_obs
        self.obs_rms: Any = getattr(loaded, "obs_rms", None)

    def normalize_obs(self, obs: Any) -> Any:  # noqa: ANN401
        """Normalize an observation or a batch."""
        return self._normalize(obs)

    def __reduce__(self) -> tuple[Any, ...]:
        return Statistics, (self._content,)


def _numbers(statistics: Any) -> bytes:  # noqa: ANN401 - of another package
    """Return mean and variance of a ``VecNormalize`` as bytes; empty without one."""
    if statistics is None:
        return b""
    if isinstance(statistics, Mapping):
        return b"".join(key.encode() + _numbers(moment) for key, moment in statistics.items())
    return b"".join(np.asarray(moment).tobytes() for moment in (statistics.mean, statistics.var))


class _File:
    """A model as the bytes of the file that it saves."""

    def __init__(self, kind: Any, content: bytes) -> None:  # noqa: ANN401
        self._kind = kind
        self._content = content

    def load(self) -> Any:  # noqa: ANN401
        replacements = dict(WITHOUT_TRAINING)
        return self._kind.load(BytesIO(self._content), device="cpu", custom_objects=replacements)


class _Dice:
    """The state of one episode's generators of random numbers."""

    def __init__(self, seed: int, model: Any) -> None:  # noqa: ANN401
        self._torch = sys.modules.get("torch")
        # An exploring model also draws from its space of actions.
        self._space = model.action_space if hasattr(model, "exploration_rate") else None
        outside = self._read()
        np.random.seed(seed % 2**32)  # noqa: NPY002 - the generator that models draw from
        if self._torch is not None:
            self._torch.manual_seed(seed)
        self._own = self._read()
        self._set(outside)

    @contextmanager
    def thrown(self) -> Iterator[None]:
        """Draw random numbers from the generators of the episode inside a context."""
        outside = self._read()
        self._set(self._own)
        try:
            if self._space is not None:
                self._space.seed(np.random.randint(2**31))  # noqa: NPY002
            yield
        finally:
            self._own = self._read()
            self._set(outside)

    def _read(self) -> tuple[Any, Any]:
        torch = self._torch
        return np.random.get_state(), None if torch is None else torch.get_rng_state()  # noqa: NPY002

    def _set(self, state: tuple[Any, Any]) -> None:
        np.random.set_state(state[0])  # noqa: NPY002
        if self._torch is not None:
            self._torch.set_rng_state(state[1])


def check_spaces(model: Any, env: gym.Env[Any, Any], name: str) -> None:  # noqa: ANN401
    """Raise InputError if a model was trained in other spaces than an environment has."""
    for which in ("observation", "action"):
        trained, has = getattr(model, f"{which}_space", None), getattr(env, f"{which}_space")
        if trained is None:
            continue
        # Models of images move the channels, so compare sizes.
        if type(trained) is not type(has) or spaces.flatdim(trained) != spaces.flatdim(has):
            raise InputError(
                f"{name} was trained with the {which} space {described(trained)}, and "
                f"{env.spec.id if env.spec else env} has {described(has)}"
            )


ALGORITHMS: dict[str, tuple[str, str, set[str]]] = {
    "RecurrentPPO": ("sb3_contrib", "sb3_contrib.common.recurrent", {"clip_range"}),
    "MaskablePPO": ("sb3_contrib", "sb3_contrib.common.maskable", {"clip_range"}),
    "TRPO": ("sb3_contrib", "", {"cg_max_steps"}),
    "ARS": ("sb3_contrib", "", {"n_delta"}),
    "TQC": ("sb3_contrib", "", {"top_quantiles_to_drop_per_net"}),
    "CrossQ": ("sb3_contrib", "", {"policy_delay", "target_entropy"}),
    "QRDQN": ("sb3_contrib", "", {"n_quantiles"}),
    "TD3": ("stable_baselines3", "", {"policy_delay"}),
    "DDPG": ("stable_baselines3", "", {"policy_delay"}),
    "SAC": ("stable_baselines3", "", {"target_entropy"}),
    "DQN": ("stable_baselines3", "", {"exploration_fraction"}),
    "PPO": ("stable_baselines3", "", {"clip_range"}),
    "A2C": ("stable_baselines3", "", {"gae_lambda"}),
}
"""The package of each algorithm, the module of its policies if that identifies it, and the
attributes that distinguish it from the algorithms below. A file of DDPG is read as TD3, which acts
the same."""


def load_policy(text: str, env: gym.Env[Any, Any]) -> Model:
    """Load ``FILE.zip`` or ``ALGORITHM:FILE.zip``; the policy gives the deterministic action.

    Observations are normalised by the ``VecNormalize`` in ``FILE_vecnormalize.pkl`` in the same
    folder, if it exists. Both files hold pickled Python objects, which can do anything when they
    are loaded.
    """
    # A path may start with the letter of a drive.
    algorithm, file = re.fullmatch(r"(?:([\w.]{2,}):)?(.+)", text, re.DOTALL).groups()  # type: ignore[union-attr]  # it matches any text
    path = Path(file)
    if not path.exists() and path.suffix != ".zip":
        path = path.with_name(f"{path.name}.zip")  # as Stable-Baselines3 adds it
    attributes, policy_module = _read(path)
    name = algorithm or algorithm_of(attributes, policy_module)
    if name is None:
        raise InputError(
            f"the algorithm of {path} is unknown; write sb3:ALGORITHM:{file}, where ALGORITHM is "
            f"{', '.join(ALGORITHMS)} or module.Class"
        )
    model = _load(name, path, attributes, file)
    check_spaces(model, env, str(path))
    normalize = path.with_name(f"{path.stem}_vecnormalize.pkl")
    files = (path, normalize) if normalize.exists() else (path,)
    return Model(model, statistics=_statistics(path, normalize), files=files)


def _statistics(path: Path, normalize: Path) -> Statistics | None:
    """Return the ``VecNormalize`` in a file next to a model; None without this file."""
    if not normalize.exists():
        return None
    content = normalize.read_bytes()
    try:
        return Statistics(content)
    except Exception as error:  # pickled objects can raise anything
        raise InputError(
            f"cannot load {normalize} as the VecNormalize of {path.name}: {type(error).__name__}: "
            f"{error}; expected the file that its save() writes, or none of this name"
        ) from error


def algorithm_of(attributes: Collection[str], policy_module: str) -> str | None:
    """Return the algorithm with these attributes, or None."""
    for name, (_, policies, distinctive) in ALGORITHMS.items():
        if distinctive.issubset(attributes) and policy_module.startswith(policies):
            return name
    return None


def _read(path: Path) -> tuple[Collection[str], str]:
    """Return the names of the attributes in a file, and the module of the policy's class."""
    try:
        with ZipFile(path) as archive:
            data = json.loads(archive.read("data"))
        return data.keys(), str(data["policy_class"].get("__module__"))
    except (BadZipFile, KeyError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is not a model of Stable-Baselines3; expected the file that model.save() "
            "writes"
        ) from error


def _load(name: str, path: Path, attributes: Collection[str], file: str) -> Any:  # noqa: ANN401
    if name == "MaskablePPO":
        raise InputError(
            f"{path} is a model of MaskablePPO, which needs the mask of allowed actions; write a "
            "function that passes the mask, and give --policy module:function"
        )
    algorithm = _class_of(name)
    replacements = {key: value for key, value in WITHOUT_TRAINING.items() if key in attributes}
    try:
        return algorithm.load(path, device="cpu", custom_objects=replacements)
    except Exception as error:
        raise InputError(
            f"cannot load {path} as a model of {name}: {type(error).__name__}: {error}; for a "
            f"model of another algorithm, write sb3:ALGORITHM:{file}"
        ) from error


def _class_of(name: str) -> Any:  # noqa: ANN401
    if name in ALGORITHMS:
        package = ALGORITHMS[name][0]
        if not find_spec(package):
            needed = {"sb3_contrib": "sb3-contrib"}.get(package, "stable-baselines3")
            raise InputError(f"a model of {name} needs {needed}: pip install {needed}")
        return find_object(package, name)
    module, dot, class_name = name.rpartition(".")
    if not dot:
        raise InputError(
            f"expected an algorithm of Stable-Baselines3, {', '.join(ALGORITHMS)}, or "
            f"module.Class, got {name!r}{nearest(name, ALGORITHMS)}"
        )
    kind = find_object(module, class_name)
    if not callable(getattr(kind, "load", None)):
        raise InputError(f"expected a class of models as {name}, got {kind!r}, which cannot load")
    return kind
