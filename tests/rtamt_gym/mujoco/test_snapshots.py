"""Simulation and monitors continue from snapshots as before, bit by bit."""

import pickle
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from mujoco_models import BOXES, BOXES_SIGNALS, BOXES_SPECS

from rtamt import InputError
from rtamt_gym import StepMonitor
from rtamt_gym.options.evaluation import View
from rtamt_gym.results import Snapshot


def monitored(integrator: str, view: View = "episode", *, forward: bool = False) -> StepMonitor:
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator=integrator))
    data = mujoco.MjData(model)
    return StepMonitor(model, data, BOXES_SPECS, BOXES_SIGNALS, view=view, forward=forward)


def played(monitor: StepMonitor, controls: np.ndarray[Any, Any]) -> list[Any]:
    """Return all results of a run."""
    shown = []
    for control in controls:
        monitor.data.ctrl[0] = control
        monitor.step()
        shown.append(
            (
                monitor.data.qpos.tolist(),
                monitor.data.qacc.tolist(),
                monitor.data.sensordata.tolist(),
                monitor.values,
                monitor.details,
                monitor.outcomes,
                (monitor.samples, monitor.violated_by, monitor.violated_at),
            )
        )
    return shown


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
@pytest.mark.parametrize("view", ["episode", "step"])
@pytest.mark.parametrize("forward", [False, True])
def test_every_branch_of_a_snapshot_goes_on_as_if_it_were_the_only_one(
    integrator: str,
    view: View,
    forward: bool,  # noqa: FBT001
) -> None:
    rng = np.random.default_rng(0)
    begin, *branches = rng.uniform(0.0, 1.0, (5, 60))
    alone = []
    for controls in branches:
        monitor = monitored(integrator, view, forward=forward)
        played(monitor, begin)
        alone.append(played(monitor, controls))
    monitor = monitored(integrator, view, forward=forward)
    played(monitor, begin)
    snapshot = Snapshot.of(monitor)
    for i in (0, 1, 2, 3, 1, 0):
        snapshot.restore(monitor)
        assert played(monitor, branches[i]) == alone[i]


def test_the_warm_start_is_part_of_a_snapshot() -> None:
    monitor = monitored("Euler")
    played(monitor, np.ones(60))
    snapshot = Snapshot.of(monitor)
    expected = played(monitor, np.ones(40))
    snapshot.restore(monitor)
    monitor.data.qacc_warmstart[:] = 0.0
    assert played(monitor, np.ones(40)) != expected


def test_a_snapshot_is_restored_in_another_monitor_and_after_a_pickle() -> None:
    monitor, other = monitored("RK4"), monitored("RK4")
    played(monitor, np.ones(50))
    snapshot = pickle.loads(pickle.dumps(Snapshot.of(monitor)))
    expected = played(monitor, np.ones(50))
    snapshot.restore(other)
    assert played(other, np.ones(50)) == expected


def test_a_finished_run_is_taken_back_to_where_it_still_ran() -> None:
    monitor = monitored("Euler")
    played(monitor, np.ones(20))
    snapshot = Snapshot.of(monitor)
    expected = played(monitor, np.ones(5))
    monitor.finish()
    snapshot.restore(monitor)
    assert played(monitor, np.ones(5)) == expected


def test_what_is_derived_is_there_at_once_where_the_monitor_derives_it() -> None:
    monitor = monitored("Euler", forward=True)
    played(monitor, np.ones(30))
    snapshot, values = Snapshot.of(monitor), monitor.values
    played(monitor, np.ones(30))
    assert monitor.values != values
    snapshot.restore(monitor)
    assert monitor.values == values


def test_a_snapshot_of_other_specifications_is_refused_and_changes_nothing() -> None:
    monitor = monitored("Euler")
    played(monitor, np.ones(20))
    snapshot = Snapshot.of(monitor)
    model, data = monitor.model, mujoco.MjData(monitor.model)
    other = StepMonitor(model, data, {"a": "always(x < 9)", "b": "always(x < 8)"}, {"x": "qpos[0]"})
    other.reset()
    other.step()
    time, state = data.time, other.details
    with pytest.raises(InputError, match="expected a state of the specifications "):
        snapshot.restore(other)
    assert (data.time, other.details, other.samples) == (time, state, 2)
    other.step()


def test_a_snapshot_tells_its_size() -> None:
    assert repr(Snapshot.of(monitored("Euler"))) == "<Snapshot with 81 numbers of state>"
