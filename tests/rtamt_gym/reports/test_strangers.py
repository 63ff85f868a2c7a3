"""The rights of a page of results with a foreign file: it reads, and nothing else."""

import json
import os
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main
from rtamt_gym.play.saved_case import SavedCase
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.traces import of_matrix
from rtamt_gym.reports.write import report_of, write_report

Output = pytest.CaptureFixture[str]

CASE = {
    "format": "rtamt result",
    "version": 2,
    "kind": "case",
    "rtamt": "0.5.0",
    "system": {"object": "stranger:tank"},
    "requirement": {"name": "dry", "text": "always(level < 2)"},
    "case": {},
    "seed": None,
    "duration": None,
    "period": 1,
    "signals": None,
    "policy": None,
    "reading": {},
    "expected": {"verdict": "VIOLATED", "robustness": -1.0},
    "versions": {},
}
STRANGER = """\
from pathlib import Path

Path("imported").touch()


def tank():
    yield {"level": 3.0}
"""
CONTENT = "root:x:0:0:the administrator\n"


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a case whose module leaves a file at its import."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "stranger.py").write_text(STRANGER, encoding="utf-8")
    path = tmp_path / "case.json"
    path.write_text(json.dumps(CASE), encoding="utf-8")
    return path


def test_case_page_imports_nothing(case: Path, capsys: Output) -> None:
    assert main(["report", "case.json", "-o", "page.html"]) == 0
    assert not Path("imported").exists()
    said = "a report only reads; --play runs the case, which imports stranger"
    assert f"case.json was not run: {said}" in " ".join(capsys.readouterr().err.split())
    assert said in Path("page.html").read_text(encoding="utf-8")
    for result in (case, SavedCase.load(case)):
        write_report("page.html", result)
        assert report_of(result).sections[0].not_played == said
    assert not Path("imported").exists()


def test_play_option_runs_the_case(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    (case.parent / "loud.py").write_text("import sys\nprint('loud', file=sys.stderr)\n")
    kept = CASE | {"system": {"object": "loud:none"}}
    Path("loud.json").write_text(json.dumps(kept), encoding="utf-8")
    assert main(["report", "case.json", "loud.json", "--play", "-o", "page.html"]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == [
        "playing case.json, which imports stranger",
        "playing loud.json, which imports loud",
        "loud",
    ]
    assert Path("imported").exists()
    page = Path("page.html").read_text(encoding="utf-8")
    assert "Played again for this page, the case gave the same robustness." in page
    Path("imported").unlink()
    monkeypatch.delitem(__import__("sys").modules, "stranger")
    write_report("page.html", case, play=True)
    assert Path("imported").exists()


@pytest.mark.parametrize(
    ("kept", "imports"),
    [
        ({"system": {"object": "os:abort"}}, ("os",)),
        ({"system": {"environment": "CartPole-v1"}}, ("gymnasium (CartPole-v1)",)),
        (
            {"system": {"environment": "rtamt/RequestGrant-v0"}},
            ("rtamt_envs (rtamt/RequestGrant-v0)",),
        ),
        ({"system": {"environment": "own.pkg:Name-v0"}}, ("own.pkg (Name-v0)",)),
        ({"system": {"fmus": {"a": "x/a.fmu", "b": "b.fmu"}}}, ("x/a.fmu", "b.fmu")),
        ({"policy": "pilot:steer"}, ("stranger", "pilot")),
        ({"policy": "sb3:model.zip"}, ("stranger", "model.zip, which is unpickled")),
        ({"policy": "zero"}, ("stranger",)),
        ({"system": {}}, ()),
    ],
)
def test_imports_of_case(tmp_path: Path, kept: dict[str, object], imports: tuple[str, ...]) -> None:
    path = tmp_path / "case.json"
    path.write_text(json.dumps(CASE | kept), encoding="utf-8")
    assert SavedCase.load(path).imports == imports


def test_docs_state_that_a_case_is_code(capsys: Output) -> None:
    main(["replay", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "A case is code of its author, as a pickle is" in said
    assert "modules, policies, FMUs" in said
    assert "A case is code of its author, as a pickle is" in (SavedCase.__doc__ or "")


def outcomes_of(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output) -> str:
    """Return the JSON of ``rtamt monitor --json`` for a trace with another name."""
    monkeypatch.chdir(folder)
    (folder / "t.csv").write_text("x\n1\n5\n", encoding="utf-8")
    main(["monitor", "always(x < 3)", "--json", "t.csv"])
    kept = json.loads(capsys.readouterr().out)
    del kept["files"]
    return json.dumps(kept).replace("t.csv", name)


def note_of(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output) -> str:
    """Return the note of a page on the worst trace, which it does not show."""
    kept = json.loads(outcomes_of(name, folder, monkeypatch, capsys))
    (shown,) = of_matrix(kept, folder, ROOM).requirements
    assert shown.worst == ()
    return shown.note


@pytest.mark.parametrize("way", ["absolute", "above", "link", "linked folder"])
def test_trace_outside_folders_is_not_opened(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    inside, outside = tmp_path / "in", tmp_path / "out"
    inside.mkdir()
    outside.mkdir()
    (outside / "x.csv").write_text("x\n1\n5\n", encoding="utf-8")
    (inside / "link.csv").symlink_to(outside / "x.csv")
    (inside / "linked").symlink_to(outside)
    name = {
        "absolute": str(outside / "x.csv"),
        "above": "../out/x.csv",
        "link": "link.csv",
        "linked folder": "linked/x.csv",
    }[way]
    assert "no regular file of this name lies below" in note_of(name, inside, monkeypatch, capsys)
    # The command line reads it from its folder too.
    Path("o.json").write_text(outcomes_of(name, inside, monkeypatch, capsys), encoding="utf-8")
    assert main(["report", "o.json", "-o", "page.html", "--traces", str(outside)]) == 0
    page = Path("page.html").read_text(encoding="utf-8")
    assert "no regular file of this name" not in page
    assert main(["report", "o.json", "-o", "page.html", "--traces", "nowhere"]) == 2
    assert "--traces: expected a folder, got nowhere" in capsys.readouterr().err


def test_pipe_is_not_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("", encoding="utf-8")
    os.mkfifo(bag / "x.db3")
    for name in ("pipe.csv", "bag", "nothing.csv", "a\0b.csv"):
        note = note_of(json.dumps(name)[1:-1], tmp_path, monkeypatch, capsys)
        assert "no regular file of this name lies below" in note


@pytest.mark.parametrize("name", ["secret", "secret.csv", "secret.parquet", "secret.jsonl"])
def test_note_has_no_content_of_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    (tmp_path / name).write_text(CONTENT, encoding="utf-8")
    note = note_of(name, tmp_path, monkeypatch, capsys)
    assert note.endswith(
        "is not shown in full: it can no longer be read as before; rtamt monitor reports the "
        "reason."
    )
    assert "root" not in note
    assert "administrator" not in note
