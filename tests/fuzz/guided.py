"""Run one target of Python under atheris: python guided.py TARGET [options of libFuzzer]."""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from pathlib import Path

import atheris

HERE = Path(__file__).parent
MODULE = HERE.parent.parent / "build" / "fuzz" / "module"


def guide_native() -> None:
    """Let `rtamt` import the module whose branches the fuzzer sees."""
    # It finds the counters of the fuzzer among the global names.
    fuzzer = importlib.util.find_spec("atheris.core_with_libfuzzer")
    assert fuzzer is not None
    assert fuzzer.origin is not None
    ctypes.CDLL(fuzzer.origin, mode=ctypes.RTLD_GLOBAL)
    (path,) = MODULE.glob("_native.*.so")
    spec = importlib.util.spec_from_file_location("rtamt._native", path)
    assert spec is not None
    assert spec.loader is not None
    sys.modules["rtamt._native"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)


def main() -> None:
    """Import the targets instrumented, and run the named one."""
    name = sys.argv.pop(1)
    sys.path.insert(0, str(HERE.parent / "support"))
    guide_native()
    with atheris.instrument_imports(include=["rtamt", "rtamt_gym", "fuzz_targets"]):
        from fuzz_targets import TARGETS

        for path in (HERE / "corpus" / name).iterdir():  # import what is loaded at first use
            TARGETS[name](path.read_bytes())
    import rtamt

    if "_trace_branch" not in rtamt.parse.__code__.co_names:
        sys.exit("expected modules that atheris instruments: install rtamt, but not editable")
    atheris.Setup(sys.argv, TARGETS[name], internal_libfuzzer=True)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
