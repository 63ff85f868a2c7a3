"""Specifications of the released classes, declared and parsed."""

from dense_signals import Signals
from strategies import VARIABLES

from rtamt import Language, Semantics, StlDenseTimeSpecification, StlDiscreteTimeSpecification

LANGUAGES = {"python": Language.PYTHON, "native": Language.CPP}
Pairs = list[list[float]]


def declared(
    text: object,
    names: tuple[str, ...] = VARIABLES,
    semantics: Semantics | str = Semantics.STANDARD,
    language: Language = Language.PYTHON,
) -> StlDiscreteTimeSpecification:
    """Return a parsed specification of variables of type float."""
    spec = StlDiscreteTimeSpecification(semantics, language)
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = str(text)
    spec.parse()
    return spec


def declared_dense(
    text: object, names: tuple[str, ...] = VARIABLES, language: Language = Language.PYTHON
) -> StlDenseTimeSpecification:
    """Return the same in dense time."""
    spec = StlDenseTimeSpecification(language=language)
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = str(text)
    spec.parse()
    return spec


def call(signals: Signals) -> list[list[object]]:
    """Return signals as the arguments of a call."""
    return [[name, [list(event) for event in events]] for name, events in signals.items()]


def update(spec: StlDenseTimeSpecification, chunk: Signals) -> Pairs:
    """Return the result of update."""
    return spec.update(*call(chunk))


def held(signals: Signals) -> Signals:
    """Return signals whose variables keep their last value until the last event of any."""
    end = max(events[-1][0] for events in signals.values())
    return {n: [*e, *([(end, e[-1][1])] if e[-1][0] < end else [])] for n, e in signals.items()}
