"""Run exported monitors with FMPy, call by call, and generate specifications to export."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, cast
from unittest.mock import patch

import fmpy  # type: ignore[import-untyped]
import pytest
from fmpy import read_model_description
from hypothesis import strategies as st
from strategies import QUARTERS, formulas

from rtamt import Formula, Specification, variable
from rtamt.export import fmu
from rtamt.export.fmu import Fmi, export_fmu
from rtamt.language.formula import make
from rtamt.language.node import Node

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Spec = str | Formula | Specification
Listener = Callable[..., None]

_number = st.sampled_from(QUARTERS)
_often = st.sampled_from((True, True, True, False))

_listeners: list[Listener] = []
"""All callbacks: FMPy calls the last unit of FMI 2.0 even after it was freed."""


class Unit:
    """An instance of an exported monitor, already instantiated."""

    def __init__(self, path: Path, folder: Path, heard: Listener = lambda *_: None) -> None:
        _listeners.append(heard)
        self.described = read_model_description(path)
        self.version = int(self.described.fmiVersion[0])
        self.entries = {each.name: each for each in self.described.modelVariables}
        self.fmu: Any = fmpy.instantiate_fmu(
            str(folder), self.described, "CoSimulation", debug_logging=True, logger=heard
        )

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        for name, value in values.items():
            self._call("set", name)([self.entries[name].valueReference], [value])

    def get(self, *names: str) -> list[float]:
        """Return the values of variables."""
        references = {name: self.entries[name].valueReference for name in names}
        return [self._call("get", name)([at])[0] for name, at in references.items()]

    def outputs(self) -> tuple[str, ...]:
        """Return the names of its outputs."""
        return tuple(name for name, each in self.entries.items() if each.causality == "output")

    def begin(self, parameters: Mapping[str, float] | None = None, start: float = 0.0) -> None:
        """Initialize it."""
        self.set(parameters or {})
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start)
        self.fmu.exitInitializationMode()

    def step(self, at: float, size: float, inputs: Mapping[str, float]) -> None:
        """Set the inputs and make a step."""
        self.set(inputs)
        self.fmu.doStep(at, size)

    def state(self) -> bytes:
        """Return its serialized state."""
        state = self.fmu.getFMUState()
        data: bytes = self.fmu.serializeFMUState(state)
        self.fmu.freeFMUState(state)
        return data

    def restore(self, data: bytes) -> None:
        """Set a serialized state."""
        state = self.fmu.deserializeFMUState(data)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)

    def _call(self, verb: str, name: str) -> Callable[..., Any]:
        call: Callable[..., Any] = getattr(self.fmu, f"{verb}{self.entries[name].type}")
        return call


@contextmanager
def exported(
    spec: Spec,
    fmi: Fmi,
    heard: Listener = lambda *_: None,
    **options: Any,  # noqa: ANN401 - those of export_fmu
) -> Iterator[Unit]:
    """Return an instance of an exported monitor."""
    folder = Path(tempfile.mkdtemp())
    try:
        path = folder / "monitor.fmu"
        with patch.object(fmu, "COMPRESSION", zipfile.ZIP_STORED):  # four times as fast
            export_fmu(spec, path, fmi=fmi, **options)
        monitor = Unit(path, Path(fmpy.extract(path, folder / "unpacked")), heard)
        try:
            yield monitor
        finally:
            monitor.fmu.freeInstance()
    finally:
        shutil.rmtree(folder)


class Drawn(NamedTuple):
    """A text with constants, its prefix that defines ``part``, and other values for them."""

    text: str
    part: str
    others: dict[str, float]


@st.composite
def texts(draw: st.DrawFn, *, dense: bool = False) -> Drawn:
    """Return a text of a named formula and a result that uses it, with constants as numbers."""
    named = draw(formulas(2, endless=True, total=False, dense=dense))
    result = draw(formulas(2, endless=True, dense=dense))
    values: dict[str, float] = {}

    def with_names(formula: Formula) -> Formula:
        made: dict[Node, Node] = {}
        for node in formula.nodes():
            if isinstance(node.leaf, float) and draw(_often):
                name = f"k{len(values)}"
                values[name] = node.leaf
                made[node] = variable(name)
            elif node.op is None:
                made[node] = node
            else:
                args = tuple(made[each] for each in node.args)
                made[node] = make(node.op.name, args, node.interval)
        return cast("Formula", made[formula])

    root = draw(st.sampled_from(("", "always", "eventually")))
    joined = f"part {draw(st.sampled_from(('and', 'or', 'implies')))} ({with_names(result)})"
    lines = [f"part = {with_names(named)}", f"whole = {root}({joined})"]
    constants = [f"const float {name} = {value!r}" for name, value in values.items()]
    constants += ["input float a", "output float b", "float c"]
    others = {name: draw(_number) for name in values if draw(_often)}
    *part, _ = text = [*constants, *lines]
    return Drawn("\n".join(text), "\n".join(part), others)
