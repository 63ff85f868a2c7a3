"""`rtamt watch` prints the notes and warnings that `rtamt monitor` prints on the same rows."""

import json
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]

TABLES = {
    "even": "time,x\n0,1\n100,2\n200,3\n300,1\n",
    "uneven": "time,x\n0,1\n100,2\n250,3\n300,1\n",
    "fine": "time,x\n0,1\n0.5,2\n1,3\n",
    "one": "time,x\n0,1\n",
    "unit": "time [ms],x\n0,1\n100,2\n200,3\n",
    "comma": "time;x\n0,0;1,5\n0,5;2,5\n",
    "groups": "time,x\n0,1.500\n0.5,2.250\n1,3.125\n",
    "digits": "time,x\n0,1.500\n0.5,2.250\n1,3.12\n",
    "empty": "time,x\n0,1\n0.5,\n1,2\n1.5,\n",
}

CASES = [
    ("even", []),
    ("even", ["--dense"]),
    ("even", ["--align", "outward"]),
    ("even", ["--time-unit", "ms"]),
    ("uneven", ["--dense"]),
    ("fine", []),
    ("one", []),
    ("unit", []),
    ("comma", []),
    ("comma", ["--decimal", ","]),
    ("groups", ["--decimal", "."]),
    ("digits", ["--decimal", "."]),
    ("empty", ["--missing", "hold"]),
    ("empty", ["--missing", "drop"]),
    ("empty", ["--missing", "unknown"]),
    ("empty", ["--missing", "unknown", "--dense"]),
    ("empty", ["--missing", "hold", "--dense"]),
]


@pytest.mark.parametrize(("name", "options"), CASES)
def test_a_stream_has_the_notes_of_its_file(
    name: str, options: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(TABLES[name])
    spec = "always(x > -9)"
    code = main(["monitor", spec, str(path), "--json", *options])
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    expected = [note.replace(f"{path}, ", "") for note in trial.get("notes", [])]
    assert main(["watch", spec, str(path), *options]) == code
    assert capsys.readouterr().err.splitlines() == expected


@pytest.mark.parametrize("options", [[], ["--dense"]])
def test_a_variable_alone_is_a_warning(options: list[str], capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,p,q\n0.0,0,0\n0.5,0,0\n")
    main(["monitor", "always(p or q)", str(path), "--json", *options])
    expected = capsys.readouterr().err.split()
    main(["watch", "always(p or q)", str(path), *options])
    assert capsys.readouterr().err.split() == expected
    assert "alone" in expected


def test_the_unit_of_times_is_the_first_hint_at_a_bound(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(TABLES["even"])
    assert main(["watch", "always[0:2](x > 0)", str(path)]) == 2
    errors = capsys.readouterr().err
    assert "if these are milliseconds, --time-unit ms; if seconds, --time-unit s" in errors
    assert "--align" not in errors


@pytest.mark.parametrize(
    ("spec", "offered"), [("always[0:2](x > 0)", False), ("always(x > 0)", True)]
)
def test_times_are_left_aside_only_without_bounds(
    spec: str,
    offered: bool,  # noqa: FBT001
    capsys: Output,
    tmp_path: Path,
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n0.0,1\n1.0,1\n3.0,1\n")
    assert main(["watch", spec, str(path)]) == 2
    errors = capsys.readouterr().err
    assert "give --dense" in errors
    assert ("--period to leave the times aside" in errors) == offered
