"""The base classes of the drop-in API: declarations, text, errors, monitors and evaluations."""

from __future__ import annotations

import importlib
import logging
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from rtamt.errors import InputError, ParseError, SpecificationError, StateError, nearest
from rtamt.language.declarations import PRIMITIVES, steps
from rtamt.language.interval import Exact
from rtamt.language.parser import parse_as
from rtamt.language.specification import Specification
from rtamt.monitors.dense_monitor import DenseMonitor
from rtamt.monitors.monitor import Monitor
from rtamt.monitors.options import Options


class _Word(Enum):
    """An enumeration with members that print as their values."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        words = ", ".join(repr(str(member)) for member in cls)
        raise InputError(f"expected a member of {cls.__name__}, or {words}, got {value!r}")

    def __str__(self) -> str:
        return str(self.value)


class Semantics(_Word):
    """The semantics of the robustness, with the values of the option ``semantics``."""

    STANDARD: Final = "standard"
    OUTPUT_ROBUSTNESS: Final = "output-robustness"
    INPUT_VACUITY: Final = "input-vacuity"
    INPUT_ROBUSTNESS: Final = "input-robustness"
    OUTPUT_VACUITY: Final = "output-vacuity"


class Language(_Word):
    """The language of the machines."""

    PYTHON = "python"
    """The C++ machines if they were built; otherwise, the Python machines: ``backend="auto"``."""
    CPP = "C++"
    """The C++ machines: ``backend="native"``."""


class TimeInterpretation(_Word):
    """Time as samples, or dense."""

    DISCRETE = "discrete_time"
    DENSE = "dense-time"


class StlIOType(Enum):
    """The role of a variable in the system."""

    IN = 0
    OUT = 1
    UNDEFINED = 2


def interface_aware(time: str, **classes: Callable[..., object]) -> dict[str, object]:
    """Return the classes of a time domain for each interface-aware semantics, by released name.

    Example:
        >>> import rtamt
        >>> offline = rtamt.StlDenseTimeOfflineSpecification
        >>> for name in interface_aware("DenseTime", Offline=offline):
        ...     print(name)
        IAStlOutputRobustnessDenseTimeOfflineSpecification
        IAStlInputVacuityDenseTimeOfflineSpecification
        IAStlInputRobustnessDenseTimeOfflineSpecification
        IAStlOutputVacuityDenseTimeOfflineSpecification
    """
    return {
        f"IAStl{str(semantics).title().replace('-', '')}{time}{kind}Specification": partial(
            cls, semantics
        )
        for semantics in Semantics
        if semantics is not Semantics.STANDARD
        for kind, cls in classes.items()
    }


_log = logging.getLogger(__name__)

_ROLES = {
    "input": "input",
    "output": "output",
    StlIOType.IN: "input",
    StlIOType.OUT: "output",
}

# Attributes of modules, which copies and pickles store by name.
_MODULES = ("modules", "_paths")


class AbstractSpecification:
    """A specification that is declared by calls, then parsed, then run.

    Attributes:
        name: The name of the specification; after `parse` the name in the text, if any.
        spec: The text.
        unit: The unit of bounds without a unit, and of the times of samples and events.
        semantics: The semantics of the robustness.
        language: The language of the machines.
        modules: The module of each imported type.
        vars: All declared names.
        free_vars: Declared variables that no formula computes.
        var_io_dict: The role of each variable: ``"input"``, ``"output"`` (the default) or
            ``"undefined"``.
        var_object_dict: The last value of each variable: a number, a message, or events.
        var_topic_dict: The path of the topic of each variable.
        out_var: The name of the result, or of the message with the result as a field; ``"out"`` if
            the text has neither.
        out_var_field: The field, or an empty text.
    """

    def __init__(
        self,
        semantics: Semantics | str = Semantics.STANDARD,
        language: Language = Language.PYTHON,
    ) -> None:
        self.name = type(self).__name__
        self.spec: str | None = None
        self.unit = "s"
        self.semantics = Semantics(semantics)
        self.language = Language(language)
        self.modules: dict[str, Any] = {}
        self.vars: set[str] = set()
        self.free_vars: set[str] = set()
        self.var_io_dict: dict[str, str] = {}
        self.var_object_dict: dict[str, Any] = {}
        self.var_topic_dict: dict[str, str] = {}
        self.out_var = ""
        self.out_var_field = ""
        self._types: dict[str, str] = {}
        self._constants: dict[str, Exact] = {}
        self._paths: dict[str, Any] = {}
        self._modular = ""
        self._parsed: Specification | None = None
        self._result = "out"
        self._forget()

    def __getstate__(self) -> dict[str, Any]:
        names = {m: {k: v.__name__ for k, v in vars(self)[m].items()} for m in _MODULES}
        return vars(self) | names

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        for name in _MODULES:
            setattr(self, name, {k: importlib.import_module(v) for k, v in state[name].items()})

    def declare_var(self, var_name: str, var_type: str) -> None:
        """Declare a variable of a primitive or an imported type.

        Raises:
            SpecificationError: If the type is neither.
        """
        if var_name in self.vars:
            _log.warning("variable '%s' is declared again", var_name)
        self.var_object_dict[var_name] = self._new(var_type)
        self._types[var_name] = var_type
        self.vars.add(var_name)
        self.free_vars.add(var_name)
        self.var_io_dict[var_name] = "output"
        self.var_topic_dict[var_name] = f"rtamt/{var_name}"

    def declare_const(self, const_name: str, const_type: str, const_val: Exact) -> None:  # noqa: ARG002 - all are doubles
        """Declare a constant with its value, a number or its text.

        Raises:
            SpecificationError: If the name is declared.
        """
        if const_name in self.vars:
            raise SpecificationError(f"'{const_name}' is already declared; choose another name")
        self._constants[const_name] = const_val
        self.vars.add(const_name)

    def import_module(self, from_name: str, module_name: str) -> None:
        """Import a message type from a module.

        Args:
            from_name: The module.
            module_name: The type in it.

        Raises:
            SpecificationError: If the module does not exist.
        """
        try:
            module = importlib.import_module(from_name)
        except ImportError as error:
            raise SpecificationError(f"cannot import the module '{from_name}': {error}") from None
        self.modules[module_name] = module
        self._paths |= {from_name: module, module.__name__: module}

    def set_var_io_type(self, var: str, io_type: str | StlIOType) -> None:
        """Set the role of a variable: input, output, or undefined for any other value."""
        if var in self.vars:
            self.var_io_dict[var] = _ROLES.get(io_type, "undefined")
        else:
            _log.warning("variable '%s' is not declared; its io type is ignored", var)

    def set_var_topic(self, var_name: str, var_topic: str) -> None:
        """Set the topic of a variable."""
        if var_name in self.vars:
            self.var_topic_dict[var_name] = var_topic
        else:
            _log.warning("variable '%s' is not declared; its topic is ignored", var_name)

    def add_var(self, var: str) -> None:
        """Add a name without a type."""
        self.vars.add(var)

    def add_input_var(self, input_var: str) -> None:
        """Declare a variable as an input."""
        self.var_io_dict[input_var] = "input"

    def add_output_var(self, output_var: str) -> None:
        """Declare a variable as an output."""
        self.var_io_dict[output_var] = "output"

    def remove_input_var(self, var: str) -> None:
        """Undo the declaration of a variable as an input."""
        if self.var_io_dict.get(var) == "input":
            self.var_io_dict[var] = "undefined"

    def remove_output_var(self, var: str) -> None:
        """Undo the declaration of a variable as an output."""
        if self.var_io_dict.get(var) == "output":
            self.var_io_dict[var] = "undefined"

    def add_sub_spec(self, sub_spec: str) -> None:
        """Add a named formula, ``p = ...``, before the text."""
        self._modular += f"{sub_spec}\n"

    def get_spec_from_file(self, path: str) -> str:
        """Return the text of a file.

        Raises:
            InputError: If the file does not exist.
        """
        try:
            return Path(path).read_text(encoding="utf-8-sig")
        except FileNotFoundError:
            raise InputError(f"expected a file with a specification, got no file {path}") from None

    def get_value(self, var_name: str) -> Any:  # noqa: ANN401 - a number, a message, a signal
        """Return the last value of a variable or of a named formula.

        Raises:
            InputError: If the name is unknown.
        """
        if self._value_of is not None and var_name in {
            *self._specification().formulas,
            self._result,
        }:
            return self._value_of(var_name)
        if var_name not in self.var_object_dict:
            raise InputError(f"no variable and no formula is named '{var_name}'")
        return self.var_object_dict[var_name]

    def parse(self) -> None:
        """Read the text; monitoring and evaluation start again.

        Raises:
            ParseError: If the text is wrong; with line, column and a hint.
            SpecificationError: If `spec` is not a text.
        """
        parsed = self._read()
        for name, module in parsed.imports.items():
            self.modules[name] = self._paths[module]
        for name, declared in parsed.declarations.items():
            if name not in self.vars:
                self.declare_var(name, declared.type)
            if declared.io is not None:
                self.var_io_dict[name] = declared.io
            if declared.default is not None:
                self.var_object_dict[name] = declared.default
        self.var_topic_dict.update(parsed.topics)
        self.name = parsed.name or self.name
        *_, last = (None, *parsed.formulas)
        self._result = last if last and parsed.formulas[last] is parsed.formula else "out"
        self.out_var, _, self.out_var_field = self._result.partition(".")
        computed = {name.partition(".")[0] for name in parsed.formulas} | {self.out_var}
        self.free_vars -= computed
        for name in {*map(self._source, parsed.variables), *computed}:
            self.var_object_dict.setdefault(name, self._initial())
            self.vars.add(name)
        self._parsed = parsed
        self._forget()

    @property
    def ast(self) -> ParsedFormulas:
        """The formulas of the text, with their horizons and variables (read-only)."""
        if self._parsed is None:
            return ParsedFormulas()
        return ParsedFormulas.of(self._specification(), self._source, self.var_io_dict)

    def pastify(self) -> None:
        """Change nothing: formulas about the future are monitored as they are, with a latency."""
        self._specification()

    def _forget(self) -> None:
        """Drop the monitor and the trace of the previous text."""
        self._value_of: Callable[[str], object] | None = None
        """Returns the value of a formula in the last run."""

    def _initial(self) -> object:
        """Return the value of a variable before its first sample or event."""
        return 0.0

    def _new(self, var_type: str) -> object:
        if var_type in self.modules:
            module = self.modules[var_type]
            if not hasattr(module, var_type):
                msg = f"the module '{module.__name__}' has no '{var_type}'"
                raise SpecificationError(msg + nearest(var_type, dir(module)))
            return getattr(module, var_type)()
        if var_type in PRIMITIVES:
            return self._initial()
        hint = nearest(var_type, (*PRIMITIVES, *self.modules))
        hint = hint or f"; import it first: import_module(MODULE, '{var_type}')"
        raise SpecificationError(f"unknown type '{var_type}'{hint}")

    def _read(self) -> Specification:
        if not isinstance(self.spec, str):
            raise SpecificationError(
                f"expected the text of a specification in the attribute spec, got {self.spec!r}"
            )
        parsed = self._parse_declared(self._modular + self.spec)
        check_declared(parsed, self.vars)
        return parsed

    def _parse_declared(self, text: str) -> Specification:
        try:
            return self._parse(text)
        except ParseError as error:
            # A text that declares some variables must declare all, so add the others.
            declared = [f"from {m.__name__} import {t}" for t, m in self.modules.items()]
            declared += [f"{self._types[name]} {name}" for name in sorted(self._types)]
            try:
                return self._parse("\n".join([text, *declared]))
            except ParseError as other:
                in_text = other.line <= text.count("\n") + 1
                raise (other if in_text else error) from None

    def _parse(self, text: str) -> Specification:
        return parse_as(text, self.unit, self._constants, self._paths, chains=True)

    def _specification(self) -> Specification:
        if self._parsed is None:
            raise StateError("expected a parsed specification; call parse() first")
        if self._parsed.unit != self.unit:
            self._parsed = self._parse(self._parsed.text)
        return self._parsed

    def _named(self, formula: str) -> Specification:
        """Return the specification with a named formula as its result."""
        spec = self._specification()
        return replace(spec, formula=spec.formulas.get(formula, spec.formula))

    def _options(self) -> Options:
        """Return the options of monitors and evaluations."""
        roles = {name: self.var_io_dict.get(name, "output") for name in self._sources()}
        return {
            "backend": "native" if self.language is Language.CPP else "auto",
            "semantics": self.semantics.value,
            "inputs": tuple(name for name, role in roles.items() if role == "input"),
            "outputs": tuple(name for name, role in roles.items() if role == "output"),
        }

    def _source(self, variable: str) -> str:
        """Return the name under which users pass a variable: of its message, or its own."""
        message = str(steps(variable)[0])
        return message if message in self._types else variable

    def _sources(self) -> tuple[str, ...]:
        """Return the names under which users pass the variables of the specification."""
        return tuple(dict.fromkeys(map(self._source, self._specification().variables)))


_M = TypeVar("_M", Monitor, DenseMonitor)
_Trace = TypeVar("_Trace")


class OnlineSpecification(AbstractSpecification, Generic[_M]):
    """A specification that a monitor runs, from the first update on."""

    _monitor: _M | None
    _robustness: float
    """The last value."""

    def reset(self) -> None:
        """Drop all samples and events; variables keep their values."""
        if self._monitor is not None:
            self._start()

    def _start(self) -> _M:
        raise NotImplementedError

    def _running(self) -> _M:
        return self._monitor or self._start()

    def _run(self, monitor: _M) -> _M:
        self._monitor, self._value_of = monitor, self._now
        return monitor

    def _now(self, formula: str) -> float:
        spec = self._specification()
        is_result = spec.formulas.get(formula, spec.formula) == spec.formula
        now = self._robustness if is_result else self._value(formula)
        return now + 0.0  # programs print it, and do not expect -0.0

    def _value(self, formula: str) -> float:
        """Return the last value of a named formula other than the result."""
        raise NotImplementedError

    def _forget(self) -> None:
        super()._forget()
        self._monitor = None


class OfflineSpecification(AbstractSpecification, Generic[_Trace]):
    """A specification that is evaluated on complete traces."""

    _trace: _Trace | None
    """The last trace."""

    def _robustness_of(self, spec: Specification, trace: _Trace) -> list[Any]:
        raise NotImplementedError

    def _evaluated(self, trace: _Trace) -> None:
        self._trace, self._value_of = trace, self._history

    def _history(self, formula: str) -> list[Any]:
        """Return the robustness of a named formula over the last trace."""
        assert self._trace is not None  # noqa: S101 - for the type checker
        return self._robustness_of(self._named(formula), self._trace)

    def _forget(self) -> None:
        super()._forget()
        self._trace = None


@dataclass(frozen=True, slots=True)
class ParsedFormula:
    """A formula of a specification.

    Attributes:
        name: The text of the formula.
        horizon: The time after t that the robustness at t can depend on, in the unit of the
            specification; inf if it is unbounded. `next` counts as one.
        in_vars: The declared names of its inputs.
        out_vars: The declared names of its outputs.
    """

    name: str
    horizon: float
    in_vars: tuple[str, ...]
    out_vars: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ParsedFormulas:
    """The formulas of a specification, for checkers of specifications.

    Attributes:
        specs: The formulas in the order of the text, the result last; empty before `parse`.
    """

    specs: tuple[ParsedFormula, ...] = ()

    @classmethod
    def of(
        cls, spec: Specification, source: Callable[[str], str], roles: Mapping[str, str]
    ) -> ParsedFormulas:
        """Return the formulas of a specification.

        Args:
            spec: The specification.
            source: Returns the declared name of a variable: for a field, the name of its message.
            roles: Declared name to ``"input"``, ``"output"`` (the default) or another role.
        """
        specs = []
        for formula in dict.fromkeys((*spec.formulas.values(), spec.formula)):
            names = dict.fromkeys(map(source, formula.variables))
            ins, outs = (
                tuple(name for name in names if roles.get(name, "output") == role)
                for role in ("input", "output")
            )
            horizon = spec.with_result(formula).horizon
            specs.append(ParsedFormula(str(formula), horizon, ins, outs))
        return cls(tuple(specs))


def check_declared(parsed: Specification, declared: Collection[str]) -> None:
    """Refuse a specification with a variable that neither the text nor a call declares.

    A variable keeps its last value, so a mistyped one would stay 0.

    Args:
        parsed: The specification.
        declared: The names that calls declared; a message declares its fields.

    Raises:
        ParseError: At the first use of an undeclared variable.
    """
    unknown = {}
    for node in parsed.nodes():
        name = node.leaf
        if node.op is not None or not isinstance(name, str) or parsed.declaration(name):
            continue
        if name not in declared and _head(name) not in declared:
            unknown[name] = node
    if not unknown:
        return
    name = min(unknown, key=lambda variable: parsed.positions[unknown[variable]])
    known = {*declared, *parsed.declarations, *parsed.formulas, *parsed.constants}
    near = nearest(name, sorted(known)).removeprefix("; ")
    hint = f"{near} declare_var('{_head(name)}', 'float') declares it".lstrip()
    raise parsed.error(unknown[name], f"'{name}' is not declared", hint)


def warn_of_unknown(names: Iterable[object], unread: Collection[str]) -> None:
    """Log the names of ignored data that are similar to variables without data.

    Args:
        names: The names that the specification does not use.
        unread: The variables that keep their values.
    """
    for name in names:
        if isinstance(name, str) and (near := nearest(name, unread)):
            _log.warning("the data of '%s' is ignored: no variable has that name%s", name, near)


def _head(name: str) -> str:
    return str(steps(name)[0])


_HOLD = "; pass nan='hold' to keep the last value instead$"
_ADVICE = (
    (
        r"take samples (\S+) s apart, or let align= round it$",
        r"or take samples \1 s apart and say so with set_sampling_period()",
    ),
    (
        r"give resolution=('.*')$",
        r"write whole nanoseconds, or use rtamt.dense.Monitor with resolution=\1",
    ),
    (
        r"; resolution=('.*') would do$",
        r"; rtamt.dense.Monitor takes it with resolution=\1",
    ),
    (
        r"or use (EpisodeMonitor or evaluate|rtamt\.dense\.evaluate)\(\)$",
        "or call evaluate() with all of it",
    ),
    (r"use evaluate\(\) with n=, or", "use StlDiscreteTimeSpecification, or"),
    (r"or use Monitor with a period$", "or use StlDiscreteTimeSpecification"),
    (r" and n=(\d+)$", r" and time: \1"),
    (_HOLD, "; rtamt.evaluate with nan='hold' keeps the last value instead"),
)


@contextmanager
def drop_in_advice() -> Iterator[None]:
    """Raise errors of the library with advice that applies to the drop-in classes."""
    try:
        yield
    except ParseError as error:
        hint = _with_own_advice(error.hint)
        raise ParseError(error.reason, error.text, error.line, error.column, hint) from None
    except SpecificationError as error:
        raise SpecificationError(_with_own_advice(str(error))) from None
    except InputError as error:
        raise InputError(_with_own_advice(str(error))) from None


def sample_error(error: InputError) -> InputError:
    """Return the error with advice for ``update``."""
    advice = "; leave it out of the sample, and it keeps its last value"
    return InputError(re.sub(_HOLD, advice, str(error)))


def _with_own_advice(text: str) -> str:
    for advice, own in _ADVICE:
        text = re.sub(advice, own, text)
    return text
