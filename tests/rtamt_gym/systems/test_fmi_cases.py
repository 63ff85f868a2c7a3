"""Runs of FMUs with cases: inputs and parameters by name replace the system's own."""

import copy
import gc
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fmus import library, write_fmu
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from input_cases import of_step, waveforms
from profiles import examples

from rtamt import InputError
from rtamt_gym import Fmus, Waveform, simulate

LOW = "always(level < 1e9)"


@pytest.fixture(scope="module", params=[2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory, version: int) -> Path:
    folder = tmp_path_factory.mktemp(f"fmi{version}")
    write_fmu(folder / "tank.fmu", library(version, folder), version)
    return folder / "tank.fmu"


def levels(
    steps: int,
    inflow: Callable[[int], float],
    step: float = 0.1,
    level: float = 1.0,
    area: float = 1.0,
) -> list[float]:
    """Return the levels by the definition of the tank."""
    result = [level]
    for i in range(steps):
        result.append(result[-1] + step * (inflow(i) - 0.5 * result[-1]) / area)
    return result


@settings(max_examples=examples(25), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    inflow=waveforms(0, 4) | st.floats(0, 4),
    numbers=st.fixed_dictionaries(
        {}, optional={"area": st.floats(0.5, 2), "level": st.floats(0, 3)}
    ),
)
def test_inputs_and_parameters_are_those_of_the_case(
    tank: Path, inflow: float | Waveform, numbers: dict[str, float]
) -> None:
    case = {"inflow": inflow, **numbers}
    system = Fmus(tank, inputs={"inflow": lambda _: 9.0}, parameters={"area": 7.0})
    own = simulate(system, LOW, duration=1)
    run = simulate(system, LOW, case=case, duration=1)
    numbers = {"area": 7.0, **numbers}
    expected = levels(10, lambda i: of_step(inflow, i, 0.1), **numbers)
    assert run.signals["level"].tolist() == expected
    assert simulate(system, LOW, duration=1) == own  # the system is unchanged


def test_a_communication_step_gets_the_value_of_its_own_time(tank: Path) -> None:
    ramp = Waveform([0, 0.2, 0.4], [0, 4, 0], "linear")
    system = Fmus(tank, step=0.05)
    run = simulate(system, LOW, case={"tank.inflow": ramp}, duration=0.5, period=0.1)
    expected = levels(10, lambda i: of_step(ramp, i, 0.05), 0.05)
    assert run.signals["level"].tolist() == expected[::2]


def test_whole_numbers_are_driven_by_whole_numbers(tank: Path) -> None:
    gears = Waveform([0, 0.2], [2, 3])
    run = simulate(Fmus(tank), "always(gear < 9)", case={"gear": gears}, duration=0.4)
    assert run.signals["gear"].tolist() == [2.0, 2.0, 3.0, 3.0, 3.0]


def test_wired_inputs_are_driven_where_the_case_says(tank: Path, tmp_path: Path) -> None:
    second = tmp_path / "second.fmu"
    second.write_bytes(tank.read_bytes())
    system = Fmus([tank, second], inputs={"second.inflow": "tank.level"})
    case: dict[str, float | Waveform] = {
        "second.inflow": 2.0,
        "tank.inflow": Waveform([0, 0.3], [1, 3]),
    }
    run = simulate(system, "always(tank.level + second.level < 99)", case=case, duration=1)
    assert run.signals["second.level"].tolist() == levels(10, lambda _: 2.0)
    assert run.signals["tank.level"].tolist() == levels(10, lambda i: 1.0 if i < 3 else 3.0)


def test_runs_share_the_unpacked_files_which_go_with_the_system(tank: Path) -> None:
    system = Fmus(tank)
    simulate(system, LOW, case={"inflow": 1.0}, duration=0.2)
    folders = list(system._folders)
    simulate(system, LOW, case={"inflow": 2.0}, duration=0.2)
    assert system._folders == folders
    assert folders[0].exists()
    again = pickle.loads(pickle.dumps(copy.copy(system)))
    run = simulate(again, LOW, case={"inflow": 2.0}, duration=0.2)
    assert run == simulate(system, LOW, case={"inflow": 2.0}, duration=0.2)
    del system
    gc.collect()
    assert not folders[0].exists()


ERRORS: list[tuple[dict[str, Any], str]] = [
    ({"inflo": 1.0}, "no variable 'inflo' in tank; did you mean 'inflow'?"),
    (
        {"area": Waveform([0], [1])},
        (
            "expected 'area' of the case as a number, which does not change during a run, got a "
            "waveform; waveforms drive inputs"
        ),
    ),
    (
        {"doubled": 1.0},
        (
            "expected a variable with a start value, got 'doubled', which is of causality 'output' "
            "and calculated"
        ),
    ),
    ({"gear": 1.5}, "expected a whole number for 'tank.gear', a {}, got 1.5"),
    (
        {"gear": Waveform([0, 1], [1, 2], "linear")},
        (
            "input 'tank.gear' takes whole numbers: expected a waveform with interpolation='hold', "
            "got Waveform(times=(0.0, 1.0), values=(1.0, 2.0), interpolation='linear')"
        ),
    ),
    (
        {"inflow": 1.0, "tank.inflow": 2.0},
        "expected 'tank.inflow' once in the case, got it as 'inflow' and as 'tank.inflow'",
    ),
]


@pytest.mark.parametrize(("case", "message"), ERRORS)
def test_an_fmu_says_what_it_takes(
    tank: Path, version: int, case: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        simulate(Fmus(tank), LOW, case=case, duration=1)
    assert str(caught.value) == message.format("Integer" if version == 2 else "Int32")
