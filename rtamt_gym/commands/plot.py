"""`rtamt plot`: draws logs of training."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.options.command_line import Option, add_options
from rtamt_gym.results.matrix import indented
from rtamt_gym.tables import counted, short, table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rtamt_gym.learners.logs import TrainingLog


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Draws logs of training: satisfaction with its interval, quantiles of robustness, "
        "progress, cost and return against steps. It reads CSV files and event files of "
        "TensorBoard with the metrics of rtamt_gym.learners."
    )
    parser.epilog = "example: rtamt plot ppo=runs/ppo dqn=runs/dqn -o training.png"
    add_options(
        parser,
        Option(
            "FOLDER",
            "a folder, or NAME=FOLDER; each folder in it with logs is a run, and several runs are "
            "drawn as their mean, with a band from the minimum to the maximum",
            nargs="+",
            dest="folders",
        ),
        Option(
            "-o FILE",
            "the picture, as .png, .svg or .pdf",
            default=Path("training.png"),
            read=Path,
            dest="output",
            alias="--output",
        ),
        Option("--only NAME", "draw only this requirement", repeat=True),
    )


def run(options: argparse.Namespace) -> int:
    """Read the logs, print the last values and draw the picture."""
    from rtamt_gym.drawing import save
    from rtamt_gym.learners.curves import columns_of, draw_training
    from rtamt_gym.learners.logs import training_logs

    check_outputs(picture=options.output)
    groups: dict[str, list[TrainingLog]] = {}
    notes: list[str] = []
    for argument in options.folders:
        name, equals, path = argument.partition("=")
        folder = Path(path if equals else argument)
        name = name if equals else str(folder)
        if name in groups:
            raise InputError(f"expected one folder for {name!r}, got two; give NAME=FOLDER")
        groups[name] = training_logs(folder, notes)
    columns = columns_of([log for logs in groups.values() for log in logs])
    for name in options.only:
        if name not in columns[1:]:
            hint = nearest(name, columns[1:]) or f"; they are {listing(columns[1:])}"
            raise InputError(f"--only: no log has the requirement {name!r}{hint}")
    chosen = [name for name in columns if name in options.only] if options.only else columns
    print(*_last_values(groups, chosen), sep="\n")
    for note in notes:
        print(*indented(f"note: {note}", ""), sep="\n")
    save(draw_training(groups, chosen), options.output)
    print(f"\npicture: {options.output}")
    return 0


def _last_values(groups: Mapping[str, Sequence[TrainingLog]], columns: Sequence[str]) -> list[str]:
    """Return a table of the newest satisfaction rates."""
    from rtamt_gym.learners.curves import PANELS, band_of

    rows: list[tuple[str, ...]] = [
        ("logs", "runs", "requirement", "from", "steps", "satisfied", "band")
    ]
    for name, logs in groups.items():
        for requirement in columns:
            for kind in ("evaluation", "training"):
                band = band_of(logs, PANELS[0], requirement, kind)
                if band is None:
                    continue
                runs = str(len(logs))
                if band.counts[-1] < len(logs):
                    runs = f"{band.counts[-1]} of {len(logs)}"
                low, high = float(band.low[-1]), float(band.high[-1])
                rows.append(
                    (
                        *(name, runs, requirement or "all", kind),
                        f"{band.steps[-1]:.0f}",
                        f"{100 * float(band.middle[-1]):.1f}%",
                        f"{short(100 * low)} to {short(100 * high)}",
                    )
                )
                break
    count = sum(map(len, groups.values()))
    if not count:
        return []
    lines = [*table(rows, "<><<>>>"), "", f"band of {_band_text(groups)}"]
    if any(" of " in row[1] for row in rows):
        text = "runs: those with a value at this step; the others end earlier or lack the metric"
        lines += indented(text, "")
    return lines


def _band_text(groups: Mapping[str, Sequence[TrainingLog]]) -> str:
    counts = sorted({len(logs) for logs in groups.values()})
    texts = [
        "one run: the 95% interval of its newest episodes"
        if count == 1
        else f"{counted(count, 'run')}: from the minimum to the maximum"
        for count in counts
    ]
    return "; of ".join(texts)
