"""Objects of Python modules by their names, for the command line."""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from rtamt import InputError
from rtamt.errors import nearest

__all__ = ["find_object", "imported", "line_in"]


def find_object(module: str, path: str) -> Any:  # noqa: ANN401
    """Imports a module, also from the working directory, and finds an object in it.

    Args:
        module: The dotted name of the module.
        path: The name of the object in it, with dots for attributes of objects.

    Raises:
        InputError: If there is no such module or object, with the nearest name, or the import
            raises.
    """
    found: Any = imported(module)
    for name in path.split("."):
        if not hasattr(found, name):
            of = f"the module {module}" if isinstance(found, ModuleType) else repr(found)
            raise InputError(f"{of} has no {name!r}{nearest(name, dir(found))}")
        found = getattr(found, name)
    return found


def line_in(module: str, error: BaseException) -> str:
    """Where in the file of a module an error was raised, " (drive.py, line 3)"; else empty."""
    own = module.replace(".", os.sep)
    files = f"{os.sep}{own}.py", f"{os.sep}{own}{os.sep}__init__.py"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.endswith(files)]
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""


def imported(module: str) -> ModuleType:
    """Imports a module, also from the working directory.

    Raises:
        InputError: If there is no such module, or the import raises.
    """
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)  # as `python -m` does
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module}.".startswith(f"{error.name}."):
            raise InputError(
                f"there is no module {error.name!r}, neither in the working directory nor where "
                "Python looks for modules"
            ) from error
        raise InputError(f"cannot import {module}: {error}{line_in(module, error)}") from error
    except SystemExit as end:
        code = "" if end.code is None else repr(end.code)
        raise InputError(
            f"cannot import {module}: it called sys.exit({code}){line_in(module, end)}; put what "
            'runs below if __name__ == "__main__":'
        ) from end
    except Exception as error:
        raise InputError(
            f"cannot import {module}: {type(error).__name__}: {error}{line_in(module, error)}"
        ) from error
