"""Cases of golden/released.json, and a program that runs them with any library `rtamt`.

The program uses only the interface of the released library. With that library, version 0.4.10, it
wrote the results into the file (``python tests/support/released_cases.py
tests/golden/released.json``), and the tests run it with this library.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import rtamt

Pairs = list[list[float]]


def measure(case: dict[str, Any]) -> object:
    """Return the result of the library for a case."""
    if case["kind"].startswith("dense"):
        return measure_dense(case)
    spec = rtamt.StlDiscreteTimeSpecification(semantics=rtamt.Semantics(case["semantics"]))
    spec.set_sampling_period(*case["period"])
    declare(spec, case)
    if case["kind"] == "offline":
        return spec.evaluate({"time": case["time"], **case["trace"]})
    spec.pastify()
    updates = [
        spec.update(time, [(name, values[i]) for name, values in case["trace"].items()])
        for i, time in enumerate(case["time"])
    ]
    return updates[case["latency"] :]


def measure_dense(case: dict[str, Any]) -> object:
    """Return the result of the library for a case in dense time."""
    spec = rtamt.StlDenseTimeSpecification(semantics=rtamt.Semantics(case["semantics"]))
    declare(spec, case)
    signals = [[name, events] for name, events in case["trace"].items()]
    if case["kind"] == "dense offline":
        return merged(spec.evaluate(*signals), case["until"])
    spec.pastify()
    return merged(spec.update(*signals), case["until"])


def declare(
    spec: rtamt.StlDiscreteTimeSpecification | rtamt.StlDenseTimeSpecification, case: dict[str, Any]
) -> None:
    """Declare the variables of a case and parse its formula."""
    for name in case["trace"]:
        spec.declare_var(name, "float")
    for name in case["inputs"]:
        spec.set_var_io_type(name, "input")
    spec.spec = case["spec"]
    spec.parse()


def merged(breakpoints: Pairs, until: float) -> Pairs:
    """Return the breakpoints before a time with a value that differs from the previous one."""
    found: Pairs = []
    for time, value in breakpoints:
        if time < until and (not found or found[-1][1] != value):
            found.append([time, value])
    return found


CLASSES = (
    "StlDiscreteTimeSpecification",
    "StlDiscreteTimeOfflineSpecification",
    "StlDiscreteTimeOnlineSpecification",
    "StlDenseTimeSpecification",
    "StlDenseTimeOfflineSpecification",
    "StlDenseTimeOnlineSpecification",
)


def names() -> dict[str, list[str]]:
    """Return every public name of the library, and of an object of each class."""
    objects = {"rtamt": rtamt} | {name: getattr(rtamt, name)() for name in CLASSES}
    return {key: [n for n in dir(o) if not n.startswith("_")] for key, o in objects.items()}


if __name__ == "__main__":
    path = Path(sys.argv[1])
    content = json.loads(path.read_text())
    for case in content["cases"]:
        case["result"] = measure(case)
    lines = ",\n".join(json.dumps(case) for case in content["cases"])
    about, known = json.dumps(content["about"]), json.dumps(names())
    path.write_text(f'{{"about": {about}, "names": {known}, "cases": [\n{lines}\n]}}\n')
