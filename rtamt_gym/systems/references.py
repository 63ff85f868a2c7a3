"""References to systems in files: ids of environments, paths of FMUs, objects of modules.

To add a system that a saved case can name, such as ``{"fmus": ...}``: a branch of `system_name` and
of `named_system`, a text in `system_texts`, and an entry of ``KINDS`` in
``tests/rtamt_gym/play/test_saved_cases.py``.
"""

from __future__ import annotations

import inspect
import json
import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import gymnasium as gym

from rtamt import InputError
from rtamt_gym.checks.names import listing
from rtamt_gym.systems.fingerprints import made_by
from rtamt_gym.systems.fmi import Fmus
from rtamt_gym.systems.registry import PACKAGES, find_object, make, package_of
from rtamt_gym.systems.system import no_exit

_KNOWN: Final = ("gymnasium", *PACKAGES.values())
"""Packages with environments that `make` finds by id."""

_WAY_OUT: Final = (
    'write save(path, system="module:name"), which names an object of a module, or a function '
    "without arguments that makes the system"
)


def system_name(system: Any, folder: Path) -> dict[str, Any]:  # noqa: ANN401
    """Return the reference to a system that a file stores; `named_system` is the inverse."""
    if isinstance(system, gym.Env):
        return _environment_name(system)
    if isinstance(system, Fmus):
        return _fmus_name(system, folder)
    path = import_path(system)
    if path is None:
        phrase = getattr(system, "__qualname__", None) or f"a {type(system).__name__}"
        if isinstance(system, tuple | list):  # no other pair can run
            phrase = "a pair (model, data)"
        raise InputError(
            f"cannot save a case of {phrase}, which no other program can import; {_WAY_OUT}"
        )
    return {"object": path}


def named_system(name: Mapping[str, Any], folder: Path) -> Any:  # noqa: ANN401
    """Return the system of a reference.

    Modules are found on Python's path, in the working directory and, from now on, in the folder of
    the file.
    """
    path_entry = str(folder.resolve())
    if path_entry not in sys.path:
        sys.path.append(path_entry)
    match {**name}:
        case {"environment": str(env_id), **rest} if set(rest) <= {"arguments", "steps"}:
            return make(env_id, rest.get("steps"), rest.get("arguments"))
        case {"fmus": dict(paths), **rest}:
            return Fmus({key: folder / path for key, path in paths.items()}, **rest)
        case {"object": str(path), **rest} if not rest:
            return named_object(path)
    raise InputError(
        "expected a system as {'environment': 'CartPole-v1'}, {'object': 'module:name'} or "
        f"{{'fmus': {{'plant': 'plant.fmu'}}}}, got {dict(name)!r}"
    )


def named_object(path: str) -> Any:  # noqa: ANN401
    """Return the object ``module:name``, or the result of a function without arguments.

    A generator function is itself a system.
    """
    module, _, name = path.partition(":")
    if not (module and name):
        raise InputError(f"expected module:name, got {path!r}")
    target = find_object(module, name)
    if (
        callable(target)
        and not inspect.isgeneratorfunction(target)
        and not _takes_arguments(target)
    ):
        with no_exit(path):
            system = target()
        made_by(system, target)
        return system
    return target


def system_texts(name: Mapping[str, Any]) -> list[str]:
    """Return the modules and files that `named_system` imports or loads for a reference.

    Example:
        >>> system_texts({"object": "os:abort"}), system_texts({"environment": "CartPole-v1"})
        (['os'], ['gymnasium (CartPole-v1)'])
    """
    match {**name}:
        case {"environment": str(env_id)}:
            return [f"{package_of(env_id)} ({env_id.rpartition(':')[2]})"]
        case {"fmus": dict(paths)}:
            return [str(path) for path in paths.values()]
        case {"object": str(path)}:
            return [path.partition(":")[0]]
    return []


def policy_text(policy: str) -> str:
    """Return the code that a policy imports or unpickles; empty for built-in policies.

    Example:
        >>> policy_text("pilot:steer"), policy_text("zero"), policy_text("sb3:PPO:model.zip")
        ('pilot', '', 'PPO:model.zip, which is unpickled')
    """
    kind, _, remainder = policy.partition(":")
    if not remainder:
        return ""
    return f"{remainder}, which is unpickled" if kind == "sb3" else kind


def import_path(thing: object) -> str | None:
    """Return the name ``module:name`` that imports an object, or None."""
    module, name = getattr(thing, "__module__", None), getattr(thing, "__qualname__", None)
    if not (isinstance(module, str) and isinstance(name, str)):
        return None
    target: Any = sys.modules.get(module)
    for part in name.split("."):
        target = getattr(target, part, None)
    if target is not thing:
        return None
    if module == "__main__":
        module = _script()
    return f"{module}:{name}" if module else None


def _script() -> str:
    """Return the module name of the main program; empty if it has no file, as in a console."""
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    if spec is not None:  # python -m
        return str(spec.name)
    path = Path(getattr(main, "__file__", None) or "")
    return path.stem if path.suffix == ".py" else ""


def _takes_arguments(function: Callable[..., object]) -> bool:
    with suppress(ValueError):  # some functions in C have no signature
        return bool(inspect.signature(function).parameters)
    return True


def _environment_name(env: gym.Env[Any, Any]) -> dict[str, Any]:
    spec = env.spec
    registered = None if spec is None else gym.registry.get(spec.id)
    if spec is None or registered is None:
        raise InputError(
            f"cannot save a case of {type(env.unwrapped).__name__}, which was not made by "
            f"gymnasium.make; {_WAY_OUT}"
        )
    if spec.additional_wrappers:
        wrappers = listing([wrapper.name for wrapper in spec.additional_wrappers])
        raise InputError(
            f"cannot save a case of {spec.id} below the wrapper {wrappers}; {_WAY_OUT}"
        )
    entry = spec.entry_point
    module = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", "")
    if module == "__main__":
        module = _script()
    known = not module or module.partition(".")[0] in _KNOWN
    name: dict[str, Any] = {"environment": spec.id if known else f"{module}:{spec.id}"}
    arguments = {
        key: value
        for key, value in spec.kwargs.items()
        if key not in registered.kwargs or repr(registered.kwargs[key]) != repr(value)
    }
    if arguments:
        _check_json(spec.id, arguments)
        name["arguments"] = arguments
    if spec.max_episode_steps != registered.max_episode_steps:
        name["steps"] = spec.max_episode_steps
    return name


def _fmus_name(system: Fmus, folder: Path) -> dict[str, Any]:
    arguments = {key: value for key, value in system.arguments.items() if value is not None}
    _check_json(system.name, arguments)
    paths = {
        name: Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
        for name, path in system.paths.items()
    }
    return {"fmus": paths, **arguments}


def _check_json(name: str, arguments: Mapping[str, Any]) -> None:
    """Raise InputError for arguments that JSON cannot store."""
    for key, value in arguments.items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            raise InputError(
                f"cannot save a case of {name}: JSON cannot hold its argument {key}={value!r}; "
                f"{_WAY_OUT}"
            ) from None
