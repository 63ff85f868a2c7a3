"""The published contracts hold for this package, and detect violations."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtamt_gym.recorded import readers
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import Format
from rtamt_gym.search.falsification.optimizers import OPTIMIZERS
from rtamt_gym.search.falsification.search import SearchOver
from rtamt_gym.systems.adapters import SampleSource
from rtamt_gym.systems.system import System
from rtamt_gym.testing import check_optimizer, check_system, check_trace_format


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_every_optimizer_keeps_the_contract(optimizer: str) -> None:
    check_optimizer(optimizer, budget=60)


def outside(evaluate: Any, dimension: int, rng: np.random.Generator) -> None:  # noqa: ANN401
    while True:
        evaluate(rng.normal(size=(4, dimension)))


def flat(evaluate: Any, dimension: int, rng: np.random.Generator) -> None:  # noqa: ANN401
    while True:
        evaluate(rng.random(dimension))


def careless(evaluate: Any, dimension: int, _rng: np.random.Generator) -> None:  # noqa: ANN401
    while True:
        evaluate(np.random.random((4, dimension)))  # noqa: NPY002 - the mistake


def endless(evaluate: Any, dimension: int, rng: np.random.Generator) -> None:  # noqa: ANN401
    try:
        while True:
            evaluate(rng.random((4, dimension)))
    except SearchOver:
        return


def deaf(evaluate: Any, dimension: int, rng: np.random.Generator) -> None:  # noqa: ANN401
    for _ in range(1000):
        with suppress(BaseException):
            evaluate(rng.random((4, dimension)))


def idle(_evaluate: Any, _dimension: int, _rng: np.random.Generator) -> None:  # noqa: ANN401
    return


@pytest.mark.parametrize(
    ("optimizer", "word"),
    [
        (outside, "unit cube"),
        (flat, "shape"),
        (careless, "same seed"),
        (endless, "swallowed"),
        (deaf, "swallowed"),
        (idle, "got none"),
    ],
)
def test_contract_catches_optimizers(optimizer: Any, word: str) -> None:  # noqa: ANN401
    with pytest.raises(AssertionError, match=word):
        check_optimizer(optimizer, budget=20)


SAMPLES = [{"x": 0.0, "y": 2.0}, {"x": 1.0, "y": 3.0}]


def test_own_systems_keep_the_contract() -> None:
    check_system(lambda: SampleSource(SAMPLES), ["x", "y"])
    check_system(
        lambda: SampleSource(lambda t: {"x": t, "y": -t}), ["x", "y"], period=Fraction(1, 8)
    )


class Counter(System):
    """Two numbers that grow with the steps."""

    name = "counter"
    period = 0.5
    limit = 4

    def bind(self, variables: Sequence[str], signals: Any, period: Fraction | None) -> None:  # noqa: ANN401
        assert not signals
        assert period == Fraction(1, 2)
        if unknown := [name for name in variables if name not in ("n", "double")]:
            from rtamt import InputError

            raise InputError(f"counter has no {unknown[0]!r}")
        self.read = list(variables)

    def start(self) -> Sequence[float]:
        self.n, self.ended = 0, ""
        return self.sample()

    def sample(self) -> list[float]:
        return [{"n": self.n, "double": 2 * self.n}[name] for name in self.read]

    def advance(self) -> Sequence[float] | None:
        if self.n == self.limit:
            self.ended = "truncated"
            return None
        self.n += 1
        return self.sample()

    def close(self) -> None:
        """Close nothing."""


class GoesOn(Counter):
    def start(self) -> Sequence[float]:
        self.n, self.ended = getattr(self, "n", 0), ""
        return self.sample()


class OwnOrder(Counter):
    def sample(self) -> list[float]:
        return [float(self.n), 2.0 * self.n]


class SilentEnd(Counter):
    def advance(self) -> Sequence[float] | None:
        last = super().advance()
        self.ended = ""
        return last


class Takes(Counter):
    def bind(self, variables: Sequence[str], signals: Any, period: Fraction | None) -> None:  # noqa: ANN401
        known = [name if name in ("n", "double") else "n" for name in variables]
        super().bind(known, signals, period)


def test_a_system_of_ones_own_keeps_the_contract() -> None:
    check_system(Counter, ["n", "double"])


@pytest.mark.parametrize(
    ("system", "word"),
    [
        (GoesOn, "a second run after a run that was left early"),
        (OwnOrder, "order"),
        (SilentEnd, "ended"),
        (Takes, "that_is_not_there"),
    ],
)
def test_a_system_that_breaks_the_contract_is_caught(system: type[System], word: str) -> None:
    with pytest.raises(AssertionError, match=word):
        check_system(system, ["n", "double"])


@contextmanager
def _open(path: str, _columns: Columns) -> Iterator[ArrayRecording]:
    text = Path(path).read_bytes().decode("latin-1")
    from rtamt import InputError

    if not text.startswith("SSV\n"):
        raise InputError(f"{path}: expected a file that begins with SSV")
    head, *rows = (line.split(";") for line in text.splitlines()[1:])
    yield ArrayRecording(
        path, {name: np.array([float(row[i]) for row in rows]) for i, name in enumerate(head)}
    )


def write(path: Path, table: Any) -> None:  # noqa: ANN401
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    lines = [";".join(map(repr, row)) for row in rows]
    path.write_text("\n".join(["SSV", ";".join(table), *lines]))


def rounded(path: Path, table: Any) -> None:  # noqa: ANN401
    write(path, {name: np.round(column, 3) for name, column in table.items()})


def shuffled(path: Path, table: Any) -> None:  # noqa: ANN401
    write(path, {**table, "gear": table["gear"][::-1]})


def test_a_format_of_ones_own_keeps_the_contract(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = type("module", (), {"open_file": staticmethod(_open)})
    monkeypatch.setitem(sys.modules, "semicolons", module)
    row = Format("SSV", (".ssv",), "semicolons")
    monkeypatch.setattr(readers, "FORMATS", [*readers.FORMATS, row])
    check_trace_format(".ssv", write, tmp_path)
    for wrong, word in ((rounded, "speed"), (shuffled, "gear")):
        with pytest.raises(AssertionError, match=word):
            check_trace_format(".ssv", wrong, tmp_path)


def opened_by(kind: str) -> Any:  # noqa: ANN401
    """Return a reader of the format with a fault."""

    @contextmanager
    def opened(path: str, columns: Columns) -> Iterator[ArrayRecording]:
        if kind == "reads what is not there" and not Path(path).exists():
            yield ArrayRecording(path, {"time": np.arange(2.0), "speed": np.zeros(2)})
            return
        noise = Path(path).name.startswith("noise")
        if noise and kind == "raises another error":
            raise ValueError("bad magic")
        if noise and kind == "reads noise":
            yield ArrayRecording(path, {"time": np.arange(2.0), "speed": np.zeros(2)})
            return
        with _open(path, columns) as result:
            yield result

    return opened


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("reads what is not there", "expected OSError for a missing file of .ssv, got a trace"),
        ("raises another error", "expected InputError, got ValueError: bad magic"),
        ("reads noise", "expected InputError, got none"),
    ],
)
def test_a_reader_that_does_not_refuse_is_caught(
    kind: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = type("module", (), {"open_file": staticmethod(opened_by(kind))})
    monkeypatch.setitem(sys.modules, "semicolons", module)
    row = Format("SSV", (".ssv",), "semicolons")
    monkeypatch.setattr(readers, "FORMATS", [*readers.FORMATS, row])
    with pytest.raises(AssertionError) as caught:
        check_trace_format(".ssv", write, tmp_path)
    assert said in str(caught.value)
