"""Test the tests: change one operator, constant, condition or statement; which test fails?

``python tests/mutation/run.py [FOLDER ...] [--seed N] [--suite quick]`` draws a sample of mutants
of each folder of `folders.py`. All mutants are in one build of the native module and one import of
the Python modules, each inactive until its number is set, and are tried one after the other
(`trials.py`). It prints, for each folder, the killed mutants with the 95 % interval of Clopper and
Pearson, and each survivor. ``--suite quick`` uses the tests of the bare command instead of the
tests chosen for each folder. ``equivalent.toml`` lists the survivors that behave like the original,
each with the reason. They are counted separately, and it is an error if a test kills one.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, Final

import native_code
import python_code
from changes import Mutant, Site
from folders import FOLDERS, QUICK, Covering, Folder

from rtamt_gym.results.intervals import clopper_pearson

ROOT: Final = Path(__file__).parents[2]
WORK: Final = ROOT / "build" / "mutation"
SEED: Final = 32
_SPARE: Final = 30  # some mutants of C++ do not compile
_TRIALS: Final = Path(__file__).with_name("trials.py")


def drawn(folder: Folder, root: Path, seed: int) -> list[Mutant]:
    """Return a sample of the folder's mutants, in the order of drawing; numbers are -1."""
    code = native_code if folder.native else python_code
    found = []
    for path in folder.paths(root):
        source = (root / path).read_text(encoding="utf-8")
        lines = source.splitlines()
        found += [
            Mutant(-1, folder.name, path, site, lines[site.line - 1].strip())
            for site in code.sites(source)
        ]
    size = folder.size + (_SPARE if folder.native else 0)
    return random.Random(f"{folder.name} {seed}").sample(found, min(size, len(found)))


def numbered(samples: Iterable[Sequence[Mutant]]) -> list[Mutant]:
    """Return all samples in one list, with the index of each mutant as its number."""
    mutants = [mutant for sample in samples for mutant in sample]
    return [
        Mutant(number, mutant.folder, mutant.path, mutant.site, mutant.text)
        for number, mutant in enumerate(mutants)
    ]


def compiled(mutants: Sequence[Mutant]) -> tuple[Path | None, set[int]]:
    """Return the library with the mutants of C++, if any, and the mutants that do not compile."""
    native = [mutant for mutant in mutants if FOLDERS[mutant.folder].native]
    refused: set[int] = set()
    library = None
    while native and library is None:
        numbers: dict[str, dict[Site, int]] = {}
        for mutant in native:
            if mutant.number not in refused:
                numbers.setdefault(mutant.path, {})[mutant.site] = mutant.number
        sources = WORK / "sources"
        native_code.write(ROOT / "rtamt" / "native", sources, numbers, ROOT)
        library, more = native_code.build(sources, WORK / "native", len(mutants))
        refused |= more
    return library, refused


def plain(mutant: Mutant) -> tuple[object, ...]:
    """Return a mutant in a task of `trials.py`."""
    return mutant.number, mutant.path, astuple(mutant.site)


def tried(mutants: Sequence[Mutant], covering: Covering, library: Path | None, count: int) -> Any:  # noqa: ANN401 - JSON
    """Return the results of `trials.py`, with mutants of an import tried alone."""
    task: dict[str, Any] = {
        "root": str(ROOT),
        "mutants": [plain(mutant) for mutant in mutants],
        "native": str(library) if library else None,
        "count": count,
        "tests": covering.tests,
        "left_out": covering.left_out,
        "backend": covering.backend,
        "suite": covering.suite,
        "only": None,
        "costs": {},
    }
    said = _asked(task)
    for mutant in mutants:
        found = said["trials"][str(mutant.number)]
        if found["killed_by"] is None and found["early"]:
            own = FOLDERS[mutant.folder].own
            costs: dict[str, float] = {}
            for test, seconds in sorted(said["costs"].items(), key=lambda item: item[1]):
                if test.startswith(own) and sum(costs.values()) + seconds < 10:
                    costs[test] = seconds
            files = sorted({test.partition("::")[0] for test in costs})
            alone = _asked(task | {"only": mutant.number, "tests": files, "costs": costs})
            found |= {"tried": found["tried"] + len(costs), "killed_by": alone["killed_by"]}
    return said


def _asked(task: Mapping[str, Any]) -> Any:  # noqa: ANN401 - JSON
    path = WORK / ("task.json" if task["only"] is None else f"task_{task['only']}.json")
    path.with_suffix(".out").unlink(missing_ok=True)
    path.write_text(json.dumps(task), encoding="utf-8")
    with path.with_suffix(".log").open("w", encoding="utf-8") as log:
        subprocess.run([sys.executable, str(_TRIALS), str(path)], stdout=log, check=False)
    return json.loads(path.with_suffix(".out").read_text(encoding="utf-8"))


def equivalents() -> dict[tuple[str, str, str], str]:
    """Return the reason of each known equivalent mutant, by path, line and change."""
    known = tomllib.loads(_TRIALS.with_name("equivalent.toml").read_text(encoding="utf-8"))
    return {(row["path"], row["line"], row["change"]): row["reason"] for row in known["mutant"]}


def main() -> None:
    """Try samples and print the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", metavar="FOLDER", help=", ".join(FOLDERS))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--suite", choices=("quick", "all"), default="all", help="which tests are tried"
    )
    parser.add_argument("--size", type=int, help="mutants in each folder's sample")
    asked = parser.parse_args()
    if unknown := set(asked.folders) - set(FOLDERS):
        parser.error(f"expected folders of {', '.join(FOLDERS)}, got {', '.join(sorted(unknown))}")
    names = asked.folders or list(FOLDERS)
    WORK.mkdir(parents=True, exist_ok=True)
    chosen = {
        name: replace(
            FOLDERS[name],
            size=asked.size or FOLDERS[name].size,
            covering=QUICK if asked.suite == "quick" else FOLDERS[name].covering,
        )
        for name in names
    }
    mutants = numbered(drawn(folder, ROOT, asked.seed) for folder in chosen.values())
    library, refused = compiled(mutants)
    trials: dict[int, Any] = {}
    samples = {
        name: [m for m in mutants if m.folder == name and m.number not in refused][: folder.size]
        for name, folder in chosen.items()
    }
    for covering in dict.fromkeys(folder.covering for folder in chosen.values()):
        these = [m for name in names if chosen[name].covering == covering for m in samples[name]]
        said = tried(these, covering, library, len(mutants))
        trials |= {int(number): found for number, found in said["trials"].items()}
        for test in said["failed"]:
            print(f"fails without a mutant, and is left out: {test}")
    known = equivalents()
    wrong = False
    for name, sample in samples.items():
        last = sample[-1].number
        left_out = sum(m.number in refused and m.number < last for m in mutants if m.folder == name)
        wrong |= report(name, sample, trials, known, left_out)
    sys.exit(1 if wrong else 0)


def report(
    name: str,
    sample: Sequence[Mutant],
    trials: Mapping[int, Any],
    known: Mapping[tuple[str, str, str], str],
    left_out: int,
) -> bool:
    """Print the results of a folder's sample; return whether `equivalent.toml` is wrong."""
    killed, equivalent, survivors, wrong = 0, [], [], []
    for mutant in sample:
        reason = known.get((mutant.path, mutant.text, mutant.site.change))
        if trials[mutant.number]["killed_by"] is not None:
            killed += 1
            wrong += [mutant] if reason else []
        elif reason:
            equivalent.append((mutant, reason))
        else:
            survivors.append(mutant)
    total = len(sample) - len(equivalent)
    low, high = clopper_pearson(killed, total)
    print(
        f"\n{name}: {len(sample)} mutants, {killed} killed, {len(equivalent)} equivalent, "
        f"{len(survivors)} survive; {killed / total:.1%} of those that a test can tell "
        f"({low:.1%} to {high:.1%})" + (f"; {left_out} did not compile" if left_out else "")
    )
    for mutant in survivors:
        found = trials[mutant.number]
        print(f"  survives {found['tried']} of {found['reaching']} tests: {mutant}")
    for mutant, reason in equivalent:
        print(f"  equivalent, {reason}: {mutant}")
    for mutant in wrong:
        print(f"  equivalent.toml is wrong, {trials[mutant.number]['killed_by']} fails: {mutant}")
    return bool(wrong)


if __name__ == "__main__":
    main()
