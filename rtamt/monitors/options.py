"""The options that monitors and evaluations share, and the programs that they compile.

To add an option of every monitor: add its type to `Options` and its row to `OPTIONS`, and use it
where monitors compile programs. If wrappers, commands and nodes should take it too, follow `Align`
through `rtamt_gym.options.evaluation` and `rtamt_ros.parameters`.
"""

from __future__ import annotations

import functools
import inspect
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any, Final, Literal, NamedTuple, TypedDict, TypeVar, cast, get_args

from rtamt.errors import InputError, alternatives, brief, nearest
from rtamt.inputs.event_reader import NO_DENSE_BOUNDS, EventReader, checked_nan
from rtamt.inputs.samples import NanPolicy
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.backend import Backend, BackendName, choose
from rtamt.machines.protocols import End
from rtamt.program.dense_lowering import (
    DenseProgram,
    RegionProgram,
    as_resolution,
    compile_dense,
    compile_regions,
)
from rtamt.program.interface import Interface, Names, SemanticsName, as_interface
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Align, Period, as_align, as_period, samples

Spec = str | Formula | Specification
"""A specification: text, a formula made of combinators, or a parsed specification."""


Interpolation = Literal["previous"]
"""The value of a signal between events."""


class Options(TypedDict, total=False):
    """The options of every monitor and evaluation; `OPTIONS` describes them."""

    semantics: SemanticsName
    inputs: Names | None
    outputs: Names | None
    backend: Backend


class SampleOptions(Options, total=False):
    """The options of monitors and evaluations of samples."""

    nan: NanPolicy
    align: Align | None


class EventOptions(Options, total=False):
    """The options of judgements and episode monitors of events, which have bounds."""

    nan: NanPolicy
    max_gap: Period | None


class MonitorOption(NamedTuple):
    """An option of monitors and evaluations; without ``choices`` it takes other values."""

    default: object
    choices: tuple[object, ...]
    about: str


OPTIONS: Final[Mapping[str, MonitorOption]] = {
    "semantics": MonitorOption(
        "standard",
        get_args(SemanticsName),
        '``"standard"``; ``"boolean"``, under which every predicate is +inf or -inf; or an '
        'interface-aware one: ``"output-robustness"``, ``"input-vacuity"``, '
        '``"input-robustness"`` or ``"output-vacuity"``.',
    ),
    "inputs": MonitorOption(
        None,
        (),
        "Variables that the system reads, for interface-aware semantics; the name of a message "
        "means all its fields. Default: variables declared ``input``.",
    ),
    "outputs": MonitorOption(
        None,
        (),
        "Variables that the system sets, for interface-aware semantics; the name of a message "
        "means all its fields. Default: variables declared ``output``.",
    ),
    "backend": MonitorOption(
        "auto",
        get_args(Backend),
        '``"native"`` runs the machine in C++, ``"python"`` the machine in Python; ``"auto"`` '
        "takes C++ if it was built.",
    ),
    "nan": MonitorOption(
        "raise",
        get_args(NanPolicy),
        '``"raise"`` refuses nan; ``"hold"`` keeps the last value of the variable. Monitors with '
        'bounds also take ``"unknown"``, for an unknown value.',
    ),
    "align": MonitorOption(
        None,
        (None, *get_args(Align)),
        "How to round a bound that is not a whole number of samples; None raises an error. "
        '``"outward"`` takes the floor of the start and the ceiling of the end, ``"inward"`` the '
        'reverse, and ``"nearest"`` the nearest sample; at a tie, it widens the window. '
        "``str(monitor.program)`` lists the rounded intervals.",
    ),
    "max_gap": MonitorOption(
        None,
        (),
        "The maximum time between events of a variable, in seconds or as text with a unit, over "
        "which its value holds. In a longer gap the value is unknown, from one tick after the "
        "first event to the second. Default: no limit.",
    ),
}
"""Every option once, for signatures, defaults and docstrings."""


_DEFAULTS: Final[Mapping[object, Mapping[str, object]]] = {
    kind: {name: OPTIONS[name].default for name in kind.__annotations__}
    for kind in (Options, SampleOptions, EventOptions)
}
_ENDS: Final[tuple[End, ...]] = get_args(End)


class Compiled(NamedTuple):
    """A specification of samples with its options, and its program."""

    specification: Specification
    interface: Interface
    backend: BackendName
    nan: NanPolicy
    period: Fraction | None
    align: Align | None
    program: Program

    def part(self, formula: Formula, interface: Interface | None = None) -> Program:
        """Return the program of another formula, perhaps by another semantics."""
        return compile_program(
            _with_result(self.specification, formula),
            self.period,
            interface=self.interface if interface is None else interface,
            align=self.align,
        )

    def bounds(self, node: Node) -> Bounds:
        """Return the bounds of an operator in samples."""
        error = functools.partial(self.specification.error, node)
        return samples(node.interval, self.period, self.specification.unit, error, self.align)


@functools.lru_cache(maxsize=512)
def _with_result(
    specification: Specification, formula: Formula, *, whole: bool = False
) -> Specification:
    other = specification.with_result(formula)
    if whole:
        other = replace(other, formulas={**other.formulas, "#": specification.formula})
    return other


_F = TypeVar("_F", bound=Callable[..., object])
_C = TypeVar("_C", bound=type)
_O = TypeVar("_O", bound=Options)
_SEE: Final = " See `OPTIONS`.\n"


def compiled(
    caller: Callable[..., object],
    spec: Spec,
    period: Period | None,
    options: SampleOptions,
    *,
    online: bool,
) -> Compiled:
    """Check the options of a monitor or an evaluation of samples, and compile its specification.

    An error names the caller. ``online`` refuses future operators without an end.
    """
    settings = _settings(caller, options, SampleOptions)
    specification, interface, backend = _understood(spec, settings)
    seconds = as_period(period)
    align = as_align(settings["align"])
    program = compile_program(
        specification, seconds, interface=interface, align=align, online=online
    )
    return Compiled(specification, interface, backend, settings["nan"], seconds, align, program)


def compiled_dense(
    caller: Callable[..., object],
    spec: Spec,
    resolution: Period,
    options: Options,
    *,
    online: bool,
) -> tuple[Specification, Interface, BackendName, DenseProgram]:
    """Compile the specification of a monitor or an evaluation of events; see `compiled`."""
    for name in ("nan", "max_gap"):
        if name in options:
            raise InputError(f"{name}= is for unknown values; {NO_DENSE_BOUNDS}")
    settings = _settings(caller, options, Options)
    specification, interface, backend = _understood(spec, settings)
    program = compile_dense(
        specification, as_resolution(resolution), interface=interface, online=online
    )
    return specification, interface, backend, program


class CompiledEvents(NamedTuple):
    """A specification of events with its options, and its program over regions."""

    specification: Specification
    interface: Interface
    backend: BackendName
    nan: NanPolicy
    max_gap: Fraction | None
    program: RegionProgram

    def reader(self) -> EventReader:
        """Return a reader of events, which remembers whether their values are known."""
        gap = None if self.max_gap is None else int(self.max_gap / self.program.resolution)
        return EventReader(self.program, self.nan, gap, bounds=True)

    def part(
        self, formula: Formula, interface: Interface | None = None, *, whole: bool = False
    ) -> RegionProgram:
        """Return the program of another formula, perhaps by another semantics.

        A ``whole`` program, or a formula without variables, keeps the variables of the trace.
        """
        whole = whole or not formula.variables
        return compile_regions(
            _with_result(self.specification, formula, whole=whole),
            self.program.resolution,
            interface=self.interface if interface is None else interface,
        )

    def bounds(self, node: Node) -> Bounds:
        """Return the bounds of an operator in ticks."""
        return self.program.bounds(node)


def compiled_regions(
    caller: Callable[..., object], spec: Spec, resolution: Period, options: EventOptions
) -> CompiledEvents:
    """Compile the specification of a judgement or a monitor of events with bounds."""
    settings = _settings(caller, options, EventOptions)
    specification, interface, backend = _understood(spec, settings)
    program = compile_regions(specification, as_resolution(resolution), interface=interface)
    max_gap, nan = as_period(settings["max_gap"], "max_gap"), checked_nan(settings["nan"])
    return CompiledEvents(specification, interface, backend, nan, max_gap, program)


def checked_end(end: object) -> End:
    """Return the end mode; raise InputError on another one."""
    if not isinstance(end, str) or end not in _ENDS:
        msg = f"expected end={alternatives(_ENDS)}, got {brief(end)}"
        raise InputError(msg + nearest(brief(end), _ENDS))
    return end


def listed_in_signature(options: type) -> Callable[[_F], _F]:
    """List each option in the signature of a function that takes them as ``**options``."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    listed = [
        inspect.Parameter(
            name, keyword, default=OPTIONS[name].default, annotation=kind.__forward_arg__
        )
        for name, kind in options.__annotations__.items()
    ]

    def decorate(function: _F) -> _F:
        signature = inspect.signature(function)
        *others, _ = signature.parameters.values()
        cast("Any", function).__signature__ = signature.replace(parameters=[*others, *listed])
        return function

    return decorate


def described(*names: str) -> Callable[[_C], _C]:
    """Insert the descriptions of options into the docstring of a class, above its ``**options``."""
    entries = [
        textwrap.fill(
            f"{name}: {OPTIONS[name].about}",
            width=100,
            initial_indent=" " * 8,
            subsequent_indent=" " * 12,
            break_on_hyphens=False,
            break_long_words=False,
        )
        for name in names
    ]

    def decorate(cls: _C) -> _C:
        if cls.__doc__:  # None under python -OO
            before, mark, after = cls.__doc__.partition("        **options:")
            remainder = after.removeprefix(_SEE)
            line = mark if remainder is after else ""
            cls.__doc__ = "".join([before, *(f"{entry}\n" for entry in entries), line, remainder])
        return cls

    return decorate


def _understood(spec: Spec, options: Options) -> tuple[Specification, Interface, BackendName]:
    specification = as_specification(spec)
    interface = as_interface(
        specification, options["semantics"], options["inputs"], options["outputs"]
    )
    return specification, interface, choose(options["backend"])


def _settings(caller: Callable[..., object], options: _O, kind: type[_O]) -> _O:
    """Return options with the defaults of their kind; raise TypeError on an unknown one."""
    defaults = _DEFAULTS[kind]
    settings = {**defaults, **options}
    if len(settings) == len(defaults):
        return cast("_O", settings)
    unknown = next(name for name in settings if name not in defaults)
    names = inspect.signature(caller).parameters
    hint = nearest(unknown, names) or f"; its arguments are {', '.join(names)}"
    raise TypeError(f"{caller.__name__}() got an unexpected keyword argument '{unknown}'{hint}")


def check_interpolation(interpolation: str) -> None:
    """Raise InputError on an interpolation other than ``"previous"``."""
    if interpolation != "previous":
        raise InputError(
            "expected interpolation='previous' (a value lasts until the next event), "
            f"got {interpolation!r}"
        )
