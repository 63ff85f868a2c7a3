"""Run subjects in processes of their own, in turns, so that all run under the same load."""

from __future__ import annotations

import json
import math
import os
import select
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
MODULES = {"sentil": "sentil_peer", "mstlo": "mstlo_peer", "reelay": "reelay_peer"}
PATIENCE = 45.0
"""Seconds after which a measurement is abandoned."""


class LeftOut(Exception):  # noqa: N818 - an outcome, not a fault
    """A figure is missing; the message is the reason."""


@dataclass
class Subject:
    """A process that measures one tool. The first request starts it."""

    python: str
    module: str
    environment: dict[str, str] = field(default_factory=dict)
    process: subprocess.Popen[bytes] | None = None

    def ask(self, request: object) -> Any:  # noqa: ANN401 - what JSON holds
        """Return the answer to a request.

        Raises:
            LeftOut: If the subject fails or exceeds the time limit.
        """
        if self.process is None:
            self.process = subprocess.Popen(
                [self.python, "-m", f"subjects.{self.module}"],
                cwd=HERE,
                env=single_threaded() | self.environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(json.dumps(request).encode() + b"\n")
            self.process.stdin.flush()
            if not select.select([self.process.stdout], [], [], PATIENCE)[0]:
                self.stop()
                raise LeftOut(f"more than {PATIENCE:.0f} s")
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = b""
        if not line:
            raise LeftOut(self.stop())
        answer = json.loads(line)
        if isinstance(answer, dict) and "error" in answer:
            raise LeftOut(answer["error"])
        return answer

    def stop(self) -> str:
        """End the process; return the last line of its standard error."""
        if self.process is None:
            return ""
        self.process.kill()
        _, output = self.process.communicate()
        self.process = None
        return output.decode(errors="replace").strip().rpartition("\n")[2] or "ended silently"


def single_threaded() -> dict[str, str]:
    """Return the environment variables of every subject."""
    return dict(os.environ) | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass
class Setting:
    """The peers and the floor of a run, and whether it is a quick one."""

    peers: dict[str, str]
    floor: Path | None
    quick: bool

    def project(self, module: str = "rtamt_online") -> Subject:
        """Return a new process of the project."""
        return Subject(sys.executable, module)

    def reference(self) -> Subject | None:
        """Return a new process of the floor; None without a floor."""
        if self.floor is None:
            return None
        path = os.pathsep.join(filter(None, (str(self.floor), os.environ.get("PYTHONPATH"))))
        return Subject(sys.executable, "c", {"PYTHONPATH": path})

    def subjects(self) -> dict[str, Subject]:
        """Return a new process for each column of a table of updates."""
        subjects = {"native": self.project(), "python": self.project()}
        if floor := self.reference():
            subjects["floor"] = floor
        for peer, python in self.peers.items():
            subjects[peer] = Subject(python, MODULES[peer])
        return subjects


Figures = dict[str, list[float]]


def race(
    entries: dict[str, tuple[Subject, dict[str, Any]]], repeats: int, notes: dict[str, str]
) -> Figures:
    """Return the minimum figures of each entry over several repeats, measured in turns.

    Args:
        entries: The subject and the case of each column.
        repeats: The number of repeats.
        notes: Receives the reason for each missing figure, by column.
    """
    best: Figures = {}
    for turn in range(-1, repeats):
        for column, (subject, case) in entries.items():
            if turn >= 0 and column not in best:
                continue
            try:
                answer = subject.ask(case if turn < 0 else None)
            except LeftOut as why:
                notes[column] = str(why)
                best.pop(column, None)
                continue
            if turn < 0:
                best[column] = [math.inf]
                continue
            seen = answer if isinstance(answer, list) else [answer]
            known = best[column] if turn else [math.inf] * len(seen)
            best[column] = [min(pair) for pair in zip(known, seen, strict=True)]
    return best
