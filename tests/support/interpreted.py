"""What a program prints where numba compiles, and where Python interprets the same functions."""

from __future__ import annotations

import os
import subprocess
import sys


def compiled_and_interpreted(program: str) -> tuple[str, str]:
    """What a program prints in a process that compiles, and in one that does not."""
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
