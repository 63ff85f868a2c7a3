"""The files that a Python module or a MuJoCo model consists of.

Modules are read as text and never imported. Their imports are followed as far as the modules
belong to the user: neither to Python nor to an installed package.
"""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import machinery
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Final
from xml.etree import ElementTree as ET

HOUSE: Final = frozenset({"rtamt", "rtamt_gym", "rtamt_arrays", "rtamt_envs", "rtamt_ros"})
"""Our own packages; their version identifies their source."""

_LOADERS: Final[tuple[tuple[type, list[str]], ...]] = (
    (machinery.ExtensionFileLoader, machinery.EXTENSION_SUFFIXES),
    (machinery.SourceFileLoader, machinery.SOURCE_SUFFIXES),
    (machinery.SourcelessFileLoader, machinery.BYTECODE_SUFFIXES),
)

READ: Final = frozenset(
    {
        *(".fmu", ".mjb", ".mjcf", ".urdf", ".xml"),
        *(".onnx", ".pt", ".pth", ".safetensors", ".zip"),
        *(".ini", ".toml", ".yaml", ".yml"),
    }
)
"""The endings of models, policies and options, which a module reads and does not write."""

_PLAIN: Final = frozenset({bool, int, float, str, type(None)})
"""The types of module constants that are compared."""

_TREE: Final = frozenset({".xml", ".mjcf", ".urdf"})
"""The endings of model files that refer to other files."""


@cache
def _installed_folders() -> tuple[Path, ...]:
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return tuple({Path(sysconfig.get_path(name)).resolve() for name in names})


def is_installed(path: Path) -> bool:
    """Return whether a file belongs to Python or to an installed package."""
    resolved = path.resolve()
    if {"site-packages", "dist-packages"} & set(resolved.parts):
        return True
    return any(resolved.is_relative_to(folder) for folder in _installed_folders())


@dataclass
class ModuleFiles:
    """The files of modules, of their imports, and of the models that they read."""

    paths: dict[Path, Path] = field(default_factory=dict)
    packages: set[str] = field(default_factory=set)
    unseen: list[str] = field(default_factory=list)
    trees: dict[Path, ast.Module] = field(default_factory=dict)

    def add(self, path: Path, name: str) -> None:
        """Add a module and everything that it imports."""
        path = path.resolve()
        depth = name.count(".") + (path.stem == "__init__")
        if depth >= len(path.parents):  # the name is invented
            depth = 0
        self._add_file(path, path.parents[depth], name)

    def _add_file(self, path: Path, root: Path, name: str) -> None:
        if path in self.paths or not path.is_file():
            return
        self.paths[path] = root
        if path.suffix not in {".py", ".pyw"}:
            self.unseen.append(f"the modules that {path.name} imports, which is compiled")
            return
        try:
            tree = ast.parse(path.read_bytes())
        except (SyntaxError, ValueError):
            self.unseen.append(f"the modules that {path.name} imports, which cannot be parsed")
            return
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        self.trees[path] = tree
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom | ast.Call):
                for module in self._imports(node, package, path):
                    self._follow(module, root)
            if isinstance(node, ast.Constant | ast.BinOp | ast.Call):
                for text in _file_names(node):
                    self._add_read(text, path, root)

    def defines(self, path: Path, name: str) -> bool:
        """Return whether a module defines a class of a name; True if it is unknown."""
        tree = self.trees.get(path.resolve())
        return tree is None or any(
            isinstance(node, ast.ClassDef) and node.name == name for node in ast.walk(tree)
        )

    def loaded(self) -> Iterator[tuple[Path, ModuleType]]:
        """Yield the modules that this program has imported, with their paths."""
        modules = {
            str(getattr(module, "__file__", "")): module for module in [*sys.modules.values()]
        }
        yield from ((path, modules[str(path)]) for path in self.trees if str(path) in modules)

    def edited(self) -> set[Path]:
        """Return the modules with functions that were edited after they were imported."""
        return {path for path, module in self.loaded() if _differs(module, path, self.trees[path])}

    def replaced(self) -> Iterator[tuple[str, object]]:
        """Yield constants that differ from the text of their modules, by name.

        The program has set them, or the file was edited after it was imported.
        """
        for path, module in self.loaded():
            for name, value in _constants(self.trees[path]):
                now = getattr(module, name, value)
                if type(now) in _PLAIN and now != value:
                    yield f"{name} of {path.name}", now

    def _imports(self, node: ast.AST, package: str, path: Path) -> Iterator[str]:
        """Yield the absolute module names that a statement or call may import."""
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                parts = package.split(".") if level else []
                parts = parts[: len(parts) - (level - 1)] if level else parts
                base = ".".join([*parts, *([module] if module else [])])
                if base:
                    yield base
                yield from (f"{base}.{alias.name}".removeprefix(".") for alias in names)
            case ast.Call(func=ast.Name(id="__import__" | "import_module"), args=[first, *_]):
                yield from self._computed(first, path)
            case ast.Call(func=ast.Attribute(attr="import_module"), args=[first, *_]):
                yield from self._computed(first, path)

    def _computed(self, argument: ast.expr, path: Path) -> Iterator[str]:
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
            yield argument.value.lstrip(".")
        else:
            self.unseen.append(f"the modules that {path.name} imports by a computed name")

    def _follow(self, name: str, root: Path) -> None:
        """Add a module that a module below ``root`` imports."""
        top, *remainder = name.split(".")
        if top in HOUSE:
            self.packages.add("rtamt")
            return
        spec = _found(root, top)
        if spec is None or spec.loader is None:  # a package precedes a folder of the same name
            if top in sys.stdlib_module_names:
                return
            outside = _root_of(top)
            if outside is None and spec is None:
                self.packages.add(top)
                return
            root = outside or root
        folder, known = root, ""
        for part in [top, *remainder]:
            spec = _found(folder, part)
            if spec is None:
                return  # a name in a module
            known = f"{known}.{part}".removeprefix(".")
            if spec.origin is not None and spec.loader is not None:
                self._add_file(Path(spec.origin).resolve(), root, known)
            if not spec.submodule_search_locations:
                return
            folder = Path(next(iter(spec.submodule_search_locations)))

    def _add_read(self, text: str, module: Path, root: Path) -> None:
        """Add a file that the text of a module names, if there is one."""
        for folder in (Path.cwd(), module.parent):
            for name in (text, f"{text}.zip"):  # as Stable-Baselines3 completes names
                path = folder / name
                with suppress(OSError, ValueError):
                    if path.suffix.lower() in READ and path.is_file():
                        for file in model_files(path):
                            self.paths.setdefault(file, root)
                        return


def _differs(module: ModuleType, path: Path, tree: ast.Module) -> bool:
    """Return whether a function of a loaded module differs from the text of its file."""
    if type(module.__loader__) is not machinery.SourceFileLoader:  # other loaders change the code
        return False
    codes: set[CodeType] = set()
    waiting = [compile(tree, str(path), "exec", dont_inherit=True)]
    while waiting:
        code = waiting.pop()
        codes.add(code)
        waiting += [member for member in code.co_consts if isinstance(member, CodeType)]
    classes = [member for member in vars(module).values() if isinstance(member, type)]
    own = [member for member in classes if member.__module__ == module.__name__]
    functions = [member for holder in (module, *own) for member in vars(holder).values()]
    return any(
        member.__code__ not in codes
        for member in functions
        if isinstance(member, FunctionType) and member.__code__.co_filename == str(path)
    )


def _constants(tree: ast.Module) -> Iterator[tuple[str, object]]:
    """Yield the names that a module assigns once, with their values, numbers or texts."""
    names = [name_node for name_node in ast.walk(tree) if isinstance(name_node, ast.Name)]
    stored = Counter(name_node.id for name_node in names if isinstance(name_node.ctx, ast.Store))
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                pass
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                pass
            case _:
                continue
        if stored[name] == 1:
            with suppress(ValueError):
                yield name, ast.literal_eval(value)


def _found(folder: Path, name: str) -> machinery.ModuleSpec | None:
    """Return the spec of a module or package in a folder, or None."""
    return machinery.FileFinder(str(folder), *_LOADERS).find_spec(name)


def _root_of(top: str) -> Path | None:
    """Return the folder of a user's module elsewhere on the path; None of an installed package."""
    loaded = getattr(sys.modules.get(top), "__file__", None)
    if loaded is None:
        try:
            spec = find_spec(top)
        except (ImportError, ValueError, AttributeError):
            return None
        loaded = None if spec is None else spec.origin
    if loaded is None or not Path(loaded).is_file() or is_installed(Path(loaded)):
        return None
    path = Path(loaded).resolve()
    return path.parents[1] if path.stem == "__init__" else path.parent


def _file_names(node: ast.AST) -> Iterator[str]:
    """Yield texts of a node that may name files: constants, and parts joined with ``/``."""
    match node:
        case ast.Constant(value=str(text)) if 0 < len(text) < 256 and "\n" not in text:
            yield text
        case ast.BinOp(op=ast.Div()):
            parts: list[str] = []
            left: ast.expr = node
            while isinstance(left, ast.BinOp) and isinstance(left.op, ast.Div):
                if not (isinstance(left.right, ast.Constant) and isinstance(left.right.value, str)):
                    return
                parts.insert(0, left.right.value)
                left = left.left
            yield "/".join(parts)
        case ast.Call(args=args):
            texts = [argument.value for argument in args if isinstance(argument, ast.Constant)]
            if len(texts) > 1 and all(isinstance(argument, str) for argument in texts):
                yield "/".join(map(str, texts))


def model_files(path: Path) -> list[Path]:
    """Return a model file and all files that it refers to: includes, meshes, textures, fields.

    Files that do not exist are left out; so are references of a file that is not XML.
    """
    first = path.resolve()
    result, waiting = {first: None}, [first]
    folders, names = [first.parent], []
    while waiting:
        current = waiting.pop()
        more, named = _references(current)
        folders += [first.parent / file for file in more]
        names += [(current.parent, file) for file in named]
        # An included file may set the folders of names that came before.
        for parent, name in names:
            for file in _candidates([parent, *folders], name):
                if file not in result:
                    result[file] = None
                    waiting.append(file)
    return list(result)


def _references(path: Path) -> tuple[list[str], list[str]]:
    """Return the folders that a model file sets, and the names of files in it."""
    folders: list[str] = []
    names: list[str] = []
    if path.suffix.lower() not in _TREE:
        return folders, names
    with suppress(ET.ParseError, OSError):
        for element in ET.parse(path).getroot().iter():  # noqa: S314 - MuJoCo reads it too
            for key, value in element.attrib.items():
                if key in {"assetdir", "meshdir", "texturedir"}:
                    folders.append(value)
                elif key.startswith("file"):
                    names.append(value.removeprefix("package://"))
    return folders, names


def _candidates(folders: Sequence[Path], name: str) -> Iterator[Path]:
    """Yield the files that a name in a model may mean; the compiler may strip its path."""
    for folder in folders:
        for candidate in (folder / name, folder / Path(name).name):
            with suppress(OSError, ValueError):
                if candidate.is_file():
                    yield candidate.resolve()
