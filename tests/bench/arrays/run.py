"""Measure monitors on arrays against the C++ machines, and traces against stljax and STLCG++.

    python tests/bench/arrays/run.py [steps traces plan] [--quick] [--device cuda]
        [--entries 1024 4096 65536] [--json FILE]

The interpreter needs JAX and torch. stljax and stlcgpp are compared if they are installed. Each row
is the minimum of several repeats in a process of its own, with one thread on a CPU. Numbers are
float32; in C++ they are float64. On a GPU the same command measures there: JAX uses the GPU that it
finds, and torch the one of --device, which adds recorded CUDA graphs. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

Row = dict[str, Any]

SECTIONS = {
    "steps": "ns an entry and step; s of processors to compile",
    "traces": "us a trace, and with its gradient; s of processors to compile",
    "plan": "a unicycle: ms a step of the optimizer; s of processors to compile",
}
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "TORCHINDUCTOR_COMPILE_THREADS": "1",
    "TF_CPP_MIN_LOG_LEVEL": "3",
}


def asked(section: str, subject: str, case: Row) -> Row:
    """Return the figures of a new process; its error text if it fails."""
    here = Path(__file__).parent
    env = os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join([str(here), *sys.path])}
    command = [sys.executable, str(here / f"{section}.py"), subject, json.dumps(case)]
    ran = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if ran.returncode:
        return {"failed": (ran.stderr.strip().splitlines() or ["no word"])[-1][:70]}
    figures: Row = json.loads(ran.stdout.splitlines()[-1])
    return figures


def cases(section: str, arguments: argparse.Namespace) -> list[tuple[str, Row]]:
    """Return the subjects of a section and their cases."""
    more = {"device": arguments.device, "quick": arguments.quick}
    if section == "steps":
        subjects = ["C++", "jax", "torch compiled", "torch eager"]
        subjects += ["torch CUDA graph"] if arguments.device != "cpu" else []
        return [
            (subject, {"spec": spec, "entries": entries, **more})
            for spec in ("W1", "resp", "nested")
            for entries in arguments.entries
            for subject in subjects
        ]
    if section == "traces":
        subjects = ["C++", "jax", "stljax", "torch", "stlcgpp"]
        return [
            (subject, {"spec": spec, **more})
            for spec in ("response", "reach")
            for subject in subjects
        ]
    return [(subject, more) for subject in ("jax", "stljax")]


def shown(cell: object) -> str:
    """Return a number with at least three digits."""
    if isinstance(cell, float):
        return f"{cell:,.0f}" if abs(cell) >= 100 else f"{cell:.3g}"
    return str(cell)


def main() -> None:
    """Print a table for each section."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--device", default="cpu", help="the device of torch, such as cuda")
    parser.add_argument("--entries", type=int, nargs="+", default=[1_024, 4_096, 65_536])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all rows there")
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(SECTIONS):
        parser.error(f"expected sections out of {', '.join(SECTIONS)}, got {unknown.pop()!r}")
    rows: list[Row] = []
    for section in arguments.sections or SECTIONS:
        print(f"\n{section}: {SECTIONS[section]}", flush=True)
        for subject, case in cases(section, arguments):
            row = {"section": section, "subject": subject, **case, **asked(section, subject, case)}
            rows.append(row)
            hidden = {"section", "device", "quick"}
            cells = (f"{k} {shown(v)}" for k, v in row.items() if k not in hidden)
            print("   ".join(cells), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
