"""What monitors share: a specification, a machine, snapshots."""

from __future__ import annotations

import functools
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Generic, Self, TypeVar

from rtamt.inputs.samples import NanPolicy
from rtamt.language.formula import Formula
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.backend import Backend, Stateful, choose
from rtamt.program.interface import Names, Semantics, as_interface
from rtamt.program.program import Program
from rtamt.program.timing import Period, as_period

__all__ = ["DirectUpdate", "Online", "Resumable", "Spec"]

Spec = str | Formula | Specification
"""A specification: text, a formula made of combinators, or a parsed specification."""

_M = TypeVar("_M", bound=Stateful)


class Resumable(Generic[_M]):
    """What is copied and pickled as what it is made from and the state of its machine."""

    __slots__ = ("_machine",)

    _machine: _M

    def __copy__(self) -> Self:
        make, args, state = self.__reduce__()
        twin = make(*args)
        twin.__setstate__(state)
        return twin

    def __deepcopy__(self, memo: object) -> Self:
        return self.__copy__()

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Any, ...], Any]:
        raise NotImplementedError

    def __setstate__(self, state: object) -> None:
        self._machine.restore(state)


class DirectUpdate:
    """What has its machine's ``update`` for its own, so that a call is one call."""

    __slots__ = ()

    def __init_subclass__(cls, **options: object) -> None:
        """Refuse a subclass whose ``update`` nobody would call."""
        super().__init_subclass__(**options)
        if callable(cls.__dict__.get("update")):
            msg = (
                f"{cls.__name__}.update would never be called: a monitor's update is the method of "
                "its machine; hold a monitor instead of inheriting from it"
            )
            raise TypeError(msg)


class Online(Resumable[_M]):
    """A specification that a machine of some kind runs."""

    __slots__ = (
        "_nan",
        "_period",
        "backend",
        "interface",
        "program",
        "specification",
    )

    def __init__(
        self,
        spec: Spec,
        period: Period | None,
        *,
        backend: Backend,
        nan: NanPolicy,
        semantics: Semantics,
        inputs: Names | None,
        outputs: Names | None,
    ) -> None:
        self.specification = as_specification(spec)
        self.interface = as_interface(self.specification, semantics, inputs, outputs)
        self._period = as_period(period)
        self.backend = choose(backend)
        self._nan = nan
        self.program = self._compiled()
        self._machine = self._made()

    def _compiled(self) -> Program:
        """The program of the specification."""
        raise NotImplementedError

    def _made(self) -> _M:
        """The machine of the back-end."""
        raise NotImplementedError

    def _arguments(self) -> tuple[Any, ...]:
        """What the constructor takes by position."""
        return self.specification, self._period

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables: in order of declaration, else of first appearance."""
        return self.program.variables

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples, exactly; None: the bounds are numbers of samples."""
        return self._period

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Any, ...], Any]:
        make = functools.partial(
            type(self),
            backend=self.backend,
            nan=self._nan,
            semantics=self.interface.semantics,
            inputs=self.interface.inputs,
            outputs=self.interface.outputs,
        )
        return make, self._arguments(), self._machine.state()
