"""The floor: the cost of the same work in C, compiled at the start."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from pathlib import Path

HERE = Path(__file__).parent / "c"


def build(folder: Path) -> str | None:
    """Compile the floor into a folder; return the reason if that fails, otherwise None."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return "no C compiler"
    python = ["-I", sysconfig.get_path("include")]
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    modules = (("cfloor.c", f"cfloor{suffix}"), ("dense.c", f"cdense{suffix}"))
    for source, target in (*modules, ("allocations.c", "allocations.so")):
        command = [compiler, "-O3", "-march=native", "-fPIC", "-shared", *python]
        command += [str(HERE / source), "-o", str(folder / target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"{source} does not compile: {done.stderr.strip()[:300]}"
    return None
