"""Robustness monitors from Signal Temporal Logic.

The text of a specification becomes a formula, the formula becomes a program of four instructions,
and a machine in C++ or Python runs the program. `Monitor` returns the robustness at each sample,
and `EpisodeMonitor` also bounds the robustness of an episode from its first sample on.
`VectorMonitor` and `VectorEpisodeMonitor` update a batch of monitors in one call. `evaluate` and
`judge` are for a recorded trace, `judge_many` is for many, and `explain` returns the samples that
decided a verdict. `rtamt.dense` has the same names for events over dense time. `holds` returns the
verdict of a robustness.

Names are imported when they are first used, so that ``import rtamt`` loads no machine.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if (Path(__file__).parent / "antlr").exists():  # which only the released library has
    raise ImportError(
        "expected only the packages of rtamt-stl, got files of the released rtamt next to them in "
        f"{Path(__file__).parent}: pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )

if TYPE_CHECKING:
    from rtamt import checking as checking
    from rtamt import columns as columns
    from rtamt import dense, limits, patterns
    from rtamt import internal as internal
    from rtamt import language as language
    from rtamt import monitors as monitors
    from rtamt import mutation as mutation
    from rtamt import typing as typing
    from rtamt.checking.check import check, equivalent
    from rtamt.checking.examples import examples
    from rtamt.compat import *  # noqa: F403 - its __all__ lists them, and the type checker reads it
    from rtamt.errors import (
        InputError,
        InputTypeError,
        ParseError,
        RtamtError,
        SpecificationError,
        StateError,
    )
    from rtamt.inputs.between import UncertainValue
    from rtamt.language.formula import Formula, Term, conjunction, disjunction, number, variable
    from rtamt.language.interval import Interval
    from rtamt.language.parser import load, parse
    from rtamt.language.specification import Specification
    from rtamt.machines.backend import BACKEND
    from rtamt.monitors.evaluation import evaluate
    from rtamt.monitors.explainer import explain
    from rtamt.monitors.explanation import Explanation
    from rtamt.monitors.judgement import Judgement, judge
    from rtamt.monitors.many import judge_many
    from rtamt.monitors.monitor import EpisodeMonitor, Monitor
    from rtamt.monitors.occurrences import occurrences
    from rtamt.monitors.vector import VectorEpisodeMonitor, VectorMonitor
    from rtamt.monitors.verdict import Verdict, holds
    from rtamt.mutation.mutants import mutants

if TYPE_CHECKING:  # Old names, which `rtamt.renamed` lists; the next version removes them.
    from rtamt.checking import Answer as Answer
    from rtamt.checking import Check as Check
    from rtamt.checking import CheckedRequirement as CheckedRequirement
    from rtamt.checking import Equivalence as Equivalence
    from rtamt.checking import Example as Example
    from rtamt.checking import ExampleTrace as ExampleTrace
    from rtamt.checking import RequirementExamples as RequirementExamples
    from rtamt.columns import unit_of_times as unit_of_times
    from rtamt.dense import Events as Events
    from rtamt.export.fmu import export_fmu as export_fmu
    from rtamt.internal import ClockEvent as ClockEvent
    from rtamt.internal import ClockKind as ClockKind
    from rtamt.internal import JointFeed as JointFeed
    from rtamt.internal import JointRead as JointRead
    from rtamt.internal import OperatorClock as OperatorClock
    from rtamt.internal import OperatorClocks as OperatorClocks
    from rtamt.internal import VerdictLog as VerdictLog
    from rtamt.internal import joint_feed as joint_feed
    from rtamt.language import Publication as Publication
    from rtamt.language import RequirementId as RequirementId
    from rtamt.language import SpecificationTemplate as SpecificationTemplate
    from rtamt.language import SubscribedField as SubscribedField
    from rtamt.language import Subscription as Subscription
    from rtamt.language.formula import predicates as predicates
    from rtamt.language.formula import scaled as scaled
    from rtamt.language.topics import publications as publications
    from rtamt.language.topics import subscriptions as subscriptions
    from rtamt.language.words import in_words as in_words
    from rtamt.monitors import Evidence as Evidence
    from rtamt.monitors import Implications as Implications
    from rtamt.monitors.evaluation import evaluate_dense as evaluate_dense
    from rtamt.monitors.evaluation import evaluate_many as evaluate_many
    from rtamt.monitors.explainer import explain_dense as explain_dense
    from rtamt.monitors.judgement import judge_dense as judge_dense
    from rtamt.mutation import MUTATIONS as MUTATIONS
    from rtamt.mutation import Mutant as Mutant
    from rtamt.mutation import Mutation as Mutation
    from rtamt.typing import Align as Align
    from rtamt.typing import End as End
    from rtamt.typing import Names as Names
    from rtamt.typing import NanPolicy as NanPolicy
    from rtamt.typing import Period as Period
    from rtamt.typing import SemanticsName as SemanticsName

    Asked = monitors.TriggerCount
    Between = UncertainValue
    DenseAsked = dense.TriggerCount
    DenseEpisodeMonitor = dense.EpisodeMonitor
    DenseExplanation = dense.Explanation
    DenseImplications = dense.Implications
    DenseMonitor = dense.Monitor
    Idle = checking.RedundantPart

    def noticed(*args: Any, **options: Any) -> tuple[bool, ...]: ...  # noqa: ANN401


__version__ = "0.5.0"

__all__ = [
    "BACKEND",
    "EpisodeMonitor",
    "Explanation",
    "Formula",
    "InputError",
    "InputTypeError",
    "Interval",
    "Judgement",
    "Monitor",
    "ParseError",
    "RtamtError",
    "Specification",
    "SpecificationError",
    "StateError",
    "Term",
    "UncertainValue",
    "VectorEpisodeMonitor",
    "VectorMonitor",
    "Verdict",
    "__version__",
    "check",
    "conjunction",
    "dense",
    "disjunction",
    "equivalent",
    "evaluate",
    "examples",
    "explain",
    "holds",
    "judge",
    "judge_many",
    "limits",
    "load",
    "mutants",
    "number",
    "occurrences",
    "parse",
    "patterns",
    "variable",
]

_MODULES = {
    "BACKEND": "rtamt.machines.backend",
    "UncertainValue": "rtamt.inputs.between",
    "EpisodeMonitor": "rtamt.monitors.monitor",
    "Explanation": "rtamt.monitors.explanation",
    "Formula": "rtamt.language.formula",
    "InputError": "rtamt.errors",
    "InputTypeError": "rtamt.errors",
    "Interval": "rtamt.language.interval",
    "Judgement": "rtamt.monitors.judgement",
    "Monitor": "rtamt.monitors.monitor",
    "ParseError": "rtamt.errors",
    "RtamtError": "rtamt.errors",
    "Specification": "rtamt.language.specification",
    "SpecificationError": "rtamt.errors",
    "StateError": "rtamt.errors",
    "Term": "rtamt.language.formula",
    "VectorEpisodeMonitor": "rtamt.monitors.vector",
    "VectorMonitor": "rtamt.monitors.vector",
    "Verdict": "rtamt.monitors.verdict",
    "check": "rtamt.checking.check",
    "conjunction": "rtamt.language.formula",
    "disjunction": "rtamt.language.formula",
    "equivalent": "rtamt.checking.check",
    "evaluate": "rtamt.monitors.evaluation",
    "examples": "rtamt.checking.examples",
    "explain": "rtamt.monitors.explainer",
    "holds": "rtamt.monitors.verdict",
    "judge": "rtamt.monitors.judgement",
    "judge_many": "rtamt.monitors.many",
    "load": "rtamt.language.parser",
    "mutants": "rtamt.mutation.mutants",
    "number": "rtamt.language.formula",
    "occurrences": "rtamt.monitors.occurrences",
    "parse": "rtamt.language.parser",
    "variable": "rtamt.language.formula",
}
"""The module of each public name. A name is imported when it is first used."""

_SUBMODULES = (
    "checking",
    "columns",
    "dense",
    "internal",
    "language",
    "limits",
    "monitors",
    "mutation",
    "patterns",
    "typing",
)

# Programs for the released library import from rtamt.spec.stl.discrete_time.specification.
__path__ += [f"{path}/compat/paths" for path in __path__]  # noqa: F405 - every package has one

if not TYPE_CHECKING:  # a type checker would accept any name

    def __getattr__(name: str) -> object:
        """Import a public name, or a name of the drop-in API, when it is first used."""
        if name in _MODULES:
            value = getattr(import_module(_MODULES[name]), name)
        elif name in _SUBMODULES:
            value = import_module(f"rtamt.{name}")
        elif name in (renamed := import_module("rtamt.renamed")).NAMES["rtamt"]:
            return renamed.old_name("rtamt", name)
        elif not name.startswith("_") and name in import_module("rtamt.compat").__all__:
            value = getattr(import_module("rtamt.compat"), name)
        else:
            raise AttributeError(f"module 'rtamt' has no attribute '{name}'")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return [*{*globals(), *__all__}]
