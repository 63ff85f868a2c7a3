"""Bags from recorders: compressed, split, without an index, cut, of other versions."""

from __future__ import annotations

import errno
import gzip
import shutil
import sqlite3
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from bags import START, Said, plain_mcap, twist, write_bag
from rosbags.highlevel import AnyReader

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import bag_reader
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_ruled

SPEC = rtamt.parse(
    "from geometry_msgs.msg import Twist; input Twist cmd; @ topic(cmd, robot0/cmd_vel);"
    "always(cmd.linear.x < 99)"
)
SAID = [twist(START + i * 10**8, float(i)) for i in range(40)]
SPEEDS = [float(i) for i in range(40)]


def read(path: Path, rules: EvaluationOptions | None = None) -> Trace:
    trace, _ = read_ruled(
        str(path), {"": SPEC}, rules or EvaluationOptions(period=Fraction(1, 10)), Columns()
    )
    assert isinstance(trace, Trace)
    return trace


def speeds(path: Path) -> list[float]:
    found: list[float] = read(path).columns["cmd.linear.x"].tolist()
    return found


@pytest.mark.parametrize(
    ("name", "compression"),
    [
        ("run.mcap", "STORAGE"),
        ("run.bag", "BZ2"),
        ("run.bag", "LZ4"),
        ("run", "MESSAGE"),
        ("run", "FILE"),
    ],
)
def test_compressed_bags_are_read(name: str, compression: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / name, SAID, compression=compression)
    assert speeds(path) == SPEEDS


def test_mcap_without_chunks_or_index(tmp_path: Path) -> None:
    assert speeds(plain_mcap(tmp_path / "run.mcap", SAID)) == SPEEDS


def test_unordered_messages_without_index_error(tmp_path: Path) -> None:
    path = plain_mcap(tmp_path / "run.mcap", [SAID[1], SAID[0]])
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected a whole MCAP file of ROS 2, got an error: Unindexed MCAP messages are "
        "not in timestamp order. Use an indexed file; what is whole in it: mcap recover FILE -o "
        "WHOLE.mcap"
    )


def test_unordered_messages_keep_their_times(tmp_path: Path) -> None:
    shuffled = [SAID[(7 * i) % 40] for i in range(40)]
    for extension in (".mcap", ".db3", ".bag"):
        assert speeds(write_bag(tmp_path / f"run{extension}", shuffled)) == SPEEDS


def test_unclosed_recording_error(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", SAID)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected a whole MCAP file of ROS 2, got an error: File end magic is invalid; "
        "what is whole in it: mcap recover FILE -o WHOLE.mcap"
    )
    path = write_bag(tmp_path / "run.bag", SAID)
    whole = path.read_bytes()
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(whole[:at] + bytes(8) + whole[at + 8 :])  # as during recording
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected a whole bag of ROS 1, got an error: Bag is not indexed, reindex before "
        "reading; rosbag reindex FILE writes the index of a bag that was not closed"
    )


def split(folder: Path, parts: list[list[Said]]) -> Path:
    """Write a bag of rosbag2 in several files, like a recorder with a size limit."""
    names = []
    for i, part in enumerate(parts):
        write_bag(folder.with_name(f"part{i}"), part)
        folder.mkdir(exist_ok=True)
        names.append(f"run_{i}.db3")
        shutil.move(folder.with_name(f"part{i}") / f"part{i}.db3", folder / names[-1])
    text = (folder.with_name("part0") / "metadata.yaml").read_text()
    listed = "".join(f"\n  - {name}" for name in names)
    (folder / "metadata.yaml").write_text(
        text.replace("relative_file_paths: [part0.db3]", f"relative_file_paths:{listed}").replace(
            "relative_file_paths:\n  - part0.db3", f"relative_file_paths:{listed}"
        )
    )
    return folder


def test_a_bag_in_several_files_is_one_trace(tmp_path: Path) -> None:
    path = split(tmp_path / "run", [SAID[:15], SAID[15:]])
    with AnyReader([path]) as reader:
        assert len([*reader.messages()]) == 40
    assert speeds(path) == SPEEDS  # although metadata.yaml lists only the first file
    (path / "run_1.db3").unlink()
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected a whole bag of rosbag2, got an error: Some database files are missing: "
        f"['{path}/run_1.db3']"
    )


def test_bag_without_definitions_uses_humble(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.db3", SAID)
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("DROP TABLE schema")
    database.close()
    assert speeds(path) == SPEEDS
    assert [*read(path).notes] == ["the bag defines no classes of messages: Humble's are taken"]


def test_topic_with_two_classes_error(tmp_path: Path) -> None:
    other = Said(START, "/robot0/cmd_vel", "std_msgs/Bool", {})
    path = plain_mcap(tmp_path / "run.mcap", SAID)
    data = plain_mcap(tmp_path / "two.mcap", [other]).read_bytes()
    # The records of the second file, with other numbers, before the end of the first.
    body = data[data.index(b"\x03", 30) : data.index(b"\x0f" + (4).to_bytes(8, "little"))]
    body = renumbered(body)
    whole = path.read_bytes()
    at = whole.index(b"\x0f" + (4).to_bytes(8, "little"))
    path.write_bytes(whole[:at] + body + whole[at:])
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected messages of one class on /robot0/cmd_vel, got geometry_msgs/Twist and "
        "std_msgs/Bool"
    )


def renumbered(records: bytes) -> bytes:
    """Return records of MCAP with 9 as the numbers of schema and channel."""
    made, at = b"", 0
    while at < len(records):
        kind, size = records[at], int.from_bytes(records[at + 1 : at + 9], "little")
        body = bytearray(records[at + 9 : at + 9 + size])
        body[0] = 9
        if kind == 4:
            body[2] = 9
        made += records[at : at + 9] + bytes(body)
        at += 9 + size
    return made


def test_a_bag_is_sampled_or_read_as_events(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", SAID)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, EvaluationOptions())
    assert str(caught.value) == (
        f"{path}: expected --period, such as 100ms, to sample the messages of a bag, or --dense to "
        "read them as events"
    )
    with pytest.raises(rtamt.InputError) as caught:
        read(path, EvaluationOptions(period=Fraction(1, 10**9)))
    assert str(caught.value) == (
        f"{path}: expected 1 to 10000000 samples, got 3900000001, one every 1e-09 s in 3.9 s; "
        "give a longer --period, or --dense"
    )
    with pytest.raises(rtamt.InputError) as caught, open_recording(str(path)):
        pass
    assert str(caught.value) == f"{path}: expected a table, got a bag; rtamt monitor reads it"


@pytest.mark.parametrize("text", [SPEC.text, "input float64 x = 1; always(x > 0)", "always(true)"])
@pytest.mark.parametrize("silent", [[], [("/robot0/cmd_vel", "geometry_msgs/Twist")]])
def test_an_empty_bag_is_refused(tmp_path: Path, text: str, silent: list[tuple[str, str]]) -> None:
    for extension in (".mcap", ".db3", ".bag"):
        path = write_bag(tmp_path / f"run{extension}", [], silent=silent)
        for rules in (EvaluationOptions(period=Fraction(1)), EvaluationOptions(dense=True)):
            with pytest.raises(rtamt.InputError) as caught:
                read_ruled(str(path), {"": rtamt.parse(text)}, rules, Columns())
            assert str(caught.value) == f"{path}: expected a bag with messages, got one without any"


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("run.mcap", b"", "whole MCAP file of ROS 2, got an error: File '{}' seems to be empty"),
        ("run.bag", b"", "whole bag of ROS 1, got an error: File '{}' seems to be empty"),
        ("run.mcap", b"x" * 99, "whole MCAP file of ROS 2, got an error: File magic is invalid"),
        ("run.bag", b"x" * 99, "whole bag of ROS 1, got an error: File magic is invalid"),
    ],
)
def test_unrecoverable_file_error(tmp_path: Path, name: str, data: bytes, said: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: expected a {said.format(path)}"


def test_unsupported_profile_or_encoding_error(tmp_path: Path) -> None:
    path = plain_mcap(tmp_path / "run.mcap", SAID)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"\x04\0\0\0ros2", b"\x04\0\0\0ros1", 1))
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected an MCAP file of ROS 2, got one with another profile"
    )
    path.write_bytes(whole.replace(b"\x07\0\0\0ros2msg", b"\x07\0\0\0protobu", 1))
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected an MCAP file of ROS 2, got messages or schemas of 'protobu'"
    )


def test_specification_without_variables_covers_bag(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", SAID)
    spec = rtamt.parse("always(true)")
    trace, _ = read_ruled(
        str(path), {"": spec}, EvaluationOptions(period=Fraction(1, 10)), Columns()
    )
    assert isinstance(trace, Trace)
    assert (trace.samples, trace.start) == (40, 0.0)


def test_packed_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(gzip.compress(write_bag(tmp_path / "whole.mcap", SAID).read_bytes()))
    with pytest.raises(rtamt.InputError, match=r"got an error: File magic is invalid$"):
        read(path)


def test_a_missing_package_names_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_bag(tmp_path / "run.mcap", SAID)
    for name in [*sys.modules]:
        if name.partition(".")[0] == "rosbags" or "recorded.bag_" in name:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert main(["monitor", "always(x < 1)", "--dense", str(path)]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: rosbags is not installed; from the checkout: pip install '.[bags]'\n"
    )


def test_unreadable_bag_is_a_system_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "run.mcap")

    path = write_bag(tmp_path / "run.mcap", SAID)
    monkeypatch.setattr(bag_reader, "AnyReader", refuse)  # root may read everything
    assert main(["monitor", "always(x < 1)", "--dense", str(path)]) == 2
    assert capsys.readouterr().err == "rtamt: error: cannot open run.mcap: Permission denied\n"


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("extension", [".mcap", ".db3", ".bag"])
def test_corrupt_byte_is_read_or_refused(extension: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / f"run{extension}", SAID[:5])
    whole = path.read_bytes()
    random = np.random.default_rng(5)
    refusals = 0
    for _ in range(60):
        data = bytearray(whole)
        data[random.integers(min(len(data), 4000))] ^= 1 << random.integers(8)
        path.write_bytes(data)
        try:
            read(path)
        except rtamt.InputError as error:
            assert str(error).startswith(f"{path}")  # noqa: PT017 - some bytes do no harm
            refusals += 1
        except rtamt.ParseError as error:  # the byte of a field's name in the definition
            assert error.reason.startswith(f"{path}: ")  # noqa: PT017
            assert " has no field '" in error.reason  # noqa: PT017
            refusals += 1
    assert refusals


def test_an_index_without_topics_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.mcap", SAID)
    data = bytearray(path.read_bytes())
    at = int.from_bytes(data[-28:-20], "little")  # the footer has the start of the summary
    while data[at] != 2:
        size = int.from_bytes(data[at + 1 : at + 9], "little")
        if data[at] in (3, 4, 11):  # schemas, channels and statistics become unknown records
            data[at] = 0x90
        at += 9 + size
    path.write_bytes(data)
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: expected an index that lists the topics, got none; what is whole in it: mcap "
        "recover FILE -o WHOLE.mcap"
    )


def test_unreadable_definition_error(tmp_path: Path) -> None:
    path = plain_mcap(tmp_path / "run.mcap", SAID)
    path.write_bytes(path.read_bytes().replace(b"Vector3 linear", b"Vector3 =inear"))
    with pytest.raises(rtamt.InputError) as caught:
        read(path)
    assert str(caught.value).startswith(
        f"{path}: expected an MCAP file of ROS 2, got a definition of messages: Could not parse: "
    )
    assert len(str(caught.value)) < len(str(path)) + 280
