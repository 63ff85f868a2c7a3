"""Texts of foreign files and names write no commands and no control characters anywhere."""

import json
import os
import unicodedata
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import run_unread
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

import rtamt
from rtamt.errors import InputError, Message, shown, shown_lines
from rtamt_gym.__main__ import main
from rtamt_gym.results.provenance import file_hash

Output = pytest.CaptureFixture[str]
EVIL = "a\x1b[31m\r\n::error::b\u202e\x85\u2028c"
HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def harmless(text: str) -> bool:
    """Return whether a text has only tabs and line ends as control characters, and no command."""
    fine = all(c in "\n\t" or unicodedata.category(c) not in HIDDEN for c in text)
    return fine and not any(word.startswith(("::", "##[", "##vso[")) for word in text.split())


@given(st.text())
def test_a_shown_text_is_harmless_and_in_one_line(text: str) -> None:
    for made, more in ((shown(text), False), (shown_lines(text), True)):
        assert harmless(made)
        assert more or "\n" not in made
        assert harmless(str(InputError(text)))
    assert shown(shown(text)) == shown(text)
    plain = "".join(c for c in text if c.isalnum())
    assert shown(plain) == shown_lines(plain) == plain


def test_messages_keep_their_arguments() -> None:
    error = InputError("got \x1b; ", rtamt.errors.Argument("nan", "hold"))
    assert str(error) == "got \\x1b; nan='hold'"
    assert error.arguments == ("nan",)
    assert isinstance(InputError(Message("a\nb")).message, Message)


def test_a_parse_error_shows_the_line_and_its_place_without_control_characters() -> None:
    with pytest.raises(rtamt.ParseError) as caught:
        rtamt.parse("always(x >\x07\x1b 1 ]")
    text = str(caught.value)
    assert harmless(text)
    line, caret = text.split("\n")[1:3]
    assert "\\x07" in line
    assert len(caret) <= len(line) + 1


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "npz"])
def test_a_column_is_called_as_it_is_shown(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    name = EVIL if kind != "mat" else "a_c"
    path = f"t.{kind}"
    match kind:
        case "csv":
            Path(path).write_text(f'"{name}"\n1\n2\n', encoding="utf-8", newline="")
        case "parquet":
            pq.write_table(pa.table({name: [1.0, 2.0]}), path)
        case "mat":
            savemat(path, {name: np.array([1.0, 2.0])})
        case "npz":
            np.savez(path, **{name: np.array([1.0, 2.0])})  # type: ignore[arg-type]  # numpy's
    assert main(["monitor", "always(x < 1)", path]) == 2
    out, err = capsys.readouterr()
    assert harmless(out + err)
    assert len(err.splitlines()) == 1
    asked = ["monitor", "always(x < 9)", "--signal", f"x={shown(name)}", path]
    assert main(asked) == 0
    assert harmless(capsys.readouterr().out)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("good", [True, False])
def test_a_file_may_have_any_name(
    *, good: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    names = [os.fsdecode(b"\xff.csv"), "::error::x.csv", EVIL.replace("\0", "") + ".csv"]
    for name in names:
        Path(name).write_text("x\n1\n5\n" if good else "x\n1\n!\n", encoding="utf-8")
    files = ["--junit", "o.xml", "--markdown", "o.md"]
    for some in (names, names[:1], names[1:2], names[2:]):
        code = main(["monitor", "always(x < 3)", *files, "--", *some])
        assert code == (1 if good else 2)
        out, err = capsys.readouterr()
        assert harmless(out + err)
        assert len(err.splitlines()) <= len(some)
        markdown = Path("o.md").read_text(encoding="utf-8")
        assert harmless(markdown)
        assert "udcff" in markdown or some[0] != names[0]
        suites = ET.fromstring(Path("o.xml").read_bytes())  # noqa: S314 - it is ours
        assert [each.get("name") for each in suites] == [shown(name) for name in some]
        assert main(["monitor", "always(x < 3)", "--json", "--", *some]) == code
        kept = json.loads(capsys.readouterr().out)
        assert kept["files"] == {shown(name): file_hash(name) for name in some}
        Path("o.json").write_text(json.dumps(kept), encoding="utf-8")
        assert main(["report", "o.json", "-o", "page.html"]) == 0
        page = Path("page.html").read_text(encoding="utf-8")
        body = page[page.index("<body") : page.index("</main>")]
        assert harmless(body)
        capsys.readouterr()


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("stem", [EVIL, "::error::x"], ids=["controls", "command"])
@pytest.mark.parametrize(
    ("before", "behind"),
    [
        (["monitor"], ["--", "t.csv", "u.csv"]),
        (["monitor", "--mutants"], ["t.csv"]),
        (["check"], []),
        (["examples"], []),
        (["run", "CartPole-v1", "--policy", "zero", "--signal", "x=obs[0]", "--spec"], []),
        (
            ["falsify", "rtamt/RequestGrant-v0", "--signal", "x=obs[0]", "--budget", "1"],
            [],
        ),
    ],
    ids=["monitor", "mutants", "check", "examples", "run", "falsify"],
)
def test_a_requirement_is_called_after_its_file_as_that_is_shown(
    before: list[str],
    behind: list[str],
    stem: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"{stem}.stl").write_text("always(x < 3 implies eventually[0:1](x > 4))")
    for name in ("t.csv", "u.csv"):
        Path(name).write_text("time,x\n0,1\n1,5\n2,1\n", encoding="utf-8")
    assert main([*before, f"{stem}.stl", *behind]) in {0, 1, 3}
    out, err = capsys.readouterr()
    assert harmless(out + err)
    assert shown(stem)[:12] in out


def test_a_replay_shows_names_and_versions_of_its_case_escaped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    vary = ["--vary", "height=2:8", "--vary", "limit=0:5"]
    assert main(["falsify", "rtamt/RequestGrant-v0", "granted", *vary, "--save", "c.json"]) == 1
    capsys.readouterr()
    kept = json.loads(Path("c.json").read_text(encoding="utf-8"))
    kept["requirement"]["name"] = EVIL
    kept["versions"] = {"numpy": EVIL}
    kept["expected"]["robustness"] = 7.0
    Path("c.json").write_text(json.dumps(kept), encoding="utf-8")
    assert main(["replay", "c.json", "--explain"]) == 0
    out, err = capsys.readouterr()
    assert harmless(out + err)
    assert out.startswith(f"{shown(EVIL)} of rtamt/RequestGrant-v0\n")
    kept["system"]["environment"] = EVIL
    Path("c.json").write_text(json.dumps(kept), encoding="utf-8")
    assert main(["report", "c.json", "--play", "-o", "page.html"]) == 3
    out, err = capsys.readouterr()
    assert harmless(out + err)
    assert err.startswith("playing c.json, which imports a\\x1b[31m")


def test_ids_of_environments_and_arguments_are_shown_escaped(capsys: Output) -> None:
    for words in (
        ["run", EVIL, "--policy", "zero"],
        ["monitor", EVIL, "t.csv"],
        ["run", f"--{EVIL}"],
    ):
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert harmless(out + err)


def test_a_page_of_a_file_of_a_stranger_has_no_control_characters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("x\n1\n5\n", encoding="utf-8")
    main(["monitor", "always(x < 3)", "--json", "t.csv"])
    text = capsys.readouterr().out.replace('"t.csv"', json.dumps(EVIL))
    Path("o.json").write_text(text, encoding="utf-8")
    assert main(["report", "o.json", "-o", "page.html"]) == 0
    page = Path("page.html").read_text(encoding="utf-8")
    body = page[page.index("<body") : page.index("</main>")]
    assert harmless(body)
    data = page[page.index('id="data">') + 10 :]
    assert "\\u001b" not in data[: data.index("</script>")]


@pytest.mark.slow
def test_outputs_are_written_though_nobody_reads_what_is_printed(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("x\n" + "1\n" * 9, encoding="utf-8")
    specs = [f"long_name_{i} = always(x < {i})" for i in range(300)]
    words = ["monitor", *specs, "--junit", "o.xml", "--markdown", "o.md", "--", "t.csv", "t.csv"]
    for more in ([], ["--json"]):
        code, said = run_unread([*words[:-3], *more, *words[-3:]], tmp_path)
        assert code == 141
        assert b"Traceback" not in said
        assert (tmp_path / "o.xml").read_bytes().endswith(b"</testsuites>\n")
        for name in ("o.xml", "o.md"):
            (tmp_path / name).unlink()
