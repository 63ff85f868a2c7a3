"""A search on several processes equals the search on one, and survives its simulations."""

import os
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from campaign_systems import rest

from rtamt import InputError
from rtamt_gym import Parameter, falsify
from rtamt_gym.__main__ import main
from rtamt_gym.play import workers as campaign_process
from rtamt_gym.results import Falsification
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

TRANSMISSION = "rtamt/AutomaticTransmission-v0"
LEVEL = Parameter("inflow", 0.1, 0.25)


def tank(inflow: float) -> Iterator[Mapping[str, float]]:
    level = 1.0
    for _ in range(20):
        yield {"level": level}
        level += inflow - 0.1 * level


def sober(found: Falsification) -> Any:  # noqa: ANN401
    """Return a result without wall times."""
    return (
        str(found),
        found.unreduced,
        found.row,
        found.record,
        dict(found.scales),
        found.simulations,
    )


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("system", "requirement", "options"),
    [
        (tank, "always(level < 1.95)", {"space": [LEVEL], "period": 1, "optimizer": "cma"}),
        (tank, "always(level < 9)", {"space": [LEVEL], "period": 1, "budget": 40}),
        (TRANSMISSION, "AT6a", {"budget": 60}),  # in scales, in environments
        (TRANSMISSION, "AT54", {"budget": 60}),  # judged once runs are over
    ],
    ids=["found", "not found", "scales", "whole"],
)
def test_the_result_is_the_same_on_any_number_of_processes(
    system: Any,  # noqa: ANN401
    requirement: str,
    options: Any,  # noqa: ANN401
) -> None:
    here = falsify(system, requirement, **options)
    assert sober(falsify(system, requirement, n_jobs=2, **options)) == sober(here)
    assert not campaign_process._all


def deadly(inflow: float) -> Iterator[Mapping[str, float]]:
    if inflow > 0.2:
        os._exit(3)
    yield from tank(inflow)


def endless(inflow: float) -> Iterator[Mapping[str, float]]:
    yield {"level": 1.0}
    while inflow > 0.24:
        rest(1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "options", "error"),
    [
        (
            deadly,
            {"n_jobs": 2},
            "ChildProcessError: the run ended its process with exit status 3, twice",
        ),
        (endless, {"timeout": 1.0}, "TimeoutError: the run was ended after timeout=1 s"),
    ],
)
def test_a_simulation_that_ends_its_process_or_hangs_has_that_in_its_row(
    system: Any,  # noqa: ANN401
    options: Any,  # noqa: ANN401
    error: str,
) -> None:
    with pytest.warns(FailedSimulationWarning):
        found = falsify(system, "always(level < 9)", [LEVEL], period=1, budget=6, **options)
    assert found.simulations == 6
    assert {row.error for row in found.record.failed()} == {error}
    assert not campaign_process._all


@pytest.mark.slow
def test_an_optimizer_that_raises_leaves_no_process() -> None:
    def broken(evaluate: Any, dimension: int, rng: Any) -> None:  # noqa: ANN401
        evaluate(rng.random((4, dimension)))
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken") as raised:
        falsify(tank, "always(level < 9)", [LEVEL], period=1, optimizer=broken, n_jobs=2)
    assert raised.value.falsification.simulations == 4  # type: ignore[attr-defined]
    assert not campaign_process._all


def test_wrong_numbers_of_processes_are_refused() -> None:
    with pytest.raises(InputError) as raised:
        falsify(tank, "always(level < 9)", [LEVEL], n_jobs=0)
    assert str(raised.value) == "expected n_jobs= as a whole number, or -1 for all cores, got 0"


def test_the_command_runs_a_search_in_processes(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["falsify", "rtamt/RequestGrant-v0", "granted", "--vary", "limit=0:5"]
    assert main(arguments) == 1
    here = capsys.readouterr().out
    assert main([*arguments, "-j", "2", "--timeout", "60"]) == 1
    assert capsys.readouterr().out == here
