"""Robustness monitors from Signal Temporal Logic.

Text becomes a formula, a formula becomes a program of four instructions, and small machines run it:
on samples as they come (`Monitor`), on an episode with bounds from the first sample on
(`EpisodeMonitor`), on many signals in lockstep (`VectorMonitor`, `VectorEpisodeMonitor`), on
recorded traces (`evaluate`, `evaluate_many`) and on events over dense time (`DenseMonitor`,
`evaluate_dense`). `judge` and `judge_dense` give the verdict on a recorded trace; `holds` tells
from a robustness whether the formula holds, `explain` and `explain_dense` which samples or times
decided it.
"""

import importlib
from pathlib import Path
from typing import TYPE_CHECKING

if (Path(__file__).parent / "antlr").exists():  # which only the released library has
    raise ImportError(
        "expected the packages of rtamt-stl alone, got files of the released rtamt among them, in "
        f"{Path(__file__).parent}: pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )

from rtamt import limits, patterns
from rtamt.checking.answers import Answer, Check, CheckedRequirement, Equivalence, Idle
from rtamt.checking.check import check
from rtamt.checking.equivalence import equivalent
from rtamt.checking.examples import Example, RequirementExamples, examples
from rtamt.checking.witness import ExampleTrace
from rtamt.columns import unit_of_times
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
from rtamt.machines.protocols import End
from rtamt.monitors.asked import Asked, Evidence
from rtamt.monitors.book import VerdictBook
from rtamt.monitors.clocks import ClockEvent, ClockKind, OperatorClock, OperatorClocks
from rtamt.monitors.dense import DenseMonitor, evaluate_dense
from rtamt.monitors.dense_asked import DenseAsked
from rtamt.monitors.dense_episode import DenseEpisodeMonitor
from rtamt.monitors.dense_explanation import DenseExplanation, explain_dense
from rtamt.monitors.dense_judgement import judge_dense
from rtamt.monitors.evaluation import evaluate
from rtamt.monitors.evidence import DenseImplications, Implications
from rtamt.monitors.explanation import Explanation, explain
from rtamt.monitors.holds import holds
from rtamt.monitors.joint import JointFeed, JointRead, joint_feed
from rtamt.monitors.judgement import Judgement, judge
from rtamt.monitors.many import evaluate_many
from rtamt.monitors.monitor import EpisodeMonitor, Monitor, Verdict
from rtamt.monitors.vector import VectorEpisodeMonitor, VectorMonitor
from rtamt.mutation.mutants import Mutant, mutants
from rtamt.mutation.mutations import MUTATIONS, Mutation
from rtamt.mutation.noticing import noticed
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.timing import Align, Period

if TYPE_CHECKING:
    from rtamt.compat import *  # noqa: F403 - its __all__ lists them, and the type checker reads it

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

# Programs for the released library import from rtamt.spec.stl.discrete_time.specification.
__path__ += [f"{path}/compat/paths" for path in __path__]  # noqa: F405 - every package has one

if not TYPE_CHECKING:  # a type checker would accept any name

    def __getattr__(name: str) -> object:
        """A class of the released library, loaded when it is first used."""
        if not name.startswith("_"):
            released = importlib.import_module("rtamt.compat")
            if name in released.__all__:
                return getattr(released, name)
        raise AttributeError(f"module 'rtamt' has no attribute '{name}'")
