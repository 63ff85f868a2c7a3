"""`MutationScore`: the share of mutants of a requirement that a suite of traces kills.

The mutation score is the share of killed mutants among all mutants that differ from the original
(DeMillo, Lipton and Sayward, "Hints on test data selection", Computer 1978).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

from rtamt_gym.results.codec import plain, read_fields
from rtamt_gym.tables import counted, shorten, table, wrapped

MutantSays = Literal["noticed", "missed", "same", "unknown"]
"""The status of a mutant: a trace kills it; it survived, and a trace that would kill it is known;
it is proved to be the same requirement; or it survived, and no trace that kills it is known."""

_WIDTH: Final = 80
"""The columns of a table."""


@dataclass(frozen=True, slots=True)
class JudgedMutant:
    """A mutant of a requirement with its status."""

    kind: str
    line: int
    column: int
    before: str
    after: str
    formula: str
    says: MutantSays
    noticed_by: str = ""
    samples: int = 0  # no trace of up to this many samples kills an unknown one; 0 if unknown
    why: str = ""
    apart: Mapping[str, tuple[float, ...]] | None = None  # a trace that would kill it
    satisfies: Literal["", "requirement", "mutant"] = ""

    sparse: ClassVar = True  # JSON leaves out defaults

    @property
    def change(self) -> str:
        """The change, such as ``[0:5] -> [0:50]``."""
        return f"{self.before} -> {self.after or 'nothing'}"

    @property
    def place(self) -> str:
        """Line and column, such as ``1:8``."""
        return f"{self.line}:{self.column}"

    @property
    def remark(self) -> str:
        """A remark on the mutant in addition to the change."""
        if self.says != "unknown":
            return ""
        if self.samples:
            return f"the same up to {counted(self.samples, 'sample')}"
        return "unknown whether it differs"


@dataclass(frozen=True, slots=True)
class MutationScore:
    """The mutants of a requirement under a suite of traces."""

    mutants: tuple[JudgedMutant, ...]
    capped: bool = False
    left_out: int = 0

    def count(self, says: MutantSays) -> int:
        """Return the number of mutants with a status."""
        return sum(mutant.says == says for mutant in self.mutants)

    @property
    def made(self) -> int:
        """The number of judged mutants."""
        return len(self.mutants)

    @property
    def different(self) -> int:
        """The number of mutants that are not proved to be the same requirement."""
        return self.made - self.count("same")

    @property
    def share(self) -> float | None:
        """The share of killed mutants among the different ones; None without any."""
        return self.count("noticed") / self.different if self.different else None

    def written(self) -> dict[str, Any]:
        """Return the score as JSON holds it."""
        counts = {says: self.count(says) for says in ("noticed", "missed", "same", "unknown")}
        return {
            "made": self.made,
            **counts,
            "share": self.share,
            "capped": self.capped,
            "left_out": self.left_out,
            "list": plain(self.mutants),
        }

    @classmethod
    def read(cls, stored: Mapping[str, Any]) -> MutationScore:
        """Read the output of `written`."""
        mutants = tuple(read_fields(JudgedMutant, item) for item in stored["list"])
        return cls(mutants, stored["capped"], stored.get("left_out", 0))


def percent(share: float | None) -> str:
    """Return a share in per cent, rounded down; a dash for None.

    Example:
        >>> percent(0.999), percent(1.0), percent(None)
        ('99 %', '100 %', '-')
    """
    return "-" if share is None else f"{int(100 * share)} %"


def below(scores: Mapping[str, MutationScore], min_share: float | None) -> list[str]:
    """Return the requirements with fewer killed mutants than required."""
    shares = {name: score.share for name, score in scores.items()}
    least = 0.0 if min_share is None else min_share
    return [name for name, share in shares.items() if share is not None and share < least]


def score_text(name: str, score: MutationScore) -> str:
    """Return the number of killed mutants of a requirement, in words."""
    text = f"{name}: {score.count('noticed')} of {counted(score.different, 'mutant')} killed"
    unknown = score.count("unknown")
    return f"{text}; {unknown} unknown" if unknown else text


def score_lines(scores: Mapping[str, MutationScore], traces: int) -> Iterator[str]:
    """Return a table with a row for each requirement, and the mutants that survived."""
    rows = [["mutants", "total", "killed", "survived", "unknown", "same", "share"]]
    for name, score in scores.items():
        counts = (score.count(item) for item in ("noticed", "missed", "unknown", "same"))
        numbers = [str(score.made), *map(str, counts), percent(score.share)]
        rows.append([shorten(name, 30), *numbers])
    yield from table(rows, "<" + ">" * 6)
    for name, score in scores.items():
        missed = [mutant for mutant in score.mutants if mutant.says in ("missed", "unknown")]
        same = [mutant for mutant in score.mutants if mutant.says == "same"]
        of = f"survived all {traces} traces" if traces > 1 else "survived the trace"
        for head, part in ((f"{name}: {of}", missed), (f"{name}: the same, left out", same)):
            if part:
                yield from ("", head)
                others = max(len(m.place) + len(_kind(m)) for m in part) + 6
                cells = [[m.place, shorten(m.change, _WIDTH - others), _kind(m)] for m in part]
                _, *lines = table([[""] * 3, *cells], "<<<")  # without names of columns
                yield from (f"  {line}".rstrip() for line in lines)
    for name, score in scores.items():
        if score.left_out:
            look, them = ("looks", "it") if score.left_out == 1 else ("look", "them")
            yield ""
            yield from wrapped(
                f"{name}: {counted(score.left_out, 'mutant')} left out, which {look} at the first "
                f"sample only; --view step evaluates {them} at each"
            )
        if score.capped:
            yield ""
            yield from wrapped(
                f"{name}: the first {score.made} mutants, of each kind in turn; --max-mutants "
                "makes more"
            )


def _kind(mutant: JudgedMutant) -> str:
    return f"{mutant.kind}, {mutant.remark}" if mutant.remark else mutant.kind
