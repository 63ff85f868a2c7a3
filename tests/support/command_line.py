"""Files for the tests of the command line, and the command line in unusual environments."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

SPEC = """\
granted = eventually[0:0.5](gnt >= 3)
out = always(req >= 3 implies granted)
"""
EVEN = "time,req,gnt,note\n0,0,0,\n0.5,5,0,a request\n1,0,1,too late\n1.5,0,4,\n"
WIDE = "time,req,gnt,note\n0,0,0,\n0.35,5,,a request\n0.9,,4,granted\n1.5,0,0,\n"
LONG = "variable,time,value\nreq,0,0\ngnt,0,0\nreq,0.35,5\ngnt,0.9,4\nreq,1.5,0\ngnt,1.5,0\nz,9,9\n"

FILES = {
    "spec.stl": SPEC,
    "calm.stl": "always(req < 9)",
    "even.csv": EVEN,
    "wide.csv": WIDE,
    "long.csv": LONG,
}


def write_files(folder: Path) -> None:
    """Write a specification of two formulas, one of one formula, and traces of the same signals."""
    for name, text in FILES.items():
        (folder / name).write_text(text)


def run_without(modules: list[str], arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """Run the command line without some modules."""
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({modules})); "
        f"from rtamt_gym.__main__ import main; sys.exit(main({arguments}))"
    )
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def run_unread(arguments: Sequence[str], folder: Path) -> tuple[int, bytes]:
    """Run the command line in a folder, its output closed as by ``| head``: exit code, errors."""
    with subprocess.Popen(
        [sys.executable, "-m", "rtamt_gym", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        said = process.stderr.read()
    return process.returncode, said
