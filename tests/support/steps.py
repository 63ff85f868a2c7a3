"""Count the steps of a call: the same number on every machine, at any load."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import os
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from types import FrameType, ModuleType
from typing import TYPE_CHECKING

import nanobind  # type: ignore[import-untyped]
from paths import ROOT, exclusive

if TYPE_CHECKING:
    from _typeshed import TraceFunction

SOURCE = Path(__file__).with_suffix(".c")
BUILD = ROOT / "build" / "steps"

# In one nanobind domain, the classes of this build and of the installed one would be equal.
FLAGS = "-O0 -fsanitize-coverage=trace-pc -DNB_DOMAIN=steps"


def counting_machines() -> ModuleType:
    """Return the native module compiled with a step counter; the first build is slow."""
    with exclusive(BUILD):
        return _build()


def _build() -> ModuleType:
    for linked in BUILD.glob("_native.*"):
        linked.unlink()  # it may contain an old counter
    counter = BUILD / "steps.o"
    cc = [os.environ.get("CC", "cc"), "-O0", "-fPIC", "-c", str(SOURCE), "-o", str(counter)]
    options = {
        "CMAKE_BUILD_TYPE": "Debug",
        "CMAKE_CXX_FLAGS": FLAGS,
        "CMAKE_MODULE_LINKER_FLAGS": str(counter),
        "CMAKE_TRY_COMPILE_TARGET_TYPE": "STATIC_LIBRARY",  # programs would lack the counter
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": nanobind.cmake_dir(),
    }
    defined = [f"-D{name}={value}" for name, value in options.items()]
    configure = ["cmake", "-S", str(ROOT / "rtamt" / "native"), "-B", str(BUILD), "-G", "Ninja"]
    search = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    for command in (
        cc,
        [*configure, *defined],
        ["cmake", "--build", str(BUILD), "--target", "_native"],
    ):
        done = subprocess.run(
            command,
            env={**os.environ, "PATH": search},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    (path,) = BUILD.glob("_native.*")
    spec = importlib.util.spec_from_file_location("rtamt._native", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class StepCounter:
    """Counts the lines of Python that a call executes, and the steps of the native module.

    Args:
        machines: The result of `counting_machines`; None counts only Python.
    """

    def __init__(self, machines: ModuleType | None = None) -> None:
        library = ctypes.CDLL(machines.__file__) if machines is not None else None
        self._native = ctypes.c_uint64.in_dll(library, "steps") if library else ctypes.c_uint64(0)

    def __call__(self, call: Callable[..., object], *args: object, **named: object) -> int:
        """Return the steps of a call with these arguments."""
        lines = 0

        def trace(_frame: FrameType, event: str, _argument: object) -> TraceFunction:
            nonlocal lines
            lines += event == "line"
            return trace

        gc.disable()  # its work would be counted here
        before, outer = self._native.value, sys.gettrace()
        sys.settrace(trace)
        try:
            call(*args, **named)
        finally:
            sys.settrace(outer)
            gc.enable()
        return lines + self._native.value - before
