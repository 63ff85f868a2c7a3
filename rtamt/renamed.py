"""Public names of the previous version that have a new name.

The tables are the only list of old names. In this version, an old name equals the new name and
gives a `DeprecationWarning`. The next version deletes this module.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, Final, ParamSpec, TypeVar

__all__ = [
    "ATTRIBUTES",
    "FUNCTIONS",
    "KEYWORDS",
    "NAMES",
    "OPTIONS",
    "TARGETS",
    "OldName",
    "new_options",
    "object_named",
    "old_keywords",
    "old_name",
]

_P = ParamSpec("_P")
_R = TypeVar("_R")

NAMES: Final[Mapping[str, Mapping[str, str]]] = {
    "rtamt": {
        "Align": "rtamt.typing.Align",
        "Answer": "rtamt.checking.Answer",
        "Asked": "rtamt.monitors.TriggerCount",
        "Between": "rtamt.UncertainValue",
        "Check": "rtamt.checking.Check",
        "CheckedRequirement": "rtamt.checking.CheckedRequirement",
        "ClockEvent": "rtamt.internal.ClockEvent",
        "ClockKind": "rtamt.internal.ClockKind",
        "DenseAsked": "rtamt.dense.TriggerCount",
        "DenseEpisodeMonitor": "rtamt.dense.EpisodeMonitor",
        "DenseExplanation": "rtamt.dense.Explanation",
        "DenseImplications": "rtamt.dense.Implications",
        "DenseMonitor": "rtamt.dense.Monitor",
        "End": "rtamt.typing.End",
        "Equivalence": "rtamt.checking.Equivalence",
        "Events": "rtamt.dense.Events",
        "Evidence": "rtamt.monitors.Evidence",
        "Example": "rtamt.checking.Example",
        "ExampleTrace": "rtamt.checking.ExampleTrace",
        "Idle": "rtamt.checking.RedundantPart",
        "Implications": "rtamt.monitors.Implications",
        "JointFeed": "rtamt.internal.JointFeed",
        "JointRead": "rtamt.internal.JointRead",
        "MUTATIONS": "rtamt.mutation.MUTATIONS",
        "Mutant": "rtamt.mutation.Mutant",
        "Mutation": "rtamt.mutation.Mutation",
        "Names": "rtamt.typing.Names",
        "NanPolicy": "rtamt.typing.NanPolicy",
        "OperatorClock": "rtamt.internal.OperatorClock",
        "OperatorClocks": "rtamt.internal.OperatorClocks",
        "Period": "rtamt.typing.Period",
        "Publication": "rtamt.language.Publication",
        "RequirementExamples": "rtamt.checking.RequirementExamples",
        "RequirementId": "rtamt.language.RequirementId",
        "SemanticsName": "rtamt.typing.SemanticsName",
        "SpecificationTemplate": "rtamt.language.SpecificationTemplate",
        "SubscribedField": "rtamt.language.SubscribedField",
        "Subscription": "rtamt.language.Subscription",
        "VerdictBook": "rtamt.internal.VerdictLog",
        "evaluate_dense": "rtamt.dense.evaluate",
        "evaluate_many": "rtamt.evaluate",
        "explain_dense": "rtamt.dense.explain",
        "export_fmu": "rtamt.Specification.export_fmu",
        "in_words": "rtamt.Specification.in_words",
        "joint_feed": "rtamt.internal.joint_feed",
        "judge_dense": "rtamt.dense.judge",
        "noticed": "rtamt.mutation.killed",
        "predicates": "rtamt.Specification.predicates",
        "publications": "rtamt.Specification.publications",
        "scaled": "rtamt.Specification.scaled",
        "subscriptions": "rtamt.Specification.subscriptions",
        "unit_of_times": "rtamt.columns.unit_of_times",
    },
    "rtamt_gym": {
        "Comparison": "rtamt_gym.results.Comparison",
        "Evaluation": "rtamt_gym.results.Evaluation",
        "Falsification": "rtamt_gym.results.Falsification",
        "MethodComparison": "rtamt_gym.results.MethodComparison",
        "Mined": "rtamt_gym.results.Mined",
        "Reading": "rtamt_gym.EvaluationOptions",
        "Record": "rtamt_gym.results.Record",
        "RequirementResult": "rtamt_gym.results.RequirementResult",
        "Run": "rtamt_gym.results.Run",
        "SavedCase": "rtamt_gym.results.SavedCase",
        "SharedBuffers": "rtamt_gym.wrappers.SharedBuffers",
        "Snapshot": "rtamt_gym.results.Snapshot",
        "Sweep": "rtamt_gym.results.Sweep",
        "as_vector_env": "rtamt_gym.wrappers.as_vector_env",
        "batched": "rtamt_gym.wrappers.batched",
        "evaluate_rollouts": "rtamt_gym.mujoco.evaluate_rollouts",
    },
}
"""For each package, every old name and the full new name."""

FUNCTIONS: Final[Mapping[str, str]] = {
    "rtamt.Specification.export_fmu": "rtamt.export.fmu.export_fmu",
    "rtamt.Specification.in_words": "rtamt.language.words.in_words",
    "rtamt.Specification.predicates": "rtamt.language.formula.predicates",
    "rtamt.Specification.publications": "rtamt.language.topics.publications",
    "rtamt.Specification.scaled": "rtamt.language.formula.scaled",
    "rtamt.Specification.subscriptions": "rtamt.language.topics.subscriptions",
}
"""The functions that became methods, which take the specification as an argument."""

TARGETS: Final[Mapping[str, str]] = {
    **FUNCTIONS,
    "rtamt.evaluate": "rtamt.monitors.evaluation.evaluate_many",
}
"""New name to the object that its old name returns if they differ: functions that became methods,
and `evaluate_many`, which takes columns of shape (n, 1) for a batch."""

ATTRIBUTES: Final[Mapping[str, Mapping[str, str]]] = {
    "rtamt.Explanation": {"circumstances": "contributions"},
    "rtamt.Judgement": {
        "asked": "triggers",
        "never_asked": "never_triggered",
        "open_for": "undecided_because",
        "untested": "unrecorded",
    },
    "rtamt.Specification": {"given": "overrides"},
    "rtamt.checking.Answer": {"says": "answer"},
    "rtamt.checking.Check": {"asked": "triggers", "says": "answer"},
    "rtamt.checking.CheckedRequirement": {
        "asked": "triggers",
        "idle": "redundant",
        "says": "answer",
    },
    "rtamt.checking.Equivalence": {"says": "answer"},
    "rtamt.checking.RequirementExamples": {"says": "answer"},
    "rtamt.dense.Explanation": {"circumstances": "contributions"},
    "rtamt.dense.TriggerCount": {"occasions": "count"},
    "rtamt.monitors.Evidence": {"asked": "triggers", "never_asked": "never_triggered"},
    "rtamt.monitors.TriggerCount": {"occasions": "count"},
    "rtamt.monitors.Unrecorded": {"begin": "start"},
    "rtamt.mutation.Mutant": {"apart": "distance"},
    "rtamt_gym.EvaluationOptions": {"of_monitors": "from_monitors"},
    "rtamt_gym.Runner": {"in_lanes": "vectorized", "reading": "evaluation_options"},
    "rtamt_gym.StepMonitor": {"panel": "monitor_set"},
    "rtamt_gym.Waveform": {"of_steps": "from_steps"},
    "rtamt_gym.results.Comparison": {"of_kept": "from_saved"},
    "rtamt_gym.results.Evaluation": {
        "of_kept": "from_saved",
        "reading": "evaluation_options",
    },
    "rtamt_gym.results.Falsification": {"found": "unreduced"},
    "rtamt_gym.results.History": {"asked": "triggers"},
    "rtamt_gym.results.MethodComparison": {"of_kept": "from_saved"},
    "rtamt_gym.results.Mined": {"asked": "triggers", "never_asked": "never_triggered"},
    "rtamt_gym.results.Outcome": {
        "asked": "triggers",
        "never_asked": "never_triggered",
        "occasions": "trigger_count",
    },
    "rtamt_gym.results.Record": {
        "chosen": "has_cases",
        "heights": "robustness_values",
        "of_files": "with_files",
        "timed": "has_times",
        "unconditional": "without_implications",
    },
    "rtamt_gym.results.RequirementResult": {
        "apart": "failures_excluded",
        "asked": "triggered",
        "heights": "robustness_values",
    },
    "rtamt_gym.results.Run": {"courses": "histories"},
    "rtamt_gym.results.SavedCase": {"reading": "evaluation_options"},
}
"""For each class, every old attribute or method and its new name."""

KEYWORDS: Final[Mapping[str, Mapping[str, str]]] = {
    "init": {"lanes": "batch_size"},
    "mutants": {"most": "limit"},
}
"""For each function, every old keyword and its new name."""

OPTIONS: Final[Mapping[str, str]] = {
    "--apart": "--distance",
    "--min-noticed": "--min-killed",
    "--require-asked": "--require-triggered",
    "--write-apart": "--write-killing-traces",
}
"""Every old command-line option and its new name."""


def old_name(package: str, name: str) -> object:
    """Return the object of an old name of a package, with a warning."""
    new = NAMES[package][name]
    _warn(f"{package}.{name}", f"{new}()" if new in FUNCTIONS else new, stacklevel=4)
    return object_named(TARGETS.get(new, new))


def object_named(path: str) -> object:
    """Return the object of a full name, such as ``"rtamt.dense.Monitor"``."""
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


class OldName:
    """The old name of an attribute or method; it returns the new one with a warning.

    Args:
        new: The new name.
    """

    def __init__(self, new: str) -> None:
        self.new = new

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember the old name."""
        self._name = name

    def __get__(self, instance: object, owner: type) -> Any:  # noqa: ANN401 - any attribute
        """Return the new attribute."""
        _warn(f"{owner.__name__}.{self._name}", f"{owner.__name__}.{self.new}", stacklevel=3)
        return getattr(owner if instance is None else instance, self.new)


def old_keywords(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Accept the old keywords of a function, with a warning."""
    keywords = KEYWORDS[function.__name__]

    @functools.wraps(function)
    def renaming(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        for old in keywords.keys() & kwargs.keys():
            new = keywords[old]
            _warn(f"{function.__name__}({old}=)", f"{function.__name__}({new}=)", stacklevel=3)
            kwargs[new] = kwargs.pop(old)
        return function(*args, **kwargs)

    return renaming


def new_options(words: Sequence[str]) -> list[str]:
    """Return a command line with the new names of options, with a warning for each old one.

    The words after ``--`` are arguments.
    """
    last = words.index("--") if "--" in words else len(words)
    return [*map(_new_option, words[:last]), *words[last:]]


def _new_option(word: str) -> str:
    option, equals, value = word.partition("=")
    if option not in OPTIONS:
        return word
    with warnings.catch_warnings():
        warnings.simplefilter("always", DeprecationWarning)  # commands hide it by default
        _warn(option, OPTIONS[option], stacklevel=2)
    return f"{OPTIONS[option]}{equals}{value}"


def _warn(old: str, new: str, *, stacklevel: int) -> None:
    warnings.warn(
        f"{old} is now {new}. The next version removes the old name.",
        DeprecationWarning,
        stacklevel=stacklevel,
    )
