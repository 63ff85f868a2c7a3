"""The output of a program with functions compiled by numba, and interpreted by Python."""

from __future__ import annotations

import os
import subprocess
import sys


def compiled_and_interpreted(program: str) -> tuple[str, str]:
    """Return the output of a program in a process that compiles, and in one that does not."""
    compiled, interpreted = (
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"NUMBA_DISABLE_JIT": disabled},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for disabled in ("0", "1")
    )
    return compiled, interpreted
