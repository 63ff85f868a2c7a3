"""No output shows a decided verdict next to a robustness of the other sign without a reason.

Two options can cause this: ``view="step"`` shows the robustness of an instant next to a verdict on
all of them, and ``at_termination="failure"`` the robustness of the samples next to a violation by
the end. Every output that shows both is a row of a table here, and is tested on each kind of case.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from made_results import SPACE, tank
from matplotlib.text import Text
from numpy.typing import NDArray

import rtamt
from rtamt_gym import (
    RobustnessOverlay,
    StlMonitor,
    VectorStlMonitor,
    evaluate_policy,
    falsify,
    simulate,
    write_report,
)
from rtamt_gym.__main__ import main
from rtamt_gym.play.run import draw, plain_run
from rtamt_gym.play.summaries import record_table, runs_json
from rtamt_gym.reports.episodes import episode_of_run
from rtamt_gym.reports.figures import episode_figure
from rtamt_gym.results import Evaluation, Falsification, Record, Run
from rtamt_gym.wrappers.overlay import OverlayPanel

NAMED = (
    "by how it ended",
    "at end",
    "by_end=True",
    "of the instant",
    "of each instant",
    "of the newest instant",
    "--end complete",
    "if nothing follows",
)
"""The words with which a text explains the difference."""

SIGNS = {"VIOLATED": -1.0, "SATISFIED": 1.0}


def sign(robustness: float) -> float:
    return math.copysign(1.0, robustness)


def of_text(text: str) -> Iterator[tuple[float, float]]:
    """Return the signs of decided verdicts and robustness values, from lines that have both."""
    first = re.findall("VIOLATED|SATISFIED", text)[:1]
    for line in text.splitlines():
        here = set(re.findall("VIOLATED|SATISFIED", line) or first)
        found = re.findall(r"robustness[= ]\+?(-?(?:inf|\d[\d.e-]*))(, violated)?", line)
        found += [(each, "") for each in re.findall(r"(?<=\s)([+-](?:inf|\d[\d.e-]*))\b", line)]
        if len(here) == 1:
            for number, word in found:
                yield SIGNS[min(here)], -1.0 if word else sign(float(number))


def of_data(data: object) -> Iterator[tuple[float, float]]:
    """Return the same for mappings with both, and without an end or an instant as the reason."""
    if isinstance(data, Mapping):
        robustness = data.get("final", data.get("robustness"))
        said = data.get("by_end") or data.get("of_instant")
        if data.get("verdict") in SIGNS and robustness is not None and not said:
            yield SIGNS[data["verdict"]], sign(float(robustness))
    parts = data.values() if isinstance(data, Mapping) else data
    if isinstance(parts, list | tuple) or isinstance(data, Mapping):
        for part in parts:  # type: ignore[attr-defined]  # it is one of both
            yield from of_data(part)


def differs(output: object) -> bool:
    """Return whether an output shows a verdict next to a robustness of the other sign."""
    pairs = of_text(output) if isinstance(output, str) else of_data(output)
    return any(verdict != of for verdict, of in pairs)


def names_it(output: object) -> bool:
    return isinstance(output, str) and any(words in output for words in NAMED)


def unnamed(output: object) -> object:
    """Return the output without its explanation of the difference."""
    if isinstance(output, str):
        return re.sub("|".join(NAMED), "", output)
    if isinstance(output, Mapping):
        marks = ("by_end", "of_instant")
        return {key: unnamed(each) for key, each in output.items() if key not in marks}
    return [unnamed(each) for each in output] if isinstance(output, list) else output


class Kind(NamedTuple):
    """A requirement on a falling pole, its options, and whether signs differ."""

    spec: str
    options: Mapping[str, Any]
    differ: bool = False
    curve: bool = False  # only in the history


ANGLE = {"angle": "obs[2]"}
KINDS = {
    "samples": Kind("always(abs(angle) < 0.1)", {}),
    "goal": Kind("eventually(abs(angle) > 0.1)", {}),
    "cut": Kind("always[50:50](once[50:50](abs(angle) > 0.5))", {"at_termination": "cut"}),
    "failure": Kind("always(abs(angle) < 0.5)", {"at_termination": "failure"}, differ=True),
    "step": Kind("abs(angle) > 0.05", {"view": "step"}, curve=True),
    "step, failure": Kind(
        "eventually[0:1](abs(angle) < 0.5)",
        {"view": "step", "at_termination": "failure"},
        differ=True,
        curve=True,
    ),
}


def right(_: object) -> int:
    return 1


class Made:
    """The results of a kind of case, each computed at its first use."""

    def __init__(self, kind: Kind, folder: Path) -> None:
        self.kind, self.folder = kind, folder
        self.specs = {"upright": kind.spec}

    def run(self) -> Run:
        options: dict[str, Any] = {"policy": right, "seed": 1, "stop": "end", **self.kind.options}
        return simulate(gym.make("CartPole-v1"), self.specs, ANGLE, **options)

    def evaluation(self) -> Evaluation:
        options: dict[str, Any] = {
            "episodes": 2,
            "stop": "end",
            "progress": False,
            **self.kind.options,
        }
        return evaluate_policy(right, "CartPole-v1", self.specs, ANGLE, **options)

    def monitored(self, env: Any) -> Any:  # noqa: ANN401 - one environment, or many
        wrap = VectorStlMonitor if hasattr(env, "num_envs") else StlMonitor
        options: dict[str, Any] = {"on_violation": "report", "details": True, **self.kind.options}
        return wrap(env, self.specs, ANGLE, **options)

    def last_info(self) -> dict[str, Any]:
        env = self.monitored(gym.make("CartPole-v1"))
        env.reset(seed=1)
        ended = False
        while not ended:
            *_, ended, _, info = env.step(1)
        found: dict[str, Any] = info
        return found

    def printed(self, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
        main([*arguments])
        return capsys.readouterr().out


def told_by(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat keys of an info as one verdict next to one robustness."""
    episode = info["stl_episode"]["upright"]
    return {
        "all": {
            "verdict": "VIOLATED" if info["stl_violated"] else "UNDECIDED",
            "robustness": info["robustness"],
            "of_instant": info.get("stl_of_instant", False),
            "by_end": episode.get("by_end", False),
        },
        "states": [
            {**each, "by_end": episode.get("by_end", False)} for each in info["stl"].values()
        ],
        "episode": episode,
    }


def vector_infos(made: Made) -> list[object]:
    env = made.monitored(gym.make_vec("CartPole-v1", 2, vectorization_mode="vector_entry_point"))
    env.reset(seed=1)
    while True:
        *_, infos = env.step(np.ones(2, np.int64))
        if "stl_episode" in infos:
            break
    entry = int(infos["_stl_episode"].nonzero()[0][0])

    def of_entry(part: Any) -> Any:  # noqa: ANN401 - a dictionary, or an array
        if not isinstance(part, dict):
            return part[entry]
        there = {key: each for key, each in part.items() if not key.startswith("_")}
        return {
            key: of_entry(each)
            for key, each in there.items()
            if f"_{key}" not in part or part[f"_{key}"][entry]
        }

    return [told_by(of_entry(infos))]


def overlay(made: Made, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the texts on the last frame, a line for each specification."""
    texts: list[str] = []
    write = OverlayPanel._text

    def noted(self: OverlayPanel, draw: Any, x: float, y: float, text: str, *more: Any) -> None:  # noqa: ANN401
        texts.append(text)
        write(self, draw, x, y, text, *more)

    env = made.monitored(gym.make("CartPole-v1", render_mode="rgb_array"))
    env = RobustnessOverlay(env, signals=())
    env.reset(seed=1)
    ended = False
    while not ended:
        *_, ended, _, _ = env.step(1)
    with monkeypatch.context() as patched:
        patched.setattr(OverlayPanel, "_text", noted)
        env.render()
    return " ".join([texts[0], *texts[2:]])


def frame(made: Made) -> list[object]:
    run = made.run()
    table = run.to_frame()
    last = table.iloc[-1]
    verdict = int(~np.signbit(last["lower(upright)"])) - int(np.signbit(last["upper(upright)"]))
    return [
        {
            "verdict": {-1: "VIOLATED", 0: "UNDECIDED", 1: "SATISFIED"}[verdict],
            "robustness": last["robustness(upright)"],
            "of_instant": table.attrs["view"] == "step",
            "by_end": "upright" in table.attrs.get("by_end", ()),
        }
    ]


def rows_of(record: Record) -> list[object]:
    table = record.to_frame()
    return [
        {
            "verdict": row["verdict(upright)"],
            "robustness": row["robustness(upright)"],
            "by_end": row.get("violated(upright)") == "by how it ended",
        }
        for _, row in table.iterrows()
    ]


def saved_rows(made: Made) -> list[object]:
    path = made.folder / "record.parquet"
    made.evaluation().record.save(path)
    return rows_of(Record.load(path))


def lowered(sentence: str) -> str:
    """Return a sentence of the page in the words of other texts."""
    return sentence.replace("Robustness", "robustness").replace("violated", "VIOLATED")


def page(made: Made) -> str:
    path = made.folder / "page.html"
    write_report(path, made.evaluation())
    shown = re.findall(r"Robustness [^<]* at the end, [^<]*", path.read_text(encoding="utf-8"))
    assert shown
    return "\n".join(map(lowered, shown))


def chart(made: Made) -> str:
    words = episode_figure(episode_of_run(made.run(), "upright", "run", 10_000, 1), "s").summary
    return lowered(words)


def picture(made: Made) -> str:
    figure = draw([made.run()])
    texts = [each.get_text() for each in figure.findobj(Text)]
    return "\n".join(f"robustness {each}" if "ATED" in each else each for each in texts)


def on_the_command_line(made: Made, capsys: pytest.CaptureFixture[str]) -> str:
    words = ["run", "CartPole-v1", "--spec", f"upright = {made.kind.spec}"]
    words += ["--signal", "angle=obs[2]", "--on-violation", "report"]
    for name, value in made.kind.options.items():
        words += [f"--{name.replace('_', '-')}", value]
    return made.printed(capsys, *words)


OUTPUTS: dict[str, Callable[..., object]] = {
    "course": lambda made: repr(made.run().histories["upright"]),
    "outcome": lambda made: repr(made.run().outcomes["upright"]).replace("<Verdict.", ""),
    "runs.json": lambda made: json.loads(runs_json([made.run()], {})),
    "run.parquet": lambda made: plain_run(made.run(), arrays=False),
    "rtamt run": on_the_command_line,
    "rtamt run --plot": picture,
    "evaluation.json": lambda made: json.loads(made.evaluation().to_json()),
    "record": lambda made: rows_of(made.evaluation().record),
    "record.parquet": saved_rows,
    "page": page,
    "last info": lambda made: told_by(made.last_info()),
    "last infos": vector_infos,
    "chart": chart,
    "overlay": overlay,
    "data frame": frame,
}
"""The outputs with verdict and robustness of a run; the last three show its curve too."""

CURVES = ("last info", "last infos", "overlay", "data frame")


@pytest.mark.slow(keep=30)
@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("name", OUTPUTS)
def test_verdict_agrees_with_robustness_or_is_explained(
    name: str,
    kind: Kind,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = {"capsys": capsys, "monkeypatch": monkeypatch}
    make = OUTPUTS[name]
    wanted = set(make.__code__.co_varnames[: make.__code__.co_argcount])
    output = make(Made(kind, tmp_path), **{k: v for k, v in given.items() if k in wanted})
    assert names_it(output) or not differs(output), output
    # Each explanation is needed: without it the two would contradict each other.
    assert differs(unnamed(output)) == (kind.differ or (kind.curve and name in CURVES)), output


@pytest.mark.parametrize("kind", ["samples", "failure"])
def test_tables_explain_violations_by_end(kind: str, tmp_path: Path) -> None:
    evaluation = Made(KINDS[kind], tmp_path).evaluation()
    for text in (str(evaluation), "\n".join(record_table(evaluation.record))):
        assert ("violated by how it ended" in text) == (kind == "failure"), text


@pytest.mark.parametrize("text", ["always(level < 99)", "always(level < 0.9)"])
def test_search_explains_violation_by_end(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options: dict[str, Any] = {"period": 1, "at_termination": "failure", "seed": 0}
    found: Falsification = falsify(tank, {"dry": text}, SPACE, budget=3, **options)
    case = tmp_path / "case.json"
    found.save(case, system="made_results:tank")
    main(["replay", str(case)])
    by_end = text == "always(level < 99)"
    kept = json.loads(case.read_text(encoding="utf-8"))["expected"]
    assert kept.get("by_end", False) == by_end
    assert json.loads(found.to_json()).get("by_end", False) == by_end
    for each in (str(found), repr(found), capsys.readouterr().out):
        assert ("by how it ended" in each) == by_end, each
        assert names_it(each) or not differs(each)
    assert not differs(json.loads(found.to_json())["trials"])


Trace = Mapping[str, NDArray[np.float64]]

TRACES: dict[str, tuple[str, list[float], Mapping[str, Any]]] = {
    "samples": ("always(x > 0)", [1.0, -1.0], {}),
    "zero": ("always(x >= 0)", [0.0, 0.0], {}),
    "no zero": ("always(x > 0)", [0.0, 0.0], {}),
    "moved": ("next(prev(x > 0))", [-4.0], {"end": "cut"}),
    "moved zero": ("next(prev(x > 0))", [0.0], {"end": "cut"}),
    "moved up": ("s_next(s_prev(x > 0))", [4.0], {"end": "cut"}),
    "moved goal": ("eventually[2:2](once[2:2](x >= 0))", [0.0], {"end": "cut"}),
    "unknown": ("always(x > 0)", [1.0, math.nan, -1.0], {"nan": "unknown"}),
    "unknown goal": ("eventually(x > 0)", [math.nan, 1.0], {"nan": "unknown"}),
    "no concern": (
        "input float64 x\noutput float64 y\nalways(x > 0)",
        [1.0],
        {"semantics": "output-robustness"},
    ),
}

MOVED = ("moved", "moved zero", "moved up", "moved goal")


def judged(spec: str, values: list[float], options: Mapping[str, Any]) -> str:
    found = rtamt.judge(spec, {"x": values}, **options)
    return f"{found}\n{found!r}"


def monitored(spec: str, values: list[float], options: Mapping[str, Any]) -> str:
    given = {key: each for key, each in options.items() if key != "end"}
    monitor = rtamt.EpisodeMonitor(spec, **given)
    for value in values:
        monitor.update(value)
    monitor.finish(options.get("end", "complete"))
    return f"{monitor!r} {monitor.verdict.name}, robustness {monitor.robustness:g}"


def events(spec: str, values: list[float], options: Mapping[str, Any]) -> str:
    given = {key: each for key, each in options.items() if key not in {"nan", "end"}}
    pairs = [(float(at), value) for at, value in enumerate([*values, values[-1]])]
    known = [(at, value) for at, value in pairs if not math.isnan(value)]
    dense = re.sub(r"s?_?next\(s?_?prev\((.*)\)\)", r"eventually[2:2](once[2:2](\1))", spec)
    found = rtamt.dense.judge(dense, {"x": known}, options.get("end", "cut"), **given)
    return f"{found}\n{found!r}"


@pytest.mark.parametrize("output", [judged, monitored, events])
@pytest.mark.parametrize("kind", TRACES)
def test_judgement_verdict_agrees_with_robustness(output: Callable[..., str], kind: str) -> None:
    shown = output(*TRACES[kind])
    assert not differs(shown), shown


ON_TRACES = [
    (command, kind)
    for command in (["monitor"], ["explain"], ["monitor", "--json"])
    for kind, (_, _, options) in TRACES.items()
    if command != ["explain"] or "nan" not in options  # it refuses this
]


@pytest.mark.parametrize(("command", "kind"), ON_TRACES)
def test_commands_explain_other_end_modes(
    command: list[str], kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, values, options = TRACES[kind]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join(["x", *("" if math.isnan(x) else f"{x:g}" for x in values), ""]))
    words = [*command, spec, str(path)]
    for name, value in options.items():
        words += ["--missing" if name == "nan" else f"--{name}", value]
    main(words)
    text = capsys.readouterr().out
    if "--json" in command:
        assert not differs(json.loads(text))
        return
    # The verdict before a robustness of 0 states its sign.
    text = text.replace("VIOLATED, robustness 0, c", "VIOLATED, robustness 0, violated, c")
    assert names_it(text) or not differs(text), text
    # An explanation follows the deciding bound, so only the table reads the complete trace.
    table = re.search(r"^\(result\) +(\S+)", text, re.MULTILINE)
    moved = kind in MOVED and table is not None
    assert ("--end complete" in text or "if nothing follows" in text) == moved or (
        "UNDECIDED" in text
    ), text


def test_ci_files_show_verdict_and_robustness(tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text("x\n-4\n")
    out = {each: tmp_path / f"out.{each}" for each in ("xml", "md")}
    words = ["monitor", "next(prev(x > 0))", str(trace), "--end", "cut"]
    main([*words, "--junit", str(out["xml"]), "--markdown", str(out["md"])])
    for path in out.values():
        text = path.read_text(encoding="utf-8")
        assert "robustness -4 at sample 0" in text
        assert not differs(text)
