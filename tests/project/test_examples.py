"""The examples run and print what their texts claim."""

import contextlib
import importlib.util
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
from experiments import SCRIPTS
from paths import EXAMPLES

import rtamt
import rtamt.language.words
from rtamt.patterns import CATALOGUE

ARGUMENTS = {
    "basics": [],
    "falling_humanoid": ["--episodes", "4"],
    "highway_rss": ["--episodes", "2"],
    "lookahead": [],
    "operators": [],
    "paper_figures": [],
    "parking": ["--episodes", "5"],
    "patterns": [],
    "walking_response": ["--episodes", "3"],
}
QUICK = {"basics", "operators", "patterns"}
"""Examples without a simulator."""
PICTURES = {"paper_figures": ["paper_flights", "paper_map", "paper_servers"]}
"""Pictures drawn into a folder; the other examples draw one picture of their own name."""


@dataclass
class Run:
    """The output and the pictures of an example."""

    text: str
    pictures: list[Path]

    def rows(self, column: str) -> list[list[str]]:
        """Return the words of each line of the table with ``column`` as its first column."""
        lines = iter(self.text.splitlines())
        while next(lines).split()[:1] != [column]:
            pass
        return [line.split() for line in lines]


Runner = Callable[[str], Run]


def _run(example: str, folder: Path, *more: str) -> Run:
    spec = importlib.util.spec_from_file_location(example, EXAMPLES / f"{example}.py")
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    pictures = [folder / f"{name}.png" for name in PICTURES.get(example, [example])]
    target = folder if example in PICTURES else pictures[0]
    with contextlib.redirect_stdout(io.StringIO()) as out, mpl.rc_context():
        module.main([*ARGUMENTS[example], "--plot", str(target), *more])
        plt.close("all")
    return Run(out.getvalue(), pictures)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Run an example once."""
    folder = tmp_path_factory.mktemp("pictures")
    return cache(lambda example: _run(example, folder))


@pytest.mark.parametrize(
    "example",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in ARGUMENTS],
)
def test_an_example_says_how_to_run_it_prints_80_columns_and_draws(
    example: str, run: Runner
) -> None:
    text = (EXAMPLES / f"{example}.py").read_text(encoding="utf-8")
    assert f"\nRun: python examples/{example}.py" in text
    assert len(text.splitlines()) < (130 if example in PICTURES else 80)
    assert max(map(len, run(example).text.splitlines())) <= 80
    for picture in run(example).pictures:
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_no_example_is_left_out() -> None:
    learning = {*SCRIPTS, "training", "corridor", "study", "vec_env"}  # tests/learners run them
    arrays = {"unicycle", "train_on_device"}  # tests/arrays runs them
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*ARGUMENTS, *learning, *arrays}


def test_the_page_on_examples_shows_them_all() -> None:
    page = (EXAMPLES.parent / "docs" / "examples.md").read_text(encoding="utf-8")
    shown = re.findall(r"\]\(([^): ]+)\)", page)
    for example in (*ARGUMENTS, "unicycle"):
        drawn = {f"examples/{name}.png" for name in PICTURES.get(example, [example])}
        assert {f"../examples/{example}.py", *drawn} <= set(shown)
    pictures = [EXAMPLES.parent / "docs" / link.partition("#")[0] for link in shown]
    assert [picture for picture in pictures if not picture.is_file()] == []
    assert max(picture.stat().st_size for picture in pictures) < 150_000


def test_pages_show_every_picture_of_an_example() -> None:
    docs = EXAMPLES.parent / "docs"
    pages = "".join(page.read_text(encoding="utf-8") for page in docs.glob("*.md"))
    pictures = {path.name for path in (docs / "examples").glob("*.png")}
    assert pictures == set(re.findall(r"\(examples/(\w+\.png)\)", pages))


def test_a_pattern_is_satisfied_by_its_first_trace_and_violated_by_its_second(run: Runner) -> None:
    rows = run("patterns").rows("pattern")
    assert len(rows) == len(CATALOGUE)
    for *_, first, above, second, below in rows:
        assert (first, second) == ("SATISFIED", "VIOLATED")
        assert float(above) >= 0 > float(below)


def test_page_of_patterns_has_words_and_picture_of_each(tmp_path: Path) -> None:
    page = (EXAMPLES.parent / "docs" / "patterns.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\(examples/patterns/(.+)\)", page)
    assert len(CATALOGUE) == len(pictures)
    _run("patterns", tmp_path, "--each", str(tmp_path))
    for pattern, picture in zip(CATALOGUE, pictures, strict=True):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
        shown = page.partition(f"examples/patterns/{picture}")[2].partition("\n### ")[0]
        assert f"\n*{rtamt.language.words.in_words(pattern.formula)}*\n" in shown


def test_operators_hold_where_their_meaning_says(run: Runner) -> None:
    p = [value > 0 for value in (-1, -2, 1, 2, 1, -1, -1.5, 0.5, 1.5, 0.5)]
    q = [value > 0 for value in (-1.5, -1, -1, -0.5, 1.5, 1, -1, -1.5, -1, 0.5)]
    meanings = {
        "p > 0 implies q > 0": [b or not a for a, b in zip(p, q, strict=True)],
        "p > 0 xor q > 0": [a != b for a, b in zip(p, q, strict=True)],
        "always[0:2](p > 0)": [all(p[i : i + 3]) for i in range(10)],
        "eventually[2:3](p > 0)": [any(p[i + 2 : i + 4]) for i in range(10)],
        "once[0:2](p > 0)": [any(p[max(0, i - 2) : i + 1]) for i in range(10)],
        "next(p > 0)": [*p[1:], True],
        "s_prev(p > 0)": [False, *p[:-1]],
        "rise(p > 0)": [b and not a for a, b in zip([False, *p], p, strict=False)],
    }
    said = {" ".join(formula): held for held, *formula in run("operators").rows("held")}
    assert len(said) == 24
    for formula, holds in meanings.items():
        assert said[formula] == "".join("-+"[each] for each in holds)


@pytest.mark.slow
def test_a_parked_car_and_a_lost_one_are_told_apart_before_the_time_limit(run: Runner) -> None:
    rows = run("parking").rows("start")
    assert len(rows) == 5
    assert {verdict for _, verdict, *_ in rows} == {"SATISFIED", "VIOLATED"}
    for _, verdict, seconds, _, lower, _, upper in rows:
        assert 2 < float(seconds) <= 22  # eventually[0:20] and always[0:2]; the limit is 100 s
        assert float(lower) > 0 if verdict == "SATISFIED" else float(upper) < 0


@pytest.mark.slow
def test_the_cautious_driver_keeps_the_rules_and_the_aggressive_one_breaks_one_and_crashes(
    run: Runner,
) -> None:
    rows = run("highway_rss").rows("driver")
    distances: dict[str, list[float]] = {"cautious": [], "aggressive": []}
    for driver, distance, _, _, _, broken, *_ in rows:
        distances[driver].append(float(distance))
        assert (broken == "never") == (driver == "cautious")
    assert min(distances["cautious"]) > 0 > max(distances["aggressive"])
    crashes = [(float(row[5]), float(row[7])) for row in rows if row[-1] == "crash"]
    assert any(broken < crash for broken, crash in crashes)


@pytest.mark.slow
def test_a_walker_that_limps_is_stopped_within_a_stride_and_the_time_of_the_response(
    run: Runner,
) -> None:
    (_, sound, *_), *lame = run("walking_response").rows("knee")
    assert sound == "SATISFIED"
    assert len(lame) == 2
    for fault, _, verdict, seconds, _ in lame:
        assert verdict == "VIOLATED"
        assert float(fault) < float(seconds) < float(fault) + 0.8 + 0.5


@pytest.mark.slow
def test_a_fall_is_stopped_before_the_floor_and_sub_steps_see_the_harder_blow(run: Runner) -> None:
    rows = run("falling_humanoid").rows("start")
    assert len(rows) == 4
    for _, stop, _, floor, _, seen, _, hardest, _ in rows:
        assert float(stop) < float(floor) < 3
        assert float(seen) <= float(hardest)
    assert any(float(row[5]) < 0.8 * float(row[7]) for row in rows)


@pytest.mark.slow
def test_looking_ahead_keeps_the_cart_in_the_corridor_and_feedback_alone_does_not(
    run: Runner,
) -> None:
    alone, ahead = run("lookahead").rows("driver")
    assert (alone[2], ahead[4]) == ("VIOLATED", "UNDECIDED")
    assert float(alone[-1]) < 0.0 < float(ahead[-1])


@pytest.mark.slow
def test_the_figures_of_the_paper_have_its_numbers(run: Runner) -> None:
    flights = run("paper_figures").rows("flight")[:3]
    assert [row[0] for row in flights] == ["expected", "H1", "0.8"]
    expected, faulty, violating = (float(row[-1]) for row in flights)
    assert max(faulty, violating) < 0 < expected
    servers = run("paper_figures").rows("server")[:4]
    assert servers == [
        ["a", "3", "3", "0"],
        ["b", "1", "inf", "1"],
        ["c", "-2", "-2", "0"],
        ["d", "-1", "-2", "0"],
    ]
    cells = [row[1:] for row in run("paper_figures").rows("frequency")[:4]]
    heights = [[float(cell) for cell in row] for row in cells]
    assert [len(row) for row in heights] == [4] * 4
    assert {f"{violating:.2f}", f"{expected:.2f}"} <= {
        f"{each:.2f}" for row in heights for each in row
    }
    assert min(map(min, heights)) < 0 < max(map(max, heights))


@pytest.mark.slow
def test_the_table_of_times_has_a_row_for_every_bound(run: Runner) -> None:
    rows = run("paper_figures").rows("bound")
    assert [row[0] for row in rows] == ["[0:100]", "[0:1000]", "[0:10000]", "[0:100000]"]
    assert all(float(cell) > 0 for row in rows for cell in row[1:])
