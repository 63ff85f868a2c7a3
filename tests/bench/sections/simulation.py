"""The time that a monitor adds to `mj_step`, to environment steps, and to `doStep` of FMUs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from controller import Figures, Setting, race
from report import Row, Table

MODELS = {
    "inverted_pendulum": ("qpos[1]", 2_000),
    "half_cheetah": ("qpos[2]", 2_000),
    "humanoid": ("qpos[2]", 300),
}


def measure(setting: Setting) -> Iterator[Table]:
    """Measure steps of models, environments and FMUs, and episodes of a policy."""
    yield models(setting)
    yield environments(setting)
    yield units(setting)
    yield episodes(setting)


def compete(setting: Setting, cases: dict[str, dict[str, Any]], table: Table) -> Figures:
    """Return one process for each case."""
    subjects = {name: setting.project("simulations") for name in cases}
    results = race(
        {name: (subjects[name], case) for name, case in cases.items()},
        3 if setting.quick else 9,
        table.notes,
    )
    for subject in subjects.values():
        subject.stop()
    return results


def models(setting: Setting) -> Table:
    """Measure the added time of a step of the physics, with one specification."""
    table = Table("StepMonitor, added to mj_step", "us")
    for name, (signal, steps) in MODELS.items():
        case = {"what": "model", "model": name, "steps": steps}
        cases: dict[str, dict[str, Any]] = {
            "bare": {**case, "signal": None},
            "one": {**case, "signal": signal},
        }
        if name == "half_cheetah":
            cases["contact"] = {**case, "signal": "contact:ffoot,floor"}
            cases["forward"] = {**case, "signal": "body:torso.xpos[2]", "forward": True}
        results = compete(setting, cases, table)
        if "bare" not in results:
            continue
        bare = results["bare"][0]
        table.rows.append(Row(f"{name}, bare mj_step", {"rtamt": bare / 1e3}))
        for who, label, target in (
            ("one", "  one spec", 0.4),
            ("contact", "  one spec of a contact", None),
            ("forward", "  one spec, forward=True", None),
        ):
            if who in results:
                added = (results[who][0] - bare) / 1e3
                table.rows.append(Row(label, {"rtamt": added}, target))
    return table


def environments(setting: Setting) -> Table:
    """Measure the added time of a step of an environment, with one specification."""
    table = Table("StlMonitor, added to env.step, without and with substeps=True", "us")
    for name, signal, frames in (
        ("Reacher-v5", "qpos[1]", 2),
        ("HalfCheetah-v5", "qpos[2]", 5),
        ("HumanoidStandup-v5", "qpos[2]", 5),
    ):
        case = {"what": "environment", "env": name, "steps": 200}
        results = compete(
            setting,
            {
                "bare": {**case, "signal": None},
                "steps": {**case, "signal": signal, "substeps": False},
                "substeps": {**case, "signal": signal, "substeps": True},
            },
            table,
        )
        if "bare" not in results:
            continue
        bare = results["bare"][0]
        table.rows.append(Row(f"{name}, bare step", {"rtamt": bare / 1e3}))
        for who, label in (
            ("steps", "  a sample a step"),
            ("substeps", f"  a sample a sub-step, {frames} of them"),
        ):
            if who in results:
                table.rows.append(Row(label, {"rtamt": (results[who][0] - bare) / 1e3}))
    return table


def units(setting: Setting) -> Table:
    """Measure a communication step of an FMU, with FMPy alone and with `simulate`."""
    table = Table("an FMU: FMPy's doStep and a read, and simulate with all its records", "us")
    for version in (2, 3):
        case = {"what": "fmu", "version": version, "steps": 2_000}
        results = compete(
            setting,
            {
                "bare": {**case, "specs": None},
                "one": {**case, "specs": "always(level > 0)"},
                "two": {**case, "specs": {"a": "always(level > 0)", "b": "always(level < 9)"}},
            },
            table,
        )
        for who, label in (
            ("bare", f"FMI {version}.0, doStep and a read"),
            ("one", "  simulate, one spec"),
            ("two", "  simulate, two specs"),
        ):
            if who in results:
                table.rows.append(Row(label, {"rtamt": results[who][0] / 1e3}))
    return table


def episodes(setting: Setting) -> Table:
    """Measure a step of `evaluate_policy` against a loop of the same policy without monitors."""
    table = Table("evaluate_policy on CartPole, a step of an episode", "us")
    for policy, label in (("good", "500 steps"), ("bad", "9 steps")):
        case = {"what": "episodes", "policy": policy, "episodes": 20 if policy == "good" else 500}
        results = compete(
            setting,
            {
                "bare": {**case, "specs": None},
                "one": {**case, "specs": {"near": "always(abs(x) < 2)"}},
                "three": {
                    **case,
                    "specs": {
                        "near": "always(abs(x) < 2)",
                        "upright": "always(abs(a) < 0.15)",
                        "slow": "always(eventually[0:0.2](v < 1))",
                    },
                },
            },
            table,
        )
        for who, words in (
            ("bare", f"{label}, a bare loop"),
            ("one", "  evaluate_policy, one requirement"),
            ("three", "  evaluate_policy, three requirements"),
        ):
            if who in results:
                table.rows.append(Row(words, {"rtamt": results[who][0] / 1e3}))
    return table
