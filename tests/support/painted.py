"""An environment whose frames show the number of their sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from replay import Replay

Picture = NDArray[np.uint8]


class Painted(Replay):
    """A `Replay` whose frames have the number of their sample as the colour.

    Args:
        values: The numbers.
        end: How the episode ends.
        render_mode: The render mode of Gymnasium.
        size: Height and width of the frames.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012 - as Gymnasium's

    def __init__(
        self,
        values: Sequence[float],
        end: str = "terminated",
        render_mode: str | None = "rgb_array",
        size: tuple[int, int] = (40, 320),
    ) -> None:
        super().__init__(values, end)
        self.render_mode = render_mode
        self.size = size

    def render(self) -> Any:  # noqa: ANN401 - as Gymnasium has it
        return np.full((*self.size, 3), self.at, np.uint8)


def numbers(frames: Sequence[Picture]) -> list[int]:
    """Return the numbers of the samples that frames show."""
    return [int(frame[0, 0, 0]) for frame in frames]
