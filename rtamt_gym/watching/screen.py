"""A view in the terminal of a stream, or of a simulation while it runs."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from time import monotonic, sleep
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self, Unpack

from rich.cells import cell_len, set_cell_size
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rtamt import InputError, Verdict
from rtamt.errors import shown
from rtamt_gym.results.outcome import Moment
from rtamt_gym.tables import counted, short
from rtamt_gym.watching.lines import Line

if TYPE_CHECKING:
    from rtamt_gym.judging.monitor_set import MonitorSetResult
    from rtamt_gym.judging.specs import SpecsLike
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.options.evaluation import EvaluationKeywords
    from rtamt_gym.play.history import Stop
    from rtamt_gym.play.run import Run
    from rtamt_gym.play.simulation import Simulation
    from rtamt_gym.signals.signals import SignalLike
    from rtamt_gym.systems.system import Policy

_POINTS: Final = 240
"""The most points of a course; beyond, neighbours become one."""

_ROWS: Final = 20
"""The most rows; the worst are shown."""

_MANY: Final = 100
"""Rows from which on only pictures read the newest lines."""

_REFRESH: Final = 0.1
"""Seconds between two pictures."""

_BARS: Final = "▁▂▃▄▅▆▇█"
_PLAIN_BARS: Final = ".:-=+*%#"
_BELOW: Final = "xX"
"""The marks of a negative robustness and of a deep one, which are seen without colours."""

_WIDE: Final = 100
"""The columns of a terminal that has room for the times of decisions."""

_SHORT: Final = 6
"""The fewest columns of a name that is cut for numbers."""

_STYLES: Final[Mapping[Verdict, str]] = {
    Verdict.VIOLATED: "bold red",
    Verdict.UNDECIDED: "yellow",
    Verdict.SATISFIED: "green",
}

Key = tuple[str | None, str]


class Course:
    """The robustness over a stream in few points, each the minimum of a part of it.

    Example:
        >>> course = Course(points=4)
        >>> for value in (3.0, 1.0, 2.0, -1.0, 5.0, 0.5):
        ...     course.add(value)
        >>> course.values
        [1.0, -1.0, 0.5]
        >>> course.bars(3), course.bars(3, plain=True)
        ('█X▄', '#X=')
    """

    def __init__(self, points: int = _POINTS) -> None:
        self._points, self._stride, self._count = points, 1, 0
        self.values: list[float] = []
        """The points so far."""

    def add(self, value: float) -> None:
        """Add the robustness at a later time."""
        if self._count % self._stride:
            self.values[-1] = _lower(self.values[-1], value)
        else:
            self.values.append(value)
        self._count += 1
        if len(self.values) > self._points:
            values = self.values
            self.values = [reduce(_lower, values[i : i + 2]) for i in range(0, len(values), 2)]
            self._stride *= 2

    def bars(self, width: int, *, plain: bool = False) -> str:
        """Return the course as text."""
        values, bars = self.values, _PLAIN_BARS if plain else _BARS
        if len(values) > width:
            bounds = [i * len(values) // width for i in range(width + 1)]
            values = [reduce(_lower, values[i:j]) for i, j in pairwise(bounds)]
        top = max((v for v in values if 0 < v < math.inf), default=1.0)
        depth = min((v for v in values if -math.inf < v < 0), default=-1.0)
        return "".join(_bar(value, top, depth, bars) for value in values)


def _lower(first: float, second: float) -> float:
    """Return the lower of two values; a value that is not known does not hide the other one."""
    if math.isnan(first) or math.isnan(second):
        return second if math.isnan(first) else first
    lower = min(first, second)
    return math.copysign(lower, -1.0) if lower == 0.0 and _signed((first, second)) else lower


def _signed(values: Iterable[float]) -> bool:
    return any(math.copysign(1.0, value) < 0 for value in values)


def _bar(value: float, top: float, depth: float, bars: str) -> str:
    if math.isnan(value):
        return " "
    if math.copysign(1.0, value) < 0:
        return _BELOW[value < depth / 2]
    level = math.ceil(min(value / top, 1.0) * len(bars)) - 1
    return bars[max(level, 0)]


class Screen:
    """The view; it is drawn on standard error, so that lines may go elsewhere.

    Attributes:
        notes: Further lines below the requirements.
    """

    def __init__(
        self,
        title: str,
        console: Console | None = None,
        clock: Callable[[], float] = monotonic,
        unit: str = "row",
    ) -> None:
        self._title, self._clock, self._unit = title, clock, unit
        self.notes: list[str] = []
        self._console = console or Console(stderr=True, highlight=False)
        self._drawn = clock()
        self._live: Any = None
        self.restart(title)
        self._plain = not self._console.encoding.lower().startswith("utf")

    def __enter__(self) -> Self:
        self._live = Live(
            self.picture(), console=self._console, auto_refresh=False, redirect_stdout=False
        )
        self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.update(self.picture(), refresh=True)
        self._live.stop()

    def restart(self, title: str) -> None:
        """Forget all rows, and show another stream under a title."""
        self._title = title
        self._lines: dict[Key, Line] = {}
        self._courses: dict[Key, Course] = {}
        self._rows = self._bad = 0
        self._newest = self._clock()
        self._ended = ""

    def add(self, line: Line) -> None:
        """Take in a final line; others are read by `update`."""
        if line.final:
            key = line.group, line.requirement
            self._lines[key] = line
            self._courses.setdefault(key, Course())

    def update(self, lines: Iterable[Line], rows: int, bad: int = 0) -> None:
        """Take in the newest verdicts, and draw if the last picture is old."""
        now = self._clock()
        due = now - self._drawn >= _REFRESH
        if rows != self._rows:
            self._newest = now
            for line in lines if due or len(self._lines) <= _MANY else ():
                key = line.group, line.requirement
                self._lines[key] = line
                self._courses.setdefault(key, Course()).add(line.robustness)
        self._rows, self._bad = rows, bad
        if due:
            self._drawn = now
        if due and self._live is not None:
            self._live.update(self.picture(), refresh=True)

    def end(self, text: str) -> None:
        """Show how the stream has ended."""
        self._ended = text

    def picture(self) -> Group:
        """Return the view as it is now."""
        plain = self._plain
        grouped = any(group is not None for group, _ in self._lines)
        widths = self._widths(grouped=grouped)
        table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
        for name, width in widths.items():
            side: Any = "right" if name == "robustness" else "left"
            table.add_column(name, width=width, justify=side, no_wrap=True, overflow="crop")
        keys = sorted(self._lines, key=self._order)
        groups = _cut_names({key[0] or "" for key in keys}, widths.get("group", 0), plain=plain)
        names = _cut_names({key[1] for key in keys}, widths["requirement"], plain=plain)
        for key in keys[:_ROWS]:
            texts = {"group": groups[key[0] or ""], "requirement": names[key[1]]}
            table.add_row(*self._cells(key, texts, widths, plain=plain))
        more = len(keys) - _ROWS
        parts: list[Any] = [self._head(), table]
        if more > 0:
            parts.append(Text(f"and {counted(more, 'row')} with a higher robustness"))
        parts += [Text(_cut(note, self._console.width, plain=plain)) for note in self.notes]
        return Group(*parts)

    def _order(self, key: Key) -> tuple[int, float]:
        """Return the place of a row if there are many: the worst first, else as they came."""
        line = self._lines[key]
        if len(self._lines) <= _ROWS:
            return (0, 0.0)
        robustness = line.robustness
        return int(line.verdict), math.inf if math.isnan(robustness) else robustness

    def _head(self) -> Text:
        now = self._clock()
        parts = [self._title, counted(self._rows, self._unit)]
        times = [line.time for line in self._lines.values() if line.time is not None]
        if times:
            parts.append(f"at {max(times):.6g} s")
        age = f"{now - self._newest:.1f} s"
        waits = f"last {self._unit} {age} ago" if self._rows else f"none for {age}"
        parts.append(self._ended or waits)
        if self._bad:
            parts.append(counted(self._bad, "bad line"))
        return Text(_cut(", ".join(parts), self._console.width, plain=self._plain))

    def _widths(self, *, grouped: bool) -> dict[str, int]:
        """Return the columns and their widths, which together are the width of the terminal.

        A cut number would be another number: names are cut first, and then columns are left out.
        """
        lines = self._lines.values()
        groups = max((cell_len(group or "") for group, _ in self._lines), default=0)
        names = max((cell_len(name) for _, name in self._lines), default=0)
        wide = self._console.width >= _WIDE
        widths = {"group": max(5, min(groups, 24 if wide else 12))} if grouped else {}
        widths["requirement"] = max(11, min(names, 30 if wide else 18))
        widths["verdict"] = len("UNDECIDED")
        if wide:
            widths["decided"] = 10
        widths["robustness"] = max([10, *(len(_robustness(line)) for line in lines)])
        widths["bounds"] = max([15, *(len(_bounds(line)) for line in lines)])
        widths["course"] = 4
        for column in ("decided", "", "course", "bounds"):
            excess = self._excess(widths)
            if excess > 0 and column:
                widths.pop(column, None)
            elif excess > 0:
                self._narrow(widths, excess)
        if "course" in widths:
            widths["course"] = min(4 + max(-self._excess(widths), 0), _POINTS)
        return widths

    def _excess(self, widths: Mapping[str, int]) -> int:
        """Return by how much columns, with two blanks between them, are wider than the terminal."""
        return sum(widths.values()) + 2 * (len(widths) - 1) - self._console.width

    @staticmethod
    def _narrow(widths: dict[str, int], excess: int) -> None:
        """Cut the columns of names by some characters, as far as names stay readable."""
        for column in ("group", "requirement"):
            part = min(excess, widths.get(column, _SHORT) - _SHORT)
            if part > 0:
                widths[column] -= part
                excess -= part

    def _cells(
        self, key: Key, names: Mapping[str, str], widths: Mapping[str, int], *, plain: bool
    ) -> list[Text]:
        line = self._lines[key]
        at = ""
        if line.decided_at is not None:
            at = (
                f"sample {line.decided_at:.0f}" if line.time is None else f"{line.decided_at:.6g} s"
            )
        cells = {
            **{column: Text(text) for column, text in names.items()},
            "verdict": Text(line.verdict.name, style=_STYLES[line.verdict]),
            "decided": Text(at),
            "robustness": Text(_robustness(line)),
            "bounds": Text(_bounds(line)),
            "course": _coloured(self._courses[key].bars(widths.get("course", 4), plain=plain)),
        }
        return [cells[column] for column in widths]


def _robustness(line: Line) -> str:
    return "-" if math.isnan(line.robustness) else short(line.robustness)


def _bounds(line: Line) -> str:
    if math.isnan(line.lower):
        return "-"
    return f"{short(line.lower)} .. {short(line.upper)}"


def _cut_names(names: Collection[str], width: int, *, plain: bool) -> dict[str, str]:
    """Return names as a terminal can show them; names with equal beginnings show their ends."""
    cut = {name: _cut(name, width, plain=plain) for name in names}
    counts = Counter(cut.values())
    return {
        name: text if counts[text] == 1 else _cut(name, width, plain=plain, tail=width // 2)
        for name, text in cut.items()
    }


def _cut(text: str, width: int, *, plain: bool, tail: int = 0) -> str:
    """Return a text as a terminal can show it.

    Args:
        text: The text.
        width: The columns of the terminal for it.
        plain: Whether to use ASCII alone.
        tail: The columns for the last letters if it is too long.
    """
    text, width = shown(text), max(width, 4)
    if plain:
        text = text.encode("ascii", "replace").decode()
    if cell_len(text) <= width:
        return text
    end = text
    while cell_len(end) > max(tail - 1, 0):
        end = end[1:]
    return f"{set_cell_size(text, width - 3 - cell_len(end)).rstrip()}...{end}"


def _coloured(bars: str) -> Text:
    text = Text()
    for bar in bars:
        text.append(bar, style="red" if bar in _BELOW else "cyan")
    return text


def open_screen(title: str, unit: str = "row", source: str = "--screen") -> Screen:
    """Return a view on standard error."""
    if not sys.stderr.isatty():
        raise InputError(f"{source} draws on a terminal, but standard error is not one")
    return Screen(title, unit=unit)


_STEP: Final = 0.05
"""The longest pause in seconds, after which the picture may be drawn again."""


class RunScreen:
    """Runs episodes on a screen."""

    def __init__(
        self,
        screen: Screen,
        speed: float | None = None,
        clock: Callable[[], float] = monotonic,
        pause: Callable[[float], None] = sleep,
    ) -> None:
        self._screen, self._speed, self._clock, self._pause = screen, speed, clock, pause

    def simulate(
        self,
        title: str,
        system: Any,  # noqa: ANN401 - of any kind that `simulate` takes
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        policy: Policy | None = None,
        seed: int | None = None,
        stop: Stop = "violation",
        live: RerunView | None = None,
        **reading: Unpack[EvaluationKeywords],
    ) -> Run:
        """Run a simulation as `rtamt_gym.simulate` does, and show each of its samples."""
        from rtamt_gym.options.evaluation import checked_options
        from rtamt_gym.play.simulate import Simulator, simulate
        from rtamt_gym.systems.system import no_exit

        options = checked_options(reading, simulate, "runs")
        self._screen.restart(title)
        with no_exit("the system"):
            simulator = Simulator(system, specs, signals, options, policy=policy)
            simulation = simulator.begin(seed=seed, stop=stop, live=live)
            begin = self._clock()
            while not simulation.step():
                self._show(simulation)
                self._wait(simulation, begin)
        run = simulation.run
        assert run is not None  # noqa: S101 - for mypy
        self._screen.update(_finals(run), run.last_sample + 1)
        self._screen.end(f"ended: {run.ended}")
        return run

    def _show(self, simulation: Simulation) -> None:
        moment = simulation.moment
        assert moment.sample is not None  # noqa: S101 - for mypy
        period = simulation.period
        lines = (_line(result, moment, period) for result in simulation.results())
        self._screen.update(lines, moment.sample + 1)

    def _wait(self, simulation: Simulation, begin: float) -> None:
        """Wait until the next sample is due."""
        if self._speed is None:
            return
        moment, period = simulation.moment, simulation.period
        if period is None or moment.seconds is None:
            raise InputError("--speed needs the time between samples. Give --period.")
        due = begin + (moment.seconds + float(period)) / self._speed
        while (left := due - self._clock()) > 1e-9:
            self._pause(min(left, _STEP))
            self._screen.update((), (moment.sample or 0) + 1)


def _line(result: MonitorSetResult, moment: Moment, period: Fraction | None) -> Line:
    name, bounds, verdict, decided, _ = result
    at = None if decided is None else Moment.of(decided, period).time
    return Line(name, None, moment.seconds, moment.sample, verdict, *bounds, decided_at=at)


def _finals(run: Run) -> Iterator[Line]:
    last = Moment.of(run.last_sample, run.period)
    for name, history in run.histories.items():
        verdict: Verdict = history.verdict
        bounds = history.final, float(history.lower[-1]), float(history.upper[-1])
        result = name, bounds, verdict, history.decided_at, history.ended_at
        yield _line(result, last, run.period)._replace(final=True)
