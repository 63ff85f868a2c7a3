"""The cost of a step of an exported monitor, compared with an FMU that does nothing.

A step sets two inputs, steps the period, and reads robustness, bounds and verdict, all through C
functions. ``python tests/bench/fmu.py`` prints nanoseconds. With the argument ``instructions`` it
counts processor instructions with valgrind, which is slow and exact. In dense time a step is a
tick, so a window of n numbers is n steps long.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from rtamt.export.program_file import dense_programs, sampled_programs
from rtamt.language.parser import as_specification, traced

C = Path(__file__).parent / "c"
TOKEN = "bench"  # noqa: S105 - it names a unit
FORMULAS = {
    "always": "always(x > 0 and y > -9)",
    "response in 100": "always(x >= 3 implies eventually[0:100](y >= 3))",
    "response in 1000": "always(x >= 3 implies eventually[0:1000](y >= 3))",
    "duration of 1000": "always(x >= 3 implies always[0:1000](y >= -9))",
    "nested": "always(x >= 3 implies eventually[0:100] always[0:50](y >= -9))",
    "and named": "near = once[0:20](x > y)\nalways(x >= 3 implies eventually[0:100](y >= 3))",
}
DENSE = {
    "always": "always(x > 0 and y > -9)",
    "response in 5": "always(x >= 3 implies eventually[0:5](y >= 3))",
    "response in 1000": "always(x >= 3 implies eventually[0:1000](y >= 3))",
    "duration of 100": "always(x >= 3 implies always[0:100](y >= -9))",
    "past of 20": "always(x > 9 implies once[0:20](y > 3))",
    "until in 20": "always((x > -9) until[0:20] (y >= 3))",
    "nested": "always(x >= 3 implies eventually[0:100] always[0:50](y >= -9))",
}


def compiled(folder: Path) -> tuple[Path, Path]:
    """Return the driver and the FMU that does nothing."""
    driver, empty = folder / "driver", folder / "empty.so"
    shared = ["-shared", "-fPIC", "-fvisibility=hidden"]
    for source, target, flags in (("driver", driver, []), ("empty", empty, shared)):
        command = ["cc", "-O2", *flags, str(C / f"fmu_{source}.c"), "-o", str(target), "-ldl"]
        subprocess.run(command, check=True)
    return driver, empty


def nanoseconds(command: list[str]) -> float:
    """Return the minimum time of a step."""
    arguments = [*command, "50000", "40"]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[0])


def instructions(command: list[str]) -> float:
    """Return the instructions of a step: the difference between a long and a short run."""
    counted = []
    for steps in (20_000, 60_000):
        tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        arguments = [*tool, *command, str(steps), "1"]
        done = subprocess.run(arguments, check=True, capture_output=True, text=True)
        match = re.search(r"Collected : (\d+)", done.stderr)
        assert match, done.stderr
        counted.append(int(match[1]))
    return (counted[1] - counted[0]) / 40_000


def main() -> None:
    """Print a row for each formula."""
    measure = instructions if sys.argv[1:] == ["instructions"] else nanoseconds
    native = find_spec("rtamt._native")
    assert native is not None
    library = str(Path(native.origin or "").with_name("rtamt_monitor.so"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        driver, empty = compiled(folder)
        floor = measure([str(driver), str(empty), folder.as_uri(), TOKEN])
        print(f"{measure.__name__} a step")
        print(f"{'nothing':22} {floor:8.1f}")
        for label, text, dense in (
            *((label, text, False) for label, text in FORMULAS.items()),
            *((f"dense {label}", text, True) for label, text in DENSE.items()),
        ):
            spec = traced(as_specification(text))
            programs = (
                dense_programs(main, spec, "1s", {})
                if dense
                else sampled_programs(main, spec, 1, {})
            )
            file = folder / "program.rtamt"
            file.write_text(programs.text(token=TOKEN, stop=False))
            cost = measure([str(driver), library, folder.as_uri(), TOKEN])
            print(f"{label:22} {cost:8.1f}  {cost - floor:+8.1f}")


if __name__ == "__main__":
    main()
