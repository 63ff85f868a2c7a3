"""`rtamt init`: what it writes, and what it leaves alone."""

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main
from rtamt_gym.starters import STARTERS


def contents(folder: Path) -> dict[str, bytes]:
    """The files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("name", STARTERS)
def test_it_writes_a_specification_a_test_and_a_job_and_says_so(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", name]) == 0
    told, _, begin = capsys.readouterr().out.partition("\n\nbegin with: ")
    written = set(contents(tmp_path))
    assert set(told.splitlines()) == written
    assert begin == f"{STARTERS[name].begin}\n"
    assert {Path(each).suffix for each in written} >= {".stl", ".py", ".yml"}
    assert [each for each in written if Path(each).name.startswith("test_")]
    assert not [each for each in written if each.endswith(".txt")]


def test_it_makes_the_folder_that_it_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a b" / "gate"
    assert main(["init", "recordings", str(folder)]) == 0
    assert "recordings/monday.csv" in contents(folder)
    assert f"\nbegin with: cd '{folder}' && rtamt monitor " in capsys.readouterr().out


@pytest.mark.parametrize("there", ["requirements.stl", ".github/workflows/requirements.yml"])
def test_it_overwrites_nothing_and_then_writes_nothing(
    there: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / there).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / there).write_text("mine")
    assert main(["init", "violation", str(tmp_path)]) == 2
    assert contents(tmp_path) == {there: b"mine"}
    message = f"{tmp_path / there} would be overwritten: give another folder, rtamt init violation"
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("blocked", ["", ".github"])
def test_a_file_in_the_place_of_a_folder_is_an_error(
    blocked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "here"
    file = folder / blocked
    file.parent.mkdir(exist_ok=True)
    file.write_text("mine")
    assert main(["init", "violation", str(folder)]) == 2
    assert f"{file} is a file: give another folder" in capsys.readouterr().err
    assert set(contents(tmp_path)) == {file.relative_to(tmp_path).as_posix()}


def test_an_unknown_starter_is_an_error_that_names_those_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", "gate", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in STARTERS)
    assert contents(tmp_path) == {}
