"""What a step of an exported monitor costs over a step of a unit that does nothing.

A step sets two inputs, makes a step of the period, and reads robustness, bounds and verdict, all
through the functions of C. ``python tests/bench/fmu.py`` prints nanoseconds; ``instructions``
behind it counts instructions of the processor with valgrind instead, which is slow and exact.
Over dense time a step is a tick, so that windows are as many steps long as the numbers say.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from rtamt.export.program_file import dense_programs, program_text, sampled_programs
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
    """The driver, and the unit that does nothing."""
    driver, empty = folder / "driver", folder / "empty.so"
    shared = ["-shared", "-fPIC", "-fvisibility=hidden"]
    for source, target, flags in (("driver", driver, []), ("empty", empty, shared)):
        command = ["cc", "-O2", *flags, str(C / f"fmu_{source}.c"), "-o", str(target), "-ldl"]
        subprocess.run(command, check=True)
    return driver, empty


def nanoseconds(command: list[str]) -> float:
    """The least time of a step."""
    given = [*command, "50000", "40"]
    done = subprocess.run(given, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[0])


def instructions(command: list[str]) -> float:
    """Instructions of a step: those of a long run less those of a short one."""
    counted = []
    for steps in (20_000, 60_000):
        tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        given = [*tool, *command, str(steps), "1"]
        done = subprocess.run(given, check=True, capture_output=True, text=True)
        found = re.search(r"Collected : (\d+)", done.stderr)
        assert found, done.stderr
        counted.append(int(found[1]))
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
            file.write_text(program_text(programs.file(token=TOKEN, stop=False)))
            cost = measure([str(driver), library, folder.as_uri(), TOKEN])
            print(f"{label:22} {cost:8.1f}  {cost - floor:+8.1f}")


if __name__ == "__main__":
    main()
