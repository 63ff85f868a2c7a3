"""`export_fmu`: a monitor as a functional mock-up unit."""

from __future__ import annotations

import os

from rtamt.errors import Argument, InputError, InputTypeError, brief
from rtamt.export import Fmi
from rtamt.language.parser import as_specification, traced
from rtamt.monitors.options import Options, SampleOptions, Spec
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.timing import Align, Period

__all__ = ["export_fmu"]


def export_fmu(
    spec: Spec,
    path: str | os.PathLike[str],
    *,
    period: Period | None = None,
    dense: bool = False,
    fmi: Fmi = 2,
    stop_on_violation: bool = False,
    semantics: SemanticsName = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
    align: Align | None = None,
    resolution: Period = "1ns",
) -> None:
    """Write a functional mock-up unit (FMU) that monitors a specification in another tool.

    It is for co-simulation, has its own copy of the C++ machines, and needs no Python where it
    runs. Its inputs are the variables of the specification, its parameters the constants of the
    text. After each step its outputs are

    * ``robustness``, ``lower``, ``upper`` and ``verdict`` (-1 violated, 0 undecided, 1 satisfied),
      to the bit what `EpisodeMonitor` says after the same samples;
    * every named formula, the result's own name too: to the bit what `Monitor` on this formula
      says, late by its latency; where the formula has an unbounded future inside, for which no
      monitor can wait, what `EpisodeMonitor` says: its robustness as if the run ended now.

    A sample is taken at every multiple of the period after the start, the first at the start: a
    step from t to t + period takes in the values that the inputs have at t. Longer steps hold
    them. Before the first step robustness and named formulas are nan.

    A constant in a bound of an interval gives the monitor its form, so it can be read, not set;
    constants that no formula uses are left out.

    Inputs are discrete in the model description, so that importers hold their values and do not
    interpolate.

    Over dense time (``dense``) steps may have any size, and each gives every variable an event at
    its start. Robustness, bounds and verdict are to the bit what `DenseEpisodeMonitor` says after
    these events; a named formula is what `DenseMonitor` has settled of it last, or, where that
    cannot wait, what `DenseEpisodeMonitor` says of it.

    The unit has the library for the platform on which it is exported, Linux on x86-64. The same
    arguments give the same bytes.

    Args:
        spec: Text, a formula, or a parsed specification; its result is monitored.
        path: The file to write; its name ends in ``.fmu``.
        period: Seconds between samples, as a number or as text (``"100ms"``).
        dense: Whether it monitors over dense time; then there is no period.
        fmi: The version of FMI, 2 or 3.
        stop_on_violation: The start value of the parameter of this name, with which the monitor
            ends the simulation after the step that makes the verdict -1.
        semantics: As for `Monitor`.
        inputs: As for `Monitor`.
        outputs: As for `Monitor`.
        align: As for `Monitor`; not over dense time.
        resolution: As for `DenseMonitor`.

    Raises:
        SpecificationError: As `EpisodeMonitor` and `DenseEpisodeMonitor` raise it, or on a name
            that the monitor has itself, such as ``lower``.
        InputError: On an argument that has no such value, a path that does not end in ``.fmu``,
            neither a period nor ``dense``, or where the library was not built or does not exist for
            this platform.
        OSError: If the file cannot be written.

    Example:
        >>> import pathlib, tempfile, zipfile
        >>> path = pathlib.Path(tempfile.mkdtemp(), "monitor.fmu")
        >>> export_fmu("const float limit = 5; always(speed < limit)", path, period="100ms")
        >>> zipfile.ZipFile(path).namelist()  # doctest: +NORMALIZE_WHITESPACE
        ['modelDescription.xml', 'binaries/linux64/rtamt_monitor.so', 'resources/program.rtamt']

    Source: Functional Mock-up Interface 2.0.4 and 3.0.2, Modelica Association.
    """
    if fmi not in {2, 3}:
        raise InputError(f"expected fmi=2 or fmi=3, got {brief(fmi)}")
    if not isinstance(path, str | os.PathLike):
        raise InputTypeError(f"expected the path of a file as text or a Path, got {brief(path)}")
    if not os.fspath(path).lower().endswith(".fmu"):  # of another name no tool takes it
        raise InputError(f"cannot write {os.fspath(path)}: expected a name that ends in .fmu")
    # What these import takes 30 ms.
    from rtamt.export.programs import dense_programs, sampled_programs
    from rtamt.export.unit import unit

    known = traced(as_specification(spec))
    if dense:
        if period is not None:
            raise InputError("expected period= or dense=True, which takes events at any time")
        if align is not None:
            raise InputError(
                Argument("align"), " rounds bounds to samples; expected none with dense time"
            )
        options: Options = {"semantics": semantics, "inputs": inputs, "outputs": outputs}
        programs = dense_programs(export_fmu, known, resolution, options)
    else:
        if period is None:
            raise InputError(
                "expected the time between samples, period= in seconds or as text such as '100ms', "
                "or dense=True"
            )
        sampled: SampleOptions = {
            "semantics": semantics,
            "inputs": inputs,
            "outputs": outputs,
            "align": align,
        }
        programs = sampled_programs(export_fmu, known, period, sampled)
    data = unit(programs, fmi, stop=bool(stop_on_violation))
    with open(path, "wb") as file:  # noqa: PTH123 - pathlib takes 5 ms of every import
        file.write(data)
