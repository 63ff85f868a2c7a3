"""Replays of episodes: whether a seed repeats an episode, and pictures of replays."""

from __future__ import annotations

import copy
import io
import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.play.episodes import Episodes
from rtamt_gym.play.run import Run
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.periods import read_period
from rtamt_gym.systems.environment import baseline_of
from rtamt_gym.tables import number
from rtamt_gym.wrappers.monitor import monitor_of
from rtamt_gym.wrappers.substeps import read_substep_period

if TYPE_CHECKING:
    from rtamt_gym.play.runner import Runner

HOW_TO_REPEAT: Final = (
    "give a function that makes an environment whose reset(seed=...) chooses all that is random: "
    "Meta-World wants env.set_task(task) before a reset, robosuite rtamt_gym.benchmarks"
)
"""What to do about an environment that seeds do not repeat."""


HOW_TO_REPLAY: Final = (
    "the policy or the environment draws numbers that the seed does not choose, or the policy "
    "keeps a state between episodes. Give a class of policies, which is made anew as "
    "Class(seed=...) for each episode; a network may also round differently in a batch (n_envs=)"
)
"""Why a replay may differ from the recorded episode, and what to do about it."""

_ROUNDING: Final = 1e-6
"""The relative difference of robustness that networks make by rounding in a batch."""


class UnrepeatedSeedWarning(UserWarning):
    """A seed did not repeat an episode: its first observation, or its robustness in a replay."""


def repeats(env: Any, seed: int) -> bool | None:  # noqa: ANN401 - an environment, or many
    """Return whether two resets with a seed show the same observation; None if a reset fails.

    It costs two resets, and leaves the environment reset.
    """
    seeds: Any = [seed] * env.num_envs if isinstance(env, VectorEnv) else seed
    try:
        first, _ = env.reset(seed=seeds)
        stored = copy.deepcopy(first)  # an environment may write the next observation into it
        second, _ = env.reset(seed=seeds)
    except (Exception, SystemExit):  # noqa: BLE001 - the episodes report the error
        return None
    return alike(stored, second)


def tell_unrepeated(name: str, seed: int) -> None:
    """Warn that seeds do not repeat episodes of an environment."""
    warnings.warn(
        f"two resets of {name} with seed {seed} begin differently: the same call plays other "
        f"episodes, none is played again, and compare refuses to pair them; {HOW_TO_REPEAT}",
        UnrepeatedSeedWarning,
        stacklevel=caller_level(),
    )


def difference(row: Trial, run: Run) -> str:
    """Return the first requirement with a different replay, or an empty string."""
    for name, outcome in row.outcomes.items():
        history = run.histories[name]
        same = math.isclose(history.final, outcome.robustness, rel_tol=_ROUNDING) or (
            math.isnan(history.final) and math.isnan(outcome.robustness)
        )
        if history.verdict is not outcome.verdict or not same:
            return (
                f"{name} had robustness {number(outcome.robustness)} ({outcome.verdict.name}), and "
                f"{number(history.final)} ({history.verdict.name}) when it was played again"
            )
    return ""


def warn_of_difference(name: str, seed: int, differing: str) -> None:
    """Warn that the replay of an episode differs from the recorded episode."""
    warnings.warn(
        f"episode {seed} of {name} does not repeat: {differing}; {HOW_TO_REPLAY}",
        UnrepeatedSeedWarning,
        stacklevel=caller_level(),
    )


def refuse_unrepeated(name: str) -> NoReturn:
    """Refuse to pair episodes of an environment by seeds that do not repeat them."""
    raise InputError(
        f"cannot pair episodes of {name} by their seeds: two resets with one seed begin "
        f"differently; {HOW_TO_REPEAT}"
    )


def alike(a: Any, b: Any) -> bool:  # noqa: ANN401 - observations of any space
    """Return whether two observations are equal; nan equals nan."""
    if isinstance(a, Mapping):
        return isinstance(b, Mapping) and a.keys() == b.keys() and all(alike(a[n], b[n]) for n in a)
    if isinstance(a, list | tuple):
        same = isinstance(b, list | tuple) and len(a) == len(b)
        return same and all(alike(one, two) for one, two in zip(a, b, strict=True))
    one, two = np.asarray(a), np.asarray(b)
    numbers = one.dtype.kind in "fc" and two.dtype.kind in "fc"
    return bool(np.array_equal(one, two, equal_nan=numbers))


_MOST: Final = 22
"""The maximum number of evenly spread pictures; the end and violations have further ones."""

_SIDE: Final = 320
"""The maximum width and height of a picture, in pixels."""

_QUALITY: Final = 60
"""WebP quality, up to 100: a MuJoCo robot takes about 6 kB, a cart with a pole 0.5 kB."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture of an episode: its time in seconds (or sample), and the bytes of a WebP file."""

    time: float
    webp: bytes


class Film:
    """Pictures of an episode of unknown length, evenly spread and at chosen steps.

    If there are too many, it drops half of them. ``expected`` is the minimum number of states.
    """

    def __init__(self, take: Callable[[], bytes], chosen: Iterable[int], expected: int) -> None:
        self._take = take
        self._chosen = frozenset(chosen)
        self._stride = -(-expected // _MOST)
        self.pictures: dict[int, bytes] = {}
        self.steps = 0

    def look(self, *, last: bool = False) -> None:
        """Count one more state; take a picture of it if it is due, or the last one."""
        step, self.steps = self.steps, self.steps + 1
        if step % self._stride == 0 or step in self._chosen or last:
            self.pictures[step] = self._take()
        while not last and len(self.pictures.keys() - self._chosen) > _MOST:
            self._stride *= 2
            self.pictures = {
                number: picture
                for number, picture in self.pictures.items()
                if number % self._stride == 0 or number in self._chosen
            }


class Filming:
    """Replays episodes, with pictures if the environment renders arrays.

    An error of rendering ends the pictures, but not the episode.
    """

    def __init__(self, runner: Runner, period: Fraction | None) -> None:
        self._runner = runner
        self._period = period
        self._error: Exception | None = None

    def play(self, row: Trial) -> tuple[Run, tuple[Frame, ...]]:
        """Play the episode of a row; return its run and its pictures."""
        runner, seed = self._runner, row.seed or 0
        if not isinstance(runner, Episodes) or runner.system.render_mode != "rgb_array":
            return played(runner, seed), ()
        env: gym.Env[Any, Any] = runner.system
        step = float(self._period or 1) * (per_step := _samples_per_step(env))
        violations = [
            outcome.violated_at
            for outcome in row.outcomes.values()
            if outcome.violated_at is not None
        ]
        film = Film(
            lambda: _picture(env),
            [math.ceil(round(time / step, 6)) for time in violations],
            round(row.simulated / step) + 1,
        )
        make = runner.evaluated.make
        act: Any = baseline_of(env) if make is None else make(seed)

        def filmed(observation: Any) -> Any:  # noqa: ANN401 - as for policies
            self._look(film)
            return act(observation)

        run = played(runner, seed, policy=filmed)
        self._look(film, last=True)
        last = len(run.times) - 1
        frames = (
            Frame(float(run.times[min(step * per_step, last)]), picture)
            for step, picture in film.pictures.items()
        )
        return run, tuple(frames)

    def tell(self) -> None:
        """Warn if a picture has failed."""
        if self._error is not None:
            warnings.warn(
                f"pictures of the worst episodes are missing, since {self._runner.name} could not "
                f"be rendered: {type(self._error).__name__}: {self._error}",
                RuntimeWarning,
                stacklevel=caller_level(),
            )

    def _look(self, film: Film, *, last: bool = False) -> None:
        if self._error is None:
            try:
                film.look(last=last)
            except Exception as error:  # noqa: BLE001 - rendering may raise anything
                self._error = error


def played(runner: Runner, seed: int, **others: Any) -> Run:  # noqa: ANN401 - options of `simulate`
    """Play the episode of a seed to its end."""
    return replace(runner.simulate({}, seed, stop="end", **others), case=None)


def replay_difference(runner: Runner, row: Trial, run: Run) -> str:
    """Return how a replay differs from the recorded episode; an empty string if it does not."""
    return difference(row, run if runner.stop == "end" else runner.simulate({}, row.seed or 0))


def _samples_per_step(env: gym.Env[Any, Any]) -> int:
    """Return the samples per step of an environment: several under a monitor with substeps."""
    monitor = monitor_of(env)
    step, sample = read_period(env), read_substep_period(env)
    if monitor is None or not monitor.substeps or not step or not sample:
        return 1
    return round(step / sample)


def _picture(env: gym.Env[Any, Any]) -> bytes:
    """Return the rendered picture as a small WebP file."""
    from PIL import Image

    shown: Any = env.render()
    if not isinstance(shown, np.ndarray) or shown.dtype != np.uint8 or shown.ndim != 3:
        raise InputTypeError(
            f"expected an array of height x width x 3 bytes from render(), got {_kind(shown)}"
        )
    image = Image.fromarray(shown).convert("RGB")
    image.thumbnail((_SIDE, _SIDE))
    file = io.BytesIO()
    image.save(file, "WEBP", quality=_QUALITY)
    return file.getvalue()


def _kind(shown: Any) -> str:  # noqa: ANN401 - anything
    if isinstance(shown, np.ndarray):
        return f"{shown.dtype} of the shape {shown.shape}"
    return f"a {type(shown).__name__}"
