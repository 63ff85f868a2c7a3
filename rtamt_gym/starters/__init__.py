"""Starters: a specification, a test and a job of CI for each tutorial.

A folder holds the files of a starter. Names end in ``.txt`` if tools would take the file for a file
of this project; the written file has no such ending.

To add a tutorial: a page in ``docs/tutorials``, a folder of the same name here with a
specification, a test and ``job.yml``, and a row of `STARTERS`. ``tests/project/test_tutorials.py``
plays the page in an empty folder: commands must print the output on the page, a block after
"`NAME`:" is that file, and a block ``diff`` changes it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rtamt import InputError

JOB = ".github/workflows/requirements.yml"
"""The path of a starter's ``job.yml`` in the written folder."""


@dataclass(frozen=True)
class Starter:
    """The start of a tutorial."""

    about: str
    extras: str
    begin: str


STARTERS: Mapping[str, Starter] = {
    "environment": Starter(
        "learn under requirements, in an environment of Gymnasium", "gym,search", "python train.py"
    ),
    "recordings": Starter(
        "recordings as a gate in CI",
        "check",
        "rtamt monitor requirements.stl --require-triggered -- recordings",
    ),
    "violation": Starter(
        "find a violation, and keep it as a test",
        "search",
        "rtamt falsify tank:tank requirements.stl --vary inflow=0:1,points=5 "
        "--duration 60 --period 1 --save overflow.json",
    ),
    "robot": Starter(
        "a robot under ROS, and its recordings as a gate",
        "bags",
        "rtamt monitor follows.stl --period 100ms -- recordings",
    ),
}
"""The starters by the name of the page of their tutorial."""


def starter_files(name: str) -> dict[str, str]:
    """Return the texts of a starter's files, by their paths.

    Example:
        >>> sorted(starter_files("violation"))
        ['.github/workflows/requirements.yml', 'requirements.stl', 'tank.py', 'test_tank.py']
    """
    folder = Path(__file__).with_name(name)
    files = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        written = path.relative_to(folder).as_posix().removesuffix(".txt")
        files[JOB if written == "job.yml" else written] = path.read_text(encoding="utf-8")
    return files


def write_starter(name: str, folder: Path) -> list[str]:
    """Write the files of a starter into a folder; return their paths in it."""
    files = starter_files(name)
    there = [file for file in files if (folder / file).exists() or (folder / file).is_symlink()]
    if there:
        more = f" and {len(there) - 1} more" if there[1:] else ""
        raise InputError(
            f"{folder / there[0]}{more} would be overwritten: give another folder, "
            f"rtamt init {name} FOLDER"
        )
    for position in (folder, *((folder / file).parent for file in files)):
        above = next((path for path in (position, *position.parents) if path.exists()), position)
        if above.exists() and not above.is_dir():
            raise InputError(f"{above} is a file: give another folder, rtamt init {name} FOLDER")
    for file, text in files.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
    return list(files)
