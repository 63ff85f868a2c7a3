"""The record of many simulations: rows, columns, and lossless Parquet files."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym import Case, Parameter, Waveform, falsify, sweep
from rtamt_gym.play.record import check_columns
from rtamt_gym.results import Record
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import Trial

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NUMBERS = st.floats(allow_nan=False)

OUTCOMES = st.builds(
    Outcome,
    NUMBERS,
    NUMBERS,
    NUMBERS,
    st.sampled_from(Verdict),
    st.none() | st.builds(Moment, st.integers(0, 2**40), st.floats(0, 1e6)),
)


@st.composite
def records(draw: st.DrawFn) -> Record:
    """Records of parameters and waveforms, some of which a row may lack."""
    waves = {"u": ((0.0, 2.5), "hold"), "v": ((0.0, 0.1, 7.0), "pchip")}
    names = draw(st.lists(st.sampled_from(["safe", "a.b", "x(y)"]), unique=True, min_size=1))
    rows = []
    for _ in range(draw(st.integers(0, 3))):
        case: dict[str, float | Waveform] = draw(
            st.fixed_dictionaries({}, optional={"mass": NUMBERS, "qpos[0]": NUMBERS})
        )
        for name, (times, how) in waves.items():
            if draw(st.booleans()):
                values = st.floats(-1e6, 1e6)
                many = draw(st.lists(values, min_size=len(times), max_size=len(times)))
                case[name] = Waveform(times, many, how)  # type: ignore[arg-type]  # a literal
        failed = draw(st.booleans())
        rows.append(
            Trial(
                Case(case),
                draw(st.none() | st.integers(0, 2**62)),
                {} if failed else {name: draw(OUTCOMES) for name in names},
                "error" if failed else draw(st.sampled_from(["truncated", "violation"])),
                draw(st.floats(0, 1e9)),
                draw(st.floats(0, 1e9)),
                draw(st.text()) if failed else "",
                draw(st.none() | st.floats(allow_nan=False)),
            )
        )
    return Record(rows, dict.fromkeys(names, "always(x > 0)"), "a system")


@settings(max_examples=examples(50))
@given(record=records())
def test_a_record_that_is_saved_and_loaded_is_the_same_to_the_last_bit(
    record: Record, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("record") / "record.parquet"
    record.save(path)
    loaded = Record.load(path)
    assert loaded == record
    # Also the parts that equality ignores: wall times and the signs of zeros.
    assert repr(loaded.columns()) == repr(record.columns())


@settings(max_examples=examples(30))
@given(record=records())
def test_a_frame_has_the_cells_of_the_columns(record: Record) -> None:
    frame = record.to_frame()
    columns = record.columns()
    assert list(frame) == list(columns)
    for name, cells in columns.items():
        for cell, shown in zip(cells, frame[name], strict=True):
            assert str(shown) in {"None", "nan", "<NA>"} if cell is None else shown == cell


def row(height: float, verdict: Verdict = Verdict.SATISFIED, **more: Any) -> Trial:  # noqa: ANN401
    outcome = Outcome(height, height, height, verdict, Moment(10, 1.0))
    kept: dict[str, Any] = {"case": Case({"mass": 1.0}), "seed": 3, "ended": "truncated"}
    kept |= {"outcomes": {"safe": outcome}, "simulated": 2.0, "wall": 0.5, "error": ""} | more
    return Trial(**kept)


def of(*rows: Trial) -> Record:
    return Record(rows, {"safe": "always(x > 0)"}, "plant")


def test_rows_are_read_in_order_by_number_and_by_slice() -> None:
    rows = [row(float(i)) for i in range(4)]
    record = of(*rows)
    assert list(record) == rows
    assert record[1] == rows[1]
    assert record[1:3] == of(*rows[1:3])
    assert len(record) == 4


def test_wall_times_are_not_compared_and_all_else_is() -> None:
    assert of(row(1.0)) == of(row(1.0, wall=9.0))
    assert of(row(1.0)) != of(row(1.0, seed=4))
    assert of(row(1.0)) != of(row(2.0))
    assert of(row(1.0)) != [row(1.0)]
    assert of(row(1.0)) != Record([row(1.0)], {"safe": "always(x > 1)"}, "plant")


def test_violated_keeps_the_rows_that_violate() -> None:
    rows = [row(1.0), row(-1.0, Verdict.VIOLATED), row(-2.0, Verdict.UNDECIDED)]
    assert list(of(*rows).violated("safe")) == rows[1:2]
    assert list(of(*rows).violated()) == rows[1:2]
    assert repr(of(*rows)) == "<Record of plant: 3 simulations, 1 violates>"


def test_the_worst_row_has_the_least_robustness_and_a_negative_zero_is_less_than_zero() -> None:
    rows = [row(0.0), row(-0.0, Verdict.VIOLATED), row(0.0), row(9.0)]
    assert of(*rows).worst() is rows[1]
    assert of(row(math.inf), row(-math.inf)).worst("safe").outcomes["safe"].robustness == -math.inf


def test_rows_of_errors_are_told_apart() -> None:
    failed = row(0.0, outcomes={}, ended="error", error="InputError: no")
    record = of(row(1.0), failed)
    assert list(record.failed()) == [failed]
    assert record.worst() == row(1.0)
    assert repr(record) == "<Record of plant: 2 simulations, 0 violate, 1 error>"
    message = r"^no simulation of the record has a robustness of 'safe'"
    with pytest.raises(InputError, match=message):
        record.failed().worst()


def test_columns_are_named_after_the_case_and_the_requirements() -> None:
    case = Case({"mass": 1.0, "u": Waveform([0, 1], [2, 3])})
    assert of(row(0.5, case=case)).columns() == {
        "mass": [1.0],
        "u[0]": [2.0],
        "u[1]": [3.0],
        "seed": [3],
        "robustness(safe)": [0.5],
        "lower(safe)": [0.5],
        "upper(safe)": [0.5],
        "verdict(safe)": ["SATISFIED"],
        "decided_at(safe)": [1.0],
        "decided_sample(safe)": [10],
        "ended": ["truncated"],
        "simulated": [2.0],
        "return": [None],
        "wall": [0.5],
        "error": [""],
    }
    assert of(row(0.5, case=case)).numbers("u[1]").tolist() == [3.0]


def test_a_name_of_a_case_is_not_that_of_another_column() -> None:
    with pytest.raises(InputError) as caught:
        of(row(1.0, case=Case({"wall": 1.0})))
    assert str(caught.value) == (
        "a varied parameter cannot have the name 'wall', a column of every record; rename it"
    )


def test_a_waveform_has_the_same_control_points_in_all_rows() -> None:
    one, two = Case({"u": Waveform([0], [1])}), Case({"u": Waveform([0, 1], [1, 2])})
    with pytest.raises(InputError) as caught:
        of(row(1.0, case=one), row(1.0, case=two))
    assert str(caught.value) == (
        "expected 'u' of every case with the same control points, got another kind in row 1: "
        "Waveform(times=(0.0, 1.0), values=(1.0, 2.0), interpolation='hold')"
    )


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda record: record.violated("saef"),
            "unknown requirement 'saef'; the requirements are 'safe'; did you mean 'safe'?",
        ),
        (
            lambda record: record.numbers("mas"),
            (
                "unknown column of numbers 'mas'; the columns are 'mass', 'seed', "
                "'robustness(safe)', 'lower(safe)', 'upper(safe)', 'decided_at(safe)', "
                "'decided_sample(safe)', 'simulated', 'return', 'wall'; did you mean 'mass'?"
            ),
        ),
        (
            lambda _record: check_columns(["mass", "gear", "mass"], ["safe"]),
            "expected columns of different names, got 'mass' twice",
        ),
        (
            lambda record: Record(record, {"a": "", "b": ""}).worst(),
            "expected the name of a requirement ('a', 'b')",
        ),
        (
            lambda record: record.save("record.csv"),
            (
                "cannot write record.csv: expected a name that ends in .parquet, the format that "
                "holds all of a record; to_frame() has the columns for other formats"
            ),
        ),
    ],
)
def test_mistakes_are_told(ask: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises(InputError) as caught:
        ask(of(row(1.0)))
    assert str(caught.value) == message


def test_files_that_hold_no_record_are_told(tmp_path: Path) -> None:
    text, frame = tmp_path / "text.parquet", tmp_path / "frame.parquet"
    text.write_text("nothing")
    of(row(1.0)).to_frame().to_parquet(frame)
    with pytest.raises(InputError) as caught:
        Record.load(text)
    assert str(caught.value) == f"cannot read {text}: it is not a Parquet file"
    with pytest.raises(InputError) as caught:
        Record.load(frame)
    assert str(caught.value) == (
        f"{frame} is not a record: expected a file of Record.save or Sweep.save"
    )


def test_a_record_says_the_unit_of_bounds_that_its_reader_does_not_know() -> None:
    def tank(inflow: float = 0.2) -> Iterator[dict[str, float]]:
        level = 1.0
        for _ in range(4):
            yield {"level": level}
            level += inflow

    dry = {"dry": rtamt.parse("always[0:2000](level < 9)", unit="ms")}
    space = [Parameter("inflow", 0.1, 0.3)]
    done = sweep(tank, dry, space, samples=2, sampler="grid", period=1)
    searched = falsify(tank, dry, space, budget=4, period=1)
    for record in (done.record, searched.record):
        assert record.requirements == {"dry": "always[0:2000ms](level < 9)"}
