"""Ids, versions and hashes of files: results have them, and reading restores them."""

import hashlib
import json
import platform
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt.language import RequirementId
from rtamt_gym import Parameter, compare, evaluate_policy, sweep
from rtamt_gym.__main__ import main
from rtamt_gym.play.record import Record
from rtamt_gym.reports.html import render
from rtamt_gym.reports.write import report_of
from rtamt_gym.results import Comparison, Evaluation
from rtamt_gym.results.codec import plain, provenance_of, read
from rtamt_gym.results.provenance import (
    Provenance,
    file_hash,
    ids_lines,
)

Output = pytest.CaptureFixture[str]

SPEC = """
@ id(dry, "SYS-REQ-7", "https://reqs.example/{id}")
@ id(wet, "W & 4711")
dry = always(level < 2)
wet = always(level > 0)
calm = always(level < 9)
"""
IDS = {
    "dry": RequirementId("SYS-REQ-7", "https://reqs.example/SYS-REQ-7"),
    "wet": RequirementId("W & 4711"),
}
TEXTS = st.text(min_size=1).filter(lambda text: text.strip() and not set(text) & set('"\r\n'))


@given(
    st.dictionaries(st.text(), st.builds(RequirementId, TEXTS, TEXTS.map("https://{}".format))),
    st.dictionaries(st.text(), st.text()),
    st.dictionaries(st.text(), st.text()),
)
def test_provenance_round_trip(
    ids: dict[str, RequirementId], versions: dict[str, str], files: dict[str, str]
) -> None:
    made = Provenance(ids, versions, files)
    text = json.dumps(plain(made))
    assert provenance_of(json.loads(text)) == made


def test_empty_provenance_is_not_written() -> None:
    assert plain(Provenance()) == {}
    assert provenance_of({}) == Provenance()
    assert ids_lines(Provenance()) == []


@pytest.fixture
def traces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(tmp_path)
    Path("tank.stl").write_text(SPEC, encoding="utf-8")
    for name, level in (("a.csv", 1), ("b.csv", 3)):
        Path(name).write_text(f"time,level\n0,{level}\n1,{level}\n", encoding="utf-8")
    return ["tank.stl", "--", "a.csv", "b.csv"]


def test_json_of_traces_has_provenance(traces: list[str], capsys: Output) -> None:
    main(["monitor", "--json", *traces])
    kept = json.loads(capsys.readouterr().out)
    assert kept["ids"] == {
        "dry": {"id": "SYS-REQ-7", "link": "https://reqs.example/SYS-REQ-7"},
        "wet": {"id": "W & 4711"},
    }
    assert kept["versions"]["python"] == platform.python_version()
    assert kept["versions"]["rtamt"] == rtamt.__version__
    assert kept["files"] == {
        name: hashlib.sha256(Path(name).read_bytes()).hexdigest()
        for name in ("tank.stl", "a.csv", "b.csv")
    }


def test_formula_and_stdin_have_no_hash(traces: list[str], capsys: Output) -> None:
    assert main(["monitor", "--json", "always(level < 2)", "a.csv"]) == 0
    assert list(json.loads(capsys.readouterr().out)["files"]) == ["a.csv"]
    assert traces
    for path in ("-", ".", "no such file", "with\0zero"):
        assert file_hash(path) == ""


def test_terminal_shows_ids(traces: list[str], capsys: Output) -> None:
    assert main(["monitor", *traces]) == 1
    assert "\nids: dry SYS-REQ-7, wet W & 4711\n" in capsys.readouterr().out
    assert main(["monitor", "tank.stl", "a.csv"]) == 0
    assert "\nids: dry SYS-REQ-7, wet W & 4711\n" in capsys.readouterr().out
    many = Provenance({f"r{i}": RequirementId(f"SYS-REQ-{i}") for i in range(20)})
    assert max(map(len, ids_lines(many))) <= 80
    assert " ".join(map(str.strip, ids_lines(many))).count("SYS-REQ-") == 20


def test_junit_has_id_and_link(traces: list[str]) -> None:
    main(["monitor", "--junit", "out.xml", *traces])
    cases = ET.fromstring(Path("out.xml").read_bytes()).iter("testcase")  # noqa: S314 - our own
    found = [
        (case.get("name"), {p.get("name"): p.get("value") for p in case.iter("property")})
        for case in cases
    ]
    each = [
        ("dry", {"id": "SYS-REQ-7", "link": "https://reqs.example/SYS-REQ-7"}),
        ("wet", {"id": "W & 4711"}),
        ("calm", {}),
    ]
    assert found == each * 2


def test_markdown_links_ids(traces: list[str]) -> None:
    main(["monitor", "--markdown", "out.md", *traces])
    text = Path("out.md").read_text(encoding="utf-8")
    assert "\ndry: [SYS-REQ-7](https://reqs.example/SYS-REQ-7)\n" in text
    assert "\nwet: W & 4711\n" in text


def tank(inflow: float) -> Iterator[dict[str, float]]:
    for i in range(5):
        yield {"level": inflow * i}


def test_sweep_files_keep_ids(tmp_path: Path) -> None:
    space = [Parameter("inflow", 0.1, 0.9)]
    done = sweep(tank, rtamt.parse(SPEC), space, samples=3, sampler="grid", period=1)
    assert done.record.provenance.ids == IDS
    done.record.save(tmp_path / "record.parquet")
    loaded = Record.load(tmp_path / "record.parquet")
    assert loaded == done.record
    assert loaded.provenance == done.record.provenance
    assert loaded[:1].provenance == loaded.violated().provenance == loaded.provenance


def test_evaluation_keeps_ids(tmp_path: Path) -> None:
    spec = '@ id(upright, "SYS-REQ-7"); upright = always(abs(angle) < 0.1)'
    found = evaluate_policy("zero", "CartPole-v1", spec, {"angle": "obs[2]"}, episodes=2)
    assert "\nupright (SYS-REQ-7): always(abs(angle) < 0.1)\n" in str(found)
    found.save(tmp_path / "found.json")
    assert read(tmp_path / "found.json")["ids"] == {"upright": {"id": "SYS-REQ-7"}}
    compared = compare(found, found)
    assert compared.ids == {"upright": RequirementId("SYS-REQ-7")}
    compared.save(tmp_path / "compared.json")
    assert Comparison.load(tmp_path / "compared.json") == compared
    assert read(tmp_path / "compared.json")["ids"] == {"upright": {"id": "SYS-REQ-7"}}
    page = render(report_of(tmp_path / "compared.json"))
    assert page.count('<span class="req-id">SYS-REQ-7</span>') == 2
    loaded = Evaluation.load(tmp_path / "found.json")
    assert loaded.record.provenance == found.record.provenance
    assert "gymnasium" in loaded.record.provenance.versions


def test_json_has_hash_of_specification(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    text = '@ id(answered, "7"); answered = always(req >= 3 implies eventually[0:5](gnt >= 3))'
    Path("req.stl").write_text(text, encoding="utf-8")
    sha = {"req.stl": file_hash("req.stl")}
    scenario = ["rtamt/RequestGrant-v0", "--vary", "limit=1:2"]
    assert (
        main(["sweep", *scenario, "--requirement", "req.stl", "--samples", "2", "--json", "s.json"])
        == 0
    )
    assert read("s.json")["files"] == sha
    capsys.readouterr()
    name, *vary = scenario
    main(["falsify", name, "req.stl", *vary, "--budget", "2", "--no-reduce", "--json"])
    kept = json.loads(capsys.readouterr().out)
    assert (kept["files"], kept["ids"]) == (sha, {"answered": {"id": "7"}})
