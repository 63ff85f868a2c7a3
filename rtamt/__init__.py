"""Robustness monitors from Signal Temporal Logic.

The text of a specification becomes a formula, the formula becomes a program of four instructions,
and a machine in C++ or Python runs the program. `Monitor` takes samples as they come,
`EpisodeMonitor` also bounds the robustness of an episode from its first sample on, `VectorMonitor`
and `VectorEpisodeMonitor` update a batch of monitors in one call. `evaluate` and `judge` take
recorded traces, and `explain` returns the samples that decided a verdict. The names with ``dense``
do the same for events over dense time. `holds` reads a verdict from a robustness.

Names are imported when they are first used, so that ``import rtamt`` loads no machine.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if (Path(__file__).parent / "antlr").exists():  # which only the released library has
    raise ImportError(
        "expected the packages of rtamt-stl alone, got files of the released rtamt among them, in "
        f"{Path(__file__).parent}: pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )

if TYPE_CHECKING:
    from rtamt import dense, limits, patterns
    from rtamt.checking.answers import (
        Answer,
        Check,
        CheckedRequirement,
        Equivalence,
        ExampleTrace,
        Idle,
    )
    from rtamt.checking.check import check, equivalent
    from rtamt.checking.examples import Example, RequirementExamples, examples
    from rtamt.columns import unit_of_times
    from rtamt.compat import *  # noqa: F403 - its __all__ lists them, and the type checker reads it
    from rtamt.errors import (
        InputError,
        InputTypeError,
        ParseError,
        RtamtError,
        SpecificationError,
        StateError,
    )
    from rtamt.export.fmu import export_fmu
    from rtamt.inputs.between import Between
    from rtamt.inputs.events import Events
    from rtamt.inputs.samples import NanPolicy
    from rtamt.language.formula import Formula, Term, conjunction, disjunction, number, variable
    from rtamt.language.ids import RequirementId
    from rtamt.language.interval import Interval
    from rtamt.language.parser import load, parse
    from rtamt.language.publications import Publication, publications
    from rtamt.language.scaling import predicates, scaled
    from rtamt.language.specification import Specification
    from rtamt.language.subscriptions import SubscribedField, Subscription, subscriptions
    from rtamt.language.template import SpecificationTemplate
    from rtamt.language.words import in_words
    from rtamt.machines.backend import BACKEND
    from rtamt.machines.clocks import ClockEvent, ClockKind, OperatorClock
    from rtamt.machines.protocols import End
    from rtamt.monitors.clocks import OperatorClocks
    from rtamt.monitors.dense_monitor import DenseEpisodeMonitor, DenseMonitor
    from rtamt.monitors.evaluation import evaluate, evaluate_dense, evaluate_many
    from rtamt.monitors.explainer import explain, explain_dense
    from rtamt.monitors.explanation import DenseExplanation, Explanation
    from rtamt.monitors.implications import DenseImplications, Implications
    from rtamt.monitors.judgement import Judgement, judge, judge_dense
    from rtamt.monitors.monitor import EpisodeMonitor, Monitor
    from rtamt.monitors.monitor_sets import JointFeed, JointRead, VerdictBook, joint_feed
    from rtamt.monitors.triggers import Asked, DenseAsked, Evidence
    from rtamt.monitors.vector import VectorEpisodeMonitor, VectorMonitor
    from rtamt.monitors.verdict import Verdict, holds
    from rtamt.mutation.mutants import Mutant, mutants, noticed
    from rtamt.mutation.mutations import MUTATIONS, Mutation
    from rtamt.program.interface import Names, SemanticsName
    from rtamt.program.timing import Align, Period

__version__ = "0.5.0"

__all__ = [
    "BACKEND",
    "MUTATIONS",
    "Align",
    "Answer",
    "Asked",
    "Between",
    "Check",
    "CheckedRequirement",
    "ClockEvent",
    "ClockKind",
    "DenseAsked",
    "DenseEpisodeMonitor",
    "DenseExplanation",
    "DenseImplications",
    "DenseMonitor",
    "End",
    "EpisodeMonitor",
    "Equivalence",
    "Events",
    "Evidence",
    "Example",
    "ExampleTrace",
    "Explanation",
    "Formula",
    "Idle",
    "Implications",
    "InputError",
    "InputTypeError",
    "Interval",
    "JointFeed",
    "JointRead",
    "Judgement",
    "Monitor",
    "Mutant",
    "Mutation",
    "Names",
    "NanPolicy",
    "OperatorClock",
    "OperatorClocks",
    "ParseError",
    "Period",
    "Publication",
    "RequirementExamples",
    "RequirementId",
    "RtamtError",
    "SemanticsName",
    "Specification",
    "SpecificationError",
    "SpecificationTemplate",
    "StateError",
    "SubscribedField",
    "Subscription",
    "Term",
    "VectorEpisodeMonitor",
    "VectorMonitor",
    "Verdict",
    "VerdictBook",
    "__version__",
    "check",
    "conjunction",
    "dense",
    "disjunction",
    "equivalent",
    "evaluate",
    "evaluate_dense",
    "evaluate_many",
    "examples",
    "explain",
    "explain_dense",
    "export_fmu",
    "holds",
    "in_words",
    "joint_feed",
    "judge",
    "judge_dense",
    "limits",
    "load",
    "mutants",
    "noticed",
    "number",
    "parse",
    "patterns",
    "predicates",
    "publications",
    "scaled",
    "subscriptions",
    "unit_of_times",
    "variable",
]

_MODULES = {
    "Align": "rtamt.program.timing",
    "Answer": "rtamt.checking.answers",
    "Asked": "rtamt.monitors.triggers",
    "BACKEND": "rtamt.machines.backend",
    "Between": "rtamt.inputs.between",
    "Check": "rtamt.checking.answers",
    "CheckedRequirement": "rtamt.checking.answers",
    "ClockEvent": "rtamt.machines.clocks",
    "ClockKind": "rtamt.machines.clocks",
    "DenseAsked": "rtamt.monitors.triggers",
    "DenseEpisodeMonitor": "rtamt.monitors.dense_monitor",
    "DenseExplanation": "rtamt.monitors.explanation",
    "DenseImplications": "rtamt.monitors.implications",
    "DenseMonitor": "rtamt.monitors.dense_monitor",
    "End": "rtamt.machines.protocols",
    "EpisodeMonitor": "rtamt.monitors.monitor",
    "Equivalence": "rtamt.checking.answers",
    "Events": "rtamt.inputs.events",
    "Evidence": "rtamt.monitors.triggers",
    "Example": "rtamt.checking.examples",
    "ExampleTrace": "rtamt.checking.answers",
    "Explanation": "rtamt.monitors.explanation",
    "Formula": "rtamt.language.formula",
    "Idle": "rtamt.checking.answers",
    "Implications": "rtamt.monitors.implications",
    "InputError": "rtamt.errors",
    "InputTypeError": "rtamt.errors",
    "Interval": "rtamt.language.interval",
    "JointFeed": "rtamt.monitors.monitor_sets",
    "JointRead": "rtamt.monitors.monitor_sets",
    "Judgement": "rtamt.monitors.judgement",
    "MUTATIONS": "rtamt.mutation.mutations",
    "Monitor": "rtamt.monitors.monitor",
    "Mutant": "rtamt.mutation.mutants",
    "Mutation": "rtamt.mutation.mutations",
    "Names": "rtamt.program.interface",
    "NanPolicy": "rtamt.inputs.samples",
    "OperatorClock": "rtamt.machines.clocks",
    "OperatorClocks": "rtamt.monitors.clocks",
    "ParseError": "rtamt.errors",
    "Period": "rtamt.program.timing",
    "Publication": "rtamt.language.publications",
    "RequirementExamples": "rtamt.checking.examples",
    "RequirementId": "rtamt.language.ids",
    "RtamtError": "rtamt.errors",
    "SemanticsName": "rtamt.program.interface",
    "Specification": "rtamt.language.specification",
    "SpecificationError": "rtamt.errors",
    "SpecificationTemplate": "rtamt.language.template",
    "StateError": "rtamt.errors",
    "SubscribedField": "rtamt.language.subscriptions",
    "Subscription": "rtamt.language.subscriptions",
    "Term": "rtamt.language.formula",
    "VectorEpisodeMonitor": "rtamt.monitors.vector",
    "VectorMonitor": "rtamt.monitors.vector",
    "Verdict": "rtamt.monitors.verdict",
    "VerdictBook": "rtamt.monitors.monitor_sets",
    "check": "rtamt.checking.check",
    "conjunction": "rtamt.language.formula",
    "disjunction": "rtamt.language.formula",
    "equivalent": "rtamt.checking.check",
    "evaluate": "rtamt.monitors.evaluation",
    "evaluate_dense": "rtamt.monitors.evaluation",
    "evaluate_many": "rtamt.monitors.evaluation",
    "examples": "rtamt.checking.examples",
    "explain": "rtamt.monitors.explainer",
    "explain_dense": "rtamt.monitors.explainer",
    "export_fmu": "rtamt.export.fmu",
    "holds": "rtamt.monitors.verdict",
    "in_words": "rtamt.language.words",
    "joint_feed": "rtamt.monitors.monitor_sets",
    "judge": "rtamt.monitors.judgement",
    "judge_dense": "rtamt.monitors.judgement",
    "load": "rtamt.language.parser",
    "mutants": "rtamt.mutation.mutants",
    "noticed": "rtamt.mutation.mutants",
    "number": "rtamt.language.formula",
    "parse": "rtamt.language.parser",
    "predicates": "rtamt.language.scaling",
    "publications": "rtamt.language.publications",
    "scaled": "rtamt.language.scaling",
    "subscriptions": "rtamt.language.subscriptions",
    "unit_of_times": "rtamt.columns",
    "variable": "rtamt.language.formula",
}
"""The module of each public name. A name is imported when it is first used."""

_SUBMODULES = ("dense", "limits", "patterns", "typing")

# Programs for the released library import from rtamt.spec.stl.discrete_time.specification.
__path__ += [f"{path}/compat/paths" for path in __path__]  # noqa: F405 - every package has one

if not TYPE_CHECKING:  # a type checker would accept any name

    def __getattr__(name: str) -> object:
        """Import a public name, or a name of the drop-in API, when it is first used."""
        if name in _MODULES:
            value = getattr(import_module(_MODULES[name]), name)
        elif name in _SUBMODULES:
            value = import_module(f"rtamt.{name}")
        elif not name.startswith("_") and name in import_module("rtamt.compat").__all__:
            value = getattr(import_module("rtamt.compat"), name)
        else:
            raise AttributeError(f"module 'rtamt' has no attribute '{name}'")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return [*{*globals(), *__all__}]
