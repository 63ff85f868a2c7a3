"""The evaluation options: how samples are judged.

An option is a field of `EvaluationOptions`: its default, its choices, the calls that take it and
the sentence that describes it. `EvaluationKeywords` repeats the types for editors. Keyword checks,
signatures, docstrings and command-line arguments come from the fields.

To add an evaluation option, such as ``nan=``:

1. Add the field to `EvaluationOptions`, and its type to `EvaluationKeywords`.
2. Write its meaning where samples are evaluated. An option with ``calls="samples"`` is passed on to
   the monitors of `rtamt`; list it in the docstrings of `mine` and `evaluate_rollouts`. If it
   changes the values of recorded samples, as ``align`` does, `Run` keeps it, because `replay`,
   `explain`, the page and `mine` judge these samples again: ``git grep -nw align rtamt_gym`` finds
   all such places.
3. If commands that play episodes take it, add its flag to `EPISODES` of
   `rtamt_gym.options.command_line` and to ``add_options`` of `rtamt_gym.commands.run`; if array
   wrappers do, its name to ``_EVALUATION`` and ``RequirementOptions`` of `rtamt_arrays.judging`. A
   command of recorded traces lists the flag in ``add_options``.
4. Add a row to the table of options in ``docs/gymnasium.md``. Run
   ``tests/support/command_options.py``, which writes ``docs/reference/commands.md``.
5. An option of recorded traces is also in ``RecordedKeywords`` and the docstring of
   `rtamt_gym.commands.recordings`; in ``_READING`` of `rtamt_gym.commands.fleet`, on which the
   outcomes in a folder of results depend; in ``_rules`` of `rtamt_gym.commands.monitor`, which JSON
   and JUnit show; and in ``_RULES``, ``parts`` and ``_FOLDER_OPTIONS`` of
   `rtamt_gym.reports.traces`, with which the page judges a trace again.
6. ``test_branches.py`` lists options of samples and of instants.
   ``test_saved_cases.py``, ``test_readings.py``, ``test_relabel_errors.py`` and ``OTHERS`` of
   ``test_evaluation_options.py`` list the options.
"""

# ruff: noqa: RUF009 - `_option` returns a field

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from fractions import Fraction
from typing import Any, Literal, TypedDict, TypeVar, Unpack, get_args

import rtamt
from rtamt import Formula, InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt.renamed import OldName
from rtamt.typing import Align, End, Names, NanPolicy, Period, SemanticsName
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing

View = Literal["episode", "step"]
"""Whether a formula is evaluated at sample 0 of the episode, or at every instant."""

AtTermination = Literal["complete", "cut", "failure"]
"""The end mode of an episode that its environment ends: an `End` of a monitor, or a failure."""

StagesLike = Sequence[str | Formula] | Mapping[str, Sequence[str | Formula]]
"""The stages of the only requirement, in order, or of several requirements by their names."""

Calls = Literal["samples", "instants", "recorded", "episodes", "runs"]
"""The calls that take an option; each group also takes the options of the groups before it.

``"samples"`` judges any samples; ``"instants"`` monitors a run that another program ends;
``"recorded"`` judges recorded episodes; ``"episodes"`` plays episodes; ``"runs"`` single runs.
"""

_F = TypeVar("_F", bound=Callable[..., object])


class EvaluationKeywords(TypedDict, total=False):
    """The types of the options, for editors and type checkers.

    A call takes only the options of its group, see `Calls`.
    """

    period: Period | None
    view: View
    nan: NanPolicy
    align: Align | None
    semantics: SemanticsName
    inputs: Names | None
    outputs: Names | None
    at_termination: AtTermination | None
    at_truncation: End
    stages: StagesLike | None
    below: bool
    rescaled: bool
    substeps: bool


class _AllKeywords(EvaluationKeywords, total=False):
    end: End
    dense: bool


def _option(
    about: str,
    calls: Calls | None,
    default: object = None,
    choices: tuple[object, ...] = (),
    *,
    metavar: str = "",
    hashed: bool = True,
) -> Any:  # noqa: ANN401 - a field of any type
    """Return the row of an option; ``calls`` is None if only recorded traces have it."""
    row = {"about": about, "calls": calls, "choices": choices, "metavar": metavar}
    return field(default=default, hash=hashed, metadata=row)


@dataclass(frozen=True, init=False, slots=True)
class EvaluationOptions:
    """How samples are judged: the evaluation options of a call.

    An option that the call leaves out has its default and is not in ``given``, so that an explicit
    default differs from a missing one. None as a default never counts as given: the system, its
    monitor or the specification decides.

    Attributes:
        **reading: Every option.
        given: The names of the options that the call sets.

    Raises:
        InputError: If an option has a wrong value.

    Example:
        >>> reading = EvaluationOptions(view="step", inputs=["req"])
        >>> reading.view, reading.inputs, reading.nan, sorted(reading.given)
        ('step', ('req',), 'raise', ['inputs', 'view'])
    """

    period: Period | None = _option(
        'Time between samples, in seconds or as text such as ``"100ms"``; otherwise the period of '
        "the system. If the system has no period, ``1`` makes bounds in the default unit count "
        "steps.",
        "samples",
        metavar="TIME",
    )
    view: View = _option(
        '``"episode"`` evaluates a formula at sample 0 of the episode; ``"step"`` evaluates it at '
        "every instant.",
        "instants",
        "episode",
        get_args(View),
    )
    nan: NanPolicy = _option(
        'What a nan means: ``"raise"`` raises an error; ``"hold"`` repeats the last value of the '
        'signal, in records too; ``"unknown"`` is a value of which nothing is known, as for '
        "`rtamt.EpisodeMonitor`.",
        "samples",
        "raise",
        get_args(NanPolicy),
    )
    align: Align | None = _option(
        "How to round a bound that is not a multiple of the period, as for `rtamt.Monitor`; "
        "otherwise it is an error.",
        "samples",
        None,
        (None, *get_args(Align)),
    )
    semantics: SemanticsName = _option(
        'Semantics of predicates, as for `rtamt.Monitor`: ``"standard"``; ``"boolean"``, where '
        "each is +inf or -inf; or, for declared inputs and outputs, "
        '``"output-robustness"``, ``"input-vacuity"``, ``"input-robustness"`` or '
        '``"output-vacuity"``.',
        "samples",
        "standard",
        get_args(SemanticsName),
        metavar="NAME",
    )
    inputs: Names | None = _option(
        "Variables that the system reads, for interface-aware semantics; otherwise those that "
        "the specifications declare ``input``.",
        "samples",
    )
    outputs: Names | None = _option(
        "Variables that the system sets; otherwise those that the specifications declare "
        "``output``.",
        "samples",
    )
    at_termination: AtTermination | None = _option(
        'End mode of an episode that its environment ends: ``"complete"``, nothing follows; '
        '``"cut"``, as at a time limit; ``"failure"``, every undecided requirement is violated '
        "and keeps the robustness of its samples. "
        'Otherwise ``"complete"``, with a warning if the end satisfies an open requirement.',
        "recorded",
        None,
        (None, *get_args(AtTermination)),
    )
    at_truncation: End = _option(
        'End mode at a time limit: ``"cut"``, bounded windows miss the values after the end, and '
        'unbounded operators cover the time so far; ``"complete"``, nothing follows; ``"open"``, '
        "the episode could have gone on.",
        "recorded",
        "cut",
        get_args(End),
    )
    stages: StagesLike | None = _option(
        "Stages that progress counts: the formulas of a requirement in order, or their texts, "
        '``["near > 0", "lifted > 0"]``; for several requirements a mapping from their names. '
        "Otherwise the stages that `rtamt.patterns.stages` finds.",
        "recorded",
        hashed=False,
    )
    below: bool = _option(
        "Whether to read signals below wrappers that rescale observations, such as "
        "``NormalizeObservation``. With such a wrapper, set this option or ``rescaled``.",
        "episodes",
        default=False,
    )
    rescaled: bool = _option(
        "Whether to read the rescaled observations of such wrappers.",
        "episodes",
        default=False,
    )
    substeps: bool = _option(
        "Whether to take a sample after every simulation step inside an environment step, as "
        "`StlMonitor` describes.",
        "runs",
        default=False,
    )
    end: End = _option(
        'End mode of a recorded trace: ``"cut"``, bounded windows miss the values after the end, '
        'and unbounded operators cover the recorded time; ``"complete"``, nothing follows; '
        '``"open"``, the trace could have gone on.',
        None,
        "cut",
        get_args(End),
    )
    dense: bool = _option(
        "Whether to read rows of a recorded trace, or messages of a bag, as events at any time; "
        "a value holds until the next event.",
        None,
        default=False,
    )
    given: frozenset[str] = field(default=frozenset(), compare=False)

    of_monitors = OldName("from_monitors")

    def __init__(self, **options: Unpack[_AllKeywords]) -> None:
        for name, row in ROWS.items():
            object.__setattr__(self, name, _checked(name, options.get(name, row.default)))
        self._set_given(options)

    def _set_given(self, names: Iterable[str]) -> None:
        given = {n for n in names if (getattr(self, n), ROWS[n].default) != (None, None)}
        object.__setattr__(self, "given", frozenset(given))

    @property
    def seconds(self) -> Fraction | None:
        """The period in seconds; None without a period."""
        return seconds_of(self.period)

    def options(self) -> dict[str, Any]:
        """Return the options in ``given`` as keywords."""
        return {name: getattr(self, name) for name in ROWS if name in self.given}

    def written(self) -> dict[str, Any]:
        """Return the options of episodes, except the period, as JSON can hold them."""
        written = {name: getattr(self, name) for name in names_for("episodes") if name != "period"}
        for name in ("inputs", "outputs"):
            written[name] = None if written[name] is None else sorted(written[name])
        if self.stages is None:
            del written["stages"]
        return written

    def having(self, **options: Unpack[_AllKeywords]) -> EvaluationOptions:
        """Return a copy with these options replaced."""
        copy = object.__new__(EvaluationOptions)
        changed: Mapping[str, Any] = options
        for name in ROWS:
            value = _checked(name, changed[name]) if name in changed else getattr(self, name)
            object.__setattr__(copy, name, value)
        copy._set_given(self.given | changed.keys())
        return copy

    def about(self, name: str) -> EvaluationOptions:
        """Return the options of one requirement, without the stages of others.

        Example:
            >>> reading = EvaluationOptions(stages={"task": ["near > 0", "up > 0"]}, view="episode")
            >>> reading.about("task").stages, reading.about("calm").stages
            (('near > 0', 'up > 0'), None)
        """
        if not isinstance(self.stages, Mapping):
            return self
        return self.having(stages=self.stages.get(name))

    def complete(self, calls: Calls) -> EvaluationOptions:
        """Return a copy that counts every option of these calls as given."""
        return self._giving(self.given | set(names_for(calls)))

    def _giving(self, given: frozenset[str]) -> EvaluationOptions:
        copy = EvaluationOptions(**self.options())
        object.__setattr__(copy, "given", given)
        return copy

    def over(self, own: EvaluationOptions, owner: str, fix: str) -> EvaluationOptions:
        """Return the options of a monitor together with the options of a call that uses it.

        Args:
            own: The options of the monitor.
            owner: The owner of these options, for errors.
            fix: How to correct the call, for errors.

        Raises:
            InputError: If both set an option to different values.

        Example:
            >>> own = EvaluationOptions(view="step", period=0.1)
            >>> EvaluationOptions(period="100ms", nan="hold").over(
            ...     own, "it", "leave it out"
            ... ).options()
            {'period': 0.1, 'view': 'step', 'nan': 'hold'}
            >>> EvaluationOptions(view="episode").over(own, "it", "leave it out")
            Traceback (most recent call last):
            rtamt.errors.InputError: view= comes from it, which has 'step', got 'episode'; leave...
        """
        for name in self.given & own.given:
            has, got = getattr(own, name), getattr(self, name)
            if _meaning(name, has) != _meaning(name, got):
                refuse_other(name, has, got, owner, fix)
        both = EvaluationOptions(**{**self.options(), **own.options()})
        return both._giving(self.given | own.given)

    def from_monitors(self, specs: Mapping[str, rtamt.Specification]) -> dict[str, dict[str, Any]]:
        """Return the keywords for `rtamt` monitors of each specification.

        With several specifications, each gets only the ``inputs`` and ``outputs`` that it uses.

        Raises:
            InputError: If no specification knows a name in ``inputs`` or ``outputs``.
        """
        shared = {name: getattr(self, name) for name in names_for("samples")}
        if self.inputs is None and self.outputs is None:
            return dict.fromkeys(specs, shared)
        known = {name: _known(spec) for name, spec in specs.items()}
        return {
            name: {
                **shared,
                "inputs": _known_names("inputs", self.inputs, name, known),
                "outputs": _known_names("outputs", self.outputs, name, known),
            }
            for name in specs
        }


ROWS: dict[str, Field[Any]] = {
    row.name: row for row in fields(EvaluationOptions) if row.name != "given"
}
"""The row of each option, by its name."""


def names_for(calls: Calls | None = None) -> list[str]:
    """Return the names of the options that a group of calls takes; None: of all options."""
    if calls is None:
        return [*ROWS]
    groups = get_args(Calls)
    taken = groups[: groups.index(calls) + 1]
    return [name for name, row in ROWS.items() if row.metadata["calls"] in taken]


def checked_options(
    options: Mapping[str, Any], caller: Callable[..., object], calls: Calls
) -> EvaluationOptions:
    """Return the options that a call gets as ``**reading``; raise InputTypeError for others."""
    taken = names_for(calls)
    for name in options:
        if name not in taken:
            known = inspect.signature(caller).parameters
            hint = nearest(name, known) or f"; its arguments are {listing(known)}"
            raise InputTypeError(
                f"{caller.__name__}() got an unexpected keyword argument {name!r}{hint}"
            )
    return EvaluationOptions(**options)


def refuse_other(name: str, own: object, got: object, owner: str, fix: str) -> None:
    """Raise InputError for an argument that differs from the monitor's value."""
    raise InputError(Argument(name), f" comes from {owner}, which has {own!r}, got {got!r}; {fix}")


def documents_options(calls: Calls | None = None) -> Callable[[_F], _F]:
    """Return a decorator that lists the options of a group of calls; None: all options.

    They replace ``**reading`` in the signature. In the docstring, a group of calls lists their
    names; the docstring of `EvaluationOptions` describes all of them. A class is decorated if its
    own docstring describes its arguments.
    """
    rows = [ROWS[name] for name in names_for(calls)]

    def decorate(function: _F) -> _F:
        taking: Any = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]  # of this very class
        signature = inspect.signature(taking)
        *others, _ = signature.parameters.values()
        keyword = inspect.Parameter.KEYWORD_ONLY
        listed = [
            inspect.Parameter(row.name, keyword, default=row.default, annotation=row.type)
            for row in rows
        ]
        taking.__signature__ = signature.replace(parameters=[*others, *listed])
        function.__doc__ = _with_entries(function.__doc__, rows, described=calls is None)
        return function

    return decorate


def _with_entries(text: str | None, rows: Iterable[Field[Any]], *, described: bool) -> str | None:
    """Replace the entry ``**reading`` of a docstring by the options, described or only named."""
    entry = re.search(r"^( *)\*\*reading: .*(?:\n\1 .*)*", text or "", re.MULTILINE)
    if text is None or entry is None:
        return text
    indent = entry[1]
    texts = [f"{row.name}: {row.metadata['about']}" for row in rows]
    if not described:
        names = [f"``{row.name}``" for row in rows]
        listed = f"{', '.join(names[:-1])} and {names[-1]}"
        texts = [f"**options: Evaluation options, as `EvaluationOptions` describes: {listed}."]
    entries = [
        textwrap.fill(
            option,
            100,
            initial_indent=indent,
            subsequent_indent=f"{indent}    ",
            break_on_hyphens=False,
        )
        for option in texts
    ]
    return text[: entry.start()] + "\n".join(entries) + text[entry.end() :]


def seconds_of(period: Period | None) -> Fraction | None:
    """Return a period in seconds, exactly; None stays None."""
    return None if period is None else rtamt.Monitor("true", period).period


def _meaning(name: str, value: Any) -> object:  # noqa: ANN401 - of any option
    """Return a value in a form that is equal for equal options, such as ``0.1`` and ``"100ms"``."""
    if name == "period":
        return seconds_of(value)
    return frozenset(value) if isinstance(value, tuple) else value


def _checked(name: str, value: Any) -> object:  # noqa: ANN401 - of any option
    """Return the value of an option as it is stored; raise InputError for a wrong choice."""
    if name in {"inputs", "outputs"}:
        return _names(value)
    if name == "stages":
        return _stages(value)
    choices = ROWS[name].metadata["choices"]
    if choices and name != "semantics":  # monitors suggest the nearest
        check_choice(name, value, choices)
    return value


def _names(names: Names | None) -> Names | None:
    """Return names as a tuple, and leave a wrong value for the monitors to report."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        return names
    return tuple(names)


def _stages(stages: StagesLike | None) -> tuple[str, ...] | dict[str, tuple[str, ...]] | None:
    """Return the texts of stages; raise an error for fewer than two, or for other values."""
    if stages is None:
        return None
    if isinstance(stages, Mapping):
        return {name: _stage_texts(listed, f" of {name!r}") for name, listed in stages.items()}
    return _stage_texts(stages, "")


def _stage_texts(stages: Sequence[str | Formula], owner: str) -> tuple[str, ...]:
    if isinstance(stages, str | Formula) or not isinstance(stages, Sequence):
        raise InputTypeError(
            "expected ",
            Argument("stages"),
            f'{owner} as a list of formulas, such as ["near > 0", "lifted > 0"], got {stages!r}',
        )
    for stage in stages:
        if not isinstance(stage, str | Formula):
            raise InputTypeError(
                "expected formulas or their texts in ",
                Argument("stages"),
                f"{owner}, got {stage!r}",
            )
    if len(stages) < 2:
        raise InputError("expected two or more ", Argument("stages"), f"{owner}, got {len(stages)}")
    return tuple(map(str, stages))


def _known_names(
    argument: str, names: Names | None, spec: str, known: Mapping[str, frozenset[str]]
) -> Names | None:
    """Return the names that a specification knows; all of them if it is the only one."""
    if len(known) == 1 or not isinstance(names, tuple):
        return names
    everywhere = frozenset().union(*known.values())
    for name in names:
        if isinstance(name, str) and name not in everywhere:
            known_names = f"; the specifications read {listing(sorted(everywhere))}"
            hint = nearest(name, everywhere) or known_names
            raise InputError(f"{name!r} in {argument} is not a variable of a specification{hint}")
    return tuple(name for name in names if name in known[spec] or not isinstance(name, str))


def _known(spec: rtamt.Specification) -> frozenset[str]:
    """Return the used and declared variables of a specification, and the messages they are in."""
    names = {*spec.variables, *spec.declarations} - {*spec.formulas}
    ends = ((name, end.start()) for name in names for end in re.finditer(r"[.\[]|$", name))
    return frozenset(name[:end] for name, end in ends)


documents_options()(EvaluationOptions)
