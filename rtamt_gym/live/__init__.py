"""A live view in Rerun: signals, robustness with bounds, verdicts and pictures of runs."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView as RerunView

    __all__ = ["RerunView"]

__all__ = ["RerunView"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the name is imported when it is used
    if name == "RerunView":
        return import_module("rtamt_gym.live.view").RerunView
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
