"""`rtamt_gym` without optional packages."""

import runpy
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

import pytest

import rtamt_gym
from rtamt_gym.checks import extras
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.commands.errors import refusal
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.play.campaign import ParallelRunner
from rtamt_gym.reports.html import render
from rtamt_gym.results import Record, Sweep
from rtamt_gym.results.intervals import scipy_stats
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.sweeps.effects import Indices

ALL = set(rtamt_gym._MODULES)


def said(code: str, *, without: str = "") -> str:
    """Return the output of a program without some packages."""
    missing = "".join(f"sys.modules[{name!r}] = None\n" for name in without.split())
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{missing}{code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


OF_INPUTS = {"Case", "Parameter", "Signal", "Space", "Waveform"}
OF_TRACES = {"EvaluationOptions", "mine"}
OF_MUJOCO = {"StepMonitor"}


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("without", "lacks"),
    [
        ("", set()),
        ("fmpy", set()),
        ("fmpy matplotlib pyarrow highway_env", set()),
        ("mujoco", OF_MUJOCO),
        ("gymnasium mujoco fmpy", ALL - OF_INPUTS - OF_TRACES),
    ],
)
def test_star_import_skips_missing_packages(without: str, lacks: set[str]) -> None:
    code = "before = {*globals(), 'before'}\nfrom rtamt_gym import *\nprint(*{*globals()} - before)"
    assert set(said(code, without=without).split()) == ALL - lacks
    assert OF_MUJOCO < ALL


@pytest.mark.parametrize(
    ("code", "without", "message"),
    [
        (
            "from rtamt_gym import *; Fmus('plant.fmu')",
            "fmpy",
            "Fmus needs fmpy, which is not installed; from the checkout: pip install '.[fmi]'",
        ),
        (
            "from rtamt_gym import StepMonitor",
            "mujoco",
            (
                "rtamt_gym.StepMonitor needs mujoco, which is not installed; "
                "from the checkout: pip install '.[gym]'"
            ),
        ),
        (
            "import rtamt_gym; rtamt_gym.simulate",
            "gymnasium",
            (
                "rtamt_gym.simulate needs gymnasium, which is not installed; "
                "from the checkout: pip install '.[gym]'"
            ),
        ),
        ("from rtamt_gym import StlMonitor", "numpy", "import of numpy halted"),
    ],
)
def test_import_error_names_extra(code: str, without: str, message: str) -> None:
    caught = (
        f"try:\n    exec({code!r})\nexcept ModuleNotFoundError as e:\n    print(e.name, str(e))"
    )
    assert said(caught, without=without).startswith(f"{without} {message}")


NONE: Any = None
DRAWING = ("rtamt_gym.drawing",)


@pytest.mark.parametrize(
    ("call", "package", "inside", "what", "extra"),
    [
        (lambda: Comparison.to_frame(NONE), "pandas", (), "Comparison.to_frame", "pandas"),
        (lambda: Indices.to_frame(NONE), "pandas", (), "Indices.to_frame", "pandas"),
        (lambda: Record.to_frame(NONE), "pandas", (), "Record.to_frame", "pandas"),
        (lambda: Record.statistics(NONE), "pandas", (), "statistics", "pandas"),
        (
            lambda: Record.load("runs.parquet"),
            "pyarrow",
            (),
            "Record.load",
            "search",
        ),
        (
            lambda: ParallelRunner(NONE, 2, None, None),
            "joblib",
            (),
            "n_jobs=",
            "search",
        ),
        (
            lambda: MethodComparison.plot(NONE, "a.png"),
            "matplotlib",
            DRAWING,
            "MethodComparison.plot",
            "plot",
        ),
        (
            lambda: Falsification.plot(NONE, "a.png"),
            "matplotlib",
            DRAWING,
            "Falsification.plot",
            "plot",
        ),
        (
            lambda: Sweep.scatter(NONE, "a.png"),
            "matplotlib",
            (*DRAWING, "rtamt_gym.search.sweeps.pictures"),
            "Sweep.scatter",
            "plot",
        ),
        (lambda: render(NONE), "jinja2", (), "a report", "report"),
        (lambda: scipy_stats("compare"), "scipy", (), "compare", "search"),
    ],
)
def test_call_error_names_extra(
    call: Callable[[], object],
    package: str,
    inside: Sequence[str],
    what: str,
    extra: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in inside:  # as in a program that has not imported them yet
        above, _, last = name.rpartition(".")
        monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.delattr(import_module(above), last, raising=False)
    for name in [*sys.modules]:
        if name.partition(".")[0] == package:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ModuleNotFoundError) as caught:
        call()
    assert str(caught.value) == (
        f"{what} needs {package}, which is not installed; from the checkout: "
        f"pip install '.[{extra}]'"
    )


@pytest.mark.parametrize(
    ("command", "extra"), [("compare", "files"), ("monitor", "files"), ("evaluate", "search")]
)
def test_command_error_names_smallest_extra(command: str, extra: str) -> None:
    error = ModuleNotFoundError("No module named 'scipy'", name="scipy")
    text = f"scipy is not installed; from the checkout: pip install '.[{extra}]'"
    assert refusal(error, {}, command) == text


def test_other_import_errors_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    error = ModuleNotFoundError("No module named 'yaml'", name="yaml")
    assert naming_extra(error, "a report") is error

    def fail(_name: str) -> None:
        raise error

    monkeypatch.setattr(rtamt_gym, "import_module", fail)
    with pytest.raises(ModuleNotFoundError) as caught:
        _ = rtamt_gym.__all__
    assert caught.value is error


def test_dir_lists_lazy_names() -> None:
    assert {"__getattr__", *ALL} <= {*dir(rtamt_gym)}


def test_released_library_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rtamt", ModuleType("rtamt"))
    with pytest.raises(ImportError) as caught:
        runpy.run_path(extras.__file__)  # a reload would change the module for other tests
    assert str(caught.value) == (
        "expected the packages of rtamt-stl, got the released rtamt, which was installed over it: "
        "pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )


@pytest.mark.slow
def test_scenario_render_error_names_extra() -> None:
    code = (
        "import gymnasium as gym, rtamt_envs\n"
        "env = gym.make('rtamt/RequestGrant-v0', render_mode='rgb_array')\n"
        "env.reset()\n"
        "try:\n    env.render()\nexcept ModuleNotFoundError as e:\n    print(e)"
    )
    assert said(code, without="matplotlib") == (
        "render needs matplotlib, which is not installed; from the checkout: pip install '.[plot]'"
    )


@pytest.mark.slow
def test_monitor_without_mujoco() -> None:
    code = (
        "import gymnasium as gym\nfrom rtamt_gym import *\n"
        "env = StlMonitor(gym.make('CartPole-v1'), 'always(x < 9)', {'x': 'obs[0]'})\n"
        "env.reset(seed=0)\n"
        "run = simulate(env.env, 'always(x < 9)', {'x': 'obs[0]'}, policy=lambda obs: 0, seed=0)\n"
        "print(run.verdict.name)"
    )
    assert said(code, without="mujoco fmpy matplotlib pyarrow highway_env") == "SATISFIED"
