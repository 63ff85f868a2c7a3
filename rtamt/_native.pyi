"""The machines in C++; the definition that they are tested against is rtamt.discrete."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs import SampleReader

FUNCTIONS: dict[str, int]
"""Names and arities of the functions of MAP."""

MONOIDS: dict[str, int]
"""Names of the monoids of WINDOW, and the numbers in an element."""

KINDS: tuple[str, ...]
"""Names of the kinds of instructions."""

class Machine:
    """Runs a program on samples, as rtamt.discrete.Machine does.

    Args:
        rows: The program, as rtamt.schedule.encoded writes it.
        terms: How many instructions, from the first, are arithmetic over the present sample.
        variables: Names of the inputs.
        result: Register of what ``update`` gives.
        observed: Registers and their latencies: of the result, and of what ``run`` gives.
        reader: Reads the arguments that are not read at once; makes all messages.
    """

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
    def state(self) -> bytes:
        """Values one behind the other, with a mark of the program."""

    def restore(self, state: bytes) -> None:
        """Continue from where ``state`` was taken.

        Raises:
            ValueError: If it was taken from a machine with another program (then nothing changes),
                or was damaged (then the machine is reset).
        """
