# The machines in C++; the definition that they are tested against is rtamt.discrete.

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs import SampleReader

FUNCTIONS: dict[str, int]  # names and arities of the functions of MAP
MONOIDS: dict[str, int]  # names of the monoids of WINDOW, and the numbers in an element
KINDS: tuple[str, ...]  # names of the kinds of instructions

class Machine:
    def __init__(
        self,
        rows: Sequence[tuple[object, ...]],
        terms: int,
        variables: tuple[str, ...],
        result: int,
        observed: Sequence[tuple[int, int]],
        reader: SampleReader,
    ) -> None: ...
    @property
    def samples(self) -> int: ...
    @property
    def registers(self) -> list[float]: ...
    @property
    def inputs(self) -> list[float]: ...
    def update(self, *args: object, **named: object) -> float: ...
    def run(
        self, columns: Sequence[ArrayLike], n: int, *, final: bool
    ) -> list[NDArray[np.float64]]: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...
