"""Every requirement of a text is judged separately, in all functions that take specifications."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

import rtamt
from rtamt_gym import StepMonitor, StlMonitor
from rtamt_gym.__main__ import main
from rtamt_gym.judging.specs import load_specs
from rtamt_gym.mujoco import evaluate_rollouts

TEXT = """\
const float LIMIT = 0.1
lean = abs(angle)
upright = always(lean < LIMIT)
near = always(abs(x) < 0.05)
calm = always[0:0.2](lean < LIMIT or abs(x) < LIMIT)
"""
APART = {
    "upright": "always(abs(angle) < 0.1)",
    "near": "always(abs(x) < 0.05)",
    "calm": "always[0:0.2](abs(angle) < 0.1 or abs(x) < 0.1)",
}
SIGNALS = {"angle": "obs[2]", "x": "obs[0]"}


def infos(env: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    """Return the infos of an episode with one action."""
    found = [env.reset(seed=2)[1]]
    done = False
    while not done:
        *_, terminated, truncated, info = env.step(env.action_space.sample() * 0)
        found.append({**info, "done": (terminated, truncated)})
        done = bool(np.any(terminated) or np.any(truncated))
    return found


def test_text_equals_named_requirements() -> None:
    one, several = (
        infos(StlMonitor(gym.make("CartPole-v1"), specs, SIGNALS, details=True))
        for specs in (TEXT, APART)
    )
    assert one == several
    assert list(one[0]["stl"]) == ["upright", "near", "calm"]
    assert one[-1]["stl_violated_by"] == "near"


def test_step_monitor_with_several_requirements() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
        "</worldbody></mujoco>"
    )
    text = "v = vz; slow = always(v > -0.1); high = always(z > -1)"
    signals = {"z": "qpos[0]", "vz": "qvel[0]"}
    monitor = StepMonitor(model, mujoco.MjData(model), text, signals)
    monitor.run(1.0)
    assert list(monitor.monitors) == ["slow", "high"]
    assert monitor.violated_by == "slow"
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    found = evaluate_rollouts(model, text, signals, np.zeros((2, 3, size)))
    assert list(found) == ["slow", "high"]


def test_command_with_several_requirements(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "balance.stl").write_text(TEXT)
    (tmp_path / "alone.stl").write_text("always(abs(x) < 2)")
    out = tmp_path / "out.json"
    specs = [tmp_path / "balance.stl", f"safe={tmp_path / 'balance.stl'}", tmp_path / "alone.stl"]
    options = [f"--spec={spec}" for spec in specs]
    options += [f"--signal={name}={selector}" for name, selector in SIGNALS.items()]
    assert main(["run", "CartPole-v1", *options, "--json", str(out)]) == 0
    names = ["upright", "near", "calm", "safe.upright", "safe.near", "safe.calm", "alone"]
    assert list(json.loads(out.read_text())["requirements"]) == names
    assert capsys.readouterr().out.splitlines()[:2] == [
        "upright: always(abs(angle) < 0.1)",
        "near: always(abs(x) < 0.05)",
    ]
    assert main(["run", "CartPole-v1", options[0], *options]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected one specification 'upright', got two; rename one\n"
    )


def test_names_of_requirements_in_a_mapping(tmp_path: Path) -> None:
    (tmp_path / "balance.stl").write_text(TEXT)
    specs: dict[str, str | Path] = {"one": "a = x > 0; always(a)", "two": tmp_path / "balance.stl"}
    assert list(load_specs(specs)) == ["one", "two.upright", "two.near", "two.calm"]
    assert list(load_specs(TEXT)) == list(load_specs(rtamt.parse(TEXT))) == list(APART)
    with pytest.raises(rtamt.InputError) as caught:
        load_specs({"s": "a = always(x > 0); b = always(x > 0)", "s.b": "always(x > 0)"})
    assert str(caught.value) == "expected one specification 's.b', got two; rename one"


def test_list_of_specifications_error() -> None:
    specs: Any = ["always(x > 0)"]
    with pytest.raises(rtamt.InputTypeError) as caught:
        load_specs(specs)
    assert str(caught.value) == (
        "expected the text of a specification, the path of a .stl file or an rtamt.Specification, "
        """got ['always(x > 0)']; name several in a mapping, {"safe": "...", "slow": "..."}"""
    )


def test_remade_environment_keeps_requirements() -> None:
    env = StlMonitor(gym.make("CartPole-v1"), rtamt.parse(TEXT), SIGNALS)
    assert env.spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert list(infos(again)[-1]["stl_episode"]) == list(APART)
    copied = pickle.loads(pickle.dumps(env))
    assert infos(copied) == infos(env)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "lean = abs(angle); upright = always(abs(angle) < 0.1); near = always(abs(x) < 1)",
            (
                "specification 'lean' is about the first sample only; no other formula uses it, "
                "so that it is a requirement by itself: use it in another, write "
                "always(abs(angle)) or view='step'"
            ),
        ),
        (
            "upright = always(abs(angle) < 0.1); abs(x) < 1",
            (
                "specification 'spec' is about the first sample only; no other formula uses it, "
                "so that it is a requirement by itself: use it in another, write "
                "always(abs(x) < 1) or view='step'"
            ),
        ),
        (
            "lean = abs(angle) + x; lean < 0.1",
            (
                "specification 'spec' is about the first sample only; write "
                "always(abs(angle) + x < 0.1) or view='step'"
            ),
        ),
    ],
)
def test_unused_helper_error(text: str, message: str) -> None:
    with pytest.raises(rtamt.SpecificationError) as caught:
        StlMonitor(gym.make("CartPole-v1"), text, SIGNALS)
    assert str(caught.value) == message
