"""Files of other versions: Parquet files of version 0.5 are read, other results are refused."""

import json
import math
from pathlib import Path

import pytest
from paths import ROOT

from rtamt import InputError
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.write import section_of
from rtamt_gym.results import Run, SavedCase, Sweep
from rtamt_gym.results.codec import read

FILES = ROOT / "tests" / "golden" / "results_v1"
GRANTED = [
    ("VIOLATED", -0.03766087628901005, 10.1),
    ("SATISFIED", 2.2414808506146073, 10.0),
    ("VIOLATED", -1.44402608089149, 5.1),
    ("SATISFIED", 1.3613133756443858, 10.0),
]


def test_sweep_of_version_0_5() -> None:
    sweep = Sweep.load(FILES / "sweep.parquet")
    outcomes = [row.outcomes["granted"] for row in sweep.record]
    assert [(each.verdict.name, each.robustness, each.decided_at) for each in outcomes] == GRANTED
    assert section_of(FILES / "sweep.parquet", ROOM).requirements


def test_run_of_version_0_5() -> None:
    run = Run.load(FILES / "run.parquet")
    (course,) = run.histories.values()
    assert course.verdict.name == "VIOLATED"
    assert course.decided_at == run.violated_at
    assert math.copysign(1.0, course.final) < 0
    assert run.case is not None
    assert section_of(FILES / "run.parquet", ROOM).requirements


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ({"format": "rtamt case 1"}, r"holds a result of version 1, .* version 2; make it again"),
        ({"format": "rtamt result", "version": 3, "kind": "case"}, "3, .*; install a newer rtamt"),
        ({"format": "rtamt evaluation 2"}, "holds no case: expected a file that"),
        ({"episodes": [], "specs": {}}, "holds no case"),
        ({"format": "rtamt result", "version": "2", "kind": "runs"}, "holds no case"),
        ({"format": "rtamt result", "version": 2, "kind": "dreams"}, "a result of kind 'dreams'"),
        ([1], "holds no case"),
    ],
)
def test_other_versions_and_kinds_error(head: object, message: str, tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    path.write_text(json.dumps(head), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        SavedCase.load(path)
    with pytest.raises(InputError):
        read(path, ["runs"])
