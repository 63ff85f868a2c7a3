"""Samples from a program that runs the loop of ``mj_step`` itself, by ``mjcb_control``.

MuJoCo calls ``mjcb_control`` where a controller sets its forces: once in a step, but four times
with the integrator RK4. The first call sees the state that the step starts from, the others see
states that are only tried, at the half of the step and at its end. Their times tell them apart.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import mujoco  # type: ignore[import-untyped]

from rtamt import StateError

__all__ = ["Attached", "Offer"]

Offer = Callable[[], None]
"""Takes the simulation as it is now as a sample, or leaves it."""


class Attached:
    """A context in which ``mjcb_control`` offers the states of a simulation.

    There is one callback in a process: one that was set before is called first, and is set again at
    the end. An exception of ``offer`` does not pass through MuJoCo: the first one ends the offers,
    and is raised at the end of the context.

    Args:
        data: The simulation; others are ignored.
        offer: Called for the states of the simulation, those that are only tried included.
        last: Called at the end, after the last step.
    """

    def __init__(self, data: Any, offer: Offer, last: Offer) -> None:  # noqa: ANN401
        self._data = data
        self._offer = offer
        self._last = last
        self._before: Any = None
        self._error: Exception | None = None

    def __enter__(self) -> Self:
        self._before = mujoco.get_mjcb_control()
        if self._before is not None and not callable(self._before):
            raise StateError(
                f"expected a Python function or nothing as mjcb_control, got {self._before!r}; "
                "mujoco.set_mjcb_control(None) takes it away"
            )
        self._error = None
        mujoco.set_mjcb_control(self._control)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        replaced = mujoco.get_mjcb_control() != self._control
        if not replaced:
            mujoco.set_mjcb_control(self._before)
        if error is not None:  # the program's own error comes first
            return
        if self._error is not None:
            raise self._error
        if replaced:
            raise StateError(
                "expected mjcb_control as it was attached, but the program has set another: no "
                "samples came since; set the controller before, it is called too"
            )
        self._last()

    def _control(self, model: Any, data: Any) -> None:  # noqa: ANN401
        if self._before is not None:
            self._before(model, data)
        if data is self._data and self._error is None:
            try:
                self._offer()
            except Exception as error:  # noqa: BLE001 - raised at the end of the context
                self._error = error
