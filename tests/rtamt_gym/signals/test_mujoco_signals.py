"""Selectors of a MuJoCo simulation read its named parts; their errors list the names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mujoco_models import arm, swing

from rtamt import InputError
from rtamt_gym import StlMonitor
from rtamt_gym.signals.mujoco import bind_signal, derive
from rtamt_gym.signals.selectors import Selector, parse_selector
from rtamt_gym.signals.signals import ParsedSignal
from rtamt_gym.signals.sources import MUJOCO


def reader(selector: str, model: Any, data: Any) -> Callable[[], float]:
    return bind_signal(ParsedSignal.parse("x", selector, MUJOCO), model, data)


READS: list[tuple[str, Callable[[Any], float]]] = [
    ("time", lambda d: d.time),
    ("qpos[1]", lambda d: d.qpos[1]),
    ("qpos[-1]", lambda d: d.qpos[-1]),
    ("qvel[0]", lambda d: d.qvel[0]),
    ("qacc[1]", lambda d: d.qacc[1]),
    ("ctrl[0]", lambda d: d.ctrl[0]),
    ("sensordata[2]", lambda d: d.sensordata[2]),
    ("sensor:where[2]", lambda d: d.sensor("where").data[2]),
    ("sensor:rate", lambda d: d.sensor("rate").data[0]),
    ("sensor:imu.data[-1]", lambda d: d.sensor("imu").data[2]),
    ("body:hand.xpos[2]", lambda d: d.body("hand").xpos[2]),
    ("body:hand.xmat[4]", lambda d: d.body("hand").xmat.flat[4]),
    ("body:'ball.1'.xpos[0]", lambda d: d.body("ball.1").xpos[0]),
    ('body : "ball.1" . xpos [ 0 ]', lambda d: d.body("ball.1").xpos[0]),
    ("joint:shoulder.qpos", lambda d: d.joint("shoulder").qpos[0]),
    ("joint:shoulder.qvel[0]", lambda d: d.joint("shoulder").qvel[0]),
    ("joint:loose.qpos[6]", lambda d: d.joint("loose").qpos[6]),
    ("geom:thumb.xpos[2]", lambda d: d.geom("thumb").xpos[2]),
    ("site:grip.xpos[0]", lambda d: d.site("grip").xpos[0]),
    ("camera:eye.xpos[1]", lambda d: d.camera("eye").xpos[1]),
    ("light:sun.xpos[2]", lambda d: d.light("sun").xpos[2]),
    ("tendon:cord.length", lambda d: d.tendon("cord").length[0]),
    ("actuator:motor.force", lambda d: d.actuator("motor").force[0]),
]


@pytest.mark.parametrize(("selector", "expected"), READS, ids=[text for text, _ in READS])
def test_selectors_match_mujoco(selector: str, expected: Callable[[Any], float]) -> None:
    model, data = arm()
    read = reader(selector, model, data)
    for _ in range(30):
        swing(model, data)
        mujoco.mj_step(model, data)
        value = read()
        assert value == expected(data)
        assert type(value) is float
    mujoco.mj_resetData(model, data)
    assert read() == expected(data)


def contacts(model: Any, data: Any, one: set[int], two: set[int]) -> tuple[float, float]:
    """Return whether geoms of the two sets push each other, and how strongly."""
    touch, total, wrench = 0.0, 0.0, np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        pair = {int(contact.geom1), int(contact.geom2)}
        if contact.efc_address >= 0 and any(pair == {a, b} for a in one for b in two):
            touch = 1.0
            mujoco.mj_contactForce(model, data, i, wrench)
            total += float(wrench[0])
    return touch, total


@pytest.mark.parametrize(
    ("names", "one", "two"),
    [
        ("skin,floor", {"skin"}, {"floor"}),
        ("floor,skin", {"floor"}, {"skin"}),
        ("'ball.1',floor", {"skin"}, {"floor"}),
        ("hand,floor", {"finger", "thumb"}, {"floor"}),
        ("thumb,floor", {"thumb"}, {"floor"}),
        ("thumb", {"thumb"}, {"floor", "rod", "finger", "skin"}),
        ("hand", {"finger", "thumb"}, {"floor", "rod", "skin", "finger", "thumb"}),
        ("rod,skin", {"rod"}, {"skin"}),
    ],
)
def test_contact_is_one_while_pushing(names: str, one: set[str], two: set[str]) -> None:
    model, data = arm()
    touch, force = (reader(f"contact:{names}{field}", model, data) for field in ("", ".force"))
    first, second = ({model.geom(name).id for name in each} for each in (one, two))
    seen = set()
    for _ in range(200):
        mujoco.mj_step(model, data)
        assert (touch(), force()) == contacts(model, data, first, second)
        seen.add(touch())
    assert seen == ({0.0} if names == "rod,skin" else {0.0, 1.0})


def test_contact_force_of_resting_body() -> None:
    model, data = arm()
    for _ in range(1500):
        mujoco.mj_step(model, data)
    weight = model.body("ball.1").mass[0] * 9.81
    assert reader("contact:skin,floor.force", model, data)() == pytest.approx(weight, rel=1e-3)


NAMES = st.text(min_size=1, max_size=12).filter(
    lambda text: not ("'" in text and '"' in text) and text.isprintable()
)


@given(NAMES, st.sampled_from(["xpos", "xmat"]), st.integers(-9, 9))
def test_any_printable_name_can_be_selected(name: str, field: str, index: int) -> None:
    selector = Selector("body", (name,), field, (index,))
    assert parse_selector("signal 'x'", str(selector), MUJOCO) == selector


@given(st.text(alphabet="bodysitecnajqp:.,[]0123456789'\"k -+/é", max_size=24))
def test_any_text_parses_or_fails(text: str) -> None:
    try:
        selector = parse_selector("signal 'x'", text, MUJOCO)
    except InputError:
        return
    assert parse_selector("signal 'x'", str(selector), MUJOCO) == selector


def test_computed_attribute_is_not_a_field() -> None:
    model, data = arm()
    motor = data.actuator("motor")
    if np.may_share_memory(motor.moment, motor.moment):  # in some versions of MuJoCo it is held
        assert reader("actuator:motor.moment[0]", model, data)() == motor.moment[0]
        return
    with pytest.raises(InputError, match="got 'moment'"):
        reader("actuator:motor.moment[0]", model, data)


def test_derive_keeps_warm_start(monkeypatch: pytest.MonkeyPatch) -> None:
    model, data = arm()
    mujoco.mj_step(model, data)
    before = data.qacc_warmstart.copy()
    forward = mujoco.mj_forward

    def as_in_older_versions(model: Any, data: Any) -> None:
        forward(model, data)
        data.qacc_warmstart[:] = data.qacc

    monkeypatch.setattr(mujoco, "mj_forward", as_in_older_versions)
    derive(model, data)
    assert np.array_equal(data.qacc_warmstart, before)
    assert not np.array_equal(data.qacc, before)


def test_selectors_of_environment() -> None:
    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        "always(z > -9 and touch < 9 and t < 9)",
        {"z": "body:torso.xpos[2]", "touch": "contact:bfoot,floor", "t": "time"},
        on_violation="report",
    )
    simulation: Any = env.unwrapped
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(10):
        info = env.step(env.action_space.sample())[4]
    touch = reader("contact:bfoot,floor", simulation.model, simulation.data)()
    assert info["robustness"] <= min(9.0 - touch, 9.0 - simulation.data.time)
    env.close()
