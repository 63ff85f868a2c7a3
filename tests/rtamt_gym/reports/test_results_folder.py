"""The page of a folder of results: totals, the worst files, and its size."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from html import unescape
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rtamt_gym.__main__ import main
from rtamt_gym.results.matrix import IDENTITY, RESULTS


def folder_of(place: Path, count: int) -> Path:
    """Write results of files, of which every third is violated and the last one is gone."""
    (place / "results").mkdir()
    identity = {"specification": {"p": "always(x > 0)"}, "end": "cut", "view": "episode"}
    (place / "results" / IDENTITY).write_text(json.dumps(identity))
    rows: list[dict[str, Any]] = []
    for i in range(count):
        value = -1.0 - i if i % 3 == 0 else 1.0
        rows.append(
            {
                "path": f"runs/v{i % 7}/r{i:06d}.csv",
                "verdict": "violated" if value < 0 else "satisfied",
                "verdict(p)": "VIOLATED" if value < 0 else "SATISFIED",
                **dict.fromkeys(("robustness(p)", "lower(p)", "upper(p)"), value),
                "error": "",
                "described": "200 samples",
                "notes": "",
                "gone": i == count - 1,
            }
        )
    pq.write_table(pa.Table.from_pylist(rows), place / "results" / RESULTS)
    return place / "results"


def page_of(folder: Path) -> str:
    page = folder.parent / "page.html"
    assert main(["report", str(folder), "-o", str(page)]) == 0
    return page.read_text(encoding="utf-8")


def texts(page: str, table: str) -> list[list[str]]:
    """Return the cells of a table by its label or class."""
    part = page[page.index(table) :]
    part = part[: part.index("</table>")]
    rows = re.findall(r"<tr.*?</tr>", part, re.DOTALL)
    cells = (re.findall(r"<t[hd].*?</t[hd]>", row, re.DOTALL) for row in rows)
    return [[re.sub(r"<[^>]+>|\s+", " ", cell).strip() for cell in row] for row in cells]


def test_folders_have_totals(tmp_path: Path) -> None:
    page = page_of(folder_of(tmp_path, 22))
    head, *rows = texts(page, "Verdicts in each folder")
    assert head == ["folder", "failed", "violated", "undecided", "satisfied", "files"]
    assert sum(int(row[2]) for row in rows) == 7  # the last of eight is gone
    assert sum(int(row[5]) for row in rows) == 21
    assert rows[0][2] >= rows[-1][2]


@pytest.mark.parametrize("count", [20, 4000])
def test_worst_files_in_small_page(count: int, tmp_path: Path) -> None:
    page = page_of(folder_of(tmp_path, count))
    _, *rows = texts(page, 'class="matrix"')
    assert len(rows) == min(count - 1, 1000)
    violated = [i for i in range(count - 1) if i % 3 == 0]
    worst = [f"runs/v{i % 7}/r{i:06d}.csv" for i in reversed(violated)]
    shown = [row[0].split()[0] for row in rows]
    assert shown[: len(worst)] == worst[:1000]
    assert len(page) < 3e6


def test_command_lists_violated_files(tmp_path: Path) -> None:
    page = page_of(folder_of(tmp_path, 9))
    (command,) = re.findall(r"<code>(python -c .*?)</code>", page)
    _, *arguments = shlex.split(unescape(command))
    ran = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert re.findall(r"r(\d+)\.csv", ran.stdout) == ["000000", "000003", "000006"]
