"""The automatic transmission: Simulink's numbers, its shifts, and its requirements."""

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.lib.stride_tricks import sliding_window_view
from rtamt_envs import automatic_transmission as transmission
from rtamt_envs.automatic_transmission import SCENARIO
from rtamt_envs.scenario import EpisodeSoFar, Floats

import rtamt

_ID = "rtamt/AutomaticTransmission-v0"
_STEPS = 3500


def _drive(actions: Floats, **options: float) -> Floats:
    """Return the observations for each sequence of actions, shape (k + 1, n, 3)."""
    cars = gym.make_vec(_ID, num_envs=actions.shape[1]).unwrapped
    first = cars.reset(options=options)[0]
    return np.concatenate([first[None], cars.rollout(actions)])  # type: ignore[attr-defined]


def _held(throttle: float, brake: float, steps: int = _STEPS) -> Floats:
    return np.full((steps, 1, 2), (throttle, brake))


def _pieces(n: int, seed: int) -> Floats:
    """Return sequences of seven pieces: some coast, some brake, some do both."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, [100.0, 325.0], (7, n, 2))
    points *= rng.random((7, n, 2)) < [0.8, 0.4]
    return points.repeat(_STEPS // 7, axis=0)


def test_full_throttle_equals_simulink() -> None:
    courses = _drive(_held(100.0, 0.0))[:, 0]
    np.testing.assert_array_equal(courses[0], [0.0, 1000.0, 1.0])
    assert courses[2000, 0] == pytest.approx(120.21327149261522, abs=1e-10, rel=0)
    assert courses[:, 1].max() == pytest.approx(4768.277187862124, abs=1e-10, rel=0)
    assert np.diff(courses[:, 2]).nonzero()[0].tolist() == [256, 616, 1232]


def test_the_solver_is_of_order_five_between_the_corners_of_the_tables() -> None:
    def travel(steps: int) -> Floats:
        rpm, wheel = 3000.0, 461.2
        for _ in range(steps):
            rpm, wheel = transmission._advance(
                0.04 / steps, np.array([100.0, 20.0]), 2.0, SCENARIO.defaults, rpm, wheel
            )
        return np.array([rpm, wheel])

    errors = [np.abs(travel(steps) - travel(128)) for steps in (2, 4, 8)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 4.8) & (orders < 6.0)), orders


def test_torque_and_converter_are_their_tables_and_the_lines_between_them() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        throttle, rpm = rng.uniform(0.0, 100.0), rng.uniform(800.0, 4800.0)
        ratio, slip = rng.uniform(2.0, 8.0), rng.uniform(0.0, 0.94)
        wheel = slip * rpm / ratio
        rows = [np.interp(rpm, transmission._SPEEDS, row) for row in transmission._TORQUES]
        torque = np.interp(throttle, transmission._THROTTLES, rows)
        ratios = transmission._RATIOS
        load = (rpm / np.interp(slip, ratios, transmission._CAPACITIES)) ** 2
        turbine = load * np.interp(slip, ratios, transmission._TORQUE_RATIOS)
        speed = 2 * np.pi * 60 / 5280 * wheel
        row = int(np.searchsorted(transmission._THROTTLES, throttle, side="right")) - 1
        found = transmission._rates(rpm, wheel, throttle, row, 70.0, 0.02, ratio, 0.1)
        expected = (
            (torque - load) / 0.0219914882835559,
            0.1 * (ratio * turbine - 70.0 - 0.02 * speed**2),
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


_UP = [[10, 10, 15, 23, 40, 40], [30, 30, 30, 41, 70, 70], [50, 50, 50, 60, 100, 100]]
_DOWN = [[5, 5, 5, 5, 30, 30], [20, 20, 25, 30, 50, 50], [35, 35, 40, 50, 80, 80]]


def _beyond(gear: int, throttle: float, speed: float) -> int:
    """Return 1 above the threshold of a gear, -1 below it, otherwise 0."""
    if gear < 4 and speed > np.interp(throttle, [0, 25, 35, 50, 90, 100], _UP[gear - 1]):
        return 1
    if gear > 1 and speed < np.interp(throttle, [0, 5, 40, 50, 90, 100], _DOWN[gear - 2]):
        return -1
    return 0


def _gears(throttles: Floats, speeds: Floats) -> list[int]:
    """Return the gear after each comparison: it changes at the third in a row beyond a threshold.

    A comparison that breaks the row does not start a new one, as in the chart of the original.
    """
    gear, run, gears = 1, 0, []
    for throttle, speed in zip(throttles, speeds, strict=True):
        beyond = _beyond(gear, throttle, speed)
        run = run + beyond if run * beyond > 0 or run == 0 else 0
        if abs(run) == 3:
            gear, run = gear + beyond, 0
        gears.append(gear)
    return gears


def test_a_gear_changes_at_the_third_comparison_in_a_row_beyond_its_threshold() -> None:
    rng = np.random.default_rng(1)
    throttles = rng.uniform(0.0, 100.0, 800).repeat(25)
    speeds = np.abs(rng.uniform(-5.0, 105.0, 2000).repeat(10) + rng.normal(0.0, 3.0, 20000))
    state = np.zeros(SCENARIO.state)
    SCENARIO.start(SCENARIO.defaults, np.zeros(0), state, np.zeros(3))
    found = []
    for throttle, speed in zip(throttles, speeds, strict=True):
        state[transmission._WHEEL] = speed / transmission._MPH
        transmission._compare(throttle, state)
        found.append(state[transmission._GEAR])
    np.testing.assert_array_equal(found, _gears(throttles, speeds))
    shifts = np.diff(found)
    assert min((shifts > 0).sum(), (shifts < 0).sum()) > 500


def test_speeds_are_compared_every_four_steps_with_the_throttle_of_the_step() -> None:
    actions = _pieces(40, 1)
    courses = _drive(actions)
    assert {-1.0, 1.0} <= set(np.diff(courses[..., 2], axis=0).ravel())
    for entry in range(actions.shape[1]):
        gears = _gears(actions[::4, entry, 0], courses[:-1:4, entry, 0])
        np.testing.assert_array_equal(courses[1:, entry, 2], np.repeat(gears, 4))


def test_the_engine_stays_within_its_limits() -> None:
    idle = _drive(_held(0.0, 325.0))[:, 0]
    assert idle[:, 1].min() == 600.0
    assert idle[500:, 0].min() >= -0.01
    assert idle[500:, 0].max() <= 0.02
    coasting = _drive(_pieces(40, 2))
    assert coasting[..., 1].min() == 600.0
    assert coasting[..., 1].max() < 6000.0
    for rpm, throttle, row, wheel, sign in ((600, 0, 0, 0, -1), (6000, 100, 8, 1000, 1)):
        at_limit, near = (
            transmission._rates(each, wheel, throttle, row, 0.0, 0.0, 7.2, 1.0)[0]
            for each in (float(rpm), rpm - sign * 1e-6)
        )
        assert at_limit == 0.0
        assert near * sign > 1000.0


def test_parameters_slow_the_car_down() -> None:
    actions = _held(60.0, 0.0, 2000)
    plain = _drive(actions)[-1, 0, 0]
    assert _drive(actions, inertia=20.0)[-1, 0, 0] < plain - 5.0
    assert _drive(actions, rolling=80.0)[-1, 0, 0] < plain - 2.0
    assert _drive(actions, drag=0.05)[-1, 0, 0] < plain - 5.0
    again = _drive(actions, inertia=12.09414785731247, rolling=40.0, drag=0.02)
    assert again[-1, 0, 0] == plain


def test_a_division_by_zero_gives_nan_alone_and_in_environments() -> None:
    env = gym.make(_ID)
    env.reset(options={"inertia": 0.0})
    with np.errstate(all="ignore"):
        alone = env.step(np.array([50.0, 0.0]))[0]
        entries = _drive(_held(50.0, 0.0, 1), inertia=0.0)[1, 0]
    np.testing.assert_array_equal(np.isnan(alone), [True, True, False])
    np.testing.assert_array_equal(entries, alone)


def test_the_baseline_drives_at_half_throttle() -> None:
    cars = gym.make_vec(_ID, num_envs=2).unwrapped
    cars.reset()
    found = cars.rollout(1000)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(found[:, :1], _drive(_held(50.0, 0.0, 1000))[1:])


def _always(values: Floats, begin: int, end: int) -> Floats:
    """Return the minimum from start to end samples ahead, within the trace."""
    least: Floats = sliding_window_view(values, end - begin + 1)[begin:].min(axis=-1)
    return least


def _eventually(values: Floats, begin: int, end: int) -> Floats:
    return -_always(-values, begin, end)


def _robustness(speed: Floats, rpm: Floats, gear: Floats) -> dict[str, float]:
    """Return the robustness of each requirement at the first sample, from its definition."""
    expected = {
        "AT1": (120.0 - speed[:2001]).min(),
        "AT2": (4750.0 - rpm[:1001]).min(),
    }
    for g in (1, 2, 3, 4):
        equal = np.minimum(gear - (g - 0.5), (g + 0.5) - gear)
        entered = np.minimum(-equal[:3001], _eventually(equal, 1, 10)[:3001])
        kept = _eventually(_always(equal, 0, 250), 1, 10)[:3001]
        expected[f"AT5{g}"] = np.maximum(-entered, kept).min()
    fast = (rpm[:3001] - 3000.0).max()
    for name, samples, limit in (("a", 401, 35.0), ("b", 801, 50.0), ("c", 2001, 65.0)):
        expected[f"AT6{name}"] = max(fast, (limit - speed[:samples]).min())
    expected["AT6abc"] = min(expected[f"AT6{name}"] for name in "abc")
    return expected


def _traces(seed: int) -> Floats:
    """Traces that no car drives, so that every requirement is both satisfied and violated."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform([20.0], [160.0], 36).repeat(100)[: _STEPS + 1] * rng.choice([0.3, 0.6, 1])
    rpm = rng.uniform(600.0, [rng.choice([2900.0, 4700.0, 5500.0])], 36).repeat(100)[: _STEPS + 1]
    low, high = rng.choice([(1, 20), (200, 300), (255, 400)])
    lengths = rng.integers(low, high, _STEPS + 1)
    gear = rng.integers(1, 5, _STEPS + 1).repeat(lengths)[: _STEPS + 1]
    return np.stack([speed, rpm, gear.astype(np.float64)], axis=-1)


def test_requirements_have_the_robustness_of_their_definition() -> None:
    courses = [*_drive(_pieces(20, 3)).transpose(1, 0, 2), *map(_traces, range(40))]
    verdicts: dict[str, set[bool]] = {}
    for course in courses:
        signals = dict(zip(("speed", "rpm", "gear"), course.T, strict=True))
        expected = _robustness(**signals)
        assert list(SCENARIO.specifications) == list(expected)
        for name, requirement in SCENARIO.specifications.items():
            found = rtamt.evaluate(requirement, signals, period=0.01)[0]
            assert found == expected[name], name
            verdicts.setdefault(name, set()).add(bool(rtamt.holds(found)))
    assert all(verdict == {False, True} for verdict in verdicts.values()), verdicts


def test_the_picture_shows_what_was_observed_and_done() -> None:
    actions = _pieces(1, 4)
    courses = _drive(actions)[:, 0]
    figure = Figure()
    times = np.linspace(0.0, 35.0, _STEPS + 1)
    assert SCENARIO.draw is not None
    SCENARIO.draw(figure, EpisodeSoFar(times, courses, actions[:, 0], {}))
    names = ["speed [mph]", "rpm", "gear", "throttle [%]", "brake [lb ft]"]
    assert [ax.get_ylabel() for ax in figure.axes] == names
    for ax, values in zip(figure.axes[:3], courses.T, strict=True):
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), values)
    for ax, values in zip(figure.axes[3:], actions[:, 0].T, strict=True):
        data = ax.patches[0].get_data()  # type: ignore[attr-defined]
        np.testing.assert_array_equal(data.values, values)
        np.testing.assert_array_equal(data.edges, times)
    begun = Figure()
    SCENARIO.draw(begun, EpisodeSoFar(times[:1], courses[:1], actions[:0, 0], {}))
    assert len(begun.axes) == 5
