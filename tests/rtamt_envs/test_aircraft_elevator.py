"""The aircraft elevator with faults: modes, positions, requirements, and the paper's map."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from interpreted import compiled_and_interpreted
from matplotlib.figure import Figure
from rtamt_envs import aircraft_elevator
from rtamt_envs.aircraft_elevator import ACTIVE, ISOLATED, OFF, SCENARIO, STANDBY
from rtamt_envs.scenario import EpisodeSoFar, Floats

import rtamt

_ID = "rtamt/AircraftElevator-v0"
_NORMAL = [ACTIVE, STANDBY, STANDBY, ACTIVE]
_INNER = [OFF, ACTIVE, ACTIVE, STANDBY]
_NAMES = [observation.name for observation in SCENARIO.observations]


def _fly(entries: int = 1, /, **options: Any) -> Floats:  # noqa: ANN401 - options of reset
    """Return the observations with the baseline, shape (1001, environments, 10)."""
    env = gym.make_vec(_ID, num_envs=entries).unwrapped
    first = env.reset(seed=0, options=options)[0]
    return np.concatenate([first[None], env.rollout(1000)])  # type: ignore[attr-defined]


def _judged(seen: Floats) -> dict[str, rtamt.Judgement]:
    """Return the judgement of each requirement on the observations of an episode."""
    trace = dict(zip(_NAMES, seen.T, strict=True))
    return {
        name: rtamt.judge(
            spec, {variable: trace[variable] for variable in spec.variables}, period=0.01
        )
        for name, spec in SCENARIO.specifications.items()
    }


def _violated(seen: Floats) -> set[str]:
    """Return the violated requirements; all others are satisfied."""
    verdicts = {name: each.verdict for name, each in _judged(seen).items()}
    assert rtamt.Verdict.UNDECIDED not in verdicts.values()
    return {name for name, verdict in verdicts.items() if verdict == rtamt.Verdict.VIOLATED}


def test_without_a_fault_the_outer_actuators_follow_the_command() -> None:
    seen = _fly()[:, 0]
    np.testing.assert_array_equal(seen[:, 3:], [_NORMAL + [1000.0] * 3] * 1001)
    np.testing.assert_array_equal(seen[:, 1], seen[:, 2])
    for end in (250, 500, 750, 1000):  # each half of the wave ends near its command
        assert abs(seen[end, 0] - seen[end, 1]) < 0.02
    assert not _violated(seen)
    assert _judged(seen)["follows_left"].robustness == pytest.approx(0.991, abs=1e-3)


def test_with_h1_lost_at_4_s_the_inner_actuators_take_over() -> None:
    seen = _fly(H1=4.0)[:, 0]
    healthy = _fly()[:, 0]
    np.testing.assert_array_equal(seen[:400], healthy[:400])
    np.testing.assert_array_equal(seen[400:, 3:], [[*_INNER, 0.0, 1000.0, 1000.0]] * 601)
    np.testing.assert_array_equal(seen[:, 1], seen[:, 2])
    assert np.abs(seen[[500, 750, 1000], 0] - seen[[500, 750, 1000], 1]).max() < 0.05
    assert np.abs(seen[400:, :2]).max() < 1.5
    assert not _violated(seen)


def test_with_h1_and_h2_lost_the_left_side_isolates() -> None:
    seen = _fly(H1=4.0, H2=6.5)[:, 0]
    np.testing.assert_array_equal(seen[:650], _fly(H1=4.0)[:650, 0])
    modes = [ISOLATED, ISOLATED, OFF, ACTIVE]
    np.testing.assert_array_equal(seen[650:, 3:], [[*modes, 0.0, 0.0, 1000.0]] * 351)
    assert np.abs(seen[750:, 1]).max() < 0.02, "nobody moves the left elevator"
    assert np.abs(seen[900:, 0] - seen[900:, 2]).max() < 0.1, "the right one follows"
    assert _violated(seen) == {"driven_left"}
    at_once = _fly(H1=4.0, H2=4.0)[:, 0]
    np.testing.assert_array_equal(at_once[400:, 3:7], [modes] * 601)
    assert _violated(at_once) == {"driven_left"}


def test_the_requirement_is_what_the_paper_says_at_the_end_of_an_episode() -> None:
    paper = "historically(rise(pc >= 0.9) implies eventually[0:1](always[0:1](abs(pc - {}) <= 3)))"
    for frequency, amplitude in ((0.2, 1.25), (0.6, 1.75), (0.8, 1.0)):
        seen = _fly(frequency=frequency, amplitude=amplitude, H1=2.0, H2=6.0)[:, 0]
        judged = _judged(seen)
        for side, elevator, column in (("left", "lep", 1), ("right", "rep", 2)):
            monitor = rtamt.Monitor(paper.format(elevator), period=0.01)
            told = [
                monitor.update({"pc": pc, elevator: position})
                for pc, position in seen[:, [0, column]].tolist()
            ]
            assert told[-1] == judged[f"follows_{side}"].robustness


def test_a_small_command_is_followed_in_the_sense_of_the_paper_by_an_elevator_at_rest() -> None:
    """The requirement of the paper cannot detect it: 3 cm are more than the command."""
    seen = _fly(H1=0.0, H2=0.0)[:, 0]
    np.testing.assert_array_equal(seen[:, 1], 0.0)
    assert _violated(seen) == {"driven_left"}
    assert _judged(seen)["follows_left"].robustness == pytest.approx(2.0)


def test_a_jump_beyond_10_cm_is_taken_for_a_failure() -> None:
    seen = _fly(H1=4.0, H2=5.0, amplitude=1.5)[:, 0]
    isolated = int((seen[:, 6] == ISOLATED).argmax())
    assert 500 < isolated < 520
    assert np.abs(seen[:isolated, 2]).max() <= 10 < abs(seen[isolated, 2])
    np.testing.assert_array_equal(seen[isolated:, 3:7], 0.0)
    assert {"driven_left", "driven_right"} <= _violated(seen)
    small = _fly(H1=4.0, H2=5.0, amplitude=1.0)[:, 0]
    np.testing.assert_array_equal(small[500:, 3:7], [[ISOLATED, ISOLATED, OFF, ACTIVE]] * 501)


FAULTS = ("LO", "LI", "RI", "RO", "H1", "H2", "H3")


@pytest.mark.parametrize("fault", FAULTS)
def test_no_single_fault_leaves_an_elevator_undriven(fault: str) -> None:
    times = np.linspace(0.0, 10.0, 12)
    seen = _fly(12, **{fault: times})
    for entry, time in enumerate(times):
        assert not _violated(seen[:, entry]), time
        begun = int(np.ceil(time * 100 - 1e-9))
        np.testing.assert_array_equal(seen[:begun, entry], _fly()[:begun, 0])
        modes = dict(zip(("LO", "LI", "RI", "RO"), seen[begun, entry, 3:7], strict=True))
        if fault in modes:
            assert modes[fault] == ISOLATED
        else:
            lost = {"H1": ("LO",), "H2": ("LI", "RI"), "H3": ("RO",)}[fault]
            assert all(modes[each] == OFF for each in lost)
            assert seen[begun, entry, 6 + int(fault[1])] == 0.0


def test_pairs_of_faults_isolate_a_side_only_where_both_its_actuators_fail() -> None:
    hit = {"LO": {"LO"}, "LI": {"LI"}, "RI": {"RI"}, "RO": {"RO"}}
    hit |= {"H1": {"LO"}, "H2": {"LI", "RI"}, "H3": {"RO"}}
    for first in FAULTS:
        for second in FAULTS:
            violated = _violated(_fly(**{first: 2.0, second: 5.0})[:, 0])
            lost = hit[first] | hit[second]
            assert ("driven_left" in violated) == ({"LO", "LI"} <= lost), (first, second)
            assert ("driven_right" in violated) == ({"RI", "RO"} <= lost), (first, second)
            assert not violated & {"alone_left", "alone_right", "isolates_left"}


@pytest.mark.slow
def test_faults_give_the_same_numbers_without_numba() -> None:
    program = (
        "import sys, gymnasium as gym, numpy as np, rtamt_envs\n"
        "env = gym.make_vec('rtamt/AircraftElevator-v0', 2).unwrapped\n"
        "options = dict(H1=[0.5, 9.0], H2=[1.0, 9.0], LI=[9.0, 0.5], RO=[9.0, 1.0], noise=40.0)\n"
        "first = env.reset(seed=0, options=options)[0]\n"
        "seen = np.concatenate([first[None], env.rollout(150)])\n"
        "sys.stdout.write(seen.tobytes().hex())\n"
    )
    outcomes = compiled_and_interpreted(program)
    seen = np.frombuffer(bytes.fromhex(outcomes[0])).reshape(151, 2, 10)
    assert (seen[-1, :, 3:7] == ISOLATED).any(axis=1).all()
    assert outcomes[0] == outcomes[1]


def test_sides_are_mirrors() -> None:
    left = _fly(H1=3.0, LI=6.0)[:, 0]
    right = _fly(H3=3.0, RI=6.0)[:, 0]
    np.testing.assert_array_equal(left[:, [0, 2, 1, 6, 5, 4, 3, 9, 8, 7]], right)


def test_a_pressure_is_the_middle_of_three_noisy_sensors() -> None:
    still = _fly(H2=5.0)
    seen = _fly(2, noise=[0.0, 10.0], H2=5.0)
    np.testing.assert_array_equal(seen[:, 0], still[:, 0])
    np.testing.assert_array_equal(seen[:, 1, :7], still[:, 0, :7])
    errors = (seen[:, 1, 7:] - seen[:, 0, 7:]).ravel() / 10
    rng = np.random.default_rng(0)
    expected = np.median(rng.standard_normal((100_000, 3)), axis=1)
    assert errors.mean() == pytest.approx(0.0, abs=0.05)
    assert errors.std() == pytest.approx(expected.std(), rel=0.05)
    assert len(set(errors.tolist())) == errors.size


def test_much_noise_turns_circuits_off_and_on_until_actuators_are_isolated() -> None:
    modes = _fly(noise=50.0)[:, 0, 3:7]
    assert (modes[0] == _NORMAL).all()
    assert ISOLATED in modes[-1]
    assert not _violated(_fly(noise=10.0)[:, 0])


def test_the_baseline_is_the_square_wave_of_the_paper() -> None:
    for frequency in (0.2, 0.4, 0.6, 0.8):
        command = _fly(frequency=frequency, amplitude=1.25)[:, 0, 0]
        assert command[0] == 0.0
        ticks = np.arange(1000) * round(frequency * 10)  # exact halves: 500 ticks
        wave = np.where(ticks // 500 % 2 == 0, 1.25, -1.25)
        np.testing.assert_array_equal(command[1:], wave)
    for half in (63, 69, 71):  # samples; the products of frequency and time are not whole
        command = _fly(frequency=50 / half)[:, 0, 0]
        wave = np.where(np.arange(1000) // half % 2 == 0, 1.0, -1.0)
        np.testing.assert_array_equal(command[1:], wave)


def test_the_map_of_the_paper() -> None:
    frequency, amplitude = np.meshgrid((0.2, 0.4, 0.6, 0.8), (1, 1.25, 1.5, 1.75), indexing="ij")
    seen = _fly(16, frequency=frequency.ravel(), amplitude=amplitude.ravel())
    values = np.array([_judged(seen[:, i])["follows_left"].robustness for i in range(16)])
    rows = [
        [0.991, 0.489, 0.6, 0.85],
        [0.998, 0.498, 0.6, 0.85],
        [1.085, 0.608, 0.133, -0.342],
        [0.659, 0.104, -0.475, -0.85],
    ]
    np.testing.assert_allclose(values.reshape(4, 4), rows, rtol=0, atol=6e-4)


def test_a_picture_has_courses_bands_of_modes_and_pressures() -> None:
    seen = _fly(H1=4.0)[:, 0]
    assert SCENARIO.draw is not None
    figure = Figure()
    episode = EpisodeSoFar(np.arange(1001) / 100, seen, seen[1:, :1], {})
    SCENARIO.draw(figure, episode)
    top, bands, bottom = figure.axes
    assert [len(ax.lines) for ax in (top, bands, bottom)] == [3, 0, 3]
    np.testing.assert_array_equal(top.lines[1].get_ydata(), seen[:, 1])
    np.testing.assert_array_equal(bands.collections[0].get_array(), seen[:, 3:7].T)
    legend = bands.get_legend()
    assert legend is not None
    names = [each.get_text() for each in legend.get_texts()]
    assert names == ["Isolated", "Off", "Passive", "Standby", "Active"]
    assert names == list(aircraft_elevator._COLOURS)
