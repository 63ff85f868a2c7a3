"""The record of a campaign is the same for any workers, and its folder belongs only to it."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import joblib
import pytest
from campaign_systems import tank, tank_runner, tank_tasks
from mujoco_models import arm

from rtamt import InputError, InputTypeError
from rtamt_gym import Case, Parameter, Runner, sweep
from rtamt_gym.__main__ import main
from rtamt_gym.play import campaign
from rtamt_gym.play import workers as campaign_process
from rtamt_gym.play.campaign import Recipe, chosen_workers, run_campaign
from rtamt_gym.play.loop import Task
from rtamt_gym.play.workers import Setup, end_processes, run_chunk
from rtamt_gym.results import Record, Sweep

GRANTS = "rtamt/RequestGrant-v0"
NOISE = Parameter("noise", 0.1, 1)


@pytest.mark.slow
def test_the_record_is_the_same_on_any_number_of_processes_in_environments_or_not() -> None:
    options: dict[str, Any] = {"space": [NOISE], "samples": 23, "sampler": "lhs", "seed": 5}
    spec = "always(gnt < 3)"
    alone = sweep(GRANTS, spec, batch=1, **options)
    entries = sweep(GRANTS, spec, batch=4, n_jobs=2, **options)
    assert alone.record == entries.record
    assert len({row.outcomes["spec"].robustness for row in alone.record}) == 23


class Registered(gym.Env[Any, Any]):
    """An environment that only this program registers: it observes its reward and its seed."""

    observation_space = gym.spaces.Box(-1e9, 1e9, (2,))
    action_space = gym.spaces.Discrete(1)
    control_timestep = 1.0

    def __init__(self, reward: float) -> None:
        self._reward = reward

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:  # noqa: ANN401
        super().reset(seed=seed, options=options)
        return [self._reward, self.np_random.integers(100)], {}

    def step(self, _: object) -> Any:  # noqa: ANN401
        return [self._reward, self.np_random.integers(100)], 0.0, False, False, {}


def registered(reward: float = 3) -> Runner:
    name = "RegisteredHere-v0"
    gym.registry.pop(name, None)
    entry: Any = Registered  # no other process can import it
    gym.register(name, entry)
    env = gym.make(name, reward=reward, max_episode_steps=5, disable_env_checker=True)
    signals: Any = {"r": "obs[0]", "x": lambda step: step.obs[1]}
    return Runner(env, "always(r > x)", signals=signals, policy=lambda _: 0)


def pendulum() -> Runner:
    return Runner(arm(), "always(q < 1)", signals={"q": "qpos[0]"}, duration=0.1)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("made", "tasks"), [(registered, [({}, 4), ({}, 5)]), (pendulum, [({}, None)])]
)
def test_what_is_registered_here_or_made_of_mujoco_runs_in_other_processes(
    made: Callable[[], Runner], tasks: list[Any]
) -> None:
    with made() as runner:
        here = run_campaign(runner, tasks)
        assert not here.failed()
        assert run_campaign(runner, tasks, n_jobs=1) == here


def test_what_cannot_be_sent_or_made_elsewhere_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    held = threading.Lock()

    def locked(inflow: float) -> Iterator[dict[str, float]]:
        with held:
            yield from tank(inflow)

    with pytest.raises(InputTypeError) as sent:
        run_campaign(tank_runner(locked), tank_tasks(1), n_jobs=2)
    assert str(sent.value) == (
        "locked cannot be sent to other processes: TypeError: cannot pickle '_thread.lock' object; "
        "give the id of a registered environment, or a function that builds the parts that cannot "
        "be pickled"
    )
    module: Any = ModuleType("only_here")
    exec("def well(inflow):\n    yield {'level': inflow}\n", vars(module))  # noqa: S102 - no file has it
    monkeypatch.setitem(__import__("sys").modules, "only_here", module)
    with pytest.raises(InputError) as made:
        run_campaign(tank_runner(module.well), tank_tasks(1), n_jobs=2)
    assert str(made.value) == (
        "another process cannot make the system: ModuleNotFoundError: No module named 'only_here'; "
        "give the id of a registered environment, or a function that can be imported or pickled"
    )


def test_a_backend_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = [
        ("ray", "ray", "import of ray halted; None in sys.modules; pip install ray"),
        ("dask", "distributed", ""),
    ]
    for backend, package, said in refused:
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(InputError) as caught:
            run_campaign(tank_runner(), tank_tasks(1), backend=backend)  # type: ignore[arg-type]
        assert str(caught.value).startswith(f"cannot use backend='{backend}': {said}")


def test_arguments_of_a_runner_are_compared_as_json() -> None:
    runner = Runner(
        tank,
        {"dry": "always(level < 2)"},
        signals={"level": ("level", 0.5)},
        period=Fraction(1, 10),
        duration=19,
    )
    identity = Recipe(runner).identity({})
    assert (identity["period"], identity["signals"]) == ("1/10", {"level": ["level", 0.5]})
    assert json.loads(json.dumps(identity)) == identity


def threads(variable: float) -> Iterator[dict[str, float]]:
    name = ["NUMBA_NUM_THREADS", "OMP_NUM_THREADS"][int(variable)]
    yield {"level": float(os.environ[name])}


@pytest.mark.slow
def test_libraries_of_a_process_start_no_more_threads_than_there_are_cores_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for jobs in (1, 2, 64):
        with chosen_workers(None, jobs) as (count, item):
            assert (count, item) == (jobs, max(1, joblib.cpu_count() // jobs))
    monkeypatch.setenv("OMP_NUM_THREADS", "7")  # the user's value counts
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    runner = Runner(threads, {"dry": "always(level < 0)"}, period=1)
    tasks = [Task(i, Case({"variable": float(i)}), None) for i in range(2)]
    setup = Setup("threads", Recipe(runner).pickled("threads"), None, 3)
    rows = dict(run_chunk(setup, tasks))
    assert [rows[i].outcomes["dry"].robustness for i in range(2)] == [-3, -7]
    end_processes("threads")
    with pytest.raises(InputError, match=r"^the campaign is over$"):
        run_chunk(setup, tasks)


@pytest.mark.slow
def test_a_process_that_has_waited_too_long_for_tasks_is_followed_by_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(campaign_process, "_IDLE", 1.0)
    setup = Setup("idle", Recipe(tank_runner()).pickled("tank"), None, 1)
    tasks = [Task(i, Case(case), None) for i, (case, _) in enumerate(tank_tasks(3))]
    rows = run_chunk(setup, tasks)
    (process,) = campaign_process._idle["idle"]
    process._process.wait(100)
    rows += run_chunk(setup, tasks)
    end_processes("idle")
    here = run_campaign(tank_runner(), tank_tasks(3))
    assert [row for _, row in rows] == [*here, *here]


def test_a_folder_holds_one_campaign_that_one_process_runs(tmp_path: Path) -> None:
    def refusal(**options: Any) -> str:  # noqa: ANN401
        given: dict[str, Any] = {"samples": 3, "folder": tmp_path / "runs", **options}
        with pytest.raises(InputError) as refused:
            sweep(given.pop("system", GRANTS), given.pop("spec", "granted"), [NOISE], **given)
        return str(refused.value).replace(f"{tmp_path}/", "")

    done = sweep(GRANTS, "granted", [NOISE], samples=3, folder=tmp_path / "runs")
    again = sweep(GRANTS, "granted", [NOISE], samples=3, folder=tmp_path / "runs", n_jobs=2)
    assert done.record == again.record == Record.load(tmp_path / "runs")
    loaded = Sweep.load(tmp_path / "runs")
    assert (loaded.space, loaded.sampler, loaded.seed) == (done.space, "sobol", 0)
    other = "runs holds another campaign: its"
    way_out = "; give another folder, or remove this one"
    assert refusal(seed=1) == f"{other} seed is 0, not 1{way_out}"
    assert refusal(samples=4) == f"{other} number of runs is 3, not 4{way_out}"
    assert refusal(stop="decided") == f'{other} stop is "end", not "decided"{way_out}'
    assert refusal(spec={"granted": "always(gnt > 9)"}) == (
        f'{other} requirements is {{"granted": "always[0:10s](req >= 3 implies '
        f'eventually[0:5s](gnt >= 3))"}}, not {{"granted": "always(gnt > 9)"}}{way_out}'
    )
    again = sweep(GRANTS, "granted", [NOISE], samples=3, folder=tmp_path / "runs")
    assert again.record == done.record
    with registered(3) as runner:
        run_campaign(runner, [({}, 4)], folder=tmp_path / "own")
    with registered(4) as runner, pytest.raises(InputError) as refused:
        run_campaign(runner, [({}, 4)], folder=tmp_path / "own")
    assert str(refused.value) == (
        f"{tmp_path / 'own'} holds another campaign: its arguments of the system is "
        f'{{"reward": 3}}, not {{"reward": 4}}{way_out}'
    )
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "todo.txt").touch()
    assert refusal(folder=tmp_path / "notes") == (
        "expected folder= as a new folder or the folder of a campaign, got notes, "
        "which holds 'todo.txt'"
    )
    assert refusal(folder=tmp_path / "notes" / "todo.txt") == (
        "expected folder= as a folder, got the file notes/todo.txt"
    )
    with pytest.raises(InputError, match=r"notes holds no campaign: there is no campaign.json in"):
        Record.load(tmp_path / "notes")

    def second(inflow: float) -> Iterator[dict[str, float]]:
        yield {"level": inflow}
        run_campaign(runner, tasks, folder=tmp_path / "both")

    runner, tasks = tank_runner(second), tank_tasks(1)
    (row,) = run_campaign(runner, tasks, folder=tmp_path / "both")
    assert row.error == (
        f"InputError: another process runs the campaign in {tmp_path / 'both'}; wait for it, or "
        "end it"
    )


@pytest.mark.slow
def test_the_command_goes_on_in_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ["--folder", str(tmp_path / "runs")]
    command = ["sweep", GRANTS, "--vary", "noise=0.1:1", "--samples", "8"]
    assert main([*command, "-j", "2", "--timeout", "100", *folder]) == 0
    first = capsys.readouterr().out
    assert main([*command, *folder]) == main(command) == 0
    reused = f"\nreused 8 of 8 simulations from\n  {folder[1]}\n"
    assert capsys.readouterr().out.replace(reused, "", 1) == first * 2
    assert len(Record.load(tmp_path / "runs")) == 8
    assert main([*command, "--timeout", "-1"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected --timeout as a finite number above 0, got -1.0\n"
    )


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"n_jobs": 0}, "expected n_jobs= as a whole number, or -1 for all cores, got 0"),
        ({"n_jobs": 2.0}, "expected n_jobs= as a whole number, or -1 for all cores, got 2.0"),
        ({"timeout": 0}, "expected timeout= as a finite number above 0, got 0"),
        ({"backend": "loky"}, "expected backend=None, 'dask' or 'ray', got 'loky'"),
    ],
)
def test_mistakes_are_refused_before_anything_runs(options: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError) as refused:
        run_campaign(tank_runner(), tank_tasks(1), **options)
    assert str(refused.value) == text


def test_the_bar_says_what_was_violated_and_what_stopping_has_saved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notes: list[tuple[int, str]] = []

    class Bar:
        def __init__(self, *_: object) -> None: ...

        def __enter__(self) -> Callable[[int, str], None]:
            return lambda done, note: notes.append((done, note))

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(campaign, "shown_progress", Bar)
    runner = Runner(tank, {"dry": "always(level < 2)"}, period=1, stop="violation", duration=19)
    record = run_campaign(runner, [({"inflow": 0.1}, None), ({"inflow": 0.3}, None)], progress=True)
    assert [(row.ended, row.simulated) for row in record] == [("duration", 19), ("violation", 7)]
    assert [done for done, _ in notes] == [0, 1, 1]
    assert [note for _, note in notes] == [
        "",
        "0 violated, minimum robustness 1",
        "1 violated, minimum robustness -0.0434, 12 s of simulation saved",
    ]
    notes.clear()
    with Runner(fragile, {"dry": "always(level < 2)"}, period=1) as runner:
        run_campaign(runner, [({"x": 1.0}, None), ({"x": 0.0}, None)], progress=True)
    assert [note for _, note in notes] == [
        "",
        "1 failed",
        "0 violated, minimum robustness 1, 1 failed",
    ]


def fragile(x: float) -> Iterator[dict[str, float]]:
    if x > 0.5:
        raise ValueError(x)
    yield {"level": 1.0}
