"""`Reading`: how samples are judged. Every option of it stands here once.

An option is a field of `Reading`, whose row holds its default, its choices and what it means, and a
line of the `TypedDict` of those that take it as a keyword. Nothing else lists the options: `help`
and `inspect.signature` show them by `lists_reading`, command lines read their choices and their
words here.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from fractions import Fraction
from typing import Any, Literal, TypedDict, TypeVar, Unpack, cast, get_args

import rtamt
from rtamt import (
    Align,
    End,
    Formula,
    InputError,
    InputTypeError,
    Names,
    NanPolicy,
    Period,
    SemanticsName,
)
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.ends import AtTermination

__all__ = [
    "ROWS",
    "EpisodeReading",
    "InstantReading",
    "PredicateReading",
    "Reading",
    "RecordedReading",
    "RunReading",
    "SampleReading",
    "StagesLike",
    "View",
    "checked_reading",
    "lists_reading",
    "refuse_other",
    "seconds_of",
]

View = Literal["episode", "step"]
"""Whether a formula is evaluated at sample 0 of the episode, or at every instant."""

StagesLike = Sequence[str | Formula] | Mapping[str, Sequence[str | Formula]]
"""The stages of the only requirement, in order, or of several requirements by their names."""

_F = TypeVar("_F", bound=Callable[..., object])


class PredicateReading(TypedDict, total=False):
    """The options of `Reading` about how predicates count."""

    semantics: SemanticsName
    inputs: Names | None
    outputs: Names | None


class SampleReading(PredicateReading, total=False):
    """The options of `Reading` about the samples of any trace."""

    period: Period | None
    nan: NanPolicy
    align: Align | None


class InstantReading(SampleReading, total=False):
    """The options of `Reading` for monitors that somebody else ends."""

    view: View


class RecordedReading(InstantReading, total=False):
    """The options of `Reading` about episodes, recorded ones too."""

    at_termination: AtTermination | None
    at_truncation: End
    stages: StagesLike | None


class EpisodeReading(RecordedReading, total=False):
    """The options of `Reading` about episodes of a system."""

    below: bool
    rescaled: bool


class RunReading(EpisodeReading, total=False):
    """The options of `Reading` about single runs of a system."""

    substeps: bool


class _Every(RunReading, total=False):
    end: End
    dense: bool


def _row(about: str, choices: tuple[object, ...] = (), metavar: str = "") -> dict[str, Any]:
    """What an option means, its choices, and what stands for its value on a command line."""
    return {"about": about, "choices": choices, "metavar": metavar}


@dataclass(frozen=True, init=False, slots=True)
class Reading:
    """How samples are judged.

    What is not given has its default, and ``given`` does not name it: an option that was given is
    told from one that was not, also where it equals the default. None, where it is the default, is
    not given: it stands for what the system, its monitor or the text says.

    Attributes:
        **reading: Every option.
        given: The names of the options that were given.

    Raises:
        InputError: If an option has no such value.

    Example:
        >>> reading = Reading(view="step", inputs=["req"])
        >>> reading.view, reading.inputs, reading.nan, sorted(reading.given)
        ('step', ('req',), 'raise', ['inputs', 'view'])
    """

    period: Period | None = field(
        default=None,
        metadata=_row(
            'Time between samples, in seconds or as text with a unit, such as ``"100ms"``; else '
            "the system's own. For a system without one, ``1`` makes bounds in the default unit "
            "count steps.",
            metavar="TIME",
        ),
    )
    view: View = field(
        default="episode",
        metadata=_row(
            '``"episode"``: a formula is about the trace from sample 0 on; ``"step"``: about '
            "every instant.",
            get_args(View),
        ),
    )
    nan: NanPolicy = field(
        default="raise",
        metadata=_row(
            '``"raise"`` refuses a signal that is nan; ``"hold"`` keeps its last value, in '
            'records too; ``"unknown"``: nothing is known of it, as for `rtamt.EpisodeMonitor`.',
            get_args(NanPolicy),
        ),
    )
    align: Align | None = field(
        default=None,
        metadata=_row(
            "How a bound that is no multiple of the period becomes samples, as for "
            "`rtamt.Monitor`; else such a bound is refused.",
            (None, *get_args(Align)),
        ),
    )
    semantics: SemanticsName = field(
        default="standard",
        metadata=_row(
            'How predicates count, as for `rtamt.Monitor`: ``"standard"``; ``"boolean"``, where '
            "each is +inf or -inf; or, about inputs or outputs, "
            '``"output-robustness"``, ``"input-vacuity"``, ``"input-robustness"`` or '
            '``"output-vacuity"``.',
            get_args(SemanticsName),
            metavar="NAME",
        ),
    )
    inputs: Names | None = field(
        default=None,
        metadata=_row(
            "Variables that the system reads, for interface-aware semantics; else those that "
            "the texts declare ``input``.",
        ),
    )
    outputs: Names | None = field(
        default=None,
        metadata=_row(
            "Variables that the system sets; else those that the texts declare ``output``.",
        ),
    )
    at_termination: AtTermination | None = field(
        default=None,
        metadata=_row(
            'How an end of the system itself is read: ``"complete"``, the episode is all there '
            "is (an invariant that held is satisfied, a goal not reached is violated); "
            '``"cut"``, as a time limit; ``"failure"``, what is not decided yet is violated '
            "by how it ended, and keeps the robustness of its samples. "
            'Else ``"complete"``, with a warning where an end of an '
            "environment so satisfies what was open.",
            (None, *get_args(AtTermination)),
        ),
    )
    at_truncation: End = field(
        default="cut",
        metadata=_row(
            'How a time limit is read: ``"cut"``, an ``always`` without bounds that held is '
            "satisfied, an ``eventually`` without bounds violated, and a window that goes "
            "beyond the end stays open unless the samples in it have decided it already; "
            '``"complete"``; or ``"open"``, the episode could have gone on, and open verdicts stay'
            " UNDECIDED.",
            get_args(End),
        ),
    )
    stages: StagesLike | None = field(
        default=None,
        hash=False,
        metadata=_row(
            "What progress counts: the stages of a requirement in order, formulas or their texts, "
            '``["near > 0", "lifted > 0"]``; of several requirements by their names. Else those '
            "that `rtamt.patterns.stages` finds.",
        ),
    )
    below: bool = field(
        default=False,
        metadata=_row(
            "Whether signals are read beneath the wrappers of an environment that rescale "
            "observations, such as ``NormalizeObservation``, whose numbers mean other things than "
            "those of the environment: refused, unless one of the two is said.",
        ),
    )
    rescaled: bool = field(
        default=False,
        metadata=_row(
            "Whether the numbers that such wrappers give are meant.",
        ),
    )
    substeps: bool = field(
        default=False,
        metadata=_row(
            "Whether to take a sample after every step of the simulation that an environment "
            "makes inside of its own, as `StlMonitor` describes it.",
        ),
    )
    end: End = field(
        default="cut",
        metadata=_row(
            'What lies behind the end of a recorded trace: ``"cut"``, what bounded windows need '
            "of it is unknown, and operators without an end speak of the recorded time; "
            '``"complete"``, nothing; ``"open"``, a continuation.',
            get_args(End),
        ),
    )
    dense: bool = field(
        default=False,
        metadata=_row(
            "Whether rows of a recorded trace, or messages of a bag, are events at any time, and "
            "a value holds until the next event.",
        ),
    )
    given: frozenset[str] = field(default=frozenset(), compare=False)

    def __init__(self, **options: Unpack[_Every]) -> None:
        for name, row in ROWS.items():
            value: Any = options.get(name, row.default)
            if name in {"inputs", "outputs"}:
                value = _names(value)
            elif name == "stages":
                value = _stages(value)
            elif row.metadata["choices"] and name != "semantics":  # whose monitors name the nearest
                check_choice(name, value, row.metadata["choices"])
            object.__setattr__(self, name, value)
        said = {n for n in options if (getattr(self, n), ROWS[n].default) != (None, None)}
        object.__setattr__(self, "given", frozenset(said))

    @property
    def seconds(self) -> Fraction | None:
        """The period in seconds; None where it is not given."""
        return seconds_of(self.period)

    def options(self) -> dict[str, Any]:
        """What was given, as keywords."""
        return {name: getattr(self, name) for name in ROWS if name in self.given}

    def written(self) -> dict[str, Any]:
        """How episodes are judged, as JSON can write it: all but the period, in their order."""
        found = {
            name: getattr(self, name) for name in EpisodeReading.__annotations__ if name != "period"
        }
        for name in ("inputs", "outputs"):
            found[name] = None if found[name] is None else sorted(found[name])
        if self.stages is None:
            del found["stages"]
        return found

    def having(self, **options: Unpack[_Every]) -> Reading:
        """The reading with these options in place of its own."""
        return Reading(**{**self.options(), **options})

    def about(self, name: str) -> Reading:
        """The reading of one requirement alone: stages that are named of others are left out.

        Example:
            >>> reading = Reading(stages={"task": ["near > 0", "up > 0"]}, view="episode")
            >>> reading.about("task").stages, reading.about("calm").stages
            (('near > 0', 'up > 0'), None)
        """
        if not isinstance(self.stages, Mapping):
            return self
        return self.having(stages=self.stages.get(name))

    def whole(self, kind: type) -> Reading:
        """The reading in which all options of a kind count as given."""
        whole = Reading(**self.options())
        object.__setattr__(whole, "given", self.given | kind.__annotations__.keys())
        return whole

    def over(self, own: Reading, whose: str, way_out: str) -> Reading:
        """Lays what was given over what a monitor has: the monitor's options, and the others.

        Args:
            own: The reading of the monitor.
            whose: Names the monitor.
            way_out: Says how to correct the call.

        Raises:
            InputError: If an option was given that the monitor has, with another value.

        Example:
            >>> own = Reading(view="step", period=0.1)
            >>> Reading(period="100ms", nan="hold").over(own, "it", "leave it out").options()
            {'period': 0.1, 'view': 'step', 'nan': 'hold'}
            >>> Reading(view="episode").over(own, "it", "leave it out")
            Traceback (most recent call last):
            rtamt.errors.InputError: view= comes from it, which has 'step', got 'episode'; leave...
        """
        for name in self.given & own.given:
            has, got = getattr(own, name), getattr(self, name)
            if _meant(name, has) != _meant(name, got):
                refuse_other(name, has, got, whose, way_out)
        laid = Reading(**{**self.options(), **own.options()})
        object.__setattr__(laid, "given", self.given | own.given)
        return laid

    def of_monitors(self, specs: Mapping[str, rtamt.Specification]) -> dict[str, SampleReading]:
        """The keyword arguments of monitors of each specification, of names those that it knows.

        Raises:
            InputError: On a name in ``inputs`` or ``outputs`` that no specification knows.
        """
        said = {name: getattr(self, name) for name in SampleReading.__annotations__}
        shared = cast("SampleReading", said)
        if self.inputs is None and self.outputs is None:
            return dict.fromkeys(specs, shared)
        known = {name: _known(spec) for name, spec in specs.items()}
        return {
            name: {
                **shared,
                "inputs": _chosen("inputs", self.inputs, name, known),
                "outputs": _chosen("outputs", self.outputs, name, known),
            }
            for name in specs
        }


ROWS: dict[str, Field[Any]] = {row.name: row for row in fields(Reading) if row.name != "given"}
"""The row of each option, by its name."""


def checked_reading(
    options: Mapping[str, Any], caller: Callable[..., object], kind: type
) -> Reading:
    """The reading of a call that takes the options of a kind as ``**reading``.

    Raises:
        InputTypeError: On a keyword that is no option of the kind.
        InputError: If an option has no such value.
    """
    for name in options:
        if name not in kind.__annotations__:
            known = inspect.signature(caller).parameters
            hint = nearest(name, known) or f"; its arguments are {listing(known)}"
            raise InputTypeError(
                f"{caller.__name__}() got an unexpected keyword argument {name!r}{hint}"
            )
    return Reading(**options)


def refuse_other(name: str, own: object, got: object, whose: str, way_out: str) -> None:
    """Refuses an argument of which a monitor has another value.

    Raises:
        InputError: Always.
    """
    raise InputError(
        Argument(name), f" comes from {whose}, which has {own!r}, got {got!r}; {way_out}"
    )


def lists_reading(kind: type) -> Callable[[_F], _F]:
    """Lists each option in the signature and the docstring of what takes it as ``**reading``.

    It decorates a function, or a class whose own docstring describes its arguments.

    Args:
        kind: The `TypedDict` of the options.
    """
    keyword = inspect.Parameter.KEYWORD_ONLY
    rows = [ROWS[name] for name in ROWS if name in kind.__annotations__]

    def decorate(function: _F) -> _F:
        taking: Any = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]  # of this very class
        signature = inspect.signature(taking)
        *others, _ = signature.parameters.values()
        listed = [
            inspect.Parameter(row.name, keyword, default=row.default, annotation=row.type)
            for row in rows
        ]
        taking.__signature__ = signature.replace(parameters=[*others, *listed])
        function.__doc__ = _listed(function.__doc__, rows)
        return function

    return decorate


def _listed(text: str | None, rows: Iterable[Field[Any]]) -> str | None:
    """The docstring in which an entry of each option stands in the place of ``**reading``."""
    found = re.search(r"^( *)\*\*reading: .*(?:\n\1 .*)*", text or "", re.MULTILINE)
    if text is None or found is None:
        return text
    indent = found[1]
    entries = [
        textwrap.fill(
            f"{row.name}: {row.metadata['about']}",
            100,
            initial_indent=indent,
            subsequent_indent=f"{indent}    ",
        )
        for row in rows
    ]
    return text[: found.start()] + "\n".join(entries) + text[found.end() :]


def _meant(name: str, value: Any) -> object:  # noqa: ANN401 - of any option
    """What the value of an option means, however it is written."""
    if name == "period":
        return seconds_of(value)
    return frozenset(value) if isinstance(value, tuple) else value


def seconds_of(period: Period | None) -> Fraction | None:
    """A period in seconds, exactly; None stays None.

    Raises:
        SpecificationError: If it is no period.
    """
    return None if period is None else rtamt.Monitor("true", period).period


def _names(names: Names | None) -> Names | None:
    """The names as a tuple; what is no collection of names stays, for the monitors to refuse."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        return names
    return tuple(names)


def _stages(given: StagesLike | None) -> tuple[str, ...] | dict[str, tuple[str, ...]] | None:
    """The texts of stages.

    Raises:
        InputError: If there are fewer than two stages.
        InputTypeError: If they are no formulas.
    """
    if given is None:
        return None
    if isinstance(given, Mapping):
        return {name: _listed_stages(each, f" of {name!r}") for name, each in given.items()}
    return _listed_stages(given, "")


def _listed_stages(given: Sequence[str | Formula], of: str) -> tuple[str, ...]:
    if isinstance(given, str | Formula) or not isinstance(given, Sequence):
        raise InputTypeError(
            "expected ",
            Argument("stages"),
            f'{of} as a list of formulas, such as ["near > 0", "lifted > 0"], got {given!r}',
        )
    for each in given:
        if not isinstance(each, str | Formula):
            raise InputTypeError(
                "expected formulas or their texts in ", Argument("stages"), f"{of}, got {each!r}"
            )
    if len(given) < 2:
        raise InputError("expected two or more ", Argument("stages"), f"{of}, got {len(given)}")
    return tuple(map(str, given))


def _chosen(
    argument: str, names: Names | None, spec: str, known: Mapping[str, frozenset[str]]
) -> Names | None:
    """The names that a specification knows; all, if it is the only one or they are no names."""
    if len(known) == 1 or not isinstance(names, tuple):
        return names
    everywhere = frozenset().union(*known.values())
    for name in names:
        if isinstance(name, str) and name not in everywhere:
            hint = nearest(name, everywhere) or f"; they read {listing(sorted(everywhere))}"
            raise InputError(f"{name!r} in {argument} is a variable of no specification{hint}")
    return tuple(name for name in names if name in known[spec] or not isinstance(name, str))


def _known(spec: rtamt.Specification) -> frozenset[str]:
    """The variables of a specification, declared ones too, and the messages they are fields of."""
    names = {*spec.variables, *spec.declarations} - {*spec.formulas}
    ends = ((name, each.start()) for name in names for each in re.finditer(r"[.\[]|$", name))
    return frozenset(name[:end] for name, end in ends)


lists_reading(_Every)(Reading)
