"""`fingerprint_of`: hashes and versions of the code and files that simulations run."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
import sys
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType, SimpleNamespace
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import VectorEnv
from gymnasium.vector.vector_env import VectorWrapper

import rtamt
from rtamt_gym.results.provenance import Fingerprint, file_hash, versions_in_use
from rtamt_gym.systems.fmi import Fmus
from rtamt_gym.systems.policies import Model
from rtamt_gym.systems.registry import MAKERS
from rtamt_gym.systems.source_files import HOUSE, READ, ModuleFiles, is_installed, model_files

_SIMULATORS: Final = frozenset({"fmpy", "mujoco"})
"""Packages that are always simulators."""

_INTERFACE: Final = frozenset({"gymnasium.core", "gymnasium.vector.vector_env"})
"""The modules of base classes that every environment has."""

_GENERATED: Final = frozenset(
    {
        *("__init__", "__repr__", "__hash__", "__setattr__", "__delattr__", "__replace__"),
        *("__eq__", "__lt__", "__le__", "__gt__", "__ge__", "__getstate__", "__setstate__"),
    }
)
"""Methods that ``dataclass`` and the like generate: the fields in the source define them."""

_SHOWN: Final = 60
"""The length of a value that is stored as it is; a longer one is hashed."""

_DEPTH: Final = 50
"""The maximum depth of nested objects."""

_ELEMENTS: Final = 1000
"""The maximum number of elements of a list that JSON cannot represent."""


def fingerprint_of(system: Iterable[object], policy: Iterable[object] = ()) -> Fingerprint:
    """Return the fingerprint of the code and files that simulations run, as they are now.

    Functions are identified by the modules that define them, by the values that they hold
    (arguments of a ``partial``, defaults, variables around them), and by their names.
    """
    collector = _Collector()
    collector.add_all(system)
    own = collector.fingerprint()
    collector.add_all(policy)
    both = collector.fingerprint()
    of_policy = {*both.contents, *both.values}.difference(own.contents, own.values)
    return replace(both, policy=tuple(sorted(of_policy)))


class _Collector:
    """Collects the parts of a fingerprint from objects and their contents."""

    def __init__(self) -> None:
        self._seen: dict[int, object] = {}  # by id; holding them keeps ids unique
        self._depth = 0
        self._modules = ModuleFiles()
        self._files: dict[Path, Path] = {}
        self._hashes: dict[str, str] = {}
        self._values: dict[str, str] = {}
        self._simulators = {"rtamt": rtamt.__version__}
        self._packages: dict[str, str] = {}
        self._unseen: dict[str, None] = {}

    def fingerprint(self) -> Fingerprint:
        """Return the fingerprint of all objects that were added."""
        for name in sorted(self._modules.packages):
            self._add_package(name, simulates=name in _SIMULATORS)
        contents = dict(self._hashes)
        places: dict[str, Path] = {}
        edited = self._modules.edited()
        for path, root in {**self._modules.paths, **self._files}.items():
            name = _label(path, root)
            if places.setdefault(name, path) != path:
                name = f"{name} of {path.parent.name}"
            contents[name] = file_hash(path)
            if path in edited:  # the running code differs from the file
                contents[name] = f"edited after process {os.getpid()} imported it"
        versions = {**versions_in_use(), **self._packages, "python": platform.python_version()}
        return Fingerprint(
            contents,
            {**self._values, **{name: repr(now) for name, now in self._modules.replaced()}},
            dict(self._simulators),
            {name: version for name, version in versions.items() if name not in self._simulators},
            tuple(dict.fromkeys([*self._unseen, *self._modules.unseen])),
        )

    def add_all(self, things: Iterable[object]) -> None:
        """Add objects without names."""
        for thing in things:
            self.add(thing)

    def add(self, thing: object, name: str = "", *, values: bool = True) -> None:
        """Add an object."""
        if thing is None or isinstance(thing, bool | int | float | complex | str | bytes | Path):
            self._add_plain(thing, name, values=values)
            return
        if id(thing) in self._seen:
            return
        self._seen[id(thing)] = thing
        if self._depth >= _DEPTH:
            self._unseen[f"objects nested deeper than {_DEPTH} levels"] = None
            return
        self._depth += 1
        try:
            self.add(MAKERS.get(id(thing), (None, None))[1])
            self._add_kind(thing, name, values=values)
        finally:
            self._depth -= 1

    def _add_kind(self, thing: object, name: str, *, values: bool) -> None:
        """Add an object by its kind."""
        kinds: tuple[tuple[Any, Callable[..., None]], ...] = (
            (Fmus, self._add_fmus),
            (gym.Env | VectorEnv, self._add_environment),
            (Model, self._add_model),
            (partial, self._add_partial),
            (MethodType, self._add_method),
            (FunctionType, self._add_function),
            (type, self._add_class),
            (ModuleType | BuiltinFunctionType, self._add_module),
        )
        named = {"MjModel": self._add_compiled, "MjData": self._add_state}
        adds = next((add for kind, add in kinds if isinstance(thing, kind)), None)
        adds = adds or named.get(type(thing).__name__)
        if adds is not None:
            adds(thing)
        elif isinstance(thing, np.ndarray | np.generic):
            self._add_array(np.asarray(thing), name, values=values)
        elif isinstance(thing, Mapping | list | tuple | set | frozenset):
            self._add_many(thing, name, values=values)
        else:
            self._add_object(thing, values=values)

    def _add_plain(self, thing: object, name: str, *, values: bool) -> None:
        if isinstance(thing, str | Path):
            with suppress(OSError, ValueError):
                path = Path(thing)
                if path.suffix.lower() in {*READ, ".json"} and path.is_file():
                    self._add_files(model_files(path))
                    return
        if name and values and not isinstance(thing, Path):  # a path, as of a log, is not a model
            self._values[name] = _short(repr(thing))

    def _add_array(self, array: Any, name: str, *, values: bool) -> None:  # noqa: ANN401
        if name and values and array.dtype != object:
            hashed = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
            text = repr(array.tolist())
            short = text if len(text) <= _SHOWN else f"an array, SHA-256 {hashed[:12]}"
            self._values[name] = short

    def _add_many(self, thing: Any, name: str, *, values: bool) -> None:  # noqa: ANN401
        if name and values:
            with suppress(TypeError, ValueError, RecursionError):
                self._values[name] = _short(json.dumps(thing, sort_keys=True))
        ordered = sorted(thing, key=repr) if isinstance(thing, set | frozenset) else thing
        pairs = thing.items() if isinstance(thing, Mapping) else enumerate(ordered)
        plain = name in self._values
        for _, (key, part) in zip(range(_ELEMENTS), pairs, strict=False):
            self.add(part, f"{name}[{key!r}]" if name and not plain else "", values=values)

    def _add_partial(self, thing: partial[Any]) -> None:
        for key, argument in [*enumerate(thing.args), *thing.keywords.items()]:
            self.add(argument, f"argument {key} of {_named(thing.func)}")
        self.add(thing.func)

    def _add_method(self, method: MethodType) -> None:
        self.add(method.__self__)
        self.add(method.__func__)

    def _add_function(self, function: FunctionType) -> None:
        of_user = self._add_code(function)
        code = function.__code__
        for cell_name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            with suppress(ValueError):  # a variable that has no value yet
                if of_user:
                    self._add_held(cell.cell_contents, f"{cell_name} of {_named(function)}")
                else:
                    self.add(cell.cell_contents, values=False)
        named = (function.__kwdefaults__ or {}).items()
        for key, value in [*enumerate(function.__defaults__ or ()), *named]:
            self.add(value, f"default {key} of {_named(function)}", values=of_user)
        self.add(getattr(function, "__wrapped__", None))

    def _add_code(self, function: FunctionType) -> bool:
        """Add the source of a function; return whether it belongs to the user."""
        code = function.__code__
        path = Path(code.co_filename)
        module = str(function.__module__)
        top = module.split(".", maxsplit=1)[0]
        generated = code.co_filename.startswith("<") and function.__name__ in _GENERATED
        if top in HOUSE or generated:
            return False
        if is_installed(path):
            self._add_package(top)
            return False
        if path.is_file():
            same = _file_of(module).resolve() == path.resolve()
            self._modules.add(path, _import_name(sys.modules[module]) if same else path.stem)
            line = f" in line {code.co_firstlineno}" if "<lambda>" in code.co_name else ""
            self._values[f"{_what(function)}{line} of {path.name}"] = "used"
        else:
            self._unseen[f"{_what(function)}, whose source is not in a file"] = None
        return True

    def _add_class(self, kind: type) -> None:
        """Add a class and its bases."""
        for base in kind.__mro__:
            top = base.__module__.split(".")[0]
            if top in sys.stdlib_module_names or top in HOUSE:
                continue
            path = _file_of(base.__module__)
            if is_installed(path):
                self._add_package(top)
                continue
            self._add_functions(base, path)
            if not path.is_file():
                self._unseen[f"the class {base.__name__}, whose source is not in a file"] = None
                continue
            self._modules.add(path, _import_name(sys.modules.get(base.__module__)))
            self._values[f"{base.__qualname__} of {path.name}"] = "used"
            if not self._modules.defines(path, base.__name__):
                self._unseen[f"the class {base.__name__}, which was made at run time"] = None

    def _add_functions(self, kind: type, path: Path) -> None:
        """Add the functions of a class that come from another file."""
        for function in vars(kind).values():
            if isinstance(function, FunctionType) and Path(function.__code__.co_filename) != path:
                self.add(function)

    def _add_object(self, thing: object, *, values: bool) -> None:
        """Add an object by its class and, for the user's classes and ours, its attributes."""
        kind = type(thing)
        self._add_class(kind)
        for name in ("__wrapped__", "py_func"):  # of a cache, of JAX, of Numba
            inside = _attribute(thing, name)
            if isinstance(inside, FunctionType | MethodType | partial | type):
                self.add(inside)
        top = kind.__module__.split(".")[0]
        ours = top == "rtamt_gym"
        others = top in HOUSE or top in sys.stdlib_module_names
        others = not ours and (others or is_installed(_file_of(kind.__module__)))
        network = _attribute(thing, "policy") if others else thing
        for part in (thing, network):
            if callable(_attribute(part, "state_dict")):
                with suppress(Exception):  # of a class that only looks like a network
                    weights = Model(SimpleNamespace(policy=part)).fingerprint
                    self._values[f"the weights of {kind.__name__}"] = f"SHA-256 {weights}"
                    return
        if others:
            return
        slots = [name for part in kind.__mro__ for name in getattr(part, "__slots__", ())]
        held = {name: _attribute(thing, name) for name in slots if isinstance(name, str)}
        for key, part in {**held, **getattr(thing, "__dict__", {})}.items():
            if ours or not values:
                self.add(part, values=False)
            else:
                self._add_held(part, f"{key} of {kind.__name__}")

    def _add_held(self, thing: object, name: str) -> None:
        """Add a value of a function or an object; a run may change its lists."""
        if isinstance(thing, list | dict | set | deque | bytearray):
            self._unseen[f"{name}, a {type(thing).__name__}"] = None
            self.add(thing)
        else:
            self.add(thing, name)

    def _add_environment(self, env: Any) -> None:  # noqa: ANN401
        layer = env
        while isinstance(layer, gym.Wrapper | VectorWrapper):
            self._add_class(type(layer))
            for part in vars(layer).values():
                if isinstance(part, FunctionType | MethodType | partial):
                    self.add(part)
            layer = layer.env
        kind = type(layer)
        self._add_class(kind)
        for part in kind.__mro__:
            if part.__module__ not in _INTERFACE and is_installed(_file_of(part.__module__)):
                self._add_package(part.__module__.split(".")[0], simulates=True)
        if env.spec is not None:
            self._add_spec(env.spec)
        elif isinstance(layer, gym.Env) and kind.__init__ is not object.__init__:
            phrase = f"the arguments of {kind.__name__}, which gymnasium.make has not made"
            self._unseen[phrase] = None
        for part in [*getattr(layer, "env_fns", ()), *getattr(layer, "envs", ())][:_ELEMENTS]:
            self.add(part)
        self._add_model_of(layer)

    def _add_spec(self, spec: EnvSpec) -> None:
        for key, value in spec.kwargs.items():
            if key != "render_mode":
                self.add(value, f"argument {key} of {spec.id}")
        for wrapper in spec.additional_wrappers or ():
            for key, value in (wrapper.kwargs or {}).items():
                self.add(value, f"argument {key} of {wrapper.name}")
        self.add(spec.entry_point if callable(spec.entry_point) else None)

    def _add_model_of(self, env: Any) -> None:  # noqa: ANN401
        """Add the MuJoCo model of an environment: by its files, or as it is compiled."""
        model = getattr(env, "model", None)
        if type(model).__name__ != "MjModel":
            model = getattr(getattr(getattr(env, "physics", None), "model", None), "ptr", None)
        if type(model).__name__ != "MjModel":
            return
        self._add_package("mujoco", simulates=True)
        paths = [getattr(env, name, None) for name in ("fullpath", "xml_path", "model_path")]
        for path in paths:
            if isinstance(path, str | os.PathLike) and Path(path).is_file():
                self._add_files(model_files(Path(path)))
                return
        self.add(model)

    def _add_compiled(self, model: Any) -> None:  # noqa: ANN401
        """Add a MuJoCo model as it is compiled: meshes and values set by a program are in it."""
        import mujoco  # type: ignore[import-untyped]

        self._add_package("mujoco", simulates=True)
        buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        name = model.names.partition(b"\0")[0].decode()
        phrase = (
            f"the MuJoCo model {name} (its XML, an included file, a mesh, a texture or a value)"
        )
        self._values[phrase] = f"SHA-256 {hashlib.sha256(buffer.tobytes()).hexdigest()}"

    def _add_state(self, data: Any) -> None:  # noqa: ANN401
        """Add the state that a simulation of MuJoCo starts from."""
        state = [data.time, *data.qpos, *data.qvel, *data.act, *data.ctrl]
        hashed = hashlib.sha256(np.array(state, np.float64).tobytes()).hexdigest()
        self._values["the first state of MjData"] = f"SHA-256 {hashed}"

    def _add_fmus(self, system: Fmus) -> None:
        self._add_package("fmpy", simulates=True)
        for name, path in system.paths.items():
            label = path.name if path.stem == name else f"{path.name} ({name})"
            self._hashes[label] = file_hash(path)
        for key, value in system.arguments.items():
            self.add(value, f"{key} of {system.name}")

    def _add_model(self, model: Model) -> None:
        if model.files:
            self._add_files(model.files)
        else:
            self._values[f"the weights of {model.name}"] = f"SHA-256 {model.fingerprint}"
        self._add_class(model.kind)
        self._values[f"deterministic of {model.name}"] = repr(model.deterministic)

    def _add_module(self, thing: ModuleType | BuiltinFunctionType) -> None:
        """Add a module, or the compiled module of a function."""
        module = sys.modules.get(str(getattr(thing, "__module__", "")))
        module = thing if isinstance(thing, ModuleType) else module
        name = "" if module is None else module.__name__
        path = _file_of(name)
        if name.split(".")[0] in HOUSE or not path.is_file():
            return
        if is_installed(path):
            self._add_package(name.split(".")[0])
        else:
            self._modules.add(path, _import_name(module))

    def _add_files(self, paths: Sequence[Path]) -> None:
        """Add a file, and the files that it refers to."""
        root = paths[0].parent
        for path in paths:
            self._files[path] = root

    def _add_package(self, name: str, *, simulates: bool = False) -> None:
        if name in HOUSE or name in sys.stdlib_module_names:
            return
        version = _version(name)
        if version:
            (self._simulators if simulates else self._packages)[name] = version


def _label(path: Path, root: Path) -> str:
    """Return the name of a file, below the folder that it belongs to if it lies there."""
    with suppress(ValueError):
        return path.resolve().relative_to(root.resolve()).as_posix()
    return path.name


def _file_of(module: str) -> Path:
    """Return the file of a loaded module; the path "." if it has no file."""
    return Path(getattr(sys.modules.get(module), "__file__", None) or "")


def _attribute(thing: object, name: str) -> object:
    """Return an attribute of an object; None if it is missing or raises an error."""
    with suppress(Exception):
        return getattr(thing, name, None)
    return None


def _import_name(module: ModuleType | None) -> str:
    """Return the dotted name of a module; of the program itself, the name of its file."""
    if module is None:
        return ""
    if module.__name__ != "__main__":
        return module.__name__
    spec = getattr(module, "__spec__", None)
    return Path(str(module.__file__)).stem if spec is None else str(spec.name)


def _named(thing: object) -> str:
    return str(getattr(thing, "__qualname__", type(thing).__qualname__)).rpartition("<locals>.")[2]


def _what(function: FunctionType) -> str:
    name = _named(function)
    return "a lambda" if name == "<lambda>" else f"the function {name}"


def _short(text: str) -> str:
    if len(text) <= _SHOWN:
        return text
    return f"{text[: _SHOWN - 30]}... (SHA-256 {hashlib.sha256(text.encode()).hexdigest()[:12]})"


def _version(package: str) -> str:
    """Return the version of an installed package by the name of its module; empty if unknown."""
    with suppress(importlib.metadata.PackageNotFoundError, ValueError):
        return importlib.metadata.version(package)
    for name in _distributions().get(package, ()):
        return importlib.metadata.version(name)
    return str(getattr(sys.modules.get(package), "__version__", ""))


@cache
def _distributions() -> Mapping[str, Sequence[str]]:
    """Return the names of distributions by the modules that they install."""
    return importlib.metadata.packages_distributions()
