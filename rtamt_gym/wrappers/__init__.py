"""Wrappers of Gymnasium environments, and their helpers."""

from typing import TYPE_CHECKING

from rtamt_gym.checks.extras import lazy_names

if TYPE_CHECKING:
    from rtamt_gym.signals.signals import batched
    from rtamt_gym.wrappers.vector_forms import SharedBuffers, as_vector_env

__all__ = ["SharedBuffers", "as_vector_env", "batched"]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "SharedBuffers": "rtamt_gym.wrappers.vector_forms.SharedBuffers",
            "as_vector_env": "rtamt_gym.wrappers.vector_forms.as_vector_env",
            "batched": "rtamt_gym.signals.signals.batched",
        },
    )
