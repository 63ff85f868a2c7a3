"""The recipes of docs/training.md for CleanRL and W&B: curves against counts by hand."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from textwrap import indent
from typing import Any

import matplotlib as mpl
import pytest
from programs import Ride, Rides, counts_of, programs, recipes, run_program, shares_of
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from wandb.proto import wandb_internal_pb2

from rtamt_gym.__main__ import main
from rtamt_gym.learners.logs import training_logs

BEGIN = "from torch.utils.tensorboard import SummaryWriter\n"
WRITER = 'writer = SummaryWriter("runs/cleanrl/seed1")\n'
STEP = "    global_step = (iteration + 1) * num_steps * num_envs\n"
PRINTED = "    for name, value in training.metrics().items():\n        print("

Points = dict[float, float]
"""The values of a curve by step."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[dict[str, Any], Rides]]:
    """Return the program of CleanRL with the recipes of both pages, in the current folder."""
    folder = tmp_path_factory.mktemp("curves")
    program = programs()["CleanRL"]
    begin = program.index(PRINTED)
    end = program.index("\n", begin + len(PRINTED)) + 1
    own = recipes()
    logged = STEP + indent(own["CleanRL"], "    ")
    setup = BEGIN + own["Weights & Biases, without a network"] + WRITER
    program = setup + program[:begin] + logged + program[end:] + "writer.close()\nwandb.finish()\n"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WANDB_MODE", "offline")  # the end of the test restores it
        patch.setenv("WANDB_SILENT", "true")
        for kind in ("CACHE", "CONFIG", "DATA", "ARTIFACT"):
            patch.setenv(f"WANDB_{kind}_DIR", str(folder / "wandb"))
        patch.chdir(folder)
        yield run_program(program, folder)


def by_hand(program: dict[str, Any], rides: Rides) -> dict[str, Points]:
    """Return the curves of the training, from the results of the environments."""
    own = [env.unwrapped for env in program["envs"].envs]
    ended: list[tuple[int, int, Ride]] = []
    for index, env in enumerate(own):
        played = [ride for ride in rides.started if ride.env is env]
        ends = accumulate(ride.steps for ride in played)
        ended += [(end, index, ride) for end, ride in zip(ends, played[:-1], strict=False)]
    ended.sort(key=lambda each: each[:2])
    curves: dict[str, Points] = {}
    for iteration in range(1, program["iterations"] + 1):
        last = iteration * program["num_steps"]
        known = [ride for end, _, ride in ended if end <= last]
        for name, value in {**shares_of(known[-100:]), **counts_of(known)}.items():
            curves.setdefault(f"stl/{name}", {})[last * program["num_envs"]] = value
    return curves


def test_event_files_of_the_loop_hold_the_curves(trained: tuple[dict[str, Any], Rides]) -> None:
    expected = by_hand(*trained)
    events = EventAccumulator("runs/cleanrl/seed1").Reload()
    assert {*events.Tags()["scalars"]} == {*expected}
    for tag, points in expected.items():
        logged = {event.step: event.value for event in events.Scalars(tag)}
        assert logged == pytest.approx(points, rel=1e-6)
    assert len(expected["stl/satisfied"]) == trained[0]["iterations"]
    assert 0 < [*expected["stl/satisfied"].values()][-1] < 1


def records_of(path: Path) -> Iterator[bytes]:
    """Return the records of a W&B file: a log of LevelDB in blocks, after seven bytes."""
    data, at, parts = path.read_bytes(), 7, b""
    while at + 7 <= len(data):
        room = 32768 - at % 32768
        if room < 7:
            at += room
            continue
        _, length, kind = struct.unpack_from("<IHB", data, at)
        parts += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # a complete record, or its last part
            yield parts
            parts = b""


def test_an_offline_run_of_wandb_holds_the_curves(trained: tuple[dict[str, Any], Rides]) -> None:
    expected = by_hand(*trained)
    (path,) = Path("runs/wandb").glob("offline-run-*/*.wandb")
    kept: dict[str, Points] = {}
    for raw in records_of(path):
        record = wandb_internal_pb2.Record()
        record.ParseFromString(raw)
        row = {
            item.key or "/".join(item.nested_key): json.loads(item.value_json)
            for item in record.history.item
        }
        for name, value in row.items():
            if name.startswith("stl/"):
                kept.setdefault(name, {})[row["global_step"]] = value
    assert {*kept} == {*expected}
    for name, points in expected.items():
        assert kept[name] == pytest.approx(points, rel=1e-6)


def test_rtamt_plot_draws_one_run(
    trained: tuple[dict[str, Any], Rides], capsys: pytest.CaptureFixture[str]
) -> None:
    expected = by_hand(*trained)
    (log,) = training_logs(Path("runs"))  # and not the links of W&B
    assert {*log.curves} == {*expected}
    for name, points in expected.items():
        steps, values = log.curves[name]
        assert dict(zip(steps, values, strict=True)) == pytest.approx(points, rel=1e-6)
    mpl.use("Agg")
    assert main(["plot", "cleanrl=runs", "-o", "training.png"]) == 0
    printed = capsys.readouterr().out
    rate = [*expected["stl/satisfied"].values()][-1]
    row = next(line.split() for line in printed.splitlines() if line.startswith("cleanrl"))
    assert row[1:4] == ["1", "all", "training"]
    assert f"{rate:.1%}" in row
    assert Path("training.png").stat().st_size > 10_000
