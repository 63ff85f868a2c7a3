"""Where parts of a formula fail and hold, in one pass, against the passes of `Foresight`."""

from __future__ import annotations

from typing import get_args

import numpy as np
from bits import identical
from hypothesis import given, settings
from implying import aware, requirements
from interface_cases import Case
from profiles import examples
from strategies import Trace, length, traces

from rtamt import Formula, Specification, parse
from rtamt.inputs.samples import SampleReader
from rtamt.language.parser import as_specification
from rtamt.machines.backend import BACKENDS, BackendName
from rtamt.machines.foresight import Foresight
from rtamt.machines.part_signs import PartSigns
from rtamt.machines.protocols import End
from rtamt.program.interface import STANDARD, Interface, as_interface
from rtamt.program.lowering import compile_program


def agrees(
    formula: Formula | Specification,
    trace: Trace,
    n: int,
    backend: BackendName,
    interface: Interface = STANDARD,
) -> None:
    program = compile_program(as_specification(formula), interface=interface)
    columns = [np.array(trace[name], np.float64) for name in program.variables]
    made = BACKENDS[backend]
    reader = SampleReader(program, bounds=True)
    foresight = Foresight.of(
        *(program, reader, made.discrete_machine, made.term_ranges, (columns, columns), n),
        everywhere=True,
    )
    for end in get_args(End):
        part, signs = foresight.part(program), PartSigns(foresight, program, end)
        assert signs.fails().tolist() == part.fails(end).tolist() == foresight.fails(end).tolist()
        assert signs.holds().tolist() == part.holds(end).tolist() == foresight.holds(end).tolist()
        assert identical(part.bounds(end), foresight.bounds(end)), end


@settings(max_examples=examples(150))
@given(formula=requirements(total=False), trace=traces(most=20))
def test_one_pass_finds_what_many_do(formula: Formula, trace: Trace, backend: BackendName) -> None:
    agrees(formula, trace, length(trace), backend)


@settings(max_examples=examples(150))
@given(case=aware(requirements(2)), trace=traces(most=12))
def test_so_it_is_under_every_semantics(case: Case, trace: Trace, backend: BackendName) -> None:
    spec, semantics = case
    agrees(spec, trace, length(trace), backend, as_interface(spec, semantics, None, None))


def test_windows_that_are_shorter_than_the_trace(backend: BackendName) -> None:
    rng = np.random.default_rng(0)
    trace = {"x": (rng.normal(size=300) - 1).tolist(), "y": rng.normal(size=300).tolist()}
    for text in (
        "eventually[0:5](x > 0)",
        "always[2:4](x > 0) or once[1:3](y > 0)",
        "next(x > 0 until[1:6] y > 0)",
        "historically(x < 3) and eventually[0:9](y > 2)",
        "x > 0 since y > 0",
        "rise(x > 0)",
        "eventually(x > 2)",
        "x > 0",
    ):
        agrees(parse(text).formula, trace, 300, backend)
