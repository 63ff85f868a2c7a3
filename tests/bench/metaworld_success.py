"""Record episodes of Meta-World's scripted policies, and count successes by every definition.

    python tests/bench/metaworld_success.py record FOLDER --jobs 2         # the study, 900 episodes
    python tests/bench/metaworld_success.py record FOLDER --all --seeds 8  # all 50 tasks
    python tests/bench/metaworld_success.py count FOLDER

``record`` needs only Meta-World and ``packaging``: ``pip install metaworld packaging`` installs
them with the MuJoCo version that Meta-World pins. Install another MuJoCo afterwards. There is a
file for each task, variant and MuJoCo version, with the flags and observations of its episodes.
``count`` reads these files. Its counts by hand share no code with the definitions of rtamt, and it
prints how many verdicts of the monitors differ.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

TASKS: Final = (
    "button-press-topdown-v3",
    "door-open-v3",
    "drawer-open-v3",
    "pick-place-v3",
    "push-v3",
    "reach-v3",
)
"""The tasks of the study."""

VARIANTS: Final = ("scripted", "noise 0.1", "noise 0.3", "noise 0.5", "half speed")
"""The scripted policy; with normal noise on its actions; with actions of half the size."""

HOLD: Final = 40
"""0.5 s in steps of 12.5 ms."""


def acting(variant: str, policy: Any, rng: np.random.Generator) -> Any:  # noqa: ANN401
    """Return the policy of a variant."""
    noise = float(variant.split()[1]) if variant.startswith("noise") else 0.0
    scale = np.array([0.5, 0.5, 0.5, 1.0]) if variant == "half speed" else 1.0

    def act(observation: Any) -> Any:  # noqa: ANN401
        wanted = policy.get_action(observation) * scale + rng.normal(0.0, noise, 4)
        return np.clip(wanted, -1.0, 1.0)

    return act


def record(folder: Path, seeds: int, job: tuple[str, str]) -> str:
    """Record the episodes of a task and a variant; an existing file stays."""
    import metaworld
    import mujoco
    from metaworld.policies import ENV_POLICY_MAP

    name, variant = job
    path = folder / f"{name} {variant} mujoco {mujoco.__version__}.npz"
    if path.exists():
        return f"{path.name}: there"
    warnings.simplefilter("ignore")
    benchmark = metaworld.MT1(name, seed=0)
    env = benchmark.train_classes[name]()
    episodes: dict[str, list[Any]] = {"flags": [], "observations": [], "targets": [], "joints": []}
    for seed in range(seeds):
        env.set_task(benchmark.train_tasks[seed])
        act = acting(variant, ENV_POLICY_MAP[name](), np.random.default_rng(seed))
        observation, _ = env.reset()
        rows, flags, joints = [observation[:18]], [0], [env.data.qpos[9:].copy()]
        truncated = False
        while not truncated:
            observation, _, _, truncated, info = env.step(act(observation))
            rows.append(observation[:18])
            flags.append(int(info["success"] > 0))
            joints.append(env.data.qpos[9:].copy())
        episodes["flags"].append(np.array(flags, np.int8))
        episodes["observations"].append(np.array(rows, np.float32))
        episodes["joints"].append(np.array(joints, np.float32))
        episodes["targets"].append(np.array(env._target_pos, np.float64))
    env.close()
    arrays: dict[str, Any] = {key: np.array(values) for key, values in episodes.items()}
    np.savez_compressed(path, dt=env.dt, **arrays)
    return path.name


def by_hand(flags: Any) -> dict[str, bool]:  # noqa: ANN401 - an array of 0 and 1
    """Return the outcomes of an episode's flags, counted by hand."""
    longest = run = 0
    for flag_row in flags:
        run = run + 1 if flag_row else 0
        longest = max(longest, run)
    return {
        "any": bool(flags.any()),
        "last": bool(flags[-1]),
        "held": longest > HOLD,
        "kept": run > HOLD,
    }


def jobs(arguments: argparse.Namespace) -> Iterator[tuple[str, str]]:
    if arguments.all:
        from metaworld import ALL_V3_ENVIRONMENTS

        yield from product(ALL_V3_ENVIRONMENTS, VARIANTS[:1])
    else:
        yield from product(arguments.tasks, VARIANTS)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=("record", "count"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--all", action="store_true", help="all tasks, scripted alone")
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.what == "record":
        options.folder.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(options.jobs) as pool:
            for line in pool.map(partial(record, options.folder, options.seeds), jobs(options)):
                print(line, flush=True)
        return
    count(options.folder)


def count(folder: Path) -> None:
    """Print the counts of all files of a folder by hand, and the number of different verdicts."""
    import rtamt
    from rtamt_gym.benchmarks.metaworld import TASKS as ROWS
    from rtamt_gym.benchmarks.metaworld import done
    from rtamt_gym.success import readings

    names = ("any", "last", "held", "kept", "kept, side")
    print(f"{'task, variant':44}{'n':>5}", *(f"{name:>11}" for name in names))
    totals: dict[str, Any] = {}
    wrong = judged = 0
    for path in sorted(folder.glob("*.npz")):
        name, _, variant_part = path.stem.partition(" ")
        variant, _, version = variant_part.partition(" mujoco ")
        file = np.load(path)
        counts = np.zeros(5, int)
        for episode, flags in enumerate(file["flags"]):
            outcomes = by_hand(flags)
            side = flags > 0
            trace = {"success": flags.astype(float)}
            row = ROWS[name]
            if row.quantity != "flag":
                past = past_of(row, file, episode)
                side = past >= -row.tolerance
                trace["past"] = past
            mine = [*outcomes.values(), by_hand(side)["kept"]]
            counts += mine
            formulas = [*readings("success").values(), readings(done(name))["kept"]]
            for formula, expected in zip(formulas, mine, strict=True):
                verdict = rtamt.judge(formula, trace, period="12.5ms", end="complete").verdict
                wrong += (verdict is rtamt.Verdict.SATISFIED) != expected
                judged += 1
        total = len(file["flags"])
        print(f"{f'{name}, {variant}':44}{total:>5}", *(f"{total_of:>11}" for total_of in counts))
        before, many = totals.get(version, (np.zeros(5, int), 0))
        totals[version] = before + counts, many + total
    for version, (counts, total) in totals.items():
        print(
            f"{f'all, MuJoCo {version}':44}{total:>5}", *(f"{total_of:>11}" for total_of in counts)
        )
    print(f"{judged} verdicts of the monitors, {wrong} other than counted by hand")


def past_of(row: Any, file: Any, episode: int) -> Any:  # noqa: ANN401 - a row of tasks, and arrays
    """Return the distance of an episode's object beyond its target, by hand."""
    if row.quantity == "lever":
        return -file["joints"][episode][:, 0].astype(float) - np.pi / 2
    axis = "xyz".index(row.quantity)
    shown = file["observations"][episode][:, 4 + axis].astype(float)
    return row.side * (shown - file["targets"][episode][axis])


if __name__ == "__main__":
    main()
