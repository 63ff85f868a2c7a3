"""Sensitivity indices, against functions whose indices are known in closed form."""

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rtamt import InputError, Verdict
from rtamt_gym import Parameter, Space, sweep
from rtamt_gym.results import Record, Sweep
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.sweeps.effects import Indices, indices
from rtamt_gym.search.sweeps.samplers import sample

LIMIT = math.pi
A, B = 7.0, 0.1


def ishigami(x1: float, x2: float, x3: float) -> Any:  # noqa: ANN401
    """Ishigami's function of three angles, as a simulation of one sample."""
    yield {"y": math.sin(x1) + A * math.sin(x2) ** 2 + B * x3**4 * math.sin(x1)}


def swept(simulation: Callable[..., Any], **options: Any) -> Sweep:  # noqa: ANN401
    names = simulation.__code__.co_varnames[: simulation.__code__.co_argcount]
    space = [Parameter(name, -LIMIT, LIMIT) for name in names]
    return sweep(simulation, {"y": "always(y >= 0)"}, space, period=1, **options)


def by_name(done: Sweep) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = done.indices().to_frame().to_dict("index")
    return found


def test_sobol_indices_of_ishigami_are_those_of_the_closed_form() -> None:
    first = 0.5 * (1 + B * LIMIT**4 / 5) ** 2
    joint = B**2 * LIMIT**8 * 8 / 225
    whole = first + A**2 / 8 + joint
    expected = {
        "x1": (first / whole, (first + joint) / whole),
        "x2": (A**2 / 8 / whole, A**2 / 8 / whole),
        "x3": (0.0, joint / whole),
    }
    space = Space([Parameter(name, -LIMIT, LIMIT) for name in expected])
    rows = []
    for point in sample(space, 2048, "saltelli", 5):
        case = space.case(point)
        (height,) = (each["y"] for each in ishigami(**case.columns()))
        outcome = Outcome(height, height, height, Verdict(1 if height > 0 else -1), Moment(0, 0.0))
        rows.append(Trial(case, None, {"y": outcome}, "terminated", 0.0, 0.0))
    record = Record(rows, {"y": "always(y >= 0)"})
    found = indices(record, space, "saltelli", 5).to_frame().to_dict("index")
    assert list(found) == ["x1", "x2", "x3"]  # by the total index
    for name, (alone, total) in expected.items():
        assert found[name]["S1"] == pytest.approx(alone, abs=0.03)
        assert found[name]["ST"] == pytest.approx(total, abs=0.03)
        assert 0 <= found[name]["S1 +-"] < 0.12


def plane(x1: float, x2: float, x3: float) -> Any:  # noqa: ANN401
    yield {"y": 2 * x1 - 5 * x2 + 0 * x3}


def test_morris_indices_of_a_plane_are_its_slopes_over_the_whole_range() -> None:
    found = by_name(swept(plane, samples=6, sampler="morris"))
    assert list(found) == ["x2", "x1", "x3"]
    for name, slope in (("x1", 2.0), ("x2", -5.0), ("x3", 0.0)):
        assert found[name]["mu"] == pytest.approx(slope * 2 * LIMIT, abs=1e-9)
        assert found[name]["mu*"] == pytest.approx(abs(slope) * 2 * LIMIT, abs=1e-9)
        assert found[name]["sigma"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("sampler", ["morris", "saltelli"])
def test_indices_of_a_seed_are_the_same(sampler: Any) -> None:  # noqa: ANN401
    frames = [
        swept(ishigami, samples=8, sampler=sampler, seed=0).indices().to_frame() for _ in range(2)
    ]
    assert frames[0].equals(frames[1])
    assert np.isfinite(frames[0].to_numpy()).all()


def test_indices_without_salib_name_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    done = swept(ishigami, samples=2, sampler="morris", seed=0)
    for name in [*sys.modules]:
        if name.partition(".")[0] == "SALib":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "SALib", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        done.indices()
    assert str(caught.value) == (
        "indices needs SALib, which is not installed; from the checkout: pip install '.[search]'"
    )


def test_indices_print_as_a_table() -> None:
    values = {"mu*": np.array([31.41593, 0.0]), "sigma": np.array([1e-5, 0.25])}
    assert str(Indices("safe", "morris", ("throttle[0]", "mass"), values)) == (
        "what moves safe:\n"
        "varied         mu*  sigma\n"
        "throttle[0]  31.42  1e-05\n"
        "mass             0   0.25"
    )


def bad(x1: float) -> Any:  # noqa: ANN401
    if x1 > 0:
        raise ValueError("no")
    yield {"y": x1}


def flat(x1: float) -> Any:  # noqa: ANN401
    yield {"y": 0 * x1 + 2}


def steep(x1: float) -> Any:  # noqa: ANN401
    yield {"y": math.inf if x1 > 0 else 1.0}


@pytest.mark.parametrize(
    ("simulation", "options", "message"),
    [
        (
            plane,
            {"sampler": "sobol"},
            "indices need sampler='morris' or 'saltelli', got a sweep with 'sobol'",
        ),
        (flat, {}, "the robustness of 'y' is 2 in every simulation: nothing moves it"),
        (
            steep,
            {},
            "indices need a finite robustness, and 'y' has an infinite one in 4 simulations of 8",
        ),
        (
            plane,
            {"stop": "decided"},
            (
                "indices need simulations up to their end, and some were stopped; "
                "sweep with stop='end'"
            ),
        ),
    ],
)
def test_what_has_no_indices_says_why(
    simulation: Callable[..., Any], options: dict[str, Any], message: str
) -> None:
    done = swept(simulation, **{"samples": 4, "sampler": "morris"} | options)
    with pytest.raises(InputError) as caught:
        done.indices()
    assert str(caught.value) == message


def test_failed_simulations_leave_no_indices() -> None:
    with pytest.warns(UserWarning, match="4 of 8 simulations failed"):
        done = swept(bad, samples=4, sampler="morris")
    with pytest.raises(InputError) as caught:
        done.indices()
    assert str(caught.value) == (
        "indices need every simulation of a sweep, and 4 simulations of 8 failed"
    )
