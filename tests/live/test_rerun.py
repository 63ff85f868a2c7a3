"""The contents of a live view, read from its file, and its viewer."""

import doctest
import io
import os
import pickle
import signal
import socket
import subprocess
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from http.client import HTTPConnection
from itertools import groupby
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from PIL import Image
from rrd_files import Point, read_rrd

import rtamt
from rtamt import InputError, StateError, Verdict
from rtamt.typing import End
from rtamt_gym import StepMonitor, StlMonitor, StlReward, VectorStlMonitor, simulate
from rtamt_gym.live import RerunView, outputs, view

SPECS = {
    "upright": "always(abs(theta) < 0.1)",
    "soon": "eventually[0:0.2](always[0:0.1](abs(x) < 0.04))",
    "late": "always[0:2](theta < 1)",
}
SIGNALS = {"theta": "obs[2]", "x": "obs[0]"}
CURVES = ("robustness", "lower", "upper")

FALLING = """
<mujoco><worldbody><body name="ball" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>
</mujoco>"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.rrd"


def cart(**keywords: Any) -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", **keywords)


def expected_curves(
    spec: str, columns: Mapping[str, Sequence[float]], end: End | None
) -> list[tuple[float, float, float]]:
    """Return robustness and bounds of a separate monitor after each sample and the end."""
    monitor = rtamt.EpisodeMonitor(spec, period="0.02")
    curves = []
    for row in zip(*(columns[name] for name in monitor.variables), strict=True):
        monitor.update(*row)
        curves.append((monitor.robustness, monitor.lower, monitor.upper))
    if end is not None:
        monitor.finish(end)
        curves[-1] = monitor.robustness, monitor.lower, monitor.upper
    return curves


def episodes(points: Sequence[Point]) -> list[list[float]]:
    """Return the values of each episode; samples are 0.02 s apart, without gaps."""
    assert [point.sample for point in points] == [*range(len(points))]
    assert [point.time for point in points] == pytest.approx(0.02 * np.arange(len(points)))
    groups = [(number, list(some)) for number, some in groupby(points, lambda p: p.episode)]
    assert [number for number, _ in groups] == [*range(1, len(groups) + 1)]
    return [[point.value for point in some] for _, some in groups]


def check_episodes(
    entities: Mapping[str, Sequence[Point]], ends: Sequence[End | None], head: str = ""
) -> list[dict[str, list[float]]]:
    """Compare the curves of every episode with other monitors; return its signals."""
    signals = {name: episodes(entities[f"{head}/signals/{name}"]) for name in SIGNALS}
    runs = [
        dict(zip(signals, columns, strict=True)) for columns in zip(*signals.values(), strict=True)
    ]
    assert len(runs) == len(ends)
    for name, spec in SPECS.items():
        curves = [episodes(entities[f"{head}/requirements/{name}/{curve}"]) for curve in CURVES]
        for run, end, *shown in zip(runs, ends, *curves, strict=True):
            assert list(zip(*shown, strict=True)) == expected_curves(spec, run, end)
    return runs


def play(env: gym.Env[Any, Any], seed: int, steps: int = 300) -> list[Any]:
    """Play an episode; return its observations."""
    actions = np.random.default_rng(seed)
    observed, _ = env.reset(seed=seed)
    seen = [observed]
    for _ in range(steps):
        observed, _, terminated, truncated, _ = env.step(int(actions.integers(2)))
        seen.append(observed)
        if terminated or truncated:
            break
    return seen


def test_file_of_stl_monitor(path: Path) -> None:
    with RerunView(path) as live:
        env = StlMonitor(
            cart(), SPECS, SIGNALS, on_violation="report", at_termination="complete", live=live
        )
        seen = [play(env, seed) for seed in range(3)]
        seen.append(play(env, 3, steps=4))
        env.close()
    runs = check_episodes(read_rrd(path), ["complete", "complete", "complete", "cut"])
    for run, observed in zip(runs, seen, strict=True):
        assert run["theta"] == [float(obs[2]) for obs in observed]


def test_file_of_stl_reward(path: Path) -> None:
    with RerunView(path) as live:
        env = StlReward(
            cart(), SPECS, SIGNALS, mode="add", at_termination="cut", on_violation="report",
            live=live,
        )  # fmt: skip
        play(env, 5)
    check_episodes(read_rrd(path), ["cut"])


def test_log_of_verdicts(path: Path) -> None:
    with RerunView(path) as live:
        env = StlMonitor(
            cart(), SPECS, SIGNALS, on_violation="report", at_termination="complete", live=live
        )
        expected = []
        for seed in range(4):
            play(env, seed)
            outcomes = env.stl_episodes[-1]["specs"]
            for name, outcome in outcomes.items():
                decided = outcome.get("decided_at")
                when = "the end" if decided is None else f"{0.02 * decided:.6g} s"
                expected.append((seed + 1, name, f"{name} {outcome['verdict']} at {when}"))
    levels = read_rrd(path, "TextLog:level")
    lines = []
    for entity, points in read_rrd(path, "TextLog:text").items():
        name = entity.split("/")[2]
        for point, level in zip(points, levels[entity], strict=True):
            assert level.value == ("ERROR" if " VIOLATED " in point.value else "INFO")
            lines.append((point.episode, name, point.value.partition(",")[0]))
    assert sorted(lines) == sorted(expected)


def test_pictures_of_an_environment(path: Path) -> None:
    with RerunView(path, pictures=4) as live:
        env = StlMonitor(
            cart(render_mode="rgb_array"), SPECS, SIGNALS, on_violation="report", live=live,
            at_termination="cut",
        )  # fmt: skip
        counts = [len(play(env, seed)) for seed in range(2)]
        last: Any = env.render()
    frames = read_rrd(path, "EncodedImage:blob")["/picture"]
    assert [frame.sample for frame in frames] == [
        *range(0, counts[0], 4),
        *range(counts[0], sum(counts), 4),
    ]
    picture = np.asarray(Image.open(io.BytesIO(bytes(frames[-1].value))))
    assert picture.shape == last.shape
    assert np.abs(picture.astype(int) - last).mean() < 4


def test_pictures_need_a_renderer(path: Path) -> None:
    with RerunView(path, pictures=1) as live, pytest.raises(InputError, match="needs pictures"):
        StlMonitor(cart(), SPECS, SIGNALS, live=live)


def test_samples_inside_of_steps(path: Path) -> None:
    with RerunView(path) as live:
        env = StlMonitor(
            gym.make("InvertedPendulum-v5"), "always(abs(a) < 9)", {"a": "qpos[1]"},
            substeps=True, live=live,
        )  # fmt: skip
        env.reset(seed=1)
        for _ in range(5):
            env.step(np.zeros(1, np.float32))
        samples = env.samples
        env.close()
    points = read_rrd(path)["/signals/a"]
    assert len(points) == samples == 11


@pytest.mark.parametrize("mode", AutoresetMode)
def test_file_of_vector_monitor(path: Path, mode: AutoresetMode) -> None:
    envs = SyncVectorEnv([cart] * 3, autoreset_mode=mode)
    seen: dict[int, list[list[float]]] = {0: [], 2: []}
    with RerunView(path, environments=(0, 2)) as live:
        monitor = VectorStlMonitor(envs, SPECS, SIGNALS, at_termination="complete", live=live)
        actions, steps = np.random.default_rng(3), 120
        observed, _ = monitor.reset(seed=7)
        for index, some in seen.items():
            some.append([float(observed[index][2])])
        for _ in range(steps):
            observed, _, terminated, truncated, infos = monitor.step(actions.integers(2, size=3))
            ended = terminated | truncated
            begun = monitor.begun if monitor.begun is not None else np.zeros(3, bool)
            final = infos.get("final_obs", observed)
            for index, some in seen.items():
                if begun[index]:
                    some.append([])
                same = mode is AutoresetMode.SAME_STEP and ended[index]
                some[-1].append(float((final if same else observed)[index][2]))
                if same:
                    some.append([float(observed[index][2])])
            if mode is AutoresetMode.DISABLED and ended.any():
                observed, _ = monitor.reset(seed=[1, 2, 3], options={"reset_mask": ended})
                for index, some in seen.items():
                    if ended[index]:
                        some.append([float(observed[index][2])])
        monitor.close()
    entities = read_rrd(path)
    assert not [entity for entity in entities if "environment" in entity and " 1" in entity]
    for index, some in seen.items():
        ends: list[End | None] = ["complete"] * (len(some) - 1)
        ends.append("cut" if len(some[-1]) > 1 and not ended[index] else
                    None if len(some[-1]) == 1 else "complete")  # fmt: skip
        runs = check_episodes(entities, ends, f"/environment\\ {index}")
        assert [run["theta"] for run in runs] == some


def test_pictures_of_a_vector(path: Path) -> None:
    envs = SyncVectorEnv([lambda: cart(render_mode="rgb_array")] * 2)
    with RerunView(path, environments=[1], pictures=3) as live:
        monitor = VectorStlMonitor(envs, "always(abs(x) < 9)", {"x": "obs[0]"}, live=live)
        monitor.reset(seed=1)
        for _ in range(6):
            monitor.step(np.array([0, 1]))
        frames: Any = monitor.render()
    shown = read_rrd(path, "EncodedImage:blob")["/environment\\ 1/picture"]
    assert [frame.sample for frame in shown] == [0, 3, 6]
    picture = np.asarray(Image.open(io.BytesIO(bytes(shown[-1].value))), int)
    assert np.abs(picture - frames[1]).mean() < min(1, np.abs(picture - frames[0]).mean() / 2)


def test_vector_environments_that_do_not_exist(path: Path) -> None:
    envs = SyncVectorEnv([cart] * 2)
    with RerunView(path, environments=(2,)) as live, pytest.raises(InputError, match="0 to 1"):
        VectorStlMonitor(envs, SPECS, SIGNALS, live=live)


def test_file_of_step_monitor(path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(FALLING)
    data = mujoco.MjData(model)
    heights = []
    with RerunView(path) as live:
        monitor = StepMonitor(
            model, data, "always(z > 0.5)", {"z": "qpos[2]", "speed": "qvel[2]"}, live=live
        )
        monitor.reset()
        heights.append(float(data.qpos[2]))
        for _ in range(200):
            monitor.step()
            heights.append(float(data.qpos[2]))
        monitor.finish()
        robustness = monitor.robustness
    entities = read_rrd(path)
    assert [point.value for point in entities["/signals/z"]] == heights
    assert entities["/signals/speed"][-1].value == data.qvel[2]
    assert entities["/requirements/spec/robustness"][-1].value == robustness
    assert entities["/requirements/spec/lower"][-1].value == robustness
    (line,) = read_rrd(path, "TextLog:text")["/requirements/spec/verdict"]
    assert line.sample == monitor.violated_at


def test_file_of_simulate(path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(FALLING)
    keywords: dict[str, Any] = {"duration": 0.2, "stop": "end"}
    with RerunView(path) as live:
        runs = [
            simulate(
                (model, mujoco.MjData(model)), "always(z > 0.9)", {"z": "qpos[2]"}, live=live,
                **keywords,
            )
            for _ in range(2)
        ]  # fmt: skip
    entities = read_rrd(path)
    signals = np.concatenate([run.signals["z"] for run in runs])
    assert [point.value for point in entities["/signals/z"]] == signals.tolist()
    for curve in CURVES:
        expected = np.concatenate([getattr(run.histories["spec"], curve) for run in runs])
        points = entities[f"/requirements/spec/{curve}"]
        assert [point.value for point in points] == expected.tolist()
        assert [point.episode for point in points] == [1] * 101 + [2] * 101


def test_simulate_of_an_environment_equals_its_run(path: Path) -> None:
    with RerunView(path) as live:
        run = simulate(
            cart(), SPECS, SIGNALS, policy=lambda obs: int(obs[3] > 0), seed=1, stop="end",
            duration=2.0, live=live,
        )  # fmt: skip
    runs = check_episodes(read_rrd(path), ["cut"])
    assert runs[0]["x"] == run.signals["x"].tolist()


def test_one_view_of_a_run(path: Path) -> None:
    with RerunView(path) as live:
        env = StlMonitor(cart(), SPECS, SIGNALS, live=live)
        with pytest.raises(InputError, match="leave one out"):
            simulate(env, live=live)
        with pytest.raises(InputError, match="make another RerunView"):
            StlMonitor(cart(), "always(x < 1)", SIGNALS | {"x": "obs[1]"}, live=live)


def test_copies_have_no_view(path: Path) -> None:
    with RerunView(path) as live:
        env = StlMonitor(cart(), SPECS, SIGNALS, at_termination="cut", live=live)
        env.reset(seed=1)
        copy = deepcopy(env)
        copy.step(1)
        env.step(0)
        with pytest.raises(TypeError, match="VectorStlMonitor"):
            pickle.dumps(live)
    assert len(read_rrd(path)["/signals/x"]) == 2
    with pytest.raises(StateError, match="closed"):
        StlMonitor(cart(), SPECS, SIGNALS, live=live)


def test_view_of_another_process(path: Path) -> None:
    with RerunView(path) as live:
        child = os.fork()
        if not child:
            try:
                live.track(["x"], ["near"], None)
            except StateError:
                os._exit(3)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3


def test_no_time_without_period(path: Path) -> None:
    with RerunView(path) as live:
        simulate([{"x": 1.0}, {"x": -1.0}], "always(x > 0)", live=live, stop="end")
    points = read_rrd(path)["/signals/x"]
    assert [(point.sample, point.time, point.value) for point in points] == [
        (0, None, 1.0),
        (1, None, -1.0),
    ]


@pytest.fixture
def viewed(path: Path) -> Iterator[RerunView]:
    with RerunView(path, viewer=True) as live:
        yield live


def viewer_of(live: RerunView) -> outputs.ViewerOutput:
    viewer = live._packer._outputs[0]
    assert isinstance(viewer, outputs.ViewerOutput)
    return viewer


def test_viewer_listens_on_loopback_only(viewed: RerunView) -> None:
    assert viewed.address is not None
    page = viewed.address.partition("?")[0]
    port = int(page.rsplit(":", 1)[1])
    connection = HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", "/")
    assert b"rerun" in connection.getresponse().read().lower()
    connection.close()
    listening = {
        line.split()[1]
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
        if line.split()[3] == "0A" and int(line.split()[1].split(":")[1], 16) == port
    }
    assert listening == {f"0100007F:{port:04X}"}
    viewed.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), 1.0)


def many_lines(live: RerunView, count: int, episodes_each: int = 500) -> None:
    """Log verdicts, and send them in parts."""
    track = live.track(["x"], ["near"], 1.0)
    for number in range(count):
        track.begin()
        track.add([1.0], [-1.0] * 3, [Verdict.VIOLATED])
        if number % episodes_each == 0:
            live.send()


def test_stopped_viewer_is_detached_once(path: Path, viewed: RerunView) -> None:
    process = viewer_of(viewed)._process
    os.killpg(process.pid, signal.SIGSTOP)
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        many_lines(viewed, 25_000)
        viewed.send()
        os.killpg(process.pid, signal.SIGCONT)
        viewed.close()
    assert [str(item.message) for item in raised if item.category is RuntimeWarning] == [
        "the viewer of Rerun is too far behind and was detached; the run goes on"
    ]
    assert len(read_rrd(path, "TextLog:text")["/requirements/near/verdict"]) == 25_000


def test_ended_viewer_is_detached(path: Path, viewed: RerunView) -> None:
    process = viewer_of(viewed)._process
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.warns(RuntimeWarning, match="has ended"):
        many_lines(viewed, 1000)
    viewed.close()
    assert len(read_rrd(path)["/signals/x"]) == 1000


def connect_until_refused(port: int) -> None:
    for _ in range(100_000):
        with suppress(TimeoutError, ConnectionResetError):  # a viewer resets them at its end
            socket.create_connection(("127.0.0.1", port), 1.0).close()


def test_viewer_ends_with_a_killed_program(tmp_path: Path) -> None:
    code = (
        "import os, signal; from rtamt_gym.live import RerunView; view = RerunView(); "
        "print(view.address, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL
    port = int(done.stdout.partition("?")[0].rsplit(":", 1)[1])
    with pytest.raises(ConnectionRefusedError):
        connect_until_refused(port)


def test_viewer_gets_all_lines(viewed: RerunView) -> None:
    many_lines(viewed, 2000)
    viewer = viewer_of(viewed)
    viewed.close()  # it waits for the viewer
    assert not viewer.detached
    assert (viewer._lines, viewer._size) == (0, 0)


def test_port_in_use() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} .* in use"):
            RerunView(ports=(0, port))


def test_example_of_the_class(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert doctest.testmod(view, optionflags=doctest.ELLIPSIS) == (0, 4)
    assert len(read_rrd(tmp_path / "cart.rrd")["/signals/a"]) == 7
