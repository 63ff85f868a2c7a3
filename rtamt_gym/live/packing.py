"""Columns of the samples of tracks, their entities, and the layout of a view."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from rtamt import Verdict
from rtamt_gym.live.outputs import APPLICATION, FileOutput, ViewerOutput
from rtamt_gym.live.track import CURVES, HEAD, PackedPicture, Track, VerdictLine

_LEVELS: Final = {
    Verdict.VIOLATED: "ERROR",
    Verdict.UNDECIDED: "WARN",
    Verdict.SATISFIED: "INFO",
}

_PALETTE: Final = (
    *((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167)),
    *((213, 94, 0), (86, 180, 233), (140, 120, 20), (110, 110, 110)),
)
"""Okabe and Ito's colours, for signals."""

_COLOURS: Final = {
    "robustness": (0, 158, 115),
    "lower": (86, 180, 233),
    "upper": (230, 159, 0),
}

_Item = TypeVar("_Item")

_SHOWN: Final = 4
"""Tracks that the layout shows; others are in the list of entities."""


class Packer:
    """Makes columns of the samples of tracks, and sends them to outputs.

    Args:
        outputs: The outputs.
    """

    def __init__(self, outputs: Sequence[FileOutput | ViewerOutput]) -> None:
        self._outputs = outputs
        self._paths: dict[str, _Paths] = {}
        _warm_up()

    def send(self, tracks: Sequence[Track]) -> None:
        """Send all samples that wait."""
        if len(tracks) > len(self._paths):
            for track in tracks:
                if track.prefix not in self._paths:
                    self._paths[track.prefix] = paths = _Paths(track)
                    self._style(paths)
            layout = blueprint([*self._paths.values()])
            for output in self._outputs:
                output.stream.send_blueprint(layout)
        lines = sum(self._send(track, self._paths[track.prefix]) for track in tracks)
        for output in self._outputs:
            output.deliver(lines)

    def close(self) -> None:
        """Close the outputs."""
        for output in self._outputs:
            output.close()

    def _send(self, track: Track, paths: _Paths) -> int:
        """Send what waits in a track; return the number of verdicts."""
        lines, frames, rows = taken(track.lines), taken(track.frames), taken(track.rows)
        if rows:
            table = np.array(rows, np.float64)
            indexes = _indexes(table[:, :HEAD])
            for path, column in zip(paths.columns, table[:, HEAD:].T, strict=True):
                self._columns(path, indexes, rr.Scalars.columns(scalars=column))
        by_name: dict[str, list[VerdictLine]] = {}
        for line in lines:
            by_name.setdefault(line.requirement, []).append(line)
        for name, some in by_name.items():
            self._columns(
                paths.verdicts[name],
                _indexes(np.array([line.place for line in some])),
                rr.TextLog.columns(
                    text=[paths.head + line.text for line in some],
                    level=[_LEVELS[line.verdict] for line in some],
                ),
            )
        if frames:
            self._pictures(paths.picture, frames)
        return len(lines)

    def _pictures(self, path: str, frames: Sequence[PackedPicture]) -> None:
        columns = rr.EncodedImage.columns(
            blob=[frame.picture for frame in frames], media_type=["image/jpeg"] * len(frames)
        )
        self._columns(path, _indexes(np.array([frame.place for frame in frames])), columns)

    def _columns(self, path: str, indexes: Sequence[Any], columns: Any) -> None:  # noqa: ANN401 - Rerun is not typed
        for output in self._outputs:
            output.stream.send_columns(path, indexes, columns)

    def _style(self, paths: _Paths) -> None:
        """Set the colours of the curves."""
        styles = [
            (path, _PALETTE[index % len(_PALETTE)], path.rsplit("/", 1)[1], 1.5)
            for index, path in enumerate(paths.signals)
        ]
        styles += [
            (path, _COLOURS[name], name, 2.5 if name == "robustness" else 1.0)
            for path, name in zip(paths.curves, paths.curve_names, strict=True)
        ]
        for path, colour, name, width in styles:
            lines = rr.SeriesLines(names=name, colors=[colour], widths=[width])
            for output in self._outputs:
                output.stream.log(path, lines, static=True)


class _Paths:
    """The entities of a track."""

    def __init__(self, track: Track) -> None:
        head = [track.prefix] if track.prefix else []
        self.root = rr.new_entity_path(head) if head else ""
        self.head = f"{track.prefix}: " if track.prefix else ""
        self.signals = [rr.new_entity_path([*head, "signals", name]) for name in track.signals]
        self.requirements = {
            name: rr.new_entity_path([*head, "requirements", name]) for name in track.requirements
        }
        self.curves = [f"{path}/{name}" for path in self.requirements.values() for name in CURVES]
        self.curve_names = [*CURVES] * len(self.requirements)
        self.columns = [*self.signals, *self.curves]
        self.verdicts = {name: f"{path}/verdict" for name, path in self.requirements.items()}
        self.has_pictures = track.has_pictures
        self.picture = rr.new_entity_path([*head, "picture"])


def blueprint(paths: Sequence[_Paths]) -> rrb.Blueprint:
    """Return the layout: curves next to picture and verdicts; of several tracks, a column each."""
    columns = [rrb.encodings.TextLogColumn(kind) for kind in ("LogLevel", "Body")]
    log = rrb.TextLogView(
        name="verdicts", columns=rrb.TextLogColumns(text_log_columns=columns), contents="/**"
    )
    if len(paths) == 1:
        side = rrb.Vertical(*_pictures(paths[0]), log)
        views = rrb.Horizontal(rrb.Vertical(*_curves(paths[0])), side, column_shares=[4, 3])
    else:
        tracks = [rrb.Vertical(*_curves(track), *_pictures(track)) for track in paths[:_SHOWN]]
        views = rrb.Vertical(rrb.Horizontal(*tracks), log, row_shares=[3, 1])
    return rrb.Blueprint(views, collapse_panels=True)


def _curves(track: _Paths) -> list[rrb.TimeSeriesView]:
    """Return the views of signals and requirements."""
    origins = [("signals", f"{track.root}/signals"), *track.requirements.items()]
    return [rrb.TimeSeriesView(origin=path, name=f"{track.head}{name}") for name, path in origins]


def _pictures(track: _Paths) -> list[rrb.Spatial2DView]:
    """Return the view of pictures, if there are any."""
    if not track.has_pictures:
        return []
    return [rrb.Spatial2DView(origin=track.picture, name=f"{track.head}picture")]


def taken(items: deque[_Item]) -> list[_Item]:
    """Take what is in a deque now, while another thread appends to it."""
    return [items.popleft() for _ in range(len(items))]


def _indexes(places: NDArray[np.float64]) -> list[Any]:
    """Return the timelines of samples: rows of sample, time and episode."""
    samples, times, episodes = places.T
    indexes = [
        rr.TimeColumn("sample", sequence=samples.astype(np.int64)),
        rr.TimeColumn("episode", sequence=episodes.astype(np.int64)),
    ]
    if not math.isnan(times[0]):
        nanoseconds = np.rint(times * 1e9).astype("timedelta64[ns]")
        indexes.insert(1, rr.TimeColumn("time", duration=nanoseconds))
    return indexes


def _warm_up() -> None:
    """Load the parts of the package that the first samples would wait for."""
    stream = rr.RecordingStream(APPLICATION)
    pipe = stream.binary_stream()
    stream.send_blueprint(rrb.Blueprint(rrb.TextLogView()))
    indexes = _indexes(np.zeros((1, HEAD)))
    stream.send_columns("a", indexes, rr.Scalars.columns(scalars=[0.0]))
    stream.send_columns("b", indexes, rr.TextLog.columns(text=["a"], level=["INFO"]))
    pipe.read(flush=True)
    stream.disconnect()
