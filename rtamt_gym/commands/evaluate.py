"""`rtamt evaluate`: measures how often a policy satisfies each requirement."""

from __future__ import annotations

import argparse
import copy
import math
import sys
import warnings
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import check_outputs, read_options, read_signals
from rtamt_gym.commands.end_notes import noted_ends
from rtamt_gym.commands.specs import files_of, requirements_of, selected
from rtamt_gym.options.command_line import (
    EPISODES,
    Option,
    add_options,
    positive,
    read_evaluation_options,
)
from rtamt_gym.options.evaluation import seconds_of
from rtamt_gym.results.warnings import (
    INTERRUPTED,
    Required,
    VerdictWarning,
    evidence_warnings,
    exit_code,
    print_warnings,
)
from rtamt_gym.success import readings
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.evaluation.comparison import Comparison
    from rtamt_gym.evaluation.evaluation import Evaluation
    from rtamt_gym.evaluation.recording_changes import RecordingsComparison
    from rtamt_gym.results.outcome import Word
    from rtamt_gym.results.statistics import Results
    from rtamt_gym.signals.signals import SignalLike

_FLAG: Final = "success"
"""The variable that reads the flag, and the first part of the names of its requirements."""

_KEYS: Final = ("success", "is_success")
"""The keys of success flags in the info of environments."""

_HOLD: Final = Fraction(1, 2)
"""The default of ``--hold`` in seconds."""

_NAMED: Final = 5
"""The maximum number of seeds in a warning."""


SUCCESS = (
    Option(
        "--success",
        "also evaluate the environment's own success flag: true at any step, at the last step, "
        "held for a time, and kept for that time until the end",
    ),
    Option(
        "--success-key KEY",
        "the key of the flag in info",
        usual="success or is_success, whichever exists",
    ),
    Option(
        "--hold TIME",
        "the time of held and kept, such as 2s",
        usual="500ms, or the next multiple of a step",
    ),
)


def check_success(options: argparse.Namespace) -> None:
    """Refuse ``--success-key`` and ``--hold`` without ``--success``."""
    for name in ("success_key", "hold"):
        if getattr(options, name) is not None and not options.success:
            raise InputError(f"--{name.replace('_', '-')} needs --success")


def success_requirements(
    options: argparse.Namespace,
    specs: Mapping[str, rtamt.Specification],
    period: rtamt.typing.Period | None,
) -> dict[str, rtamt.Specification]:
    """Return the specifications, and the requirements of the success flag if there is one."""
    if not options.success:
        return dict(specs)
    formulas = readings(_FLAG, options.hold or _hold(period))
    requirements = {
        f"{_FLAG}.{name}": rtamt.Specification.of(formula) for name, formula in formulas.items()
    }
    for name in requirements:
        if name in specs:
            raise InputError(f"expected one specification {name!r}, got two; rename one")
    return {**specs, **requirements}


def _hold(period: rtamt.typing.Period | None) -> str:
    """Return the default time as a text with its unit."""
    step = seconds_of(period)
    length = _HOLD if step is None else math.ceil(_HOLD / step) * step
    return f"{float(length * 1000):.12g}ms"


def flag_signal(
    options: argparse.Namespace,
    env: Any,  # noqa: ANN401 - an environment
    signals: Mapping[str, SignalLike],
) -> dict[str, SignalLike]:
    """Return the signals with the success flag, unless a signal has its name.

    A reset and a step of the environment show which key of info the flag has.
    """
    if not options.success or _FLAG in signals:
        return dict(signals)
    key = options.success_key
    if key is None:
        _, info = env.reset(seed=0)
        *_, last = env.step(copy.deepcopy(env.action_space).sample())
        keys = {**info, **last}
        flags = [name for name in _KEYS if name in keys]
        if len(flags) != 1:
            got = "both of them" if flags else f"{listing(keys) if keys else 'no key at all'}"
            raise InputError(
                f"--success: expected {' or '.join(_KEYS)} in the info of a step, got {got}; name "
                "another key with --success-key KEY, or read a signal with --signal "
                "success=SELECTOR"
            )
        key = flags[0]
    return {**signals, _FLAG: (f"info[{key!r}]", 0.0)}


def not_kept(results: Results) -> list[VerdictWarning]:
    """Return the warning on episodes that succeed at some step but not at the end."""
    lost = [
        row.seed
        for row in results
        if _satisfies(row, f"{_FLAG}.any") and not _satisfies(row, f"{_FLAG}.kept")
    ]
    if not lost:
        return []
    listed = ", ".join(map(str, lost[:_NAMED])) + (", ..." if len(lost) > _NAMED else "")
    seeds = "seed" if len(lost) == 1 else "seeds"
    return [
        VerdictWarning(
            f"success at some step, and not kept: {len(lost)} of "
            f"{counted(len(results), 'episode')}, {seeds} {listed}"
        )
    ]


def _satisfies(row: Any, name: str) -> bool:  # noqa: ANN401 - a `Trial`
    judged = row.judged(name)
    return judged is not None and judged.verdict is Verdict.SATISFIED


_EPISODES = 100
"""The default of ``--episodes``."""

_MOST = 10_000
"""The default of ``--episodes`` with ``--until-width`` or ``--target``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs episodes of a policy and prints how often it satisfies each requirement, with the "
        "95% interval of that rate. Exits 0; with --target, 1 if a requirement misses it, "
        "otherwise 3 if one is undecided. After Ctrl-C it prints the finished episodes and "
        "exits 130."
    )
    parser.epilog = (
        "example: rtamt evaluate CartPole-v1 --policy sb3:model.zip --spec 'upright = "
        "always(abs(angle) < 0.1)' --signal 'angle=obs[2]' --episodes 200"
    )
    add_options(
        parser,
        "ENV_ID",
        "--env-kwarg",
        Option(
            "--policy POLICY",
            "the policy, as for rtamt run, such as sb3:FILE.zip or module:function; load only "
            "files that you trust",
            required=True,
        ),
        Option("--name NAME", "name of the policy in tables, files and reports", usual="POLICY"),
        "--spec",
        "--only",
        *SUCCESS,
        Option(
            "--signal NAME=SELECTOR", "the selector of a variable, as for rtamt run", repeat=True
        ),
        Option(
            "--episodes N",
            f"number of episodes (default: {_EPISODES}); with --until-width or --target the "
            f"maximum number (default: {_MOST})",
            read=positive,
        ),
        Option(
            "--until-width WIDTH",
            "run episodes until the interval of every rate is this narrow, such as 0.05",
            read=float,
        ),
        Option(
            "--target RATE",
            "run episodes until the rate of every requirement is clearly above or below this "
            "one, such as 0.95",
            read=float,
        ),
        Option(
            "--alpha CHANCE",
            "maximum probability of a wrong answer to --target",
            usual="0.05",
            read=float,
        ),
        Option(
            "--margin MARGIN",
            "a rate below the target by this much or more misses it; in between, either answer "
            "is right",
            usual="0.05",
            read=float,
        ),
        Option(
            "--interval",
            "method of the 95% intervals: exact contains the true rate in at least 95 of 100 "
            "evaluations; wilson is narrower and contains it in about 95, near 0 and 1 in far "
            "fewer",
            default="exact",
            choices=("exact", "wilson"),
        ),
        "--seed",
        "--max-steps",
        Option(
            "--stop",
            "stop an episode at the first violation, which leaves other requirements open, or "
            "once all verdicts are certain",
            default="end",
            choices=("end", "violation", "verdicts"),
        ),
        Option(
            "--n-envs N",
            "number of parallel episodes in a process",
            default=1,
            read=positive,
        ),
        "-j",
        "--timeout",
        "--folder",
        "--accept-changed",
        *EPISODES,
        "--require-triggered",
        "--require-answered",
        Option("--save FILE", "write the evaluation as JSON, which rtamt compare reads", read=Path),
        Option(
            "--report FILE",
            "write the evaluation as a page of HTML, with plots of the worst episodes",
            read=Path,
        ),
        trial="episode",
    )


def run(options: argparse.Namespace) -> int:
    """Play the episodes and print the results; return 1 or 3 if a target is not met."""
    from rtamt_gym.evaluation.evaluate import evaluate_policy
    from rtamt_gym.evaluation.evaluation import show
    from rtamt_gym.evaluation.replays import UnrepeatedSeedWarning
    from rtamt_gym.evaluation.sequential import stopping_of
    from rtamt_gym.judging.specs import own_requirements
    from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning
    from rtamt_gym.signals.periods import read_period
    from rtamt_gym.systems.registry import make

    check_files(options)
    check_success(options)
    sequential = options.until_width is not None or options.target is not None
    rules = {name: getattr(options, name) for name in _RULES if getattr(options, name) is not None}
    for name in ("alpha", "margin"):
        if name in rules and options.target is None:
            raise InputError(f"--{name} needs --target")
    stopping_of((), **rules)  # refuses wrong numbers before the environment is made
    signals, lost = read_signals(options.signal), 0
    kwargs = read_options(options.env_kwarg)
    with closing(make(options.env_id, options.max_steps, kwargs)) as env, noted_ends() as notes:
        requirements = {}
        if options.spec or not options.success:
            own = own_requirements(env)
            requirements = requirements_of(options.spec, own, options.env_id, "--spec")
        specs, signals = selected(requirements, options.only, signals)
        reading = read_evaluation_options(options)
        specs = success_requirements(options, specs, reading.period or read_period(env))
        signals = flag_signal(options, env, signals)
        with warnings.catch_warnings():
            for category in (FailedSimulationWarning, UnrepeatedSeedWarning):  # by the table
                warnings.simplefilter("ignore", category)
            try:
                evaluation = evaluate_policy(
                    options.policy,
                    env,
                    specs,
                    signals or None,
                    episodes=options.episodes or (_MOST if sequential else _EPISODES),
                    progress=True,
                    **rules,
                    **{name: getattr(options, name) for name in _ARGUMENTS},
                    **reading.options(),
                )
            except KeyboardInterrupt as pressed:
                evaluation, lost = _so_far(pressed)
        record = evaluation.record.with_files(files_of(options.spec, options.policy))
        evaluation = replace(evaluation, record=record)
        if options.save:
            evaluation.save(options.save)
    show(evaluation)
    if lost:
        print("", f"not counted: at most {counted(lost, 'unfinished episode')}", sep="\n")
    if notes:
        print("", *notes, sep="\n")
    tell_files(evaluation, options, "evaluation")
    verdict_warnings = evidence_warnings(evaluation.record, "episode", Required.of(options))
    verdict_warnings += not_kept(evaluation.record) if options.success else []
    print_warnings(verdict_warnings)
    if evaluation.interrupted is not None:
        return INTERRUPTED
    return exit_code(_words(evaluation.decision or {}, options.target), verdict_warnings)


def _so_far(pressed: KeyboardInterrupt) -> tuple[Evaluation, int]:
    """Return the evaluation so far after an interrupt, and the number of unfinished episodes."""
    evaluation: Evaluation | None = getattr(pressed, "evaluation", None)
    if evaluation is None:
        print("interrupted before an episode was over", file=sys.stderr)
        raise pressed
    lost: int = getattr(pressed, "lost", 0)
    return evaluation, lost


_RULES = ("until_width", "target", "alpha", "margin")

_ARGUMENTS = (
    *("name", "seed", "n_envs", "n_jobs", "timeout", "folder", "accept_changed", "stop"),
    "interval",
)
"""The options that are arguments of `evaluate_policy` of the same names."""


def check_files(options: argparse.Namespace, *inputs: Path) -> None:
    """Refuse ``--save`` and ``--report`` that cannot be written, before anything runs."""
    check_outputs(options.save, options.report, picture=None, inputs=list(map(str, inputs)))
    if options.save is not None and options.save.suffix.lower() != ".json":
        raise InputError(f"cannot write {options.save}: expected a name that ends in .json")
    if options.report is not None:
        from rtamt_gym.reports.write import check_page

        check_page(options.report)
        for package in ("jinja2", "plotly"):  # fail before hours of episodes, not after
            import_module(package)


def tell_files(
    result: Evaluation | Comparison | RecordingsComparison, options: argparse.Namespace, what: str
) -> None:
    """Write the report page, and print the paths of all written files."""
    files = [f"{what}: {options.save}"] if options.save else []
    if options.report:
        from rtamt_gym.reports.write import write_report

        write_report(options.report, result)
        files.append(f"report: {options.report}")
    if files:
        print("", *files, sep="\n")


def _words(decision: Mapping[str, str], target: float | None) -> list[Word]:
    """Return the results of requirements with a target."""
    if target is None:
        return []
    return [_word(answer) for answer in decision.values()]


def _word(decision: str) -> Word:
    if decision.startswith("meets"):
        return "satisfied"
    return "violated" if decision.startswith("falls short") else "undecided"
