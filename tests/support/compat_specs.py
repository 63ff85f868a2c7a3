"""Specifications of `StlDiscreteTimeSpecification`, declared and parsed."""

from strategies import VARIABLES

from rtamt import Language, Semantics, StlDiscreteTimeSpecification

LANGUAGES = {"python": Language.PYTHON, "native": Language.CPP}


def declared(
    text: object,
    names: tuple[str, ...] = VARIABLES,
    semantics: Semantics | str = Semantics.STANDARD,
    language: Language = Language.PYTHON,
) -> StlDiscreteTimeSpecification:
    """A parsed specification of variables of type float."""
    spec = StlDiscreteTimeSpecification(semantics, language)
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = str(text)
    spec.parse()
    return spec
