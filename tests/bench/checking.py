"""The time of `rtamt check`, and a check of its witnesses with the monitors.

``python tests/bench/checking.py`` checks every specification of the repository (files, scenarios,
golden cases) and generated ones with the default horizon. It prints the specifications that take at
least one second or have an unknown answer, with the cause, and then 50 pairs of requirements. Times
are processor times. `rtamt.judge` judges every witness again.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from collections.abc import Iterator
from pathlib import Path

from rtamt_envs.scenario import SCENARIOS, scenario_of

import rtamt
from rtamt import Verdict, judge

ROOT = Path(__file__).parents[2]
FILES = ("examples/*.stl", "examples/ros/*.stl", "ros/rtamt_ros/config/*.stl")
GOLDEN = ("discrete", "episode", "evidence", "verdict")


def written(most: int) -> Iterator[tuple[str, rtamt.Specification, float | str | None]]:
    """Return the specifications of the repository, each with a period."""
    for pattern in FILES:
        for path in sorted(ROOT.glob(pattern)):
            yield str(path.relative_to(ROOT)), rtamt.load(path), "100ms"
    for name in SCENARIOS:
        scenario = scenario_of(name)
        yield name, rtamt.parse(scenario.requirements), scenario.period
    for name in GOLDEN:
        cases = json.loads((ROOT / "tests" / "golden" / f"{name}.json").read_text())
        cases = cases["cases"] if isinstance(cases, dict) else cases
        texts = dict.fromkeys(case["formula"] for case in cases)
        for i, text in enumerate([*texts][:most]):
            yield f"{name}.json {i}", rtamt.parse(text), None


def generated(
    seed: int, count: int
) -> Iterator[tuple[str, rtamt.Specification, float | str | None]]:
    """Return formulas of two variables with short windows and with unbounded windows."""
    chance = random.Random(seed)

    def interval() -> str:
        begin = chance.randint(0, 2)
        ends = ["", f"[{begin}:inf]", *[f"[{begin}:{begin + chance.randint(0, 3)}]"] * 4]
        return chance.choice(ends)

    def formula(depth: int) -> str:
        if depth == 0 or chance.random() < 0.15:
            comparison = chance.choice([">", ">=", "<", "<=", "==", "!="])
            other = chance.choice(["0", "1", "2.5", "y", "x + 1", "2 * y - 1"])
            return f"({chance.choice('xy')} {comparison} {other})"
        one, two = formula(depth - 1), formula(depth - 1)
        name = chance.choice(
            ["not", "rise", "next", "prev", "always", "eventually", "once", "historically"]
            + ["and", "or", "implies", "until", "since"] * 2
        )
        if name in {"not", "rise", "next", "prev"}:
            return f"{name}({one})"
        if name in {"always", "eventually", "once", "historically"}:
            return f"{name}{interval()}({one})"
        return f"({one} {name}{interval() if name in {'until', 'since'} else ''} {two})"

    for i in range(count):
        yield f"generated {i}", rtamt.parse(formula(chance.randint(1, 3))), None


def agrees(
    result: rtamt.checking.Check, specs: dict[str, rtamt.Specification], period: float | str | None
) -> int:
    """Return the number of witnesses; raise AssertionError if the monitors disagree with one."""
    count = 0
    for name, requirement in result.requirements.items():
        questions = (
            (requirement.satisfiable, Verdict.SATISFIED),
            (requirement.falsifiable, Verdict.VIOLATED),
        )
        for answer, verdict in questions:
            if answer.trace is None or answer.trace.loop:
                continue
            columns = {v: answer.trace.unrolled(v) for v in specs[name].variables}
            n = None if columns else answer.trace.samples
            judged = judge(specs[name], columns, period, end="cut", n=n).verdict
            if judged is not verdict:
                raise AssertionError(f"{name}: {judged}, expected {verdict}: {requirement.text}")
            count += 1
    return count


def pairs(count: int) -> dict[str, str]:
    """Return requirements on few variables, so that most pairs share a variable."""
    chance = random.Random(1)
    bound, floor, late = "always(v{0} < {3})", "v{0} > {4}", "[0:{5}](v{1} < {3}))"
    kinds = (
        bound,
        f"always({floor} implies eventually{late}",
        f"always(rise({floor}) implies always{late}",
    )
    return {
        f"r{i}": chance.choice(kinds).format(
            *((i + k) % 6 for k in range(3)),
            chance.randint(20, 99),
            chance.randint(3, 9),
            chance.randint(2, 9),
        )
        for i in range(count)
    }


def main() -> None:
    """Print the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--golden", type=int, default=25, help="golden cases of each file")
    parser.add_argument("--generated", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pairs", type=int, default=50)
    options = parser.parse_args()
    for title, specs in (
        ("of the repository", written(options.golden)),
        ("generated", generated(options.seed, options.generated)),
    ):
        times, counts, judged = [], {"yes": 0, "no": 0, "unknown": 0}, 0
        for name, spec, period in specs:
            begin = time.process_time()
            try:
                result = rtamt.check(spec, period)
            except rtamt.RtamtError as error:
                print(f"  refused   {name}: {str(error).splitlines()[0]}")
                continue
            times.append((time.process_time() - begin) / len(result.requirements))
            judged += agrees(result, dict(spec.requirements), period)
            for one, requirement in result.requirements.items():
                counts[requirement.answer] += 1
                if requirement.answer == "unknown":
                    answers = (
                        requirement.satisfiable,
                        requirement.falsifiable,
                        *requirement.triggers.values(),
                    )
                    whys = {*requirement.unknown.values(), *(a.why for a in answers)} - {""}
                    print(f"  unknown   {name} {one}: {'; '.join(sorted(whys))}")
            if times[-1] >= 1:
                print(f"  {times[-1]:6.2f} s  {name}: {str(spec.formula)[:100]}")
        if not times:
            continue
        times.sort()
        print(
            f"{title}: {len(times)} specifications, {counts}, "
            f"median {times[len(times) // 2]:.3f} s, maximum {times[-1]:.2f} s; "
            f"{judged} witnesses, all confirmed by the monitors",
            flush=True,
        )
    if options.pairs:
        begin = time.process_time()
        result = rtamt.check(pairs(options.pairs))
        took = time.process_time() - begin
        print(
            f"{options.pairs} requirements in pairs: {took:.1f} s, answer {result.answer}, "
            f"{len(result.implied)} implied, {len(result.equal)} equal, "
            f"{len(result.unknown)} unknown"
        )


if __name__ == "__main__":
    main()
