"""Environments by id, and objects of modules by name.

To add a namespace of environments, add the package that registers them to `PACKAGES`.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import gymnasium as gym

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.extras import EXTRAS
from rtamt_gym.systems.system import exited

PACKAGES: Final[Mapping[str, str]] = {"rtamt": "rtamt_envs", "": "highway_env"}
"""The package that registers the environments of a namespace, ``NAMESPACE/Name-v0``, on import."""


def make(
    env_id: str, max_steps: int | None = None, options: Mapping[str, Any] | None = None
) -> gym.Env[Any, Any]:
    """Make the environment of an id; `PACKAGES` are imported if they are needed."""
    name = env_id.rpartition(":")[2].partition("-v")[0]
    package = PACKAGES.get(name.rpartition("/")[0])
    if package and ":" not in env_id and not _known(name) and find_spec(package):
        register(package)
    if ":" in env_id:
        imported(env_id.partition(":")[0])
    try:
        return gym.make(
            env_id, max_episode_steps=max_steps, disable_env_checker=True, **(options or {})
        )
    except (gym.error.Error, ModuleNotFoundError) as error:
        reason, hint = str(error), ""
        if isinstance(error, gym.error.NameNotFound):
            missing = _register_all()
            hint = _function_hint(env_id)
            named = {spec.name: spec.id for spec in gym.registry.values() if spec.namespace}
            if name in named:
                hint = f" Did you mean: `{named[name]}`?"
            elif missing:
                reason = reason.removesuffix(".")
                hint = "".join(
                    f"; the environments of {name.replace('_', '-')} need "
                    f"pip install '.[{EXTRAS[name][0]}]'"
                    for name in missing
                )
        raise InputError(f"cannot make {env_id}: {reason}{hint}") from error
    except SystemExit as end:
        raise exited(f"the making of {env_id}", end) from end
    except Exception as error:
        if not options:
            raise
        # An environment may raise any error for its arguments.
        arguments = ", ".join(f"{key}={value!r}" for key, value in options.items())
        # Gymnasium adds the id and the arguments to a TypeError.
        phrase = str(error).partition(" was raised from the environment creator")[0]
        raise InputError(
            f"cannot make {env_id} with {arguments}: {type(error).__name__}: {phrase}"
        ) from error


def _function_hint(env_id: str) -> str:
    """Return a hint if an id names a module in the working directory; empty otherwise."""
    module, _, function = env_id.partition(".")
    if not (module.isidentifier() and Path(f"{module}.py").is_file()):
        return ""
    function = "FUNCTION" if function in {"", "py"} else function
    return f" For a function of {module}.py write {module}:{function}."


def families() -> dict[str, list[str]]:
    """Return the newest ids of all registered environments, by their source."""
    _register_all()
    newest: dict[tuple[str | None, str], gym.envs.registration.EnvSpec] = {}
    for spec in gym.registry.values():
        known = newest.get((spec.namespace, spec.name))
        if known is None or (spec.version or 0) >= (known.version or 0):
            newest[spec.namespace, spec.name] = spec
    by_source: dict[str, list[str]] = {}
    for spec in newest.values():
        entry = spec.entry_point if isinstance(spec.entry_point, str) else ""
        module = entry.partition(":")[0].removeprefix("gymnasium.envs.")
        by_source.setdefault(module.partition(".")[0] or "others", []).append(spec.id)
    return {family: sorted(ids) for family, ids in sorted(by_source.items())}


def package_of(env_id: str) -> str:
    """Return the module that `make` imports for an id: its own, one of `PACKAGES`, or gymnasium.

    Example:
        >>> package_of("rtamt/RequestGrant-v0"), package_of("CartPole-v1"), package_of("a.b:C-v0")
        ('rtamt_envs', 'gymnasium', 'a.b')
    """
    module, colon, own = env_id.rpartition(":")
    if colon:
        return module
    name = own.partition("-v")[0]
    namespace = name.rpartition("/")[0]
    if not namespace and _known(name):
        return "gymnasium"
    return PACKAGES.get(namespace, "gymnasium")


def register(package: str) -> None:
    """Register the environments of a package in `PACKAGES`."""
    # Without this, pygame, which highway-env imports, prints a greeting on stdout.
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import_module(package)


def _register_all() -> list[str]:
    """Register the environments of all packages; return the packages that are not installed."""
    missing = [package for package in PACKAGES.values() if not find_spec(package)]
    for package in PACKAGES.values():
        if package not in missing:
            register(package)
    return missing


def _known(name: str) -> bool:
    return any(spec.id.rpartition("-v")[0] == name for spec in gym.registry.values())


def find_object(module: str, path: str) -> Any:  # noqa: ANN401
    """Import a module, also from the working directory, and return an object in it."""
    target: Any = imported(module)
    for name in path.split("."):
        if not hasattr(target, name):
            holder = f"the module {module}" if isinstance(target, ModuleType) else repr(target)
            raise InputError(f"{holder} has no {name!r}{nearest(name, dir(target))}")
        target = getattr(target, name)
    return target


def line_in(module: str, error: BaseException) -> str:
    """Return where in a module an error was raised, " (drive.py, line 3)", or an empty text."""
    own = module.replace(".", os.sep)
    files = f"{os.sep}{own}.py", f"{os.sep}{own}{os.sep}__init__.py"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.endswith(files)]
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""


def imported(module: str) -> ModuleType:
    """Import a module, also from the working directory."""
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)  # as `python -m` does
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module}.".startswith(f"{error.name}."):
            raise InputError(
                f"cannot find the module {error.name!r} in the working directory or on the search "
                "path of Python"
            ) from error
        raise InputError(f"cannot import {module}: {error}{line_in(module, error)}") from error
    except SystemExit as end:
        code = "" if end.code is None else repr(end.code)
        raise InputError(
            f"cannot import {module}: it called sys.exit({code}){line_in(module, end)}; put the "
            'main program below if __name__ == "__main__":'
        ) from end
    except Exception as error:
        raise InputError(
            f"cannot import {module}: {type(error).__name__}: {error}{line_in(module, error)}"
        ) from error
