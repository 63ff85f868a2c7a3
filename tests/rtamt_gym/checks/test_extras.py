"""`rtamt_gym` where optional packages are not installed."""

import subprocess
import sys

import pytest

import rtamt_gym

ALL = set(rtamt_gym._MODULES)


def said(code: str, *, without: str = "") -> str:
    """What a program prints where packages are missing."""
    missing = "".join(f"sys.modules[{name!r}] = None\n" for name in without.split())
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{missing}{code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


OF_INPUTS = {"Case", "Parameter", "Signal", "Space", "Waveform"}
OF_TRACES = {"Mined", "Reading", "Record", "RequirementResult", "mine"}
OF_MUJOCO = {"Snapshot", "StepMonitor", "evaluate_rollouts"}


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
def test_a_star_imports_what_the_installed_packages_allow(without: str, lacks: set[str]) -> None:
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
def test_what_needs_a_missing_package_names_its_extra(
    code: str, without: str, message: str
) -> None:
    caught = (
        f"try:\n    exec({code!r})\nexcept ModuleNotFoundError as e:\n    print(e.name, str(e))"
    )
    assert said(caught, without=without).startswith(f"{without} {message}")


def test_a_scenario_that_draws_names_the_extra_of_matplotlib() -> None:
    code = (
        "import gymnasium as gym, rtamt_envs\n"
        "env = gym.make('rtamt/RequestGrant-v0', render_mode='rgb_array')\n"
        "env.reset()\n"
        "try:\n    env.render()\nexcept ModuleNotFoundError as e:\n    print(e)"
    )
    assert said(code, without="matplotlib") == (
        "render needs matplotlib, which is not installed; from the checkout: pip install '.[plot]'"
    )


def test_environments_are_monitored_without_mujoco() -> None:
    code = (
        "import gymnasium as gym\nfrom rtamt_gym import *\n"
        "env = StlMonitor(gym.make('CartPole-v1'), 'always(x < 9)', {'x': 'obs[0]'})\n"
        "env.reset(seed=0)\n"
        "run = simulate(env.env, 'always(x < 9)', {'x': 'obs[0]'}, policy=lambda obs: 0, seed=0)\n"
        "print(run.verdict.name)"
    )
    assert said(code, without="mujoco fmpy matplotlib pyarrow highway_env") == "SATISFIED"
