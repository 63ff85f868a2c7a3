"""`evaluate_rollouts`: the robustness of trajectories of `mujoco.rollout`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import ArrayLike, NDArray

import rtamt
from rtamt import InputError
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.mujoco import bind_signal
from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import ParsedSignal, SignalLike, parse_signals
from rtamt_gym.signals.sources import MUJOCO

Floats = NDArray[np.float64]


@documents_options("samples")
def evaluate_rollouts(
    model: mujoco.MjModel,
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    states: ArrayLike,
    sensordata: ArrayLike | None = None,
    **reading: Unpack[EvaluationKeywords],
) -> dict[str, Floats]:
    """Return the robustness of many rollouts at every sample, offline.

    Samples are the states after each step, which ``mujoco.rollout`` returns; put the initial states
    before them to get the sample 0 of `StepMonitor`. Selectors are written as for `StepMonitor` and
    read a rollout: ``time``, ``qpos``, ``qvel``, ``act``, ``joint:hip.qpos`` and similar ones from
    the states, ``sensordata`` and ``sensor:imu[0]`` from the sensors, which are one step late. For
    anything else add a sensor to the model.

    Args:
        model: The model that was rolled out, or one with the same layout.
        specs: As for `StepMonitor`.
        signals: For every variable a selector.
        states: The states, shape (rollouts, steps, numbers of ``mjSTATE_FULLPHYSICS``).
        sensordata: The sensors, shape (rollouts, steps, sensor data); needed if a signal reads it.
        **reading: ``period`` (None is ``model.opt.timestep``), ``nan``, ``align``, ``semantics``,
            ``inputs`` and ``outputs``, as for `StepMonitor`.

    Returns:
        For each specification by name, its robustness at every sample, shape (rollouts, steps).

    Raises:
        SpecificationError: As `rtamt.evaluate` does.
        InputError: If a variable has no signal; if a selector does not fit the model or a rollout;
            on shapes that do not fit, on nan, and on a wrong option.

    Example:
        >>> import mujoco, mujoco.rollout, numpy as np
        >>> model = mujoco.MjModel.from_xml_string('''
        ...     <mujoco><worldbody><body><joint name="up" type="slide" axis="0 0 1"/>
        ...     <geom size=".1"/></body></worldbody></mujoco>''')
        >>> start = np.zeros((3, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        >>> start[:, 2] = [1.0, 2.0, 3.0]  # time, position, velocity
        >>> states, _ = mujoco.rollout.rollout(model, mujoco.MjData(model), start, nstep=200)
        >>> robustness = evaluate_rollouts(model, "always(z > 0)", {"z": "joint:up.qpos"}, states)
        >>> robustness["spec"].shape, robustness["spec"][:, 0].round(2).tolist()
        ((3, 200), [-0.39, 0.0, 0.01])
    """
    read = checked_options(reading, evaluate_rollouts, "samples")
    loaded = load_specs(specs)
    if read.period is None:
        read = read.having(period=float(model.opt.timestep))
    options = read.from_monitors(loaded)
    variables = [name for spec in loaded.values() for name in spec.variables]
    parsed = parse_signals(signals, variables, MUJOCO)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    columns = _table("states", states, size, "the model's mjSTATE_FULLPHYSICS has")
    if sensordata is not None:
        sensed = _table(
            "sensordata", sensordata, model.nsensordata, "the sensors of the model have"
        )
        if sensed.shape[:2] != columns.shape[:2]:
            raise InputError(
                f"expected as many rollouts and steps of sensordata as of states, got "
                f"{sensed.shape[:2]} and {columns.shape[:2]}"
            )
        columns = np.concatenate([columns, sensed], axis=2)
    data = {
        name: columns[:, :, position]
        for name, position in _indices(model, parsed, sensordata).items()
    }
    lengths = np.full(columns.shape[0], columns.shape[1])
    return {
        name: rtamt.evaluate(
            spec,
            data if spec.variables else columns[:, :, :0],
            lengths=lengths,
            **options[name],
        )
        for name, spec in loaded.items()
    }


def _indices(
    model: mujoco.MjModel, signals: tuple[ParsedSignal, ...], sensordata: ArrayLike | None
) -> dict[str, int]:
    """Return the index of every signal in a row of states and sensor data.

    Every number of a simulation is set to a unique value, which identifies what a selector reads.
    """
    data = mujoco.MjData(model)
    counts = [1, model.nq, model.nv, model.na, model.nsensordata]
    marks = np.random.default_rng(0).uniform(1.0, 2.0, sum(counts))
    data.time, *_ = marks
    _, data.qpos[:], data.qvel[:], data.act[:], data.sensordata[:] = np.split(
        marks, np.cumsum(counts)[:-1]
    )
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    row = [*state.tolist(), *data.sensordata.tolist()]
    places = {}
    for signal in signals:
        if not isinstance(signal.reads, Selector):
            raise InputError(
                f"signal {signal.name!r}: a function reads a running simulation, and a rollout is "
                "over; give a selector"
            )
        mark = bind_signal(signal, model, data)()
        if mark not in marks:
            raise InputError(
                f"signal {signal.name!r}: {signal} is neither in the states nor in the sensordata "
                "of a rollout; add a sensor to the model and read sensor:NAME[0]"
            )
        places[signal.name] = row.index(mark)
        if sensordata is None and places[signal.name] >= len(state):
            raise InputError(f"signal {signal.name!r}: {signal} needs sensordata=, got none")
    return places


def _table(name: str, values: ArrayLike, width: int, has: str) -> Floats:
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 3 or table.shape[2] != width:
        raise InputError(
            f"expected {name} of shape (rollouts, steps, {width}), as many numbers as {has}, got "
            f"shape {table.shape}"
        )
    return table
