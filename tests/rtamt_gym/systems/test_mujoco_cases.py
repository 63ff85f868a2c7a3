"""A run of a MuJoCo model with a case equals a loop written by hand."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from input_cases import of_step, waveforms
from profiles import examples

from rtamt import InputError
from rtamt_gym import Case, Parameter, Signal, Space, StepMonitor, Waveform, simulate

CART = """
<mujoco model="cart">
  <option timestep="0.02" integrator="implicitfast"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom name="box" size=".1" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" size=".03" fromto="0 0 0 0 0 .8" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="slide" gear="10"/>
    <general name="lag" joint="hinge" dyntype="filter" dynprm=".05" gainprm="4"/>
  </actuator>
</mujoco>
"""
SIGNALS = {"x": "qpos[0]", "angle": "joint:hinge.qpos", "force": "actuator:motor.force"}
LOW = "always(abs(x) < 1e9 and abs(angle) < 1e9 and abs(force) < 1e9)"

drives = waveforms(-0.3, 0.3) | st.floats(-0.3, 0.3)
ENTRIES: dict[str, st.SearchStrategy[Any]] = {
    "ctrl[0]": drives,
    "actuator:lag": drives,
    "qfrc_applied[1]": drives,
    "body:pole.xfrc_applied[0]": drives,
    "joint:hinge.qpos": st.floats(-1, 1),
    "qvel[0]": st.floats(-1, 1),
    "act[0]": st.floats(-1, 1),
    "body:pole.mass": st.floats(0.05, 2),
    "joint:slide.damping[0]": st.floats(0, 2),
    "opt.gravity[2]": st.floats(-20, 0),
    "opt.viscosity": st.floats(0, 1),
    "opt.timestep": st.sampled_from([0.01, 0.02, 0.04]),
}

WRITES: dict[str, Callable[[Any, Any, float], None]] = {
    "ctrl[0]": lambda _m, d, v: d.ctrl.__setitem__(0, v),
    "actuator:lag": lambda _m, d, v: d.ctrl.__setitem__(1, v),
    "qfrc_applied[1]": lambda _m, d, v: d.qfrc_applied.__setitem__(1, v),
    "body:pole.xfrc_applied[0]": lambda _m, d, v: d.xfrc_applied.__setitem__((2, 0), v),
    "joint:hinge.qpos": lambda _m, d, v: d.qpos.__setitem__(1, v),
    "qvel[0]": lambda _m, d, v: d.qvel.__setitem__(0, v),
    "act[0]": lambda _m, d, v: d.act.__setitem__(0, v),
    "body:pole.mass": lambda m, _d, v: m.body_mass.__setitem__(2, v),
    "joint:slide.damping[0]": lambda m, _d, v: m.dof_damping.__setitem__(0, v),
    "opt.gravity[2]": lambda m, _d, v: m.opt.gravity.__setitem__(2, v),
    "opt.viscosity": lambda m, _d, v: setattr(m.opt, "viscosity", v),
    "opt.timestep": lambda m, _d, v: setattr(m.opt, "timestep", v),
}

DRIVEN = ("ctrl[0]", "actuator:lag", "qfrc_applied[1]", "body:pole.xfrc_applied[0]")


def cart() -> tuple[Any, Any]:
    """Return a moving cart."""
    model = mujoco.MjModel.from_xml_string(CART)
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.05
    for _ in range(5):
        mujoco.mj_step(model, data)
    return model, data


def by_hand(case: dict[str, Any], steps: int) -> list[list[float]]:
    """Return the samples of the signals, from a loop of `mj_step`."""
    model, data = cart()
    for name, entry in case.items():
        if name not in DRIVEN:
            WRITES[name](model, data, entry)
    if {"body:pole.mass", "joint:slide.damping[0]"} & set(case):
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def sample() -> list[float]:
        shown = mujoco.MjData(model)
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        return [shown.qpos[0], shown.qpos[1], shown.actuator_force[0]]

    seen = [sample()]
    for i in range(steps):
        for name in DRIVEN:
            if name in case:
                WRITES[name](model, data, of_step(case[name], i, model.opt.timestep))
        mujoco.mj_step(model, data)
        seen.append(sample())
    return seen


def arrays(of: Any) -> dict[str, bytes]:  # noqa: ANN401 - MuJoCo is not typed
    """Return all arrays of a model or of its data."""
    held = ((name, getattr(of, name)) for name in dir(of) if not name.startswith("_"))
    return {name: array.tobytes() for name, array in held if isinstance(array, np.ndarray)}


@pytest.mark.slow
@settings(max_examples=examples(40))
@given(st.fixed_dictionaries({}, optional=ENTRIES))
def test_a_model_runs_as_the_case_says_and_stays_as_it_was(case: dict[str, Any]) -> None:
    model, data = cart()
    before = arrays(model), arrays(data), arrays(model.opt), data.time, model.opt.timestep
    run = simulate((model, data), LOW, SIGNALS, case=case, duration=0.4, stop="end")
    timestep = case.get("opt.timestep", 0.02)
    steps = round(0.4 / timestep)
    assert run.period == Fraction(str(timestep))
    seen = np.array([run.signals[name] for name in SIGNALS]).T
    assert np.array_equal(seen, np.array(by_hand(case, steps)))
    after = arrays(model), arrays(data), arrays(model.opt), data.time, model.opt.timestep
    assert after == before


@pytest.mark.slow
@given(st.floats(0.005, 0.04))
def test_a_timestep_may_be_any_number(timestep: float) -> None:
    run = simulate(cart(), LOW, SIGNALS, case={"opt.timestep": timestep}, duration=0.2, stop="end")
    seen = np.array([run.signals[name] for name in SIGNALS]).T
    assert np.array_equal(seen, np.array(by_hand({"opt.timestep": timestep}, len(seen) - 1)))
    assert run.duration == pytest.approx(timestep * (len(seen) - 1), rel=1e-11)
    assert run.duration <= 0.2 < run.duration + timestep + 1e-11


def test_what_the_case_drives_the_policy_does_not() -> None:
    def push(_model: Any, data: Any) -> None:  # noqa: ANN401
        data.ctrl[:] = 0.1, 0.2

    drive = Waveform([0, 0.1], [0.3, -0.3])
    run = simulate(
        cart(),
        "always(u < 9 and v < 9)",
        {"u": "ctrl[0]", "v": "ctrl[1]"},
        case={"ctrl[0]": drive},
        policy=push,
        duration=0.2,
    )
    assert run.signals["u"][1:].tolist() == [0.3] * 5 + [-0.3] * 5
    assert run.signals["v"][1:].tolist() == [0.2] * 10


def test_a_period_of_several_steps_drives_each_of_them() -> None:
    case = {"ctrl[0]": Waveform([0, 0.2], [-0.3, 0.3], "linear")}
    fine = simulate(cart(), LOW, SIGNALS, case=case, duration=0.4, stop="end")
    coarse = simulate(cart(), LOW, SIGNALS, case=case, duration=0.4, period=0.08, stop="end")
    assert coarse.signals["x"].tolist() == fine.signals["x"][::4].tolist()


def test_a_space_of_a_model_is_run_by_its_columns() -> None:
    entries = [
        Signal("ctrl[0]", -1, 1, points=4, interpolation="pchip"),
        Parameter("body:pole.mass", 0.1, 1),
    ]
    space = Space(entries, duration=0.4)
    assert space.columns[0] == "ctrl[0][0]"
    runs = [
        simulate(cart(), LOW, SIGNALS, case=space.case(point), duration=0.4, stop="end")
        for point in (np.zeros(5), np.ones(5), np.zeros(5))
    ]
    assert runs[0] == runs[2]
    assert runs[0] != runs[1]


@given(st.floats(1, 20), st.floats(0, 2), st.sampled_from([0.01, 0.02]), waveforms(-3, 3))
@settings(max_examples=examples(20))
def test_an_environment_steps_a_model_with_other_constants(
    mass: float, damping: float, timestep: float, push: Waveform
) -> None:
    env = gym.make("InvertedPendulum-v5")
    simulation: Any = env.unwrapped
    model, before = simulation.model, arrays(simulation.model)
    case = Case(
        {
            "body:pole.mass": mass,
            "joint:slider.damping": damping,
            "opt.timestep": timestep,
            "action[0]": push,
        }
    )
    run = simulate(
        env, "always(abs(x) < 9)", {"x": "obs[1]"}, case=case, seed=1, duration=0.4, stop="end"
    )
    assert simulation.model is model
    assert (arrays(model), model.opt.timestep) == (before, 0.02)
    assert run.period == 2 * Fraction(str(timestep))
    model.body("pole").mass = mass
    model.joint("slider").damping = damping
    model.opt.timestep = timestep
    mujoco.mj_setConst(model, mujoco.MjData(model))
    obs, _ = env.reset(seed=1)
    seen = [obs[1]]
    for i in range(run.steps):
        obs, *_ = env.step(np.array([of_step(push, i, 2 * timestep)], np.float32))
        seen.append(obs[1])
    assert run.signals["x"].tolist() == seen


@pytest.mark.parametrize(
    ("case", "message"),
    [
        (
            {"qpos[0]": 1},
            (
                "InvertedPendulum-v5 takes no 'qpos[0]' of a case: it resets its state; of its "
                "model a case sets constants, such as body:torso.mass or opt.gravity[2]"
            ),
        ),
        (
            {"ctrl[0]": 1},
            (
                "InvertedPendulum-v5 takes no 'ctrl[0]' of a case: it has actions for its inputs; "
                "of its model a case sets constants, such as body:torso.mass or opt.gravity[2]"
            ),
        ),
        (
            {"mass": 1},
            (
                "InvertedPendulum-v5 takes no 'mass' of a case; it takes 'action[0]' and numbers "
                "of its attributes, such as 'env.gravity', and of its model, such as "
                "'body:torso.mass'"
            ),
        ),
        (
            {"body:pole.mass": Waveform([0], [1])},
            (
                "expected 'body:pole.mass' of the case as a number, which does not change during a "
                "run, got a waveform; waveforms drive its actions"
            ),
        ),
    ],
)
def test_an_environment_of_mujoco_says_what_it_takes(case: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(
            gym.make("InvertedPendulum-v5"),
            "always(x < 9)",
            {"x": "obs[0]"},
            case={"action[0]": 0.0, **case},
        )
    assert str(caught.value) == message


ERRORS: list[tuple[dict[str, Any], str]] = [
    (
        {"force": 1},
        (
            "'force' of the case, column 1: expected one of ctrl, actuator, qpos, qvel, act, "
            "qfrc_applied, opt, body, joint, geom, site, tendon, camera, light, got 'force'\n"
            "  force\n"
            "  ^\n"
            "  hint: write ctrl[0], actuator:motor, qpos[0], opt.gravity[2] or body:pole.mass"
        ),
    ),
    ({"ctrl[2]": 1}, "'ctrl[2]' of the case: ctrl[2] does not fit: ctrl has 2 elements, 0 to 1"),
    (
        {"actuator:moter": 1},
        (
            "'actuator:moter' of the case: actuator:moter.ctrl names no actuator: Invalid name "
            "'moter'. Valid names: ['lag', 'motor']"
        ),
    ),
    (
        {"opt.timestp": 0.1},
        ("'opt.timestp' of the case: MuJoCo has no option 'timestp'; did you mean 'timestep'?"),
    ),
    (
        {"opt.gravity": 1},
        "'opt.gravity' of the case: expected one index, opt.gravity[0], got opt.gravity",
    ),
    (
        {"opt.iterations": 1.5},
        "expected 'opt.iterations' of the case as a whole number, as 100, got 1.5",
    ),
    (
        {"body:pole.mass": Waveform([0], [1])},
        (
            "expected 'body:pole.mass' of the case as a number, which does not change during a "
            "run, got a waveform; waveforms drive ctrl[0], actuator:NAME, qfrc_applied[0], "
            "joint:NAME.qfrc_applied and body:NAME.xfrc_applied[0]"
        ),
    ),
    ({"qpos[0]": math.inf}, "expected 'qpos[0]' of the case as a finite number, got inf"),
    (
        {"ctrl[0]": math.inf},
        "expected 'ctrl[0]' of the case as a waveform or a finite number, got inf",
    ),
    (
        {"body:pole.subtreemass": 3},
        (
            "'body:pole.subtreemass' of the case cannot be set: MuJoCo derives it from other "
            "values of cart"
        ),
    ),
    (
        {"ctrl[0]": 1, "actuator:motor": 1},
        ("expected one entry of the case for a number, got 'ctrl[0]' and 'actuator:motor'"),
    ),
    (
        {"geom:box.type": 3},
        "'geom:box.type' of the case: geom:box.type is a whole number, which a case cannot set",
    ),
]


@pytest.mark.parametrize(("case", "message"), ERRORS)
def test_a_model_says_what_it_takes(case: dict[str, Any], message: str) -> None:
    model, data = cart()
    before = arrays(model), arrays(data), arrays(model.opt)
    with pytest.raises(InputError) as caught:
        simulate((model, data), LOW, SIGNALS, case=case, duration=1)
    assert str(caught.value) == message
    assert (arrays(model), arrays(data), arrays(model.opt)) == before


def test_a_field_that_is_not_there_names_the_nearest() -> None:
    with pytest.raises(InputError) as caught:
        simulate(cart(), LOW, SIGNALS, case={"body:pole.mas": 1}, duration=1)
    assert str(caught.value).startswith(
        "'body:pole.mas' of the case: body:pole.mas does not fit: expected a field "
    )
    assert str(caught.value).endswith(", got 'mas'; did you mean 'mass'?")


def test_a_monitor_that_runs_on_takes_no_case() -> None:
    model, data = cart()
    monitor = StepMonitor(model, data, "always(x < 9)", {"x": "qpos[0]"})
    case = Case({"ctrl[0]": 1})
    with pytest.raises(InputError) as caught:
        simulate(monitor, case=case, duration=1)
    assert str(caught.value) == (
        "cart takes no case, got Case({'ctrl[0]': 1.0}); environments, pairs (model, data) of "
        "MuJoCo, Fmus, functions of time and generator functions take one"
    )
