"""Records of one variable at one instant, times that go back, and topics subscribed twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal
from bags import START, twist, write_bag
from hypothesis import given
from hypothesis import strategies as st
from ulogs import Topic, Ulog

from rtamt import InputError
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.times import one_record, same_as_before

Output = pytest.CaptureFixture[str]
Rows = list[tuple[float, float]]
TOPIC = Topic("pos", (("double", "z"),))


def write_mdf(path: Path, *channels: tuple[str, Rows]) -> str:
    """A measurement with a group for each channel."""
    with MDF(version="4.10") as file:
        for name, rows in channels:
            times, values = zip(*rows, strict=True)
            file.append(Signal(np.array(values, float), np.array(times, float), name=name))
        file.save(path, overwrite=True)
    return str(path)


def mdf(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    return write_mdf(folder / "t.mf4", ("v", rows)), []


def ulog(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    log = Ulog()
    log.records(TOPIC, [(round((1 + time) * 1e6), [value]) for time, value in rows])
    return str(log.save(folder / "t.ulg")), ["--signal", "v=pos.z"]


def bag(folder: Path, rows: Rows) -> tuple[str, list[str]]:
    said = [twist(START + round(time * 1e9), value) for time, value in rows]
    write_bag(folder / "bag", said)
    return str(folder / "bag"), ["--signal", "v=/robot0/cmd_vel.linear.x"]


Writer = Callable[[Path, Rows], tuple[str, list[str]]]
DOUBLE: Rows = [(0, 1), (1, -3), (1, 2), (2, 1)]


@pytest.mark.parametrize("write", [mdf, ulog, bag])
@pytest.mark.parametrize("choice", [None, "first", "last"])
def test_different_records_at_one_time(
    write: Writer, choice: str | None, tmp_path: Path, capsys: Output
) -> None:
    path, options = write(tmp_path, DOUBLE)
    words = ["monitor", "always(v >= 0)", path, "--dense", *options]
    words += [] if choice is None else ["--same-time", choice]
    code = main(words)
    out, err = capsys.readouterr()
    if choice is None and write is mdf:
        assert code == 2
        assert "expected one value at 1 s, got -3 and 2; choose with --same-time first or" in err
        return
    assert code == (1 if choice == "first" else 0)
    note = " ".join(out.split())
    assert f"the {choice or 'last'} of 2 different records at" in note


@pytest.mark.parametrize("write", [mdf, ulog, bag])
def test_equal_records_at_one_time_are_one(write: Writer, tmp_path: Path, capsys: Output) -> None:
    path, options = write(tmp_path, [(0, 1), (1, 2), (1, 2), (1, 2), (2, 1)])
    assert main(["monitor", "always(v >= 1)", path, "--dense", *options]) == 0
    assert "different records" not in capsys.readouterr().out


@pytest.mark.parametrize("write", [mdf, ulog])
def test_times_that_go_back_are_refused(write: Writer, tmp_path: Path, capsys: Output) -> None:
    path, options = write(tmp_path, [(0, 1), (2, 1), (1, -1), (3, 1)])
    assert main(["monitor", "always(v >= 0)", path, "--dense", *options]) == 2
    assert "expected times that increase, got" in capsys.readouterr().err


def test_last_bit_differences_are_one_clock(tmp_path: Path, capsys: Output) -> None:
    fast: Rows = [
        (float(time), 1 - 2 * (index == 150)) for index, time in enumerate(np.arange(0, 2, 0.01))
    ]
    slow: Rows = [(float(time), 1) for time in np.arange(0, 2, 0.1)]
    assert {time for time, _ in slow} - {time for time, _ in fast}  # some differ
    path = write_mdf(tmp_path / "t.mf4", ("a", fast), ("b", slow))
    words = ["monitor", "always(a > 0 and b > 0)", path, "--missing", "hold"]
    assert main(words) == 1
    assert "200 samples, one every 0.01 s" in capsys.readouterr().out


def test_channel_in_two_groups_can_be_chosen(tmp_path: Path, capsys: Output) -> None:
    path = write_mdf(tmp_path / "t.mf4", ("v", [(0, 1), (1, 1)]), ("v", [(0, -1), (1, -1)]))
    assert main(["monitor", "always(v > 0)", path]) == 2
    assert "expected one column 'v', got 2; choose one with --signal, such as v=group0.v" in (
        capsys.readouterr().err
    )
    for group, code in ((0, 0), (1, 1)):
        assert main(["monitor", "always(v > 0)", path, "--signal", f"v=group{group}.v"]) == code


def test_names_of_values_are_read_as_numbers(tmp_path: Path, capsys: Output) -> None:
    conversion = {"val_0": 0, "text_0": "off", "val_1": 3, "text_1": "on"}
    signal = Signal(
        np.array([0, 3, 0], np.uint8), np.arange(3.0), name="state", conversion=conversion
    )
    with MDF(version="4.10") as file:
        file.append(signal)
        file.save(tmp_path / "t.mf4", overwrite=True)
    path = str(tmp_path / "t.mf4")
    assert main(["monitor", "eventually(state == 3) and always(state <= 3)", path]) == 0
    assert "'state' names its values: the numbers behind the names are read" in " ".join(
        capsys.readouterr().out.split()
    )


def test_log_may_start_at_zero(tmp_path: Path, capsys: Output) -> None:
    log = Ulog()
    log.records(TOPIC, [(100_000 * i, [1.0 - 2 * (i == 0)]) for i in range(40)])
    path = str(log.save(tmp_path / "t.ulg"))
    assert main(["monitor", "always(v > 0)", path, "--signal", "v=pos.z"]) == 1
    assert "40 samples, one every 0.1 s, 0 s to 3.9 s" in capsys.readouterr().out


@pytest.mark.parametrize("instance", [0, 1])
def test_topic_subscribed_twice_is_read_whole(
    instance: int, tmp_path: Path, capsys: Output
) -> None:
    first, log = replace(TOPIC, instance=instance), Ulog()
    log.records(first, [(1_000_000 + 50_000 * i, [1.0]) for i in range(20)])
    again = replace(first, subscription=1)
    log.records(again, [(2_000_000 + 50_000 * i, [1.0 - (i == 15)]) for i in range(20)])
    path = str(log.save(tmp_path / "t.ulg"))
    assert main(["monitor", "always(v > 0)", path, "--signal", "v=pos.z"]) == 1
    assert "40 samples, one every 0.05 s, 1 s to 2.95 s" in capsys.readouterr().out


def test_instant_is_one_unit_in_the_last_place() -> None:
    times = np.array([0.3, np.nextafter(0.3, 1), 0.3 + 3 * np.spacing(0.3), 1e9, 1e9 + 1.2e-7])
    assert same_as_before(times).tolist() == [True, False, False, True]
    assert same_as_before(np.array([5, 5, 6])).tolist() == [True, False]


@given(
    st.lists(st.tuples(st.integers(0, 4), st.sampled_from([1.0, 2.0, np.nan])), min_size=1),
    st.sampled_from([None, "first", "last"]),
)
def test_one_record_keeps_the_chosen_one(rows: Rows, choice: str | None) -> None:
    rows = sorted(rows, key=lambda row: row[0])
    times, values = (np.array(column, float) for column in zip(*rows, strict=True))
    groups = {time: [str(v) for t, v in rows if t == time] for time in times}
    if choice is None and any(len({*group}) > 1 for group in groups.values()):
        with pytest.raises(InputError, match="--same-time first or --same-time last"):
            one_record(times, values, None, "t")
        return
    kept, note = one_record(times, values, choice, "t")  # type: ignore[arg-type]
    assert times[kept].tolist() == [*groups]
    place = -1 if choice == "last" else 0
    assert [str(v) for v in values[kept]] == [group[place] for group in groups.values()]
    assert bool(note) == any(len({*group}) > 1 for group in groups.values())


def _csv(rows: Rows) -> str:
    return "time,v\n" + "".join(f"{time},{value}\n" for time, value in rows)


def _long(rows: Rows) -> str:
    return "time,variable,value\n" + "".join(f"{time},v,{value}\n" for time, value in rows)


def _lines(rows: Rows) -> str:
    return "".join(f'{{"time": {time}, "v": {value}}}\n' for time, value in rows)


TABLES = [
    (".csv", _csv, []),
    (".csv", _csv, ["--dense"]),
    (".csv", _long, ["--dense"]),
    (".jsonl", _lines, []),
    (".jsonl", _lines, ["--dense"]),
]


@pytest.mark.parametrize(("suffix", "text", "dense"), TABLES)
def test_different_values_need_a_choice(
    suffix: str, text: Callable[[Rows], str], dense: list[str], tmp_path: Path, capsys: Output
) -> None:
    path = tmp_path / f"t{suffix}"
    path.write_text(text(DOUBLE))
    words = ["monitor", "always(v >= 0)", str(path), *dense]
    assert main(words) == 2
    assert "expected one value at 1 s, got -3 and 2; choose with --same-time first or" in (
        capsys.readouterr().err
    )
    for choice, code in (("first", 1), ("last", 0)):
        assert main([*words, "--same-time", choice]) == code
        assert f"the {choice} of 2 different records at 1 s counts" in (
            " ".join(capsys.readouterr().out.split())
        )
    path.write_text(text([(0, 1), (1, 2), (1, 2), (2, 1)]))
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "different records" not in out
    assert dense or "3 samples, one every 1 s" in out
    path.write_text(text([(0, 1), (2, 1), (1, -1), (3, 1)]))
    assert main([*words, "--same-time", "last"]) == 2
    assert "expected times" in capsys.readouterr().err


def test_rows_at_one_time_are_one_sample(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time,a,b\n0,1,\n0,,1\n1,2,\n1,,-2\n2,3,\n2,,3\n")
    words = ["monitor", "always(a > 0 and b > 0)", str(path)]
    assert main([*words, "--missing", "hold"]) == 1
    assert "3 samples, one every 1 s" in capsys.readouterr().out
    assert main([*words, "--dense"]) == 1
