"""Requirements in the managers of Isaac Lab and mjlab: terms of a ``ManagerBasedRLEnv``.

`Violated` is a termination term, which judges the episodes. `first_sample` and `monitor_state` are
observation terms, which take the sample of a reset. `shaped_reward` is a reward term. They follow
the documented interfaces; the tests use a stand-in for the simulators.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import torch

from rtamt import InputError
from rtamt.errors import InputTypeError, brief, no_such
from rtamt_arrays.judging import (
    JudgedStep,
    RequirementOptions,
    RequirementState,
    StepJudge,
)
from rtamt_arrays.monitor_set import ArrayLibrary, MonitorSetUpdate
from rtamt_arrays.torch import episode, online
from rtamt_arrays.torch.operations import TorchOperations
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.options.evaluation import seconds_of
from rtamt_gym.wrappers.monitoring import OnViolation

try:
    from isaaclab.managers import ManagerTermBase
except ModuleNotFoundError as e:
    if e.name != "isaaclab":  # Isaac Lab is installed, and its simulator has not been started
        raise

    class ManagerTermBase:  # type: ignore[no-redef]
        """The base of a term in mjlab, which accepts any class."""

        def __init__(self, cfg: Any, env: Any) -> None:  # noqa: ANN401 - of mjlab
            self.cfg, self._env = cfg, env


__all__ = ["Violated", "first_sample", "monitor_state", "shaped_reward"]

EnvSignal = Callable[[Any], torch.Tensor] | tuple[Callable[[Any], torch.Tensor], float]
"""A function ``(env) -> tensor[num_envs]``, or a pair of a function and its value at a reset."""


class Violated(ManagerTermBase):
    """A termination term that ends an episode at the first certain violation.

    With ``time_out=True`` in the configuration the end is a truncation; otherwise, it is a
    termination. `shaped_reward` returns the reward and writes ``env.extras["stl"]``.

    A signal is a function ``(env) -> tensor[num_envs]``, like other terms, or a pair
    ``(function, value)`` if the function is not defined at a reset, such as an action.

    A reset only marks environments, because the simulator may update poses and contacts after it.
    `first_sample` or `monitor_state`, among the observations, then takes sample 0. Without them,
    the sample after the first step is sample 0.

    No method waits for the device.

    Example:
        ::

            class TerminationsCfg:
                violated = TerminationTermCfg(
                    func=Violated,
                    params={"specs": "always(tilt < 0.5)", "signals": {"tilt": tilt}},
                )


            class PolicyCfg(ObservationGroupCfg):
                first_sample = ObservationTermCfg(func=first_sample)

    Args:
        cfg: The configuration of the term. Its ``params`` are ``specs``, ``signals`` and
            optionally ``options``, a dictionary of `rtamt_arrays.judging.RequirementOptions`.
            The default of ``period`` is ``env.step_dt``.
        env: The environment.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If a variable has no signal, an option is wrong, or an option is set that the
            managers set: ``observe``, and an ``on_violation`` that differs from ``time_out``.
        InputTypeError: If a signal is not a function, nor a pair of a function and a number.

    Attributes:
        requirements: The judge of the specifications.
        width: The number of features that `monitor_state` returns.
    """

    def __init__(self, cfg: Any, env: Any) -> None:  # noqa: ANN401 - of the simulator
        super().__init__(cfg, env)
        params = cfg.params
        for name in ("specs", "signals"):
            if name not in params:
                raise InputError(f"The params of Violated have no {name!r}.")
        self._truncates = bool(getattr(cfg, "time_out", False))
        options = _checked_options(
            params.get("options") or RequirementOptions(), env.step_dt, truncates=self._truncates
        )
        self.requirements = StepJudge(
            params["specs"],
            ArrayLibrary(
                partial(episode, device=env.device),
                partial(online, device=env.device),
                TorchOperations(torch.device(env.device)),
            ),
            options,
        )
        self._signals = _signals_of(params["signals"], self.requirements.variables)
        self._state = self.requirements.init(env.num_envs)
        self._never = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        self._zero = torch.zeros(env.num_envs, device=env.device)
        self._marked: torch.Tensor | None = ~self._never
        # A step with unknown ends.
        self._open_step: tuple[RequirementState, MonitorSetUpdate] | None = None
        self._paid: JudgedStep | None = None
        self.width: int = self.requirements.features.box.shape[0]
        self._features = self._zero[:, None].repeat(1, self.width)

    def reset(self, env_ids: Sequence[int] | torch.Tensor | slice | None = None) -> None:
        """Mark environments whose next sample is the first of an episode.

        Args:
            env_ids: Indices of environments, or a boolean for each; a slice; or None for all.

        Raises:
            InputError: If an index has no environment, or the number of booleans is wrong.
            InputTypeError: If ``env_ids`` has another type.
        """
        mask = self._mask_of(env_ids)
        self._state = self.requirements.reset(self._state, mask)
        self._marked = mask if self._marked is None else self._marked | mask

    def take_first(self) -> torch.Tensor:
        """Take sample 0 of the marked environments, and unmark them.

        Returns:
            The state of the monitors, of shape (num_envs, features).
        """
        if self._marked is not None:
            sample = {
                name: _read(name, signal, self._env) if at_reset is None else at_reset
                for name, (signal, at_reset) in self._signals.items()
            }
            self._state, judged = self.requirements.begin(self._state, sample, self._marked)
            self._features = torch.where(self._marked[:, None], judged.features, self._features)
            self._marked = None
        return self._features

    def __call__(
        self,
        env: Any,  # noqa: ANN401 - of the simulator
        specs: SpecsLike,  # noqa: ARG002 - managers pass the parameters at every call
        signals: Mapping[str, EnvSignal],  # noqa: ARG002
        options: RequirementOptions | None = None,  # noqa: ARG002
    ) -> torch.Tensor:
        """Take the sample of the step, and return where a requirement is certainly violated."""
        sample = {name: _read(name, signal, env) for name, (signal, _) in self._signals.items()}
        update = self.requirements.update(self._state, sample)
        self._open_step = self._state, update
        self._marked = None
        self._conclude(self._state, update, self._never, self._never)
        violated: torch.Tensor = self.requirements.violated(update)
        return violated

    def pay(self, terminated: torch.Tensor, truncated: torch.Tensor) -> JudgedStep | None:
        """Return the results of the step; None before the first step.

        Call it after all terminations are known. A second call in the same step returns the same
        result.
        """
        if self._open_step is not None:
            others = ~self.requirements.violated(self._open_step[1])
            ends = (
                (terminated, truncated & others)
                if self._truncates
                else (terminated & others, truncated)
            )
            self._paid = self._conclude(*self._open_step, *ends)
            self._open_step = None
        return self._paid

    def _conclude(
        self,
        before: RequirementState,
        update: MonitorSetUpdate,
        terminated: torch.Tensor,
        truncated: torch.Tensor,
    ) -> JudgedStep:
        self._state, judged = self.requirements.conclude(
            before, update, self._zero, terminated, truncated
        )
        self._features = judged.features
        return judged

    def _mask_of(self, env_ids: Sequence[int] | torch.Tensor | slice | None) -> torch.Tensor:
        """Return a boolean for each environment."""
        mask = self._never.clone()
        if env_ids is None or isinstance(env_ids, slice):
            mask[slice(None) if env_ids is None else env_ids] = True
            return mask
        try:
            ids = torch.as_tensor(env_ids, device=mask.device)
        except (TypeError, ValueError, RuntimeError) as e:
            raise _wrong_ids(env_ids) from e
        if ids.dtype == torch.bool:
            if ids.shape != mask.shape:
                raise InputError(
                    f"env_ids has {tuple(ids.shape)} booleans, expected one for each of the "
                    f"{len(mask)} environments"
                )
            return ids
        if ids.numel() == 0:
            return mask
        if ids.is_floating_point() or ids.is_complex():
            raise _wrong_ids(env_ids)
        try:
            mask[ids.to(torch.int64)] = True
        except IndexError as e:
            raise InputError(
                f"env_ids has an index without an environment: {brief(env_ids)}. Indices go up to "
                f"{len(mask) - 1}."
            ) from e
        return mask


def _wrong_ids(env_ids: object) -> InputTypeError:
    return InputTypeError(
        "expected env_ids as indices of environments, a boolean for each, a slice or None, "
        f"got {brief(env_ids)}"
    )


def _checked_options(
    options: RequirementOptions, step_dt: float, *, truncates: bool
) -> RequirementOptions:
    """Return the options of the judge; raise InputError for options that the managers set."""
    for name in options:
        if name not in RequirementOptions.__annotations__:
            raise InputError(no_such("option", name, RequirementOptions.__annotations__))
    if options.get("observe") is not None:
        raise InputError(
            f"Violated has no observe={options['observe']!r}. Add monitor_state to the "
            "observations."
        )
    ends: OnViolation = "truncate" if truncates else "terminate"
    on_violation = options.get("on_violation", ends)
    if on_violation != ends:
        raise InputError(
            f"on_violation={on_violation!r} has no effect: the termination manager ends the "
            f"episode, and time_out={truncates} means on_violation={ends!r}. Remove the option, or "
            "set time_out in the configuration of the term; a violation always ends the episode."
        )
    period = seconds_of(options.get("period"))
    if period is not None and period != 1 and not math.isclose(period, step_dt, rel_tol=1e-6):
        warnings.warn(
            f"period= is {float(period):g} s, but a step of the environment, which is a sample, "
            f"takes {step_dt:g} s, so bounds last {step_dt / float(period):g} times as long as "
            "written; leave period= out, or set period=1 to count steps",
            UserWarning,
            stacklevel=caller_level(),
        )
    return {"period": step_dt, **options, "on_violation": ends}


def _signals_of(
    signals: Mapping[str, EnvSignal], variables: Sequence[str]
) -> dict[str, tuple[Callable[[Any], torch.Tensor], float | None]]:
    """Return the function of each variable, and its value at a reset or None."""
    if not isinstance(signals, Mapping):
        raise InputTypeError(
            f"expected signals as a dictionary from variable to function, got {brief(signals)}"
        )
    pairs: dict[str, tuple[Callable[[Any], torch.Tensor], float | None]] = {}
    for name in variables:
        if name not in signals:
            listed = ", ".join(signals) or "none"
            raise InputError(f"variable {name!r} has no signal; the signals are {listed}")
        match signals[name]:
            case (function, bool() | int() | float() as value) if callable(function):
                pairs[name] = function, float(value)
            case function if callable(function):
                pairs[name] = function, None
            case signal:
                raise InputTypeError(
                    f"expected signal {name!r} as a function of the environment, or as a pair of "
                    f"a function and a number for resets, got {brief(signal)}"
                )
    return pairs


def _read(name: str, function: Callable[[Any], torch.Tensor], env: Any) -> torch.Tensor:  # noqa: ANN401 - of the simulator
    """Return the values of a signal, one for each environment."""
    values = function(env)
    if isinstance(values, torch.Tensor) and values.shape != (env.num_envs,):
        raise InputError(
            f"Signal {name!r} has the shape {tuple(values.shape)}, expected ({env.num_envs},). "
            "Return one number for each environment, such as values[:, 0]."
        )
    return values


def _terms_of(env: Any) -> dict[str, Violated]:  # noqa: ANN401 - of the simulator
    """Return the `Violated` terms of an environment by name."""
    manager = env.termination_manager
    terms = {name: manager.get_term_cfg(name).func for name in manager.active_terms}
    terms = {name: term for name, term in terms.items() if isinstance(term, Violated)}
    if not terms:
        raise InputError(
            "The environment has no termination term with func=Violated, which judges its "
            "episodes. Add one; its params are the specifications and their signals."
        )
    return terms


def _term_name(terms: Mapping[str, Violated], name: str | None, reader: str) -> str:
    """Return the name of the term that a reader names, or of the only term."""
    listed = ", ".join(map(repr, terms))
    if name is not None and name not in terms:
        raise InputError(f"{reader} has term={name!r}. The terms with func=Violated are {listed}.")
    if name is None and len(terms) > 1:
        raise InputError(
            f"{reader} does not name a term, and several have func=Violated: {listed}. "
            f"Add one {reader} for each, with params={{'term': NAME}}."
        )
    return next(iter(terms)) if name is None else name


def shaped_reward(env: Any, term: str | None = None) -> torch.Tensor:  # noqa: ANN401 - of the simulator
    """Return the shaped reward of `Violated`, as a reward term; 0 without the option ``mode``.

    The reward manager multiplies it by its weight and by the duration of a step. It does not call
    a term of weight 0.

    ``env.extras["stl"]`` then has the keys of `rtamt_arrays.jax.brax.StlWrapper`, as tensors of
    shape (num_envs,). If several terms have ``func=Violated``, it has these keys for each name.

    Args:
        env: The environment, which has `Violated` among its terminations.
        term: The name of the termination term; None if there is one `Violated`.

    Returns:
        A tensor of shape (num_envs,).

    Raises:
        InputError: If the environment has no `Violated`, or several and ``term`` names none.
    """
    terms = _terms_of(env)
    name = _term_name(terms, term, "shaped_reward")
    ends = env.termination_manager
    step = terms[name].pay(ends.terminated, ends.time_outs)
    if step is None:  # a manager may call it for its shape
        return torch.zeros(env.num_envs, device=env.device)
    if len(terms) == 1:
        env.extras["stl"] = step.info
    else:
        env.extras.setdefault("stl", {})[name] = step.info
    reward: torch.Tensor = step.reward
    return reward


def first_sample(env: Any) -> torch.Tensor:  # noqa: ANN401 - of the simulator
    """Take sample 0 of the environments that were reset, as an observation term of width 0.

    It takes the sample for every `Violated` of the environment; `monitor_state` takes it for one.

    Args:
        env: The environment, which has `Violated` among its terminations.

    Returns:
        A tensor of shape (num_envs, 0), which adds nothing to the observation.

    Raises:
        InputError: If the environment has no `Violated`.
    """
    if hasattr(env, "termination_manager"):  # managers create observations before terminations
        for term in _terms_of(env).values():
            term.take_first()
    return torch.zeros(env.num_envs, 0, device=env.device)


def monitor_state(
    env: Any,  # noqa: ANN401 - of the simulator
    features: int = 5,
    term: str | None = None,
) -> torch.Tensor:
    """Return the state of the monitors, as an observation term: ``observe="state"`` of `rtamt_gym`.

    Like `first_sample`, it takes sample 0 of the environments that were reset.

    Args:
        env: The environment, which has `Violated` among its terminations.
        features: The width of the observation: five for each specification. Managers need it
            before they know the specifications.
        term: The name of the termination term; None if there is one `Violated`.

    Returns:
        A tensor of shape (num_envs, features).

    Raises:
        InputError: If the environment has no `Violated`, or several and ``term`` names none; or if
            ``features`` is not the number of features.
    """
    if not hasattr(env, "termination_manager"):  # managers create observations before terminations
        return torch.zeros(env.num_envs, features, device=env.device)
    terms = _terms_of(env)
    violated = terms[_term_name(terms, term, "monitor_state")]
    if violated.width != features:
        raise InputError(
            f"monitor_state has features={features}, and its specifications have {violated.width}. "
            f"Pass params={{'features': {violated.width}}}."
        )
    return violated.take_first()
