"""Print mutation scores of the requirements and traces of the repository.

``python tests/bench/suites.py`` prints a row for each requirement of the commands on the pages,
with the traces of these commands, and of the suites of ``examples``. ``--survived`` also prints the
mutants that no trace kills. Needs the extra ``check``.
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

SUITES: Final = (
    "examples/response.stl -- examples/response.csv examples/recordings examples/edges/response",
    "examples/follows.stl --period 100ms -- examples/drive.mcap examples/edges/follows",
    "examples/teleoperation.stl --period 500ms -- examples/edges/teleoperation",
)
"""The suites of the specifications in ``examples``."""

OPTIONS: Final = {"--period": 1, "--signal": 1, "--jitter": 1, "--missing": 1, "--max-gap": 1} | {
    "--dense": 0
}
"""The options that change how traces are read, with the number of their values."""

HEAD: Final = "requirement", "traces", "total", "killed", "survived", "unknown", "same", "share"


def commands() -> Iterator[list[str]]:
    """Yield the specifications, options and traces of the commands on the pages, each once."""
    seen = set[tuple[str, ...]]()
    for pattern in PAGES:
        for page in sorted(ROOT.glob(pattern)):
            for line in page.read_text(encoding="utf-8").splitlines():
                words = shlex.split(line) if line.startswith("$ rtamt ") else []
                if words[2:3] in (["monitor"], ["explain"]) and "--mutants" not in words:
                    arguments = read(words[3:])
                    if arguments and tuple(arguments) not in seen:
                        seen.add(tuple(arguments))
                        yield arguments


def read(words: Sequence[str]) -> list[str]:
    """Return specifications, options and traces of a command; empty if a trace is missing."""
    left, options, plain = [*words], list[str](), list[str]()
    while left:
        word = left.pop(0)
        if word in OPTIONS:
            options += [word, *(left.pop(0) for _ in range(OPTIONS[word]))]
        elif word == "--" or not word.startswith("--"):
            plain.append(word)
    separator = plain.index("--") if "--" in plain else len(plain) - 1
    specs, traces = plain[:separator], [word for word in plain[separator:] if word != "--"]
    exist = all((ROOT / trace).exists() for trace in traces)
    return [*specs, *options, "--", *traces] if exist else []


def scores(arguments: Sequence[str]) -> dict[str, MutationScore]:
    """Return the mutation score of each requirement of a command."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        rtamt(["monitor", "--mutants", "--json", *arguments])
    stored: dict[str, Any] = json.loads(output.getvalue())["mutants"]["requirements"]
    return {name: MutationScore.read(item) for name, item in stored.items()}


def row(name: str, score: MutationScore, arguments: Sequence[str]) -> str:
    """Return a row of the table."""
    separator = arguments.index("--")
    texts = [word for word in arguments[:separator] if not word.endswith(".stl")]
    named = [word for word in texts if word.startswith(f"{name} =") or name == "spec"]
    title = named[0] if named else Path(arguments[0]).name
    traces = ", ".join(word.removeprefix("examples/") for word in arguments[separator + 1 :])
    # The JSON of the command has the old names of killed and survived.
    counts = [score.count(status) for status in ("noticed", "missed", "unknown", "same")]
    cells = [f"`{title}`", traces, score.made, *counts, percent(score.share)]
    return f"| {' | '.join(map(str, cells))} |".replace("||", "\\|\\|")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--survived", action="store_true", help="print the mutants that survived")
    options = parser.parse_args(arguments)
    os.chdir(ROOT)
    print(f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}", sep="\n")
    for command in [*commands(), *map(shlex.split, SUITES)]:
        for name, score in scores(command).items():
            print(row(name, score, command), flush=True)
            for mutant in score.mutants if options.survived else ():
                if mutant.says in ("missed", "unknown"):
                    text = f"  {mutant.place} {mutant.change}: {mutant.kind} {mutant.apart}"
                    print(text, file=sys.stderr)


if __name__ == "__main__":
    main()
