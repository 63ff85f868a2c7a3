"""The specifications of an environment: loaded and named; the period and resets of its samples."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium import logger
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt.errors import Argument
from rtamt_gym.checks.requirements import load_file, named_in, requirement_named
from rtamt_gym.judging.constants import ConstantValue, checked_constants, no_such_constant

__all__ = [
    "SpecLike",
    "SpecsLike",
    "autoreset_mode",
    "check_period",
    "checked_mask",
    "load_specs",
    "own_requirements",
    "recordable",
]

SpecLike = str | os.PathLike[str] | rtamt.Formula | rtamt.Specification
"""Text, the path of a ``.stl`` file, a formula built in Python, or a parsed specification."""

SpecsLike = SpecLike | Mapping[str, SpecLike]
"""One specification, or several with their names."""


def own_requirements(env: Any) -> Mapping[str, rtamt.Specification]:  # noqa: ANN401 - any system
    """The requirements that an environment has of its own: its attribute ``requirements``.

    A scenario of `rtamt_envs` has one, and any environment may: ``{"AT1": rtamt.parse("...")}``.
    """
    own = getattr(getattr(env, "unwrapped", env), "requirements", None)
    return own if isinstance(own, Mapping) else {}


def load_specs(
    specs: SpecsLike,
    own: Mapping[str, rtamt.Specification] = MappingProxyType({}),
    constants: Mapping[str, ConstantValue] | None = None,
) -> dict[str, rtamt.Specification]:
    """Loads the requirements of specifications, by name.

    A text that is the name of a requirement in ``own`` stands for that requirement. Of
    ``constants`` each gets those that it names.

    Each formula that no other formula of its text uses is a requirement, and is judged by itself;
    see `rtamt.Specification.requirements`. A specification alone names them by its text. In a
    mapping a specification with a single requirement gives it the name of its key, ``"safe"``; one
    with several adds their names: ``"safe.near"``, ``"safe.slow"``.

    Raises:
        SpecificationError: If a specification is wrong; a note names it if there are several.
        InputError: If there is no specification, two requirements have the same name, a text is
            nearly a name in ``own``, or none names one of the constants.
        InputTypeError: If one is neither text, nor a path, nor a ``Specification``, or the
            constants are no mapping.
    """
    values = checked_constants(constants)
    loaded = _load_all(specs, own, values)
    for name in values:
        if all(name not in spec.given for spec in loaded.values()):
            raise no_such_constant(name, loaded)
    return loaded


def _load_all(
    specs: SpecsLike,
    own: Mapping[str, rtamt.Specification],
    constants: Mapping[str, ConstantValue],
) -> dict[str, rtamt.Specification]:
    if not isinstance(specs, Mapping):
        found = requirement_named(specs, own)
        if isinstance(specs, str) and found:
            return {specs: _load(found, constants)}
        return dict(_load(specs, constants).requirements)
    if not specs:
        raise InputError("expected at least one specification, got an empty mapping")
    loaded: dict[str, rtamt.Specification] = {}
    for name, spec in specs.items():
        try:
            found = requirement_named(spec, own)
            requirements = _load(spec if found is None else found, constants).requirements
        except RtamtError as error:
            error.add_note(f"in specification {name!r}")
            raise
        for part, requirement in requirements.items():
            whole = name if len(requirements) == 1 else f"{name}.{part}"
            if whole in loaded:
                raise InputError(f"expected one specification {whole!r}, got two; rename one")
            loaded[whole] = requirement
    return loaded


def recordable(specs: SpecsLike) -> str | dict[str, str]:
    """The specifications as ``EnvSpec.to_json`` can write them."""
    if isinstance(specs, Mapping):
        return {name: _text(spec) for name, spec in specs.items()}
    return _text(specs)


def autoreset_mode(env: VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """Reads when a vector environment resets an environment whose episode has ended.

    Raises:
        InputError: If its metadata has something else than a mode.
    """
    mode, inner = env.metadata.get("autoreset_mode"), env.unwrapped
    if isinstance(inner, SyncVectorEnv | AsyncVectorEnv) and env.metadata is inner.metadata:
        # Before 1.4, vector environments of one class share their metadata.
        mode = mode and inner.autoreset_mode
    if isinstance(mode, AutoresetMode):
        return mode
    if mode is not None:
        raise InputError(
            f"expected an AutoresetMode as metadata['autoreset_mode'] of {env}, got {mode!r}"
        )
    # As Gymnasium's own wrappers do.
    logger.warn(
        f"{env} has no metadata['autoreset_mode']; VectorStlMonitor takes it for "
        "AutoresetMode.NEXT_STEP"
    )
    return AutoresetMode.NEXT_STEP


def checked_mask(mask: Any, num: int) -> NDArray[np.bool_]:  # noqa: ANN401 - whatever is given
    """Refuses an ``options["reset_mask"]`` that is not what Gymnasium asks for."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise InputTypeError(
            f"expected options['reset_mask'] as an array of booleans, got {mask!r}"
        )
    if mask.shape != (num,) or not mask.any():
        raise InputError(
            f"expected options['reset_mask'] of shape ({num},), true for one environment or more, "
            f"got {mask!r}"
        )
    return mask


def check_period(
    specs: Mapping[str, rtamt.Specification],
    period: rtamt.Period | None,
    system: object,
    why: str = "",
) -> None:
    """Checks that there is a period if a specification has a bound.

    Raises:
        SpecificationError: If there is none; names ``system``, which should have one, and why.
    """
    timed = next((name for name, spec in specs.items() if spec.timed), None)
    if period is None and timed is not None:
        raise SpecificationError(
            f"specification {timed!r} has bounds in time, but {system} does not say how long a "
            f"step lasts{why and f': {why}'}; give ",
            Argument("period"),
            " in seconds, or ",
            Argument("period", 1),
            " to count steps",
        )


def _load(spec: SpecLike, constants: Mapping[str, ConstantValue]) -> rtamt.Specification:
    match spec:
        case rtamt.Specification():
            mine = {name: value for name, value in constants.items() if name in spec.constants}
            return rtamt.SpecificationTemplate(spec).at(mine) if mine else spec
        case rtamt.Formula():
            return rtamt.Specification.of(spec)
        case os.PathLike():
            return load_file(Path(spec), constants)
        case str() if spec.endswith(".stl") and len(spec.split()) == 1:
            return load_file(Path(spec), constants)
        case str():
            return rtamt.parse(spec, constants=named_in(spec, constants))
    several = '; name several in a mapping, {"safe": "...", "slow": "..."}'
    raise InputTypeError(
        "expected the text of a specification, the path of a .stl file or an "
        f"rtamt.Specification, got {spec!r}{several if isinstance(spec, list | tuple) else ''}"
    )


def _text(spec: SpecLike) -> str:
    return os.fspath(spec) if isinstance(spec, os.PathLike) else str(spec)
