"""Systems by name: ids of environments, paths of FMUs, objects of modules.

To add a namespace of environments, add the package that registers them to `PACKAGES`.

To add a system that a saved case can name, such as ``{"fmus": ...}``: a branch of `system_name` and
of `named_system`, a text in `system_texts`, and an entry of ``KINDS`` in
``tests/rtamt_gym/play/test_saved_cases.py``.
"""

from __future__ import annotations

import inspect
import json
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import gymnasium as gym

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.extras import EXTRAS
from rtamt_gym.checks.names import listing
from rtamt_gym.systems.fmi import Fmus
from rtamt_gym.systems.system import exited, no_exit

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


def module_of(path: str) -> str:
    """Return the name of the module in a file.

    Example:
        >>> module_of("tank.py"), module_of("./plants/tank.py"), module_of("/home/me/tank.py")
        ('tank', 'plants.tank', 'tank')
    """
    file = Path(path).with_suffix("")
    outside = file.is_absolute() or ".." in file.parts
    return file.name if outside else ".".join(file.parts)


def imported(module: str) -> ModuleType:
    """Import a module, also from the working directory."""
    if module.endswith(".py"):
        raise InputError(
            f"expected a module, got the name of a file, {module}; write {module_of(module)}"
        )
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


MAKERS: Final[dict[int, tuple[object, object]]] = {}
"""Objects that a user's function has made, with the function, by id.

The source of the function belongs to their fingerprints.
"""

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
        MAKERS[id(system)] = system, target
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
