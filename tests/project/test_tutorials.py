"""The tutorials and their starters: their text matches their behaviour."""

import doctest
import re
from pathlib import Path

import pytest
from paths import EXAMPLES, ROOT
from tutorials import Reader, blocks_of, commands_of

from rtamt_gym.starters import JOB, STARTERS, write_starter

TUTORIALS = ROOT / "docs" / "tutorials"
PLAYED = [name for name in STARTERS if name != "robot"]
"""Tutorials that are run here; tests/ros runs the tutorial of a robot."""


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Reader:
    """Return a reader in an empty folder."""
    return Reader(tmp_path, monkeypatch)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("name", PLAYED)
def test_a_tutorial_shows_what_happens(name: str, reader: Reader, tmp_path: Path) -> None:
    checker = doctest.OutputChecker()
    page = (TUTORIALS / f"{name}.md").read_text(encoding="utf-8")
    played = 0
    for block in blocks_of(page):
        if block.language == "console":
            for command, shown in commands_of(block.text):
                given = reader.gives(command)
                assert checker.check_output(shown, given, doctest.ELLIPSIS), f"{command}\n{given}"
                played += 1
        elif block.language == "diff":
            assert block.file is not None
            reader.changes(block.file, block.text)
        elif block.file is not None:
            assert (tmp_path / block.file).read_text(encoding="utf-8") == block.text
        elif ">>>" in block.text:
            assert reader.python(block.text, name) == []
        else:
            assert block.language in {"sh", "text"}, "say of which file the block is, or run it"
    assert played > 4


def test_every_starter_has_its_tutorial() -> None:
    pages = {page.stem for page in TUTORIALS.glob("*.md")}
    assert pages == set(STARTERS)


def run_lines(text: str) -> list[str]:
    """Return the commands of a job or an action, without installations."""
    lines = [line.strip() for line in re.findall(r"^ +(?:- )?run: (.+)$", text, re.MULTILINE)]
    assert lines[0].startswith("pip install ")
    return lines[1:]


@pytest.mark.slow
@pytest.mark.parametrize("name", STARTERS)
def test_the_job_of_a_starter_is_green(name: str, reader: Reader, tmp_path: Path) -> None:
    write_starter(name, tmp_path)
    job = (tmp_path / JOB).read_text(encoding="utf-8")
    assert f"rtamt-stl[{STARTERS[name].extras}] @ $RTAMT" in job
    for line in run_lines(job):
        said = reader.gives(line, GITHUB_STEP_SUMMARY="summary.md")
        assert reader.code == 0, said
    assert (tmp_path / "outcomes.xml").read_text(encoding="utf-8").count("<testcase") > 0


@pytest.mark.slow
def test_the_action_is_red_where_a_recording_violates(reader: Reader, tmp_path: Path) -> None:
    write_starter("recordings", tmp_path)
    text = (EXAMPLES / "ci" / "action.yml").read_text(encoding="utf-8")
    (judge,) = run_lines(text)
    inputs = {
        "SPECIFICATIONS": "requirements.stl",
        "TRACES": "recordings",
        "OPTIONS": "--require-triggered",
        "JUNIT": "outcomes.xml",
        "GITHUB_STEP_SUMMARY": "summary.md",
    }
    used = re.findall(r"(\w+): \${{ inputs\.(\w+) }}", text)
    assert {variable: name.upper() for variable, name in used} == {
        each: each for each in {*inputs, "RTAMT"} - {"GITHUB_STEP_SUMMARY"}
    }
    reader.gives(judge, **inputs)
    assert reader.code == 0
    assert (tmp_path / "summary.md").read_text(encoding="utf-8").startswith("# SATISFIED")
    reader.gives(judge, **inputs | {"TRACES": "recordings known/late.csv"})
    assert reader.code == 1


@pytest.mark.slow
def test_the_hooks_pass_a_good_commit_and_refuse_a_bad_one(reader: Reader, tmp_path: Path) -> None:
    write_starter("recordings", tmp_path)
    text = (EXAMPLES / "ci" / "pre-commit-config.yaml").read_text(encoding="utf-8")
    check, monitor = re.findall(r"entry: (.+)", text)
    specifications, inputs = (re.compile(each) for each in re.findall(r"files: (.+)", text))
    assert specifications.search("requirements.stl")
    assert inputs.search("recordings/monday.csv")
    assert not inputs.search("known/late.csv")
    codes = {}
    for command in (f"{check} requirements.stl", monitor):
        reader.gives(command)
        codes[command] = reader.code
    assert set(codes.values()) == {0}
    (tmp_path / "never.stl").write_text("no = always(speed < 0 and speed > 1)")
    (tmp_path / "known" / "late.csv").rename(tmp_path / "recordings" / "wednesday.csv")
    for command in (f"{check} never.stl", monitor):
        reader.gives(command)
        codes[command] = reader.code
    assert codes[f"{check} never.stl"] == codes[monitor] == 1
