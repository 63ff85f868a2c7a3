"""Ctrl-C while an FMU runs."""

from __future__ import annotations

import sys

__all__ = ["Interrupts"]


class Interrupts:
    """Keeps a ``KeyboardInterrupt`` that comes while an FMU hands over a message.

    Python raises it in the function that takes the message, from where ctypes cannot pass it on
    through the FMU: it would tell `sys.unraisablehook` and forget it, and the simulation would go
    on.
    """

    def __init__(self) -> None:
        self._came = self._hears = False

    def begin(self) -> None:
        """Begins to listen."""
        self._came, self._hears = False, True
        self._before = sys.unraisablehook
        sys.unraisablehook = self._hear

    def end(self) -> None:
        """Listens no more, if it did."""
        if self._hears:
            self._hears = False
            sys.unraisablehook = self._before

    def check(self) -> None:
        """Raises the ``KeyboardInterrupt`` that came since the last check, if one did."""
        if self._came:
            self._came = False
            raise KeyboardInterrupt

    def _hear(self, unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._came = True
        else:
            self._before(unraisable)
