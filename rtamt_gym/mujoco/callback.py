"""Samples from a program that runs the loop of ``mj_step`` itself, by ``mjcb_control``.

MuJoCo calls ``mjcb_control`` where a controller sets its forces: once in a step, but four times
with the integrator RK4. The first call sees the state that the step starts from, the others see
states that are only tried, at the half of the step and at its end, as their times show.
"""

from __future__ import annotations

import ctypes
from _ctypes import CFuncPtr  # the class of all functions of ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco  # type: ignore[import-untyped]

from rtamt import StateError


@contextmanager
def attached(data: Any, offer: Callable[[], None], last: Callable[[], None]) -> Iterator[None]:
    """Call ``offer`` for states of a simulation in this context, by ``mjcb_control``.

    There is one callback in a process: one that was set before is called first, and is set again at
    the end. An exception of ``offer`` does not pass through MuJoCo: the first one ends the offers,
    and is raised at the end of the context.

    Args:
        data: The simulation; others are ignored.
        offer: Called for the states of the simulation, including states that are only tried.
        last: Called at the end, after the last step.
    """
    before = mujoco.get_mjcb_control()
    controller = _called_from_python(before)
    failed: Exception | None = None

    def control(model: Any, stepped: Any) -> None:
        nonlocal failed
        if controller is not None:
            controller(model, stepped)
        if stepped is data and failed is None:
            try:
                offer()
            except Exception as error:  # noqa: BLE001 - raised at the end of the context
                failed = error

    mujoco.set_mjcb_control(control)
    try:
        yield  # an error of the program's own passes through here, and comes first
    finally:
        replaced = mujoco.get_mjcb_control() is not control
        if not replaced:
            mujoco.set_mjcb_control(before)
    if failed is not None:
        raise failed
    if replaced:
        raise StateError(
            "expected mjcb_control as it was attached, but the program has set another: no "
            "samples came since; set the controller before, it is called too"
        )
    last()


def _called_from_python(controller: Any) -> Any:
    """Return a function that calls a controller with model and data; None if there is none."""
    if not isinstance(controller, CFuncPtr):
        return controller
    # MuJoCo passes pointers, whatever argument types the controller declares; Numba makes functions
    # of ctypes too.
    pointed = ctypes.cast(controller, ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p))
    return lambda model, data: pointed(model._address, data._address)  # noqa: SLF001
