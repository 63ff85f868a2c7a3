"""Rendered pictures of environments."""

from __future__ import annotations

from typing import Any

from rtamt import InputError


def check_pictures(env: Any, name: str, *, lists: bool = True) -> None:
    """Raise an `InputError` if an environment renders no pictures.

    Args:
        env: The environment.
        name: The name of the wrapper that needs them, for the message.
        lists: Whether lists of pictures are allowed.
    """
    if env.render_mode != "rgb_array" and not (lists and env.render_mode == "rgb_array_list"):
        raise InputError(
            f"{name} needs pictures, got render_mode={env.render_mode!r} of {env}; make it with "
            'gym.make(..., render_mode="rgb_array")'
        )
