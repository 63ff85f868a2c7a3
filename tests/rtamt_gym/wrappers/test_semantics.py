"""`semantics=` of the wrappers: neutral predicates, single and vector environments, errors."""

from __future__ import annotations

import copy
import pickle
from typing import Any, get_args

import gymnasium as gym
import numpy as np
import pytest
from bits import bits
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from replay import Replay, run
from vector_environments import difference

import rtamt
from rtamt.typing import SemanticsName
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.options.evaluation import View
from rtamt_gym.shaping import Mode

SEMANTICS = get_args(SemanticsName)
SPECS = {
    "granted": "always(req >= 3 implies eventually[0:2](gnt >= 3))",
    "quiet": "always(gnt < 5 or req > 1)",
    "asked": "eventually(req >= 4)",
}
SIGNALS = {"req": "obs[0]", "gnt": "obs[1]"}
ROLES = {"inputs": ["req"], "outputs": ["gnt"]}
TRACE = np.array([[0, 0], [4, 0], [0, 1], [0, 0], [5, 3], [1, 6], [2, 0]], np.float64)


class Pairs(gym.Env[Any, Any]):
    """Observes pairs of numbers, in an order of the seed; the last ends the episode."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Discrete(2)

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.rows = TRACE[self.np_random.permutation(len(TRACE))] if seed else TRACE
        self.at = 0
        return self.rows[0], {}

    def step(self, action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        self.at += 1
        return self.rows[self.at], 1.0, self.at == len(TRACE) - 1, False, {}


def infos(env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    shown = [env.reset(seed=0)[1]]
    while len(shown) < len(TRACE):
        shown.append(env.step(0)[4])
    return shown


@pytest.mark.parametrize("view", ["episode", "step"])
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_a_wrapper_says_what_the_monitors_of_its_specifications_say(
    semantics: SemanticsName, view: View
) -> None:
    texts = SPECS if view == "episode" else {"near": "req >= 3 implies eventually[0:2](gnt >= 3)"}
    options: Any = {"semantics": semantics, **ROLES}
    env = StlMonitor(
        Pairs(), texts, SIGNALS, period=1, view=view, on_violation="report", details=True, **options
    )
    judged = texts if view == "episode" else {"near": f"always({texts['near']})"}
    twins = {}
    for name, text in judged.items():
        known = {k: [n for n in v if n in rtamt.parse(text).variables] for k, v in ROLES.items()}
        twins[name] = rtamt.EpisodeMonitor(text, 1, semantics=semantics, **known)  # type: ignore[arg-type]  # a dictionary
    for at, info in enumerate(infos(env)):
        sample = dict(zip(SIGNALS, TRACE[at].tolist(), strict=True))
        for name, twin in twins.items():
            twin.update({v: sample[v] for v in twin.variables})
            if at == len(TRACE) - 1:
                twin.finish()
            shown = info["stl"][name]
            assert (shown["lower"], shown["upper"]) == (twin.lower, twin.upper)
            assert shown["verdict"] == twin.verdict.name
            if view == "episode":
                assert shown["robustness"] == twin.robustness


@pytest.mark.slow(keep=12)
@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("view", ["episode", "step"])
def test_many_environments_say_what_one_says(
    semantics: SemanticsName, mode: AutoresetMode, view: View
) -> None:
    options: Any = {"semantics": semantics, "view": view, "details": True, "period": 1, **ROLES}
    texts = SPECS if view == "episode" else {"near": "req >= 3 implies eventually[0:2](gnt >= 3)"}
    many = VectorStlMonitor(
        SyncVectorEnv([Pairs] * 3, autoreset_mode=mode), texts, SIGNALS, **options
    )
    alone = SyncVectorEnv(
        [lambda: StlMonitor(Pairs(), texts, SIGNALS, on_violation="report", **options)] * 3,
        autoreset_mode=mode,
    )
    shown: list[list[Any]] = []
    for envs in (many, alone):
        shown.append([envs.reset(seed=3)])
        for _ in range(2 * len(TRACE)):
            shown[-1].append(envs.step(np.zeros(3, np.int64)))
            ended = np.logical_or(*shown[-1][-1][2:4])
            if mode is AutoresetMode.DISABLED and ended.any():
                shown[-1].append(envs.reset(options={"reset_mask": ended}))
    assert difference(shown[0], shown[1]) == ""


@pytest.mark.parametrize("mode", ["add", "terminal"])
def test_rewards_are_those_of_the_semantics(mode: Mode) -> None:
    text, roles = SPECS["granted"], {"semantics": "output-robustness", **ROLES}
    options: Any = {"mode": mode, "clip": 9.0, "on_violation": "report", "period": 1, **roles}
    env = StlReward(Pairs(), text, SIGNALS, **options)
    many = VectorStlReward(SyncVectorEnv([Pairs] * 2), text, SIGNALS, **options)
    env.reset(seed=0)
    many.reset(seed=[0, 0])
    for end in range(2, len(TRACE) + 1):
        row = {"req": TRACE[:end, 0], "gnt": TRACE[:end, 1]}
        expected = float(rtamt.evaluate(text, row, 1, **roles)[0])  # type: ignore[arg-type]  # a dictionary
        paid = min(max(expected, -9.0), 9.0) if mode == "add" or end == len(TRACE) else 0.0
        assert env.step(0)[1] == 1.0 + paid
        assert many.step(np.zeros(2, np.int64))[1].tolist() == [1.0 + paid] * 2


def test_declared_inputs_and_outputs_are_those_of_each_text() -> None:
    declared = (
        "input float req\noutput float gnt\nalways(req >= 3 implies eventually[0:2](gnt >= 3))"
    )
    options: Any = {"semantics": "output-robustness", "on_violation": "report", "period": 1}
    said = infos(StlMonitor(Pairs(), declared, SIGNALS, **options))
    named: Any = {**options, **ROLES}
    assert said == infos(StlMonitor(Pairs(), SPECS["granted"], SIGNALS, **named))
    options["semantics"] = "standard"
    assert said != infos(StlMonitor(Pairs(), declared, SIGNALS, **options))


@pytest.mark.parametrize("kind", ["scalar", "vector"])
def test_the_semantics_is_recorded(kind: str) -> None:
    roles: Any = {"semantics": "input-robustness", "inputs": {"req"}, "outputs": iter(["gnt"])}
    envs: Any = Pairs() if kind == "scalar" else SyncVectorEnv([Pairs])
    wrapper: Any = StlMonitor if kind == "scalar" else VectorStlMonitor
    made = wrapper(envs, SPECS, SIGNALS, period=1, **roles)
    kept = made._saved_kwargs
    assert (kept["semantics"], kept["inputs"], kept["outputs"]) == (
        *("input-robustness", ("req",), ("gnt",)),
    )
    again = wrapper(envs, **kept)
    for other in (copy.deepcopy(made), pickle.loads(pickle.dumps(made)), again):
        for _, judge in other.monitors.values():
            assert judge.interface.semantics == "input-robustness"
        assert difference(other.reset(seed=0), made.reset(seed=0)) == ""


def test_an_environment_is_made_again_with_its_semantics() -> None:
    env = StlMonitor(
        gym.make("CartPole-v1"),
        {"upright": "always(abs(theta) < 0.2)", "calm": "always(abs(push) < 2)"},
        {"theta": "obs[2]", "push": "obs[1]"},
        semantics="output-robustness",
        outputs=["theta"],
    )
    assert env.spec is not None
    remade: Any = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert remade.spec.to_json() == env.spec.to_json()
    upright, calm = (judge for _, judge in remade.get_wrapper_attr("monitors").values())
    assert (upright.interface.outputs, calm.interface.outputs) == (("theta",), ())
    assert remade.reset(seed=1)[1] == env.reset(seed=1)[1]


def test_an_error_about_one_of_several_specifications_names_it() -> None:
    specs = {"a": "output float gnt\nalways(gnt > 1)", "b": "always(req > 1)"}
    with pytest.raises(
        rtamt.InputError, match="needs output variables, and none are declared"
    ) as raised:
        StlMonitor(Pairs(), specs, SIGNALS, semantics="output-robustness")
    assert raised.value.__notes__ == ["in specification 'b'"]


def test_the_message_of_a_field_is_a_name_too() -> None:
    specs = {"a": "always(cmd.x > 1)", "b": "always(gnt > 1)"}
    signals = {"cmd.x": "obs[0]", "gnt": "obs[1]"}
    env = StlMonitor(
        Pairs(), specs, signals, semantics="input-robustness", inputs=["cmd"], details=True
    )
    stl = env.reset(seed=0)[1]["stl"]
    assert (stl["a"]["robustness"], stl["b"]["robustness"]) == (-1.0, -np.inf)


def test_what_hangs_on_a_predicate_left_out_stays_undecided() -> None:
    for text in ("always(x > 9)", "always(not (x > 9))", "eventually(x > 9)"):
        options: Any = {"semantics": "output-vacuity", "outputs": [], "details": True}
        env = StlMonitor(Replay([1, 0, 5]), text, {"x": "obs[0]"}, **options)
        shown = run(env)
        assert not any(info["stl_violated"] for info in shown)
        assert {info["stl"]["spec"]["verdict"] for info in shown} == {"UNDECIDED"}
        assert (shown[-1]["is_success"], shown[-1]["stl_undecided"]) == (False, True)
    monitor = rtamt.EpisodeMonitor("always(x > 9)", semantics="output-vacuity", outputs=())
    monitor.update(1.0)
    assert bits([monitor.lower, monitor.upper]) == bits([-0.0, 0.0])
