"""Annotations: ids of requirements and columns of variables, in texts, parts and pickles."""

from __future__ import annotations

import copy
import pickle
import zipfile
from pathlib import Path
from urllib.parse import quote

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import Specification, SpecificationError
from rtamt.language import RequirementId

TEXT = """specification drive
@ id(apart, "SYS-REQ-7", "https://reqs.example/{id}?from=ci")
@ id(drive, "Höhe 3/4 // not a comment")
gap = abs(x - y)
apart = always(gap > 1)
slow = always(v < 5)
always(x > 0)
"""

ids = st.text(
    st.characters(exclude_characters='"\r\n', exclude_categories=["Cs"]), min_size=1, max_size=30
).filter(lambda text: text.strip() != "")


def test_ids_belong_to_formulas_and_to_the_whole() -> None:
    spec = rtamt.parse(TEXT)
    link = "https://reqs.example/SYS-REQ-7?from=ci"
    long_id = RequirementId("Höhe 3/4 // not a comment")
    assert spec.ids == {"apart": RequirementId("SYS-REQ-7", link), "drive": long_id}
    assert spec.id == long_id
    by_name = {name: item.id for name, item in spec.requirements.items()}
    assert by_name == {"apart": spec.ids["apart"], "slow": None, "drive": long_id}
    assert str(by_name["apart"]) == "SYS-REQ-7"


@pytest.mark.parametrize("name", ["drive", "apart"])
def test_title_names_single_requirement(name: str) -> None:
    spec = rtamt.parse(f'specification drive; @ id({name}, "7"); gap = x - y; apart = gap > 1')
    assert spec.id == RequirementId("7")
    assert spec.ids == {"apart": RequirementId("7")}
    assert spec.requirements["drive"].id == RequirementId("7")


def test_a_part_has_no_id_and_no_formula_means_no_id() -> None:
    spec = rtamt.parse('specification drive; @ id(drive, "7"); always(x > 0)')
    assert spec.id == RequirementId("7")
    assert spec.always().id is None
    assert rtamt.parse("always(x > 0)").id is None
    assert Specification.of(spec.formula).id is None


def test_ids_distinguish_specifications() -> None:
    one, two, none = (
        rtamt.parse(f"{note}p = x > 0") for note in ('@ id(p, "1"); ', '@ id(p, "2"); ', "")
    )
    assert one != two != none != one
    assert one == rtamt.parse('p = x > 0\n@ id(p, "1")')


@given(label=ids, path=st.none() | ids)
def test_text_pickle_and_copy_keep_any_id_and_link(label: str, path: str | None) -> None:
    link = "" if path is None else f"https://reqs.example/{path}/{{id}}"
    note = f', "{link}"' if link else ""
    spec = rtamt.parse(f'@ id(b, "{label}"{note}); a = x > 0; b = always(y > 0)')
    assert spec.id == RequirementId(label, link)
    for other in (rtamt.parse(str(spec)), pickle.loads(pickle.dumps(spec)), copy.deepcopy(spec)):
        assert other == spec
        assert other.ids == spec.ids
    for name, part in spec.requirements.items():
        again = rtamt.parse(str(part))
        assert again.id == part.id == (spec.id if name == "b" else None)


@given(label=ids)
def test_an_id_made_in_python_is_the_one_that_is_read(label: str) -> None:
    rid = RequirementId(label, "http://reqs.example/{id}/{id}")
    text = f'@ id(p, "{label}", "http://reqs.example/{{id}}/{{id}}"); p = x > 0'
    assert rtamt.parse(text).id == rid
    assert rid.link == f"http://reqs.example/{quote(label, safe='')}/{quote(label, safe='')}"


@pytest.mark.parametrize("label", ["", "  ", 'a"b', "a\nb", "a\rb"])
def test_what_no_text_could_say_is_no_id(label: str) -> None:
    with pytest.raises(SpecificationError, match="expected"):
        RequirementId(label)


@pytest.mark.parametrize("link", ["javascript:alert(1)", "reqs.example", " https://x", "file:///x"])
def test_only_addresses_of_the_web_are_links(link: str) -> None:
    with pytest.raises(SpecificationError, match="starts with https:// or http://"):
        RequirementId("7", link)


def test_parts_leave_out_topics_of_what_they_do_not_have() -> None:
    spec = rtamt.parse("@ topic(v, a/b); @ topic(x, c); apart = x > 1; slow = v < 5")
    for name, topics in (("apart", {"x": "c"}), ("slow", {"v": "a/b"})):
        part = spec.requirements[name]
        assert part.topics == topics
        assert rtamt.parse(str(part)).topics == topics


@pytest.mark.parametrize("parts", [(3,), ("SYS-1", 3), (None,)])
def test_an_id_that_is_no_text_is_refused(parts: tuple[object, ...]) -> None:
    with pytest.raises(rtamt.InputTypeError) as error:
        RequirementId(*parts)  # type: ignore[arg-type]
    assert str(error.value) == f"expected id and link as text, got {parts[-1]!r}"


COLUMNS = (
    "float level\nfloat other\n"
    '@ column(level, "Level [mm]")\n@ column(other, "Other; // no comment")\n'
    "high = always(level < 5)\nlow = always(other > 0)"
)


def test_a_text_is_printed_with_its_columns() -> None:
    spec = rtamt.parse(COLUMNS)
    assert spec.columns == {"level": "Level [mm]", "other": "Other; // no comment"}
    assert str(spec) == COLUMNS
    assert rtamt.parse(str(spec)) == spec
    assert rtamt.parse(COLUMNS.replace("[mm]", "[m]")) != spec


@given(st.text(st.characters(exclude_characters='"\r\n', codec="utf-8"), min_size=1))
def test_any_name_without_quotes_is_kept(name: str) -> None:
    if not name.strip():
        return
    spec = rtamt.parse(f'@ column(x, "{name}")\nx > 0')
    assert spec.columns == {"x": name}
    assert rtamt.parse(str(spec)).columns == {"x": name}


def test_requirements_keep_the_columns_that_they_read() -> None:
    parts = rtamt.parse(COLUMNS).requirements
    assert {name: dict(part.columns) for name, part in parts.items()} == {
        "high": {"level": "Level [mm]"},
        "low": {"other": "Other; // no comment"},
    }
    for part in parts.values():
        assert rtamt.parse(str(part)).columns == part.columns


def test_other_results_keep_readable_texts() -> None:
    spec = rtamt.parse('@ column(x, "X [m]")\n@ column(y, "Y [m]")\nx > 0 and y > 0')
    single = spec.with_result(spec.formula.args[0])  # type: ignore[arg-type]
    assert rtamt.parse(str(single)) == single
    assert single.columns == {"x": "X [m]"}


def test_mutants_carry_columns() -> None:
    mutants = rtamt.mutants(rtamt.parse(COLUMNS).requirements["high"])
    assert mutants
    assert {item.specification.columns["level"] for item in mutants} == {"Level [mm]"}


def test_fields_of_messages_have_columns() -> None:
    spec = rtamt.parse('@ column(cmd.linear.x, "v")\ncmd.linear.x > 0')
    assert spec.columns == {"cmd.linear.x": "v"}


def test_fmus_describe_columns(tmp_path: Path) -> None:
    rtamt.parse(COLUMNS).requirements["high"].export_fmu(tmp_path / "one.fmu", period=1)
    with zipfile.ZipFile(tmp_path / "one.fmu") as unit:
        text = unit.read("modelDescription.xml").decode()
    assert "a variable of the specification; column Level [mm]" in text
