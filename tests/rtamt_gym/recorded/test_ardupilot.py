"""Dataflash logs of ArduPilot: names, scales, instances, damage."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

Output = pytest.CaptureFixture[str]

_PACKED = {"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i"}
_PACKED |= {"M": "B", "a": "32h", "g": "e"}


class DataFlash:
    """Writes a log, from the published description of the format."""

    def __init__(self) -> None:
        self.data = b""
        self._types: dict[str, tuple[int, str]] = {}
        self.format("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", number=128)

    def format(self, name: str, letters: str, fields: str, number: int | None = None) -> None:
        """Describe a type of messages."""
        number = len(self._types) + 1 if number is None else number
        packing = "<" + "".join(_PACKED.get(letter, letter) for letter in letters)
        self._types[name] = number, packing
        length = 3 + struct.calcsize(packing)
        texts = name.encode(), letters.encode(), fields.encode()
        self.add("FMT", number, length, *texts)

    def add(self, name: str, *values: object) -> None:
        """Add a message."""
        number, packing = self._types[name]
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack(packing, *values)

    def number(self, name: str) -> int:
        """Return the number of a type."""
        return self._types[name][0]

    def save(self, path: Path) -> Path:
        """Write the file."""
        path.write_bytes(self.data)
        return path


def flight() -> DataFlash:
    """Attitudes every 40 ms, positions every 100 ms, two accelerometers that take turns."""
    log = DataFlash()
    log.format("UNIT", "QbZ", "TimeUS,Id,Label")
    log.format("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    log.format("ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
    log.format("POS", "QLLf", "TimeUS,Lat,Lng,Alt")
    log.format("IMU", "QBf", "TimeUS,I,AccX")
    log.format("MSG", "QZ", "TimeUS,Message")
    log.add("FMTU", 900, log.number("IMU"), b"s#o", b"F-0")
    log.add("MSG", 1000, b"take off")
    for k in range(50):
        now = 1_000_000 + 20_000 * k
        log.add("IMU", now, k % 2, k / 8)
        if k % 2 == 0:
            log.add("ATT", now + 3, -k * 100, k, 36000 - k)
        if k % 5 == 0:
            log.add("POS", now + 7, 470000000 + k, -80000000, k)
    return log


def events(path: Path, **signals: str) -> Mapping[str, tuple[Sequence[float], Sequence[float]]]:
    """Return the times and the values of fields."""
    spec = rtamt.parse(f"always({' + '.join(signals)} < 1e9)")
    reading = EvaluationOptions(dense=True)
    trace, _ = read_ruled(str(path), {"": spec}, reading, Columns(signals=signals))
    assert isinstance(trace, EventTrace)
    return {name: (at.tolist(), values.tolist()) for name, (at, values) in trace.signals.items()}


def test_fields_are_scaled_and_instances_apart(tmp_path: Path) -> None:
    path = flight().save(tmp_path / "log.bin")
    read = events(
        path, roll="ATT.Roll", yaw="ATT.Yaw", lat="POS.Lat", a="IMU.0.AccX", b="IMU.1.AccX"
    )
    even = np.arange(0, 50, 2)
    assert read["roll"][1][:25] == (-even).astype(float).tolist()
    assert read["yaw"][1][:25] == ((36000 - even) / 100).tolist()
    assert read["lat"][1][:10] == [(470000000 + k) / 1e7 for k in range(0, 50, 5)]
    assert read["lat"][0][:10] == [(1_000_007 + 20_000 * k) / 1e6 for k in range(0, 50, 5)]
    assert read["a"][1][:25] == (even / 8).tolist()
    assert read["b"][1][:25] == ((even + 1) / 8).tolist()


def test_names_of_columns(tmp_path: Path) -> None:
    path = flight().save(tmp_path / "log.bin")
    with open_recording(str(path)) as recording:
        names = {*recording.names}
    assert {"ATT.Roll", "ATT.0.Roll", "POS.Alt", "IMU.1.AccX"} <= names
    assert not {"IMU.AccX", "MSG.Message", "ATT.TimeUS"} & names


def test_two_messages_in_one_requirement(tmp_path: Path, capsys: Output) -> None:
    path = flight().save(tmp_path / "log.bin")
    command = ["monitor", "always(ATT.Roll + POS.Alt <= 4)", str(path), "--start", "known"]
    assert main([*command, "--period", "100ms"]) == 0
    assert "sampled every 0.1 s" in capsys.readouterr().out
    assert main([*command, "--dense"]) == 0


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-(2**15), 2**15 - 1), st.floats(width=32, allow_nan=False)),
        min_size=2,
    )
)
def test_every_letter_of_numbers(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float]]
) -> None:
    log = DataFlash()
    letters = "bBhHiqfdcCeELMg"
    log.format("ALL", "Q" + letters, ",".join(["TimeUS", *(f"F{n}" for n in range(len(letters)))]))
    cells = []
    for at, (whole, real) in enumerate(rows):
        low, half = whole % 128, float(np.float16(whole / 64))
        row = [real if c in "fd" else half if c == "g" else low for c in letters]
        log.add("ALL", 1_000_000 + 1000 * at, *row)
        scale = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
        cells.append([v / scale.get(c, 1) for v, c in zip(row, letters, strict=True)])
    path = log.save(tmp_path_factory.mktemp("log") / "all.bin")
    spec = rtamt.parse(f"always({' + '.join(f'ALL.F{n}' for n in range(len(letters)))} < 1e9)")
    trace, _ = read_ruled(str(path), {"": spec}, EvaluationOptions(), Columns())
    assert isinstance(trace, Trace)
    columns = np.array([trace.columns[f"ALL.F{n}"] for n in range(len(letters))]).T
    np.testing.assert_array_equal(columns, np.array(cells))


def test_log_that_ends_within_a_message(tmp_path: Path, capsys: Output) -> None:
    log = flight()
    log.data = log.data[:-4]
    path = log.save(tmp_path / "log.bin")
    assert main(["monitor", "always(ATT.Roll <= 0)", str(path), "--dense"]) == 0
    assert "note: the log ends within a message" in capsys.readouterr().out
    log.data += b"\xff" * 300
    log.save(path)
    assert main(["monitor", "always(ATT.Roll <= 0)", str(path), "--dense"]) == 2


def test_space_that_was_reserved_is_no_damage(tmp_path: Path) -> None:
    log = flight()
    log.data += b"\0" * 4096
    path = log.save(tmp_path / "log.bin")
    assert main(["monitor", "always(ATT.Roll <= 0)", str(path), "--dense"]) == 0


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda data: b"\0" + data, "expected a dataflash log of ArduPilot"),
        (lambda data: data[:-16] + b"\xff" + data[-15:], "bytes from"),
        (lambda data: data + b"\xa3\x95\xfa" + b"\0" * 9, "the type 250, which no FMT"),
        (lambda data: data.replace(b"QccC\0", b"Qcc?\0"), "got the letters 'Qcc?' for 4 fields"),
        (lambda data: data.replace(b"QccC\0", b"QccI\0"), "expected a format of 17 bytes for ATT"),
        (lambda data: data[:89], "expected messages with TimeUS or TimeMS, got none"),
        (lambda data: data[:0], "expected a dataflash log of ArduPilot"),
    ],
)
def test_damage_is_an_error(change: object, error: str, tmp_path: Path, capsys: Output) -> None:
    log = flight()
    assert callable(change)
    log.data = change(log.data)
    path = log.save(tmp_path / "log.bin")
    assert main(["monitor", "always(ATT.Roll <= 0)", str(path), "--dense"]) == 2
    assert error in capsys.readouterr().err


def test_any_cut_is_a_note_or_an_error(tmp_path: Path, capsys: Output) -> None:
    whole, log = flight().data, flight()
    for part in range(40):
        log.data = whole[: len(whole) * part // 40]
        path = log.save(tmp_path / "log.bin")
        code = main(["monitor", "always(ATT.Roll <= 0)", str(path), "--dense"])
        printed = capsys.readouterr()
        assert code in (0, 2)
        assert (code == 2) == ("rtamt: error: " in printed.err)
