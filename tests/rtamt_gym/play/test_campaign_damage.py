"""Damaged folders of campaigns: errors name the file and a fix."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from rtamt import InputError, Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.folder import Folder
from rtamt_gym.play.record import Record
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.provenance import Fingerprint, file_hash
from rtamt_gym.results.trial import Trial

IDENTITY = {"tasks": "abc"}
REMOVE = "remove it, and its runs are made again, or give another folder"
OTHER = "give another folder, or remove this one"


def opened(path: Path) -> Folder:
    of = (IDENTITY, {"space": None}, {"dry": "always(x > 0)"}, "tank", Fingerprint())
    return Folder(path, *of, accept_changed=False)


def trial(value: float) -> Trial:
    outcome = Outcome(value, value, value, Verdict.SATISFIED, None)
    return Trial(Case({"a": value}), 1, {"dry": outcome}, "duration", 1.0, 0.1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a campaign that was interrupted after two parts."""
    path = tmp_path / "runs"
    with opened(path) as made:
        made.add([(0, trial(1.0)), (2, trial(3.0))])
        made.add([(1, trial(2.0))])
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught, opened(path) as made:
        made.rows()
    return str(caught.value)


def test_names_of_parts_have_their_checksums(folder: Path) -> None:
    names = sorted(part.name for part in folder.glob("part-*"))
    assert names == [
        f"part-{i:06d}-{file_hash(part)[:16]}.parquet"
        for i, part in enumerate(sorted(folder.glob("part-*")), 1)
    ]
    with opened(folder) as made:
        assert {number: row.case["a"] for number, row in made.rows().items()} == {0: 1, 2: 3, 1: 2}
        made.add([(3, trial(4.0))])
    assert max(folder.glob("part-*")).name.startswith("part-000003-")
    assert len(Record.load(folder)) == 4


def test_parts_of_before_have_no_checksum_and_are_read(folder: Path) -> None:
    for i, part in enumerate(sorted(folder.glob("part-*")), 1):
        part.rename(folder / f"part-{i:06d}.parquet")
    with opened(folder) as made:
        assert len(made.rows()) == 3


@pytest.mark.parametrize("place", [0.1, 0.5, 0.9, 0.999])
def test_a_changed_byte_of_a_part_is_found(folder: Path, place: float) -> None:
    part = max(folder.glob("part-*"))
    raw = bytearray(part.read_bytes())
    raw[int(place * len(raw))] ^= 1
    part.write_bytes(bytes(raw))
    message = f"{part} is damaged: its content does not match the checksum in its name; {REMOVE}"
    assert refusal(folder) == message
    with pytest.raises(InputError, match="is damaged"):
        Record.load(folder)
    part.unlink()
    with opened(folder) as made:
        assert sorted(made.rows()) == [0, 2]


@pytest.mark.parametrize("name", ["part-abc.parquet", "part-1-xyz.parquet", "part-.parquet"])
def test_a_file_that_is_called_like_a_part_is_named(folder: Path, name: str) -> None:
    shutil.copy(max(folder.glob("part-*")), folder / name)
    assert refusal(folder) == (
        f"expected parts of a campaign as part-NUMBER-CHECKSUM.parquet, got {folder / name}; "
        f"{REMOVE}"
    )


@pytest.mark.parametrize("content", [b"", b"no Parquet", None])
def test_a_part_of_before_that_is_no_record_is_named(folder: Path, content: bytes | None) -> None:
    part = folder / "part-000009.parquet"
    if content is None:
        Record([trial(1.0)], {"dry": "always(x > 0)"}, "tank").save(part)
    else:
        part.write_bytes(content)
    message = refusal(folder)
    assert message.startswith(f"{part} is damaged: ")
    assert message.endswith(REMOVE)


@pytest.mark.parametrize(
    "text", ["[]", "", "{", "null", "{}", '{"system": 3}', "\x00", "[" * 100_000]
)
def test_a_damaged_description_is_named(folder: Path, text: str) -> None:
    (folder / "campaign.json").write_text(text, encoding="utf-8")
    message = refusal(folder)
    assert message.startswith(f"{folder / 'campaign.json'} is damaged: ")
    assert message.endswith(OTHER)
    with pytest.raises(InputError, match=r"campaign\.json is damaged"):
        Record.load(folder)


def test_a_damaged_record_is_named(folder: Path) -> None:
    with opened(folder) as made:
        rows = made.rows()
        made.finish(Record(rows.values(), {"dry": "always(x > 0)"}, "tank"))
    (folder / "record.parquet").write_bytes(b"PAR1")
    message = refusal(folder)
    assert message.startswith(f"{folder / 'record.parquet'} is damaged: ")
    assert message.endswith(OTHER)


@pytest.mark.parametrize(
    ("name", "way_out"),
    [
        ("campaign.json", OTHER),
        ("record.parquet", OTHER),
        ("part-000009-0123456789abcdef.parquet", REMOVE),
    ],
)
def test_a_pipe_among_the_files_is_not_opened(folder: Path, name: str, way_out: str) -> None:
    path = folder / name
    path.unlink(missing_ok=True)
    os.mkfifo(path)
    message = f"{path} is damaged: expected a regular file; {way_out}"
    assert refusal(folder) == message
    with pytest.raises(InputError) as caught:
        Record.load(folder)
    assert str(caught.value) == message


@pytest.mark.parametrize("kind", ["link", "dangling", "pipe"])
def test_the_lock_is_no_link_and_no_pipe(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "runs"
    path.mkdir()
    victim = tmp_path / "victim"
    lock = path / "lock"
    match kind:
        case "link":
            victim.write_text("keep me", encoding="utf-8")
            lock.symlink_to(victim)
        case "dangling":
            lock.symlink_to(victim)
        case "pipe":
            os.mkfifo(lock)
    with pytest.raises(InputError, match="expected a file as the lock of a folder, got"):
        opened(path)
    if kind == "link":
        assert victim.read_text(encoding="utf-8") == "keep me"
    assert victim.exists() is (kind == "link")
    lock.unlink()
    with opened(path):
        assert json.loads((path / "campaign.json").read_text(encoding="utf-8"))["system"] == "tank"


def test_the_lock_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "runs" / "lock").mkdir(parents=True)
    with pytest.raises(IsADirectoryError):
        opened(tmp_path / "runs")


def test_the_lock_holds_other_processes_off(tmp_path: Path) -> None:
    first: Any
    with opened(tmp_path / "runs") as first:
        assert first.rows() == {}
        with pytest.raises(InputError, match="another process runs the campaign"):
            opened(tmp_path / "runs")
