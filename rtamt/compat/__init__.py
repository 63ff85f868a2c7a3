"""The classes of the released library, for programs that were written for it.

They call `rtamt.Monitor`, `rtamt.EpisodeMonitor`, `rtamt.evaluate`, `rtamt.dense.Monitor` and
`rtamt.dense.evaluate`, and return their values; docs/differences.md lists the differences to the
released library. ``rtamt.StlDiscreteTimeSpecification`` and the other classes are attributes of
`rtamt`, imported when they are first used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from rtamt.compat.dense import (
    NamedEvents,
    Pairs,
    StlDenseTimeOfflineSpecification,
    StlDenseTimeOnlineSpecification,
    StlDenseTimeSpecification,
)
from rtamt.compat.discrete import (
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
)
from rtamt.compat.specification import (
    AbstractSpecification,
    Language,
    Semantics,
    StlIOType,
    TimeInterpretation,
)
from rtamt.errors import InputError, RtamtError, SpecificationError

__all__ = [
    "LTLDiscreteTimeSpecification",
    "LTLException",
    "LTLNotImplementedException",
    "LTLOfflineException",
    "LTLParseException",
    "LTLPastifyException",
    "LTLSpecification",
    "LTLSpecificationException",
    "Language",
    "RTAMTException",
    "STLCTSpecification",
    "STLDenseTimeSpecification",
    "STLDiscreteTimeSpecification",
    "STLException",
    "STLIOCTSpecification",
    "STLIOSpecification",
    "STLNotImplementedException",
    "STLOfflineException",
    "STLParseException",
    "STLSpecification",
    "STLSpecificationException",
    "Semantics",
    "StlDenseTimeOfflineSpecification",
    "StlDenseTimeOnlineSpecification",
    "StlDenseTimeSpecification",
    "StlDiscreteTimeOfflineSpecification",
    "StlDiscreteTimeOnlineSpecification",
    "StlDiscreteTimeOnlineSpecificationCpp",
    "StlDiscreteTimeSpecification",
    "StlIOType",
    "TimeInterpretation",
]


class _FirstReleases(AbstractSpecification):
    """A specification with the constructor and the names of the releases up to 0.3.

    Args:
        semantics: The semantics of the robustness; a number or a bool means `is_pure_python`.
        language: The language of the machines.
        is_pure_python: False means ``Language.CPP``.
    """

    def __init__(
        self,
        semantics: Semantics | str | int = Semantics.STANDARD,
        language: Language = Language.PYTHON,
        *,
        is_pure_python: bool = True,
    ) -> None:
        if isinstance(semantics, int):
            semantics, is_pure_python = Semantics.STANDARD, bool(semantics)
        super().__init__(semantics, language if is_pure_python else Language.CPP)

    @property
    def iosem(self) -> str:
        """The semantics of the robustness."""
        return str(self.semantics)

    @iosem.setter
    def iosem(self, semantics: Semantics | str) -> None:
        self.semantics = Semantics(semantics)

    def get_var_object(self, var_name: str) -> Any:  # noqa: ANN401 - as get_value
        """Return `get_value`."""
        return self.get_value(var_name)


class STLSpecification(_FirstReleases, StlDiscreteTimeSpecification):
    """Robustness of samples.

    Example:
        >>> spec = STLSpecification(is_pure_python=True)
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "always(x >= 3)"
        >>> spec.parse()
        >>> spec.offline({"x": [(0, 5.0), (1, 4.0), (2, 6.0)]})
        1.0
    """

    def offline(self, dataset: Mapping[str, Sequence[tuple[float, Any]]]) -> float:
        """Add a complete trace, and return the result of `update` for its last sample.

        Args:
            dataset: For every variable its pairs of time and value.

        Raises:
            InputError: As for `update`, or if variables have different times, or there are no
                samples.
        """
        times = {name: [time for time, _ in pairs] for name, pairs in dataset.items()}
        first, *others = times.values() or [[]]
        if not first or any(other != first for other in others):
            got = ", ".join(f"{name}: {len(column)}" for name, column in times.items()) or "none"
            raise InputError(
                f"expected samples of all variables at the same times, 1 or more; got {got}"
            )
        for i, time in enumerate(first):
            sample = [(name, pairs[i][1]) for name, pairs in dataset.items()]
            robustness = self.update(time, sample)
        return robustness


class STLCTSpecification(_FirstReleases, StlDenseTimeSpecification):
    """Robustness of dense-time signals.

    Example:
        >>> spec = STLCTSpecification(is_pure_python=True)
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "x >= 3"
        >>> spec.parse()
        >>> spec.offline(["x", [(0, 5.0), (1, 4.0), (2, 4.0)]])
        [[0.0, 2.0], [1.0, 1.0]]
    """

    def offline(self, *signals: NamedEvents) -> Pairs:
        """Return `evaluate`."""
        return self.evaluate(*signals)

    def update_final(self, *signals: NamedEvents) -> Pairs:
        """Return `final_update`."""
        return self.final_update(*signals)


STLIOSpecification = STLDiscreteTimeSpecification = STLSpecification
LTLSpecification = LTLDiscreteTimeSpecification = STLSpecification
STLIOCTSpecification = STLDenseTimeSpecification = STLCTSpecification

STLException = LTLException = RtamtError
STLParseException = LTLParseException = SpecificationError
STLSpecificationException = LTLSpecificationException = SpecificationError
STLNotImplementedException = LTLNotImplementedException = SpecificationError
LTLPastifyException = SpecificationError
STLOfflineException = LTLOfflineException = InputError


RTAMTException = RtamtError
StlDiscreteTimeOnlineSpecificationCpp = partial(
    StlDiscreteTimeOnlineSpecification, language=Language.CPP
)
