"""The released classes in both time domains: declarations, text, and what runs of them."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from rtamt.compat.options import Language, Semantics, StlIOType
from rtamt.compat.tree import ParsedFormulas
from rtamt.compat.undeclared import check_declared
from rtamt.errors import InputError, ParseError, SpecificationError, StateError, nearest
from rtamt.language.interval import Exact
from rtamt.language.names import steps
from rtamt.language.parser import parse_as
from rtamt.language.specification import PRIMITIVES, Specification
from rtamt.monitors.dense_monitor import DenseMonitor
from rtamt.monitors.monitor import Monitor
from rtamt.monitors.options import Options

__all__ = ["AbstractSpecification", "OfflineSpecification", "OnlineSpecification"]

_log = logging.getLogger(__name__)

_ROLES = {
    "input": "input",
    "output": "output",
    StlIOType.IN: "input",
    StlIOType.OUT: "output",
}

# Attributes that hold modules, which copies and pickles keep by name.
_MODULES = ("modules", "_paths")


class AbstractSpecification:
    """A specification that is declared call by call, then parsed, then run.

    Attributes:
        name: A name for the whole; after `parse` the name that the text gives it, if any.
        spec: The text.
        unit: Unit of the bounds that have none, and of the times of samples and events.
        semantics: The semantics of the robustness.
        language: The language of the machines that run.
        modules: The module of each imported type.
        vars: Every declared name.
        free_vars: Declared variables that no formula computes.
        var_io_dict: The role of each variable: ``"input"``, ``"output"`` (the default) or
            ``"undefined"``.
        var_object_dict: The last value of each variable: a number, a message, or events.
        var_topic_dict: The path of the topic of each variable.
        out_var: The name of the result, or of the message of which it is a field; ``"out"`` if the
            text names neither.
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
            found = {k: importlib.import_module(v) for k, v in state[name].items()}
            setattr(self, name, found)

    def declare_var(self, var_name: str, var_type: str) -> None:
        """Declare a variable of a primitive or an imported type.

        Raises:
            SpecificationError: On a type that is neither.
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
        """Give a constant its value, as a number or its text.

        Raises:
            SpecificationError: If the name is declared.
        """
        if const_name in self.vars:
            raise SpecificationError(f"'{const_name}' is already declared; choose another name")
        self._constants[const_name] = const_val
        self.vars.add(const_name)

    def import_module(self, from_name: str, module_name: str) -> None:
        """Import a type of messages from a module.

        Args:
            from_name: The module.
            module_name: The type in it.

        Raises:
            SpecificationError: If there is no such module.
        """
        try:
            module = importlib.import_module(from_name)
        except ImportError as error:
            raise SpecificationError(f"cannot import the module '{from_name}': {error}") from None
        self.modules[module_name] = module
        self._paths |= {from_name: module, module.__name__: module}

    def set_var_io_type(self, var: str, io_type: str | StlIOType) -> None:
        """Set the role of a variable in the system: input, output, or (any other value) neither."""
        if var in self.vars:
            self.var_io_dict[var] = _ROLES.get(io_type, "undefined")
        else:
            _log.warning("variable '%s' is not declared; its io type is ignored", var)

    def set_var_topic(self, var_name: str, var_topic: str) -> None:
        """Name the topic of a variable."""
        if var_name in self.vars:
            self.var_topic_dict[var_name] = var_topic
        else:
            _log.warning("variable '%s' is not declared; its topic is ignored", var_name)

    def add_var(self, var: str) -> None:
        """Add a name without a type."""
        self.vars.add(var)

    def add_input_var(self, input_var: str) -> None:
        """Make a variable an input."""
        self.var_io_dict[input_var] = "input"

    def add_output_var(self, output_var: str) -> None:
        """Make a variable an output."""
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
        """Put a named formula, ``p = ...``, before the text."""
        self._modular += f"{sub_spec}\n"

    def get_spec_from_file(self, path: str) -> str:
        """The text in a file.

        Raises:
            InputError: If there is no such file.
        """
        try:
            return Path(path).read_text(encoding="utf-8-sig")
        except FileNotFoundError:
            raise InputError(
                f"expected a file with a specification, found none at {path}"
            ) from None

    def get_value(self, var_name: str) -> Any:  # noqa: ANN401 - a number, a message, a signal
        """The last value of a variable, or of a named formula.

        Raises:
            InputError: On an unknown name.
        """
        if self._ran is not None and var_name in {*self._specification().formulas, self._result}:
            return self._ran(var_name)
        if var_name not in self.var_object_dict:
            raise InputError(f"no variable and no formula is named '{var_name}'")
        return self.var_object_dict[var_name]

    def parse(self) -> None:
        """Read the text; monitoring and evaluation start afresh.

        Raises:
            ParseError: With line, column and the way out.
            SpecificationError: If there is no text.
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
        """The formulas of the text, with their horizons and variables, to be read."""
        if self._parsed is None:
            return ParsedFormulas()
        return ParsedFormulas.of(self._specification(), self._source, self.var_io_dict)

    def pastify(self) -> None:
        """Change nothing: formulas about the future are monitored as they are, with a latency."""
        self._specification()

    def _forget(self) -> None:
        """Drop the monitor and the trace of the text before."""
        self._ran: Callable[[str], object] | None = None
        """Gives the value of a formula in the last run."""

    def _initial(self) -> object:
        """The value of a variable before its first sample or event."""
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
            # A text that declares some of its variables must declare all: the others are added.
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
        """The specification whose result is a named formula."""
        spec = self._specification()
        return replace(spec, formula=spec.formulas.get(formula, spec.formula))

    def _options(self) -> Options:
        """The options of monitors and evaluations."""
        roles = {name: self.var_io_dict.get(name, "output") for name in self._sources()}
        return {
            "backend": "native" if self.language is Language.CPP else "auto",
            "semantics": self.semantics.value,
            "inputs": tuple(name for name, role in roles.items() if role == "input"),
            "outputs": tuple(name for name, role in roles.items() if role == "output"),
        }

    def _source(self, variable: str) -> str:
        """The name by which users hand in a variable: its declared message's, or its own."""
        message = str(steps(variable)[0])
        return message if message in self._types else variable

    def _sources(self) -> tuple[str, ...]:
        """The names by which users hand in the variables of the specification."""
        return tuple(dict.fromkeys(map(self._source, self._specification().variables)))


_M = TypeVar("_M", Monitor, DenseMonitor)
_Trace = TypeVar("_Trace")


class OnlineSpecification(AbstractSpecification, Generic[_M]):
    """A specification that a monitor runs from the first update on."""

    _monitor: _M | None
    _robustness: float
    """The value last given."""

    def reset(self) -> None:
        """Forget all samples and events; variables keep their values."""
        if self._monitor is not None:
            self._start()

    def _start(self) -> _M:
        raise NotImplementedError

    def _running(self) -> _M:
        return self._monitor or self._start()

    def _run(self, monitor: _M) -> _M:
        self._monitor, self._ran = monitor, self._now
        return monitor

    def _now(self, formula: str) -> float:
        spec = self._specification()
        is_result = spec.formulas.get(formula, spec.formula) == spec.formula
        now = self._robustness if is_result else self._value(formula)
        return now + 0.0  # programs print it, and know no -0.0

    def _value(self, formula: str) -> float:
        """The last value of a named formula that is not the result."""
        raise NotImplementedError

    def _forget(self) -> None:
        super()._forget()
        self._monitor = None


class OfflineSpecification(AbstractSpecification, Generic[_Trace]):
    """A specification that is evaluated on whole traces."""

    _trace: _Trace | None
    """The last one."""

    def _robustness_of(self, spec: Specification, trace: _Trace) -> list[Any]:
        raise NotImplementedError

    def _evaluated(self, trace: _Trace) -> None:
        self._trace, self._ran = trace, self._whole

    def _whole(self, formula: str) -> list[Any]:
        """The robustness of a named formula in the last trace."""
        assert self._trace is not None  # noqa: S101 - for the type checker
        return self._robustness_of(self._named(formula), self._trace)

    def _forget(self) -> None:
        super()._forget()
        self._trace = None
