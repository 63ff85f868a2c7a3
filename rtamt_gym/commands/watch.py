"""`rtamt watch`: judges a stream of samples or events while it comes."""

from __future__ import annotations

import argparse
import math
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rtamt import InputError, Verdict
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import hold, open_view
from rtamt_gym.commands.collection import few_collections
from rtamt_gym.commands.specs import chosen, read_constants, read_requirements, variables_of
from rtamt_gym.commands.traces import COLUMNS, is_trace, names_file
from rtamt_gym.options.command_line import (
    Option,
    add_options,
    positive,
    read_evaluation_options,
    shared,
)
from rtamt_gym.recorded.columns import Columns, read_columns, read_seconds
from rtamt_gym.results.warnings import INTERRUPTED
from rtamt_gym.tables import short, shorten

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.watching.events import EventGroup
    from rtamt_gym.watching.lines import Line
    from rtamt_gym.watching.sampled import SampledGroup
    from rtamt_gym.watching.screen import Screen
    from rtamt_gym.watching.states import RowValues
    from rtamt_gym.watching.watch import StreamWatch, WatchOptions

_COLUMNS: Final = (
    *("--signal", "--time", "--time-unit", "--date-order", "--one-trace", "--separator", "--skip"),
    *("--decimal", "--missing", "--default", "--no-defaults"),
)
"""The column options of streams; the others need the complete file."""


_ABOUT: Final[Mapping[str, Mapping[str, Any]]] = {
    "--signal": {
        "about": "the column of a variable with another name: 'speed=Vehicle Speed [km/h]'"
    },
    "--time": {
        "about": "the column of times, or two, as in secs+nsecs (default: time, timestamp, t, "
        "stamp, Time [s], elapsed_time, TimeUS, Zeit ...)",
        "usual": "",
    },
    "--decimal": {
        "usual": "from the first number that shows it; a number before it that can be read in two "
        "ways is an error"
    },
    "--missing": {
        "about": "the meaning of an empty cell, or nan: raise, an error; hold, the value before; "
        "drop, its row is left out; unknown, an unknown value"
    },
}
"""The help of options with another meaning in a stream."""


def _columns() -> Iterator[Option]:
    """Yield the column options of streams."""
    for option in COLUMNS:
        flag = option.name.partition(" ")[0]
        if flag in _COLUMNS:
            yield replace(option, **_ABOUT.get(flag, {}))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Evaluates rows of a stream while they come, and prints a line of JSON as soon as a "
        "verdict is decided. At the end of the stream every requirement gets a final line. Exits "
        "2 for a bad argument or line, 1 for a violation, 3 for an undecided requirement, "
        "otherwise 0. Ctrl-C prints the final lines and exits 130."
    )
    parser.epilog = "example: simulator | rtamt watch requirements.stl --stop violation"
    add_options(
        parser,
        Option("SPEC", "a .stl file, name=path, or a formula", dest="spec"),
        Option(
            "SOURCE",
            "- for standard input, a file, or tcp:PORT or unix:PATH, a socket on this machine for "
            "one client",
            default="-",
            nargs="?",
        ),
        Option(
            "--format",
            "csv, rows below a line of names, or ndjson, a JSON object in each line",
            usual="ndjson if the first byte is {, otherwise csv",
            choices=("csv", "ndjson"),
        ),
        Option("--follow", "wait for more rows at the end of a file"),
        Option(
            "--idle TIME",
            "with --follow: end after this time without a byte, such as 10s",
            usual="never",
        ),
        Option(
            "--stop",
            "stop at the first violation, or once all verdicts are decided; the process that "
            "writes the stream ends at its next write",
            default="end",
            choices=("end", "violation", "decided"),
        ),
        Option(
            "--screen",
            "draw verdicts and robustness with bounds on the terminal, by standard error; lines "
            "are printed only if standard output is not a terminal",
        ),
        "--rerun",
        Option(
            "--speed FACTOR",
            "replay a file at this multiple of its recorded speed, such as 10",
            usual="as fast as possible",
            read=float,
        ),
        Option("--every", "print a line for every sample; otherwise for each change of a verdict"),
        "--only",
        "--constant",
        shared(
            "--end",
            about="end mode at the end of the stream, as for rtamt monitor",
        ),
        shared(
            "--period",
            about="time between samples, such as 100ms",
            usual="from the first two times, to which all others must fit",
        ),
        shared(
            "--view",
            about="episode evaluates a requirement at the first sample; step evaluates it at "
            "every instant, late by its horizon, and prints each change of its verdict",
        ),
        *("--semantics", "--align"),
        shared(
            "--dense", about="read rows as events at any time; a value holds until the next event"
        ),
        Option(
            "--skip-bad",
            "leave out bad lines, and count their samples as unknown",
            usual="a bad line is an error",
        ),
        "--min-duration",
    )
    groups = parser.add_argument_group("groups")
    add_options(
        groups,
        Option(
            "--by COLUMN",
            "evaluate the rows with each value of this column as a trace of its own",
            several=True,
        ),
        Option(
            "--max-groups N", "maximum number of groups at one time", default=100_000, read=positive
        ),
        Option(
            "--group-idle TIME",
            "end a group when the newest time of all groups is this much later than its own",
            usual="at the end of the stream",
        ),
    )
    add_options(parser.add_argument_group("columns"), *_columns())


def run(options: argparse.Namespace) -> int:
    """Judge the stream; return the exit code."""
    from rtamt_gym.watching.sources import StreamSource
    from rtamt_gym.watching.watch import StreamWatch

    _check_order(options.spec, options.source)
    settings = _settings(options)
    idle = None if options.idle is None else float(read_seconds("--idle", options.idle))
    beat = _BEAT if options.screen else None
    source = StreamSource(options.source, options.follow, idle, beat)
    source.check()
    output = _Output(printed=not (options.screen and sys.stdout.isatty()))
    watch = StreamWatch(settings, source.title, output.add)
    blocks = source.blocks()
    if options.speed is not None:
        blocks = _replayed(options, watch, blocks)
    screen = output.screen = _screen(source.title) if options.screen else None
    view = open_view(options.rerun)
    if view is not None:
        output.view = StreamView(view, [*settings.specs], watch.rules.variables)
        watch.rules.show = output.view.sample
    with (
        view or nullcontext(),
        screen or nullcontext(),
        _interrupts() as interrupts,
        few_collections(),
    ):
        code = _judge(watch, blocks, output, interrupts)
        output.flush()
        if view is not None and output.view is not None and code is None:
            output.view.end()
            source.leave()
            with suppress(KeyboardInterrupt), interrupts.allowed():
                hold(view)
    messages = [] if output.closed else watch.messages()
    print(*messages, sep="\n", end="\n" * bool(messages), file=sys.stderr)
    if output.view is not None and output.view.hidden:
        print(f"--rerun shows the first {SHOWN_GROUPS} groups", file=sys.stderr)
    for failure in watch.failures:
        print(f"rtamt: error: {failure}", file=sys.stderr)
    return watch.exit_code() if code is None else code


def _judge(
    watch: StreamWatch, blocks: Iterator[bytes], output: _Output, interrupts: _Interrupts
) -> int | None:
    """Judge the blocks and end the traces; return the exit code of an interrupt, or None."""
    try:
        while not (watch.stopped or output.closed):
            with interrupts.allowed():
                block = next(blocks, None)
            if block is None:
                watch.end_of_input()
                break
            watch.add(block)
            output.look(watch)
    except KeyboardInterrupt:
        watch.finish(early=True)
        output.end("stopped by Ctrl-C")
        return INTERRUPTED
    except Exception:
        watch.finish(early=True)
        output.end("ended by an error")
        raise
    output.look(watch)
    watch.finish(early=watch.stopped)
    output.end("stopped" if watch.stopped else "ended")
    return None


def _screen(title: str) -> Screen:
    from rtamt_gym.watching.screen import open_screen

    return open_screen(title)


def _replayed(
    options: argparse.Namespace, watch: StreamWatch, blocks: Iterator[bytes]
) -> Iterator[bytes]:
    """Return the blocks of a file at the pace of its times."""
    from rtamt_gym.watching.sources import paced

    if options.source == "-" or options.source.startswith(("tcp:", "unix:")) or options.follow:
        raise InputError("--speed replays a file; expected the path of a file, without --follow")
    if not 0 < options.speed < math.inf:
        raise InputError(f"--speed: expected a factor above 0, such as 10, got {options.speed:g}")

    def seconds() -> float | None:
        at = watch.seconds()
        if at is None and any(trace.samples for trace in watch.traces.values()):
            raise InputError(
                "--speed replays rows by their times, but there is no column of times. Give "
                "--period TIME, the time between two rows, or leave out --speed."
            )
        return at

    return paced(blocks, seconds, options.speed)


def _check_order(spec: str, source: str) -> None:
    """Refuse a stream before its specification, and a second specification."""
    is_stream = spec == "-" or spec.startswith(("tcp:", "unix:")) or is_trace(spec)
    is_spec = source.endswith(".stl") or not names_file(source)
    if source.startswith(("tcp:", "unix:")) or not (is_stream or is_spec):
        return
    if is_spec and (is_stream or (Path(spec).exists() and not spec.endswith(".stl"))):
        raise InputError(
            f"expected a specification first, got the stream {shorten(spec, 60)}; write "
            f"rtamt watch {shlex.quote(shorten(source, 60))} {shlex.quote(spec)}"
        )
    if is_stream:
        raise InputError(
            f"expected a specification first, got the stream {shorten(spec, 60)}; write "
            f"rtamt watch SPEC {shlex.quote(spec)}"
        )
    raise InputError(
        f"expected a stream after the specification, got the specification {shorten(source, 60)}; "
        "write all requirements into one file or formula"
    )


def _settings(options: argparse.Namespace) -> WatchOptions:
    """Read the requirements and the options."""
    from rtamt_gym.recorded.judge import viewed
    from rtamt_gym.watching.watch import WatchOptions

    constants = read_constants(options.constant)
    specs = chosen(read_requirements([options.spec], constants), options.only)
    reading = read_evaluation_options(options)
    for spec in specs.values():
        viewed(spec, reading.view)
    names = {flag.removeprefix("--").replace("-", "_") for flag in _COLUMNS} - {"signal", "default"}
    columns = read_columns(
        signals=options.signal,
        defaults=tuple(dict.fromkeys(options.default)),
        **{name: getattr(options, name) for name in names & {f.name for f in fields(Columns)}},
    )
    variables = variables_of(specs)
    for name in columns.signals:
        if name not in variables:
            hint = nearest(name, variables) or f"; they read {listing(variables)}"
            raise InputError(f"--signal: no specification reads {name!r}{hint}")
    group_idle, least = options.group_idle, options.min_duration
    return WatchOptions(
        specs,
        reading,
        columns,
        options.format,
        [*dict.fromkeys(options.by)],
        options.max_groups,
        None if group_idle is None else read_seconds("--group-idle", group_idle),
        options.every,
        options.stop,
        options.skip_bad,
        None if least is None else read_seconds("--min-duration", least),
        live=options.follow or options.source.startswith(("tcp:", "unix:")),
    )


class _Output:
    """Lines of JSON on standard output, written once for each block, and the screen.

    Attributes:
        screen: The view in the terminal; None without one.
        view: The view in Rerun; None without one.
    """

    def __init__(self, *, printed: bool) -> None:
        self._texts: list[str] = []
        self._printed = printed
        self.screen: Screen | None = None
        self.view: StreamView | None = None

    def add(self, line: Line) -> None:
        """Write a line, and pass it to the views."""
        if self.screen is not None:
            self.screen.add(line)
        if self.view is not None:
            self.view.line(line)
        if self._printed:
            self._texts.append(line.to_json())
            if len(self._texts) >= _MANY:
                self.flush()

    def look(self, watch: StreamWatch) -> None:
        """Write all lines and update the screen."""
        self.flush()
        if self.screen is not None:
            self.screen.update(watch.newest(), watch.rows, watch.bad)

    def end(self, text: str) -> None:
        """Write the last lines, and show how the stream has ended."""
        self.flush()
        if self.screen is not None:
            self.screen.end(text)

    def flush(self) -> None:
        """Write all lines, and wait for a slow reader."""
        if self._texts:
            texts, self._texts = self._texts, []
            sys.stdout.write("\n".join(texts) + "\n")
            sys.stdout.flush()

    @property
    def closed(self) -> bool:
        """Whether the reader of standard output has ended."""
        return bool(getattr(sys.stdout, "closed_by_reader", False))


_BEAT: Final = 0.2
"""Seconds after which the screen is drawn again if no row comes."""

_MANY: Final = 10_000
"""The number of lines at which they are written before the block ends."""


class _Interrupts:
    """The handler of Ctrl-C: it ends a wait for input at once, and other work after the block."""

    def __init__(self) -> None:
        self._waiting = self._pending = False

    def handle(self, *_: object) -> None:
        """Handle a signal."""
        if self._waiting:
            raise KeyboardInterrupt
        self._pending = True

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Raise KeyboardInterrupt in this context, also for an earlier Ctrl-C."""
        self._waiting = True
        try:
            if self._pending:
                raise KeyboardInterrupt
            yield
        finally:
            self._waiting = False


@contextmanager
def _interrupts() -> Iterator[_Interrupts]:
    interrupts = _Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    before = signal.signal(signal.SIGINT, interrupts.handle)
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, before)


SHOWN_GROUPS: Final = 100
"""The maximum number of groups in a view."""


class StreamView:
    """Shows the groups of a stream in a view.

    Attributes:
        hidden: Whether there are more groups than a view shows.
    """

    def __init__(
        self, view: RerunView, requirements: Sequence[str], variables: Sequence[str]
    ) -> None:
        self._view, self._requirements, self._variables = view, requirements, variables
        self._tracks: dict[str | None, Track | None] = {}
        self._verdicts: dict[tuple[str | None, str], Verdict] = {}
        self.hidden = False

    def sample(self, trace: SampledGroup | EventGroup, row: RowValues) -> None:
        """Show the newest row of a group."""
        track = self._track(trace.group)
        if track is None:
            return
        curves: list[float] = []
        for line in trace.newest():
            curves += (line.robustness, line.lower, line.upper)
        time = trace.seconds
        track.add(row, curves, None, (trace.samples - 1, math.nan if time is None else time))

    def line(self, line: Line) -> None:
        """Show a verdict that has changed or is final, and the bounds after the end."""
        track = self._track(line.group)
        if track is None:
            return
        if line.final:
            track.change(line.requirement, (line.robustness, line.lower, line.upper))
        key = line.group, line.requirement
        before = self._verdicts.get(key, Verdict.UNDECIDED)
        self._verdicts[key] = line.verdict
        if line.verdict is before and not (line.final and line.verdict is Verdict.UNDECIDED):
            return
        when = "the end" if line.final else _when(line)
        robustness = "" if math.isnan(line.robustness) else f", robustness {short(line.robustness)}"
        reason = f", {line.reason}" if line.reason and not line.final else ""
        text = f"{line.requirement} {line.verdict.name} at {when}{robustness}{reason}"
        sample = track.sample_count if line.sample is None else line.sample
        if line.final and line.sample is None:
            sample -= 1
        time = math.nan if line.time is None else line.time
        track.log(line.requirement, line.verdict, text, (sample, time, 1))

    def end(self) -> None:
        """Send the newest rows too, after the final lines."""
        for track in self._tracks.values():
            if track is not None:
                track.begin()

    def _track(self, group: str | None) -> Track | None:
        if group not in self._tracks:
            visible = len(self._tracks) < SHOWN_GROUPS
            self.hidden |= not visible
            self._tracks[group] = (
                self._view.track(self._variables, self._requirements, None, group or "")
                if visible
                else None
            )
        return self._tracks[group]


def _when(line: Line) -> str:
    return f"sample {line.sample}" if line.time is None else f"{line.time:.6g} s"
