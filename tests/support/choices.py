"""The back-ends and the end modes that tests run with."""

from typing import Literal, get_args

from rtamt.typing import End

Backend = Literal["native", "python"]

ENDS: tuple[End, ...] = get_args(End)
