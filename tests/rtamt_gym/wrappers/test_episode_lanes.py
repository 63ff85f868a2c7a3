"""What `VectorStlMonitor` says of every environment is what `StlMonitor` says of it alone."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
import pytest
from episode_oracle import Flags, chargeable, mismatch
from gymnasium.vector import AutoresetMode
from hypothesis import assume, given, settings
from numpy.typing import NDArray
from profiles import examples
from scripts import Case, Scripted, cases, variables
from vector_environments import MODES, Envs, difference, sync

from rtamt_gym import StlMonitor, VectorStlMonitor

LANES = 3
STEPS = 18
RUNNING = (False, False)
modes = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
some_cases = cases((None, "violation", "depth", "latched", "first"), LANES)
pytestmark = [
    pytest.mark.filterwarnings(f"ignore:.*{word}:UserWarning")
    for word in ("at_termination", "is_success")
]


def arguments(case: Case, mode: AutoresetMode) -> dict[str, Any]:
    """Those of all wrappers; episodes are ended early only where the caller resets."""
    options = {**vars(case.options), "signals": variables(case.specs), "period": 1}
    return options if mode is AutoresetMode.DISABLED else {**options, "on_violation": "report"}


class Row(NamedTuple):
    """A reset of some or a step of all: the infos, and how episodes ended."""

    resets: NDArray[np.bool_] | None
    flags: list[Flags]
    infos: dict[str, Any]


def lead(envs: Envs) -> list[Row]:
    """A reset and steps; with `DISABLED` the ended are reset, and now and then one that runs."""
    shown = [Row(np.ones(LANES, np.bool_), [RUNNING] * LANES, envs.reset()[1])]
    for step in range(STEPS):
        *_, terminated, truncated, infos = envs.step(np.zeros(LANES, np.int64))
        flags = list(zip(terminated.tolist(), truncated.tolist(), strict=True))
        shown.append(Row(None, flags, infos))
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            mask = np.logical_or(terminated, truncated)
            mask[step % LANES] |= step % 7 == 3
            if mask.any():
                reset = envs.reset(options={"reset_mask": mask.copy()})
                shown.append(Row(mask, [RUNNING] * LANES, reset[1]))
    return shown


def follow(env: StlMonitor[Any, Any], shown: list[Row], lane: int, mode: AutoresetMode) -> None:
    """Leads one environment as it was led among the others, and compares what it says."""
    ended = False
    for row in shown:
        infos = row.infos
        if row.resets is not None and not row.resets[lane]:
            assert of_lane(infos, lane) == {}
            continue
        if row.resets is not None or (ended and mode is AutoresetMode.NEXT_STEP):
            expected, flags = env.reset()[1], RUNNING
        else:
            *_, terminated, truncated, expected = env.step(0)
            flags = terminated, truncated
        ended = any(flags)
        assert row.flags[lane] == flags
        if mode is AutoresetMode.SAME_STEP:
            final = of_lane(infos.get("final_info", {}), lane)
            assert mismatch(expected if ended else {}, final) == ""
            expected = env.reset()[1] if ended else expected
        assert mismatch(expected, of_lane(infos, lane)) == ""


def of_lane(infos: dict[str, Any], lane: int) -> dict[str, Any]:
    """The info of one environment, as it would be alone, but for what is final."""
    found: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_") or key in ("final_info", "final_obs") or not infos[f"_{key}"][lane]:
            continue
        if isinstance(value, dict):
            found[key] = of_lane(value, lane)
        else:
            assert value.dtype in (np.float64, np.bool_, np.int64, object)
            found[key] = value[lane] if value.dtype == np.float64 else value.item(lane)
    return found


@pytest.mark.slow(keep=1)
@modes
@given(some_cases)
def test_infos_ends_and_records_of_every_lane_are_those_of_one_environment(
    mode: AutoresetMode, case: Case
) -> None:
    assume(case.options.cost not in ("violation", "depth") or costs(case))
    makes = [functools.partial(Scripted, scripts) for scripts in case.lanes]
    options = arguments(case, mode)
    envs = VectorStlMonitor(sync(makes, mode), case.specs, **options)
    shown = lead(envs)
    envs.close()
    for lane, make in enumerate(makes):
        env = StlMonitor(make(), case.specs, **options)
        follow(env, shown, lane, mode)
        env.close()
        records = [record for record in envs.stl_episodes if record.pop("env") == lane]
        assert mismatch(list(env.stl_episodes), records) == ""


def costs(case: Case) -> bool:
    return chargeable(case.specs, case.options.view)


@pytest.mark.slow(keep=1)
@modes
@given(some_cases)
@settings(max_examples=examples(40))
def test_one_wrapper_around_all_gives_the_infos_of_a_wrapper_around_each(
    mode: AutoresetMode, case: Case
) -> None:
    assume(case.options.cost not in ("violation", "depth") or costs(case))
    options = arguments(case, mode) | {"on_violation": "report"}
    bare = [functools.partial(Scripted, scripts) for scripts in case.lanes]
    each = [
        functools.partial(lambda make: StlMonitor(make(), case.specs, **options), make)
        for make in bare
    ]
    together = lead(VectorStlMonitor(sync(bare, mode), case.specs, **options))
    singly = lead(sync(each, mode))
    assert difference([row.infos for row in together], [row.infos for row in singly]) == ""
    assert [row.flags for row in together] == [row.flags for row in singly]
