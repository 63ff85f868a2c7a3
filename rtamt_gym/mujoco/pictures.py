"""Rendered pictures of a MuJoCo simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco  # type: ignore[import-untyped]

_WIDTH, _HEIGHT = 480, 360


def renderer(model: Any, data: Any) -> Callable[[], Any]:
    """Return a function that renders the simulation now, as an array of shape (height, width, 3).

    Args:
        model: A ``mujoco.MjModel``.
        data: A ``mujoco.MjData`` of the model.
    """
    size = model.vis.global_
    scene = mujoco.Renderer(
        model, height=min(_HEIGHT, size.offheight), width=min(_WIDTH, size.offwidth)
    )

    def render() -> Any:
        scene.update_scene(data)
        return scene.render()

    return render
