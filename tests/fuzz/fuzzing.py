"""Search for inputs that break a target, guided by coverage.

Clang links C++ targets with libFuzzer. atheris runs Python targets, with a native module that shows
its branches to the fuzzer; this needs an installation that is not editable. Each target starts from
its folder in `corpus`. An input that breaks a target is kept in `build/fuzz/found/TARGET` and fails
the run.

Run: python tests/fuzz/fuzzing.py [--seconds N] [TARGET ...]
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import nanobind  # type: ignore[import-untyped]

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
BUILD = ROOT / "build" / "fuzz"
NATIVE = ("program_file", "unit_calls")
PYTHON = ("specification", "snapshot", "trace", "equality")


def build(source: Path, folder: Path, **options: str) -> None:
    """Configure and build a CMake project with Clang."""
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "CC": "clang", "CXX": "clang++"}
    defined = [f"-D{name}={value}" for name, value in options.items()]
    configure = ["cmake", "-S", str(source), "-B", str(folder), "-G", "Ninja", *defined]
    for command in (configure, ["cmake", "--build", str(folder)]):
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)


def main() -> int:
    """Run the targets one after the other; return 1 if any of them broke."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("targets", nargs="*", choices=[[], *NATIVE, *PYTHON], metavar="TARGET")
    parser.add_argument("--seconds", type=int, default=60, help="of each target (default: 60)")
    args = parser.parse_args()
    targets = args.targets or [*NATIVE, *PYTHON]
    if set(targets) & set(NATIVE):
        build(HERE / "native", BUILD / "units", CMAKE_BUILD_TYPE="Debug", FUZZER="ON")
    if set(targets) & set(PYTHON):
        build(
            ROOT / "rtamt" / "native",
            BUILD / "module",
            CMAKE_BUILD_TYPE="Release",
            CMAKE_CXX_FLAGS="-fsanitize=fuzzer-no-link",
            CMAKE_TRY_COMPILE_TARGET_TYPE="STATIC_LIBRARY",
            Python_EXECUTABLE=sys.executable,
            nanobind_DIR=nanobind.cmake_dir(),
        )
    broken = [target for target in targets if not run(target, args.seconds)]
    if broken:
        print(f"broken: {', '.join(broken)}; the inputs are in {BUILD / 'found'}")
    return 1 if broken else 0


def run(target: str, seconds: int) -> bool:
    """Run a target, and print its runs and its coverage; return whether nothing broke."""
    grown, found = BUILD / "grown" / target, BUILD / "found" / target
    for folder in (grown, found):
        folder.mkdir(parents=True, exist_ok=True)
    program = (
        [str(BUILD / "units" / target)]
        if target in NATIVE
        else [sys.executable, str(HERE / "guided.py"), target]
    )
    options = [f"-max_total_time={seconds}", f"-artifact_prefix={found}/", "-print_final_stats=1"]
    limits = ["-max_len=4096", "-rss_limit_mb=4096", "-timeout=60"]
    corpora = [str(grown), str(HERE / "corpus" / target)]
    done = subprocess.run(
        [*program, *options, *limits, *corpora], capture_output=True, text=True, check=False
    )
    said = done.stdout + done.stderr
    runs = re.findall(r"number_of_executed_units: *(\d+)", said)
    reached = re.findall(r"cov: (\d+)", said)
    print(
        f"{target:14} {(runs or ['?'])[-1]:>10} runs, {(reached or ['?'])[-1]:>6} branches",
        flush=True,
    )
    if done.returncode:
        print("\n".join(said.splitlines()[-40:]))
    return done.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
