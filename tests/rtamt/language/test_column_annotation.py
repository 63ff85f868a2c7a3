"""``@ column(x, "Level [mm]")``: the column of a variable in recorded tables."""

import zipfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

import rtamt

TEXT = (
    "float level\nfloat other\n"
    '@ column(level, "Level [mm]")\n@ column(other, "Other; // no comment")\n'
    "high = always(level < 5)\nlow = always(other > 0)"
)


def test_a_text_is_printed_with_its_columns() -> None:
    spec = rtamt.parse(TEXT)
    assert spec.columns == {"level": "Level [mm]", "other": "Other; // no comment"}
    assert str(spec) == TEXT
    assert rtamt.parse(str(spec)) == spec
    assert rtamt.parse(TEXT.replace("[mm]", "[m]")) != spec


@given(st.text(st.characters(exclude_characters='"\r\n', codec="utf-8"), min_size=1))
def test_any_name_without_quotes_is_kept(name: str) -> None:
    if not name.strip():
        return
    spec = rtamt.parse(f'@ column(x, "{name}")\nx > 0')
    assert spec.columns == {"x": name}
    assert rtamt.parse(str(spec)).columns == {"x": name}


def test_requirements_keep_the_columns_that_they_read() -> None:
    parts = rtamt.parse(TEXT).requirements
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
    mutants = rtamt.mutants(rtamt.parse(TEXT).requirements["high"])
    assert mutants
    assert {item.specification.columns["level"] for item in mutants} == {"Level [mm]"}


def test_fields_of_messages_have_columns() -> None:
    spec = rtamt.parse('@ column(cmd.linear.x, "v")\ncmd.linear.x > 0')
    assert spec.columns == {"cmd.linear.x": "v"}


def test_fmus_describe_columns(tmp_path: Path) -> None:
    rtamt.parse(TEXT).requirements["high"].export_fmu(tmp_path / "one.fmu", period=1)
    with zipfile.ZipFile(tmp_path / "one.fmu") as unit:
        text = unit.read("modelDescription.xml").decode()
    assert "a variable of the specification; column Level [mm]" in text
