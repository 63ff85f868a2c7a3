"""Which share of the mutants of the repository's own requirements its own traces notice.

``python tests/bench/suites.py`` prints a table: a row for each requirement
in the commands that the pages show, with the traces that these commands judge, and for the suites
that are made of these traces and of ``examples/edges``. ``--missed`` prints the mutants that no
trace notices too. Needs the extra ``check``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from rtamt_gym.__main__ import main as rtamt
from rtamt_gym.results.mutation import MutationScore, percent

ROOT: Final = Path(__file__).parents[2]

PAGES: Final = ("README.md", "docs/*.md")

WHOLE: Final = (
    "examples/response.stl -- examples/response.csv examples/recordings examples/edges/response",
    "examples/follows.stl --period 100ms -- examples/drive.mcap examples/edges/follows",
    "examples/teleoperation.stl --period 500ms -- examples/edges/teleoperation",
)
"""The suites of the specifications in ``examples``."""

READING: Final = {"--period": 1, "--signal": 1, "--jitter": 1, "--missing": 1, "--max-gap": 1} | {
    "--dense": 0
}
"""The options by which traces are read, with the number of their values."""

HEAD: Final = "requirement", "traces", "made", "noticed", "missed", "unknown", "same", "share"


def shown() -> Iterator[list[str]]:
    """The arguments of the commands that pages show, each once: specifications, reading, traces."""
    seen = set[tuple[str, ...]]()
    for pattern in PAGES:
        for page in sorted(ROOT.glob(pattern)):
            for line in page.read_text(encoding="utf-8").splitlines():
                words = shlex.split(line) if line.startswith("$ rtamt ") else []
                if words[2:3] in (["monitor"], ["explain"]) and "--mutants" not in words:
                    found = read(words[3:])
                    if found and tuple(found) not in seen:
                        seen.add(tuple(found))
                        yield found


def read(words: Sequence[str]) -> list[str]:
    """The arguments of a command that say what is judged; none if a trace is not there."""
    left, reading, plain = [*words], list[str](), list[str]()
    while left:
        word = left.pop(0)
        if word in READING:
            reading += [word, *(left.pop(0) for _ in range(READING[word]))]
        elif word == "--" or not word.startswith("--"):
            plain.append(word)
    at = plain.index("--") if "--" in plain else len(plain) - 1
    specs, traces = plain[:at], [word for word in plain[at:] if word != "--"]
    there = all((ROOT / trace).exists() for trace in traces)
    return [*specs, *reading, "--", *traces] if there else []


def scores(arguments: Sequence[str]) -> dict[str, MutationScore]:
    """What the traces of a command notice of the mutants of each requirement."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        rtamt(["monitor", "--mutants", "--json", *arguments])
    told: dict[str, Any] = json.loads(said.getvalue())["mutants"]["requirements"]
    return {name: MutationScore.read(each) for name, each in told.items()}


def row(name: str, score: MutationScore, arguments: Sequence[str]) -> str:
    """A row of the table."""
    at = arguments.index("--")
    texts = [word for word in arguments[:at] if not word.endswith(".stl")]
    written = [word for word in texts if word.startswith(f"{name} =") or name == "spec"]
    called = written[0] if written else Path(arguments[0]).name
    traces = ", ".join(word.removeprefix("examples/") for word in arguments[at + 1 :])
    counts = [score.count(each) for each in ("noticed", "missed", "unknown", "same")]
    cells = [f"`{called}`", traces, score.made, *counts, percent(score.share)]
    return f"| {' | '.join(map(str, cells))} |".replace("||", "\\|\\|")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--missed", action="store_true", help="print the mutants that are missed")
    options = parser.parse_args(arguments)
    os.chdir(ROOT)
    print(f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}", sep="\n")
    for command in [*shown(), *map(shlex.split, WHOLE)]:
        for name, score in scores(command).items():
            print(row(name, score, command), flush=True)
            for each in score.mutants if options.missed else ():
                if each.says in ("missed", "unknown"):
                    print(
                        f"  {each.place} {each.change}: {each.kind} {each.apart}", file=sys.stderr
                    )


if __name__ == "__main__":
    main()
