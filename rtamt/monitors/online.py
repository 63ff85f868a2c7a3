"""The base classes of monitors: options, copies and pickles, values of the machine."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar, cast

from rtamt.inputs.messages import write_fields
from rtamt.language.specification import Specification
from rtamt.machines.backend import BackendName
from rtamt.machines.protocols import Stateful
from rtamt.monitors.options import SampleOptions, Spec, compiled
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.interface import Interface
from rtamt.program.program import Program
from rtamt.program.timing import Period

_M = TypeVar("_M", bound=Stateful)
_P = TypeVar("_P", Program, DenseProgram)
_T_co = TypeVar("_T_co", covariant=True)
_Numbers = TypeVar("_Numbers")
_Flags = TypeVar("_Flags")


class MachineValue(Protocol[_T_co]):
    """A read-only attribute of a monitor that its machine holds."""

    def __get__(self, monitor: object, owner: object) -> _T_co: ...


def machine_value(name: str, doc: str) -> MachineValue[_T_co]:
    """Return a property of a monitor that reads the attribute of its machine.

    An attrgetter takes half the time of a property in Python, and it is read after every update.
    """
    return cast("MachineValue[_T_co]", property(operator.attrgetter(f"_machine.{name}"), doc=doc))


class Online(Generic[_M, _P]):
    """A compiled specification and the machine that runs it.

    ``update`` is the method of the machine, so that a call is one call. Copies and pickles hold the
    specification, the options and the state of the machine.
    """

    __slots__ = {
        "_machine": None,
        "backend": 'The back-end of the machine: ``"native"`` or ``"python"``.',
        "interface": "The semantics, and the inputs and outputs of the system.",
        "program": "The compiled program.",
        "specification": "The parsed specification.",
    }

    _machine: _M
    backend: BackendName
    interface: Interface
    program: _P
    specification: Specification

    def __init_subclass__(cls, **options: object) -> None:
        """Raise TypeError for a subclass with an ``update`` of its own, which nobody would call."""
        super().__init_subclass__(**options)
        if callable(cls.__dict__.get("update")):
            raise TypeError(
                f"{cls.__name__}.update would never be called: a monitor's update is the method of "
                "its machine; hold a monitor instead of inheriting from it"
            )

    def _arguments(self) -> dict[str, Any]:
        """Return the keywords for another monitor of the specification."""
        return {
            "semantics": self.interface.semantics,
            "inputs": self.interface.inputs,
            "outputs": self.interface.outputs,
            "backend": self.backend,
        }

    def _runs(self, machine: _M) -> None:
        """Set the machine; the machine of an earlier `__init__` refuses further updates."""
        before: Any = getattr(self, "_machine", None)
        if before is not None:
            before.retire()
        self._machine = machine

    def _state(self) -> object:
        return self._machine.state()

    def __copy__(self) -> Self:
        make: Callable[..., Self] = type(self)
        twin = make(self.specification, **self._arguments())
        twin.__setstate__(self._state())
        return twin

    def __deepcopy__(self, memo: object) -> Self:
        return self.__copy__()

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Specification], object]:
        make = functools.partial(type(self), **self._arguments())
        return make, (self.specification,), self._state()

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - each machine has its own
        self._machine.restore(state)


class Sampled(Online[_M, Program]):
    """A monitor of samples."""

    __slots__ = ("_align", "_nan", "_period")

    _online: ClassVar = False

    def _compile(self, spec: Spec, period: Period | None, options: SampleOptions) -> None:
        (
            self.specification,
            self.interface,
            self.backend,
            self._nan,
            self._period,
            self._align,
            self.program,
        ) = compiled(type(self), spec, period, options, online=self._online)
        if self.program.rates:  # machines in C++ read samples themselves, without the rates
            self.backend = "python"

    def _arguments(self) -> dict[str, Any]:
        sampling = {"period": self._period, "align": self._align, "nan": self._nan}
        return super()._arguments() | sampling

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables: the declared ones in order of declaration, then the others."""
        return self.program.inputs

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples, exactly; None if the bounds are numbers of samples."""
        return self._period


class Late:
    """A monitor whose robustness is late by the latency of its program."""

    __slots__ = ()

    program: Program
    _online: ClassVar = True

    @property
    def latency(self) -> int:
        """Samples by which the robustness is late."""
        return self.program.latency or 0


class EpisodeValues(Generic[_Numbers, _Flags]):
    """The robustness and bounds of an episode; in a batch, arrays with a value for each entry."""

    __slots__ = ()

    robustness: MachineValue[_Numbers] = machine_value(
        "robustness",
        "Robustness (of each batch entry) if the episode ended now; nan before the first sample.",
    )
    lower: MachineValue[_Numbers] = machine_value(
        "lower", "The minimum robustness (of each batch entry) over all continuations and ends."
    )
    upper: MachineValue[_Numbers] = machine_value(
        "upper", "The maximum robustness (of each batch entry) over all continuations and ends."
    )
    finished: MachineValue[_Flags] = machine_value(
        "finished", "Whether `finish` has ended the episode (of each batch entry)."
    )


class NamedValues:
    """The robustness of the formulas that have names."""

    __slots__ = ()

    specification: Specification

    @property
    def values(self) -> dict[str, float]:
        """The robustness of every named formula."""
        raise NotImplementedError

    def write(self, messages: Mapping[str, object] | None = None, /, **named: object) -> bool:
        """Set fields of messages to the values of the formulas that are named after them.

        For the text ``out.value = always(...)``, ``write(out=message)`` sets the field ``value`` of
        the message to ``values["out.value"]``, which is nan as long as it is unknown.

        Args:
            messages: Objects with attributes, or mappings, by name.
            named: The same by keyword.

        Returns:
            Whether every value written is a number.

        Raises:
            InputError: If no formula is named after a field of the message, or the message does not
                have the field (a mapping need not have it). No message is changed.
            InputTypeError: If the class of a message is not the class in the text. No message is
                changed.

        Example:
            >>> from rtamt import Monitor
            >>> monitor, message = Monitor("out.value = always[0:1](x > 0)"), {}
            >>> for x in (3.0, 1.0):
            ...     monitor.update(x), monitor.write(out=message), message
            (nan, False, {'value': nan})
            (1.0, True, {'value': 1.0})
        """
        return write_fields(self.specification, self.values, messages, named)
