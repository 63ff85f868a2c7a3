"""Online monitoring of Signal Temporal Logic."""

from typing import Final, Literal

try:
    import rtamt._native
except ModuleNotFoundError:  # a module that is there but does not load is a broken build: raise
    _backend: Literal["native", "python"] = "python"
else:
    _backend = "native"

BACKEND: Final = _backend
"""``"native"`` where the C++ machines are built, ``"python"`` where no compiler was at hand."""

__version__ = "0.5.0"

__all__ = ["BACKEND", "__version__"]
