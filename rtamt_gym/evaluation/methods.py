"""`compare_methods`: comparison of learning methods over training seeds."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.paired import LEVEL, holm
from rtamt_gym.results.codec import SavedResult, document, read_fields
from rtamt_gym.results.method_scores import (
    Estimate,
    MethodScores,
    improvement,
    interquartile_mean,
    mean,
    permutation_p,
    profile,
    stratified_bootstrap,
)
from rtamt_gym.tables import Terminal, counted, p_text

if TYPE_CHECKING:  # matplotlib is optional
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MethodRuns = ArrayLike | Sequence[Evaluation] | Mapping[str, "ArrayLike | Sequence[Evaluation]"]
"""The runs of a method: a score or a curve of scores for each training seed; for several tasks, a
mapping by task."""

_POINTS: Final = 51
"""The thresholds of performance profiles."""

_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#222222")
"""The palette of Okabe and Ito."""


@dataclass(frozen=True, repr=False)
class MethodComparison(SavedResult):
    """Learning methods over training seeds; `compare_methods` returns it, and ``print`` shows it.

    Attributes:
        methods: The results of each method, by name.
        baseline: The name of the method to compare the others with.
        tasks: The names of the tasks; one empty text for a single task.
        thresholds: The thresholds of the performance profiles.
        steps: The training steps of the points of curves; empty without curves.
        score: The name of the score.
        confidence: How often an interval covers the true value.
        resamples: The number of bootstrap samples for the intervals.
        seed: The seed of the random numbers.
    """

    methods: Mapping[str, MethodScores]
    baseline: str
    tasks: tuple[str, ...]
    thresholds: tuple[float, ...]
    steps: tuple[float, ...]
    score: str
    confidence: float
    resamples: int
    seed: int

    kind: ClassVar = "methods"

    @property
    def sentence(self) -> str:
        """The significant differences between each method and the baseline."""
        return " ".join(
            self._sentence(name, result)
            for name, result in self.methods.items()
            if name != self.baseline
        )

    def _sentence(self, name: str, scores: MethodScores) -> str:
        adjusted = 1.0 if scores.adjusted is None else scores.adjusted
        gap = scores.mean.value - self.methods[self.baseline].mean.value
        if adjusted >= LEVEL:
            return (
                f"No difference is shown between {name} and {self.baseline} ({p_text(adjusted)})."
            )
        return (
            f"{name} has {abs(gap):.3g} {'more' if gap > 0 else 'less'} mean {self.score} than "
            f"{self.baseline} ({p_text(adjusted)})."
        )

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw the scores of all runs, the profiles, and the curves if there are any.

        Needs the extra ``plot``.

        Args:
            path: The name of the picture, such as ``methods.png``, ``.svg`` or ``.pdf``.

        Raises:
            InputError: If the file does not have the extension of a picture.
        """
        try:
            from rtamt_gym import drawing
        except ModuleNotFoundError as error:
            raise naming_extra(error, "MethodComparison.plot") from error
        drawing.check_format(Path(path))
        drawing.save(_draw(self), Path(path))

    def to_json(self) -> str:
        """Return the comparison as strict JSON."""
        stored = {field.name: getattr(self, field.name) for field in fields(self)}
        return document("methods", stored | {"sentence": self.sentence})

    @classmethod
    def from_saved(cls, kept: Mapping[str, Any]) -> Self:
        """Return the comparison from the JSON of a result of the kind ``"methods"``."""
        return read_fields(cls, kept)

    def __repr__(self) -> str:
        return f"<Comparison of {counted(len(self.methods), 'method')}: {listing(self.methods)}>"

    def __str__(self) -> str:
        share = f"{100 * self.confidence:g} %"
        head = ["method", "runs", "mean", share, "IQM", share, "minimum", "median"]
        head += [f"above {self.baseline}", "p"]
        rows = [head]
        for name, result in self.methods.items():
            row = [name, str(result.runs)]
            for item in (result.mean, result.interquartile_mean):
                row += [f"{item.value:.3g}", _ends(item)]
            row += [f"{result.quartiles[0]:.3g}", f"{result.quartiles[2]:.3g}"]
            if result.improvement is None or result.adjusted is None:
                row += ["", ""]
            else:
                row += [f"{result.improvement.value:.2f}", p_text(result.adjusted)[2:].lstrip("= ")]
            rows.append(row)
        tasks = "" if self.tasks == ("",) else f" over {counted(len(self.tasks), 'task')}"
        title = f"{self.score}{tasks}, a run for each training seed"
        return "\n".join([title, "", *Terminal().table(rows, "<" + ">" * (len(head) - 1))])


def compare_methods(
    runs: Mapping[str, MethodRuns],
    *,
    baseline: str | None = None,
    steps: ArrayLike | None = None,
    score: str = "satisfaction",
    confidence: float = 0.95,
    resamples: int = 10_000,
    seed: int = 0,
) -> MethodComparison:
    """Compare methods of learning over runs with different training seeds.

    A run is one policy: its many episodes are not independent trials of the training method.
    Therefore every number counts runs. The definitions follow Agarwal et al., "Deep Reinforcement
    Learning at the Edge of the Statistical Precipice" (NeurIPS 2021):

    | number | of the scores, runs x tasks |
    |---|---|
    | mean | the mean over tasks of the means over runs |
    | interquartile mean | the mean of the middle half of all scores: a few runs weigh little |
    | probability of improvement | of a run against a run of the baseline; equal scores count half |
    | performance profile | the share of all scores above each threshold |
    | intervals | percentiles of the stratified bootstrap: runs are resampled within each task |

    The p-value comes from a two-sided permutation test on the means, within each task. An interval
    from few runs is too narrow; if all scores are equal, its width is 0. The interquartile mean
    hides up to a quarter of failed runs; `MethodScores.quartiles` starts with the minimum.

    Args:
        runs: The scores of the runs of each method, such as shares of satisfied episodes: a number
            or an `Evaluation` for each training seed; with ``steps`` a curve for each, an array of
            shape (runs, points). For several tasks, a mapping from task names to these, with the
            same number of runs in each.
        baseline: The method to compare the others with. Default: the first.
        steps: The training steps of the points of curves. The last point of a curve is the score of
            its run.
        score: The name of the score in tables and pictures.
        confidence: How often an interval covers the true value.
        resamples: The number of bootstrap samples for the intervals.
        seed: The seed of the random numbers: the same arguments return the same comparison.

    Raises:
        InputError: If there is no method or no run, numbers of runs or points or names of tasks
            differ, or a score is not finite.
        InputTypeError: If ``runs`` is not a mapping.

    Example:
        >>> from rtamt_gym import compare_methods
        >>> found = compare_methods(
        ...     {"plain": [0.0, 0.1, 0.0, 0.2, 0.1], "shaped": [0.9, 1.0, 0.2, 1.0, 1.0]}
        ... )
        >>> shaped = found.methods["shaped"]
        >>> round(shaped.mean.value, 2), round(shaped.interquartile_mean.value, 2)
        (0.82, 0.97)
        >>> round(shaped.improvement.value, 2), round(shaped.p, 3)
        (0.98, 0.016)
    """
    if not 0 < confidence < 1:
        raise InputError(f"expected confidence= between 0 and 1, such as 0.95, got {confidence!r}")
    check_count(Argument("resamples"), resamples)
    points = None if steps is None else tuple(map(float, np.asarray(steps).ravel()))
    scores = _scores(runs, points)
    tasks = _tasks(scores)
    reference = next(iter(scores)) if baseline is None else baseline
    if reference not in scores:
        raise InputError(
            f"expected baseline= as a method ({listing(scores)}), got "
            f"{baseline!r}{nearest(baseline, scores)}"
        )
    curves = {
        name: np.stack([of_task[task] for task in tasks], axis=1)
        for name, of_task in scores.items()
    }
    ends = {name: curve[..., -1] for name, curve in curves.items()}
    every = np.concatenate([value.ravel() for value in ends.values()])
    low, high = min(0.0, float(every.min())), max(1.0, float(every.max()))
    thresholds = np.linspace(low, high, _POINTS)
    interval = partial(stratified_bootstrap, confidence=confidence, resamples=resamples, seed=seed)
    chances = {
        name: permutation_p(value, ends[reference], seed=seed)
        for name, value in ends.items()
        if name != reference
    }
    adjusted = holm(chances)
    methods = {}
    for name, values in ends.items():
        share = profile(values, thresholds)
        methods[name] = MethodScores(
            tuple(tuple(map(float, row)) for row in values),
            _estimate([values], mean, interval),
            _estimate([values], interquartile_mean, interval),
            _estimates(share, interval([values], partial(profile, thresholds=thresholds))),
            ()
            if points is None
            else tuple(
                _estimate([curves[name][..., k]], mean, interval) for k in range(len(points))
            ),
            None
            if name == reference
            else _estimate([values, ends[reference]], improvement, interval),
            chances.get(name),
            adjusted.get(name),
        )
    return MethodComparison(
        methods,
        reference,
        tasks,
        tuple(map(float, thresholds)),
        points or (),
        score,
        confidence,
        resamples,
        seed,
    )


_Bootstrap = Callable[[Sequence[Floats], Callable[..., Any]], tuple[Any, Any]]


def _estimate(
    samples: Sequence[Floats], statistic: Callable[..., Any], interval: _Bootstrap
) -> Estimate:
    low, high = interval(samples, statistic)
    return Estimate(float(statistic(*samples)), (float(low), float(high)))


def _estimates(values: Floats, interval: tuple[Floats, Floats]) -> tuple[Estimate, ...]:
    return tuple(
        Estimate(float(value), (float(low), float(high)))
        for value, low, high in zip(values, *interval, strict=True)
    )


def _scores(runs: object, points: tuple[float, ...] | None) -> dict[str, dict[str, Floats]]:
    """Return the curves of each method and task, of shape (runs, points); checked."""
    if not isinstance(runs, Mapping):
        raise InputTypeError(
            "expected the runs as a mapping, such as {'plain': [0.1, 0.0], 'shaped': [0.9, 1.0]}, "
            f"got {type(runs).__name__}"
        )
    if not runs:
        raise InputError("expected at least one method, got none")
    result = {}
    for name, argument in runs.items():
        by_task = argument if isinstance(argument, Mapping) else {"": argument}
        if not by_task:
            raise InputError(f"expected at least one task of {name!r}, got none")
        result[str(name)] = {
            str(task): _curves(value, points, f"{name!r}" + (f" on {task!r}" if task else ""))
            for task, value in by_task.items()
        }
    return result


def _curves(runs: Any, points: tuple[float, ...] | None, name: str) -> Floats:  # noqa: ANN401
    """Return the curves of the runs of one method on one task; a score is a curve of one point."""
    scores = [
        item.success.rate if isinstance(item, Evaluation) else item
        for item in (runs if isinstance(runs, list | tuple) else np.asarray(runs))
    ]
    try:
        array = np.array(scores, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"expected numbers for each run of {name}, got others: {error}") from error
    if points is None:
        wanted, fits = "a score for each run, shape (runs,)", array.ndim == 1
    else:
        wanted = f"a curve for each run, shape (runs, {len(points)}) as steps= has"
        fits = array.ndim == 2 and array.shape[1] == len(points)
    if not fits or not array.size:
        raise InputError(f"expected {wanted}, of {name}, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(
            f"expected finite scores of {name}, got nan or inf in run "
            f"{int(np.argwhere(~np.isfinite(array))[0][0])}; give a failed run a score, such as 0"
        )
    return array.reshape(len(array), -1)


def _tasks(scores: Mapping[str, Mapping[str, Floats]]) -> tuple[str, ...]:
    """Return the names of the tasks, which all methods have, with as many runs in each."""
    (first, tasks), *others = ((name, tuple(of_task)) for name, of_task in scores.items())
    for name, other in others:
        if set(other) != set(tasks):
            raise InputError(
                f"expected the same tasks of all methods, got {listing(tasks)} of {first!r} and "
                f"{listing(other)} of {name!r}"
            )
    for name, of_task in scores.items():
        counts = {task: len(value) for task, value in of_task.items()}
        if len(set(counts.values())) > 1:
            raise InputError(
                f"expected as many runs of {name!r} in each task, got {counts}; compare tasks with "
                "other numbers of runs separately"
            )
    return tasks


def _ends(estimate: Estimate) -> str:
    low, high = estimate.interval
    return f"[{low:.3g}, {high:.3g}]"


def _draw(comparison: MethodComparison) -> Figure:
    """Draw the curves of training if there are any, the score of every run, and the profiles."""
    from matplotlib.figure import Figure

    from rtamt_gym import drawing

    methods, steps, score = comparison.methods, comparison.steps, comparison.score
    panels = 2 + bool(steps)
    figure = Figure(figsize=(3.6 * panels + 0.4, 3.3), layout="constrained")
    *first, runs, profiles = figure.subplots(1, panels)
    colours = dict(zip(methods, cycle(_COLOURS), strict=False))
    for ax in first:
        for name, method in methods.items():
            _band(ax, steps, method.curve, name, colours[name])
        drawing.tidy(ax, f"mean {score}")
        ax.set_xlabel("steps of training", fontsize=9)
    for index, (name, method) in enumerate(methods.items()):
        scores = np.sort(np.ravel(method.scores))
        # Runs next to each other, so that equal runs stay visible.
        across = index + np.linspace(-0.3, 0.3, len(scores))
        runs.plot(across, scores, ".", color=colours[name], markersize=4)
        low, high = method.mean.interval
        runs.plot([index, index], [low, high], color=colours[name], linewidth=2)
        runs.plot([index], [method.mean.value], "o", color=colours[name])
    runs.set_xticks(range(len(methods)), list(methods))
    drawing.tidy(runs, f"{score} of each run")
    for name, method in methods.items():
        _band(profiles, comparison.thresholds, method.profile, name, colours[name])
    drawing.tidy(profiles, "share of runs above")
    profiles.set_xlabel(score, fontsize=9)
    handles, labels = profiles.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _band(
    ax: Axes, places: Sequence[float], estimates: Sequence[Estimate], name: str, colour: str
) -> None:
    """Draw a curve with the intervals of its points."""
    low, high = np.array([estimate.interval for estimate in estimates]).T
    ax.plot(
        places, [estimate.value for estimate in estimates], color=colour, label=name, linewidth=1.6
    )
    ax.fill_between(places, low, high, color=colour, alpha=0.18, linewidth=0)
