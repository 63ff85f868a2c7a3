"""The tasks of Meta-World: the quantity that defines success, its side, and its tolerance.

Meta-World's own flag is a band, ``abs(quantity - target) <= tolerance``, for most tasks. A puck on
a mark needs a band, but a door, a button or a drawer has one side: opening it further is not a
failure. `TASKS` follows ``evaluate_state`` of each task in metaworld 3.1.1, in the file below
``metaworld/envs`` that a row names.

metaworld 3.1.1 needs MuJoCo 3.3.0, and ``packaging``, which it does not declare: ``pip install
metaworld packaging``. Importing this module registers ``metaworld/door-open-v3`` and the other
tasks. A seed repeats an episode there, and ``"baseline"`` is the scripted policy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import gymnasium as gym
import numpy as np

from rtamt import Formula, InputError
from rtamt.errors import nearest
from rtamt_gym.benchmarks import benchmark
from rtamt_gym.signals.signals import SignalLike, Step
from rtamt_gym.success import flag, one_sided

__all__ = ["TASKS", "BenchmarkTask", "SeededTask", "done", "make", "signals_of", "task_named"]

Axis = Literal["x", "y", "z"]

_AXES: Final = ("x", "y", "z")

_LEVER: Final = 1.5707963267948966
"""The angle of a pulled lever, in radians."""


class BenchmarkTask(NamedTuple):
    """The success of a task.

    Attributes:
        name: Its name in Meta-World.
        quantity: ``"flag"`` for the task's own flag; an axis of the object's position, in metres;
            or ``"lever"``, an angle in radians.
        side: 1 if the quantity grows towards its target and beyond; -1 if it falls; 0 for a flag.
        tolerance: The distance before the target that still counts as done, as in its own flag.
        file: The file of its flag, below ``metaworld/envs``.
        flag: The flag in this file.
    """

    name: str
    quantity: Literal["flag", "x", "y", "z", "lever"]
    side: Literal[-1, 0, 1]
    tolerance: float
    file: str
    flag: str


def _row(
    name: str,
    file: str,
    flag: str,
    quantity: Literal["flag", "x", "y", "z", "lever"] = "flag",
    side: Literal[-1, 0, 1] = 0,
    tolerance: float = 0.0,
) -> BenchmarkTask:
    return BenchmarkTask(f"{name}-v3", quantity, side, tolerance, f"sawyer_{file}_v3.py", flag)


_NEAR: Final = "norm(object - target) <= {}"

_ROWS: Final = (
    # The success has one side: doors, drawers, windows, buttons, handles, levers, locks, faucets,
    # plugs.
    _row("button-press", "button_press", "abs(y) <= 0.02", "y", 1, 0.02),
    _row("button-press-topdown", "button_press_topdown", "abs(z) <= 0.024", "z", -1, 0.024),
    _row(
        "button-press-topdown-wall", "button_press_topdown_wall", "abs(z) <= 0.024", "z", -1, 0.024
    ),
    _row("button-press-wall", "button_press_wall", "abs(y) <= 0.03", "y", 1, 0.03),
    _row("coffee-button", "coffee_button", "abs(y) <= 0.02", "y", 1, 0.02),
    _row("disassemble", "disassemble_peg", "z > 0", "z", 1, 0.0),
    _row("door-close", "door_close", _NEAR.format(0.08), "x", 1, 0.08),
    _row("door-lock", "door_lock", "abs(z) <= 0.02", "z", -1, 0.02),
    _row("door-open", "door", "abs(x) <= 0.08", "x", -1, 0.08),
    _row("door-unlock", "door_unlock", "abs(x) <= 0.02", "x", 1, 0.02),
    _row("drawer-close", "drawer_close", _NEAR.format(0.055), "y", 1, 0.055),
    _row("drawer-open", "drawer_open", _NEAR.format(0.03), "y", -1, 0.03),
    _row("faucet-close", "faucet_close", _NEAR.format(0.07), "y", 1, 0.07),
    _row("faucet-open", "faucet_open", _NEAR.format(0.07), "y", 1, 0.07),
    _row("handle-press", "handle_press", "abs(z) <= 0.02", "z", -1, 0.02),
    _row("handle-press-side", "handle_press_side", "abs(z) <= 0.02", "z", -1, 0.02),
    _row("handle-pull", "handle_pull", "abs(z) <= 0.05", "z", 1, 0.05),
    _row("handle-pull-side", "handle_pull_side", _NEAR.format(0.08), "z", 1, 0.08),
    _row("lever-pull", "lever_pull", "abs(angle - pi/2) <= pi/24", "lever", 1, _LEVER / 12),
    _row("peg-unplug-side", "peg_unplug_side", _NEAR.format(0.07), "x", 1, 0.07),
    _row("window-close", "window_close", "abs(x) <= 0.05", "x", -1, 0.05),
    _row("window-open", "window_open", "abs(x) <= 0.05", "x", 1, 0.05),
    # One side already.
    _row("hammer", "hammer", "NailSlideJoint > 0.09"),
    # The flag is about a place or a posture, so a band fits it.
    _row("assembly", "assembly_peg", "norm(xy) < 0.02 and z > 0"),
    _row("basketball", "basketball", _NEAR.format(0.08)),
    _row("bin-picking", "bin_picking", _NEAR.format(0.05)),
    _row("box-close", "box_close", _NEAR.format(0.08)),
    _row("coffee-pull", "coffee_pull", _NEAR.format(0.07)),
    _row("coffee-push", "coffee_push", _NEAR.format(0.07)),
    _row("dial-turn", "dial_turn", _NEAR.format(0.07)),
    _row("hand-insert", "hand_insert", _NEAR.format(0.05)),
    _row("peg-insert-side", "peg_insertion_side", _NEAR.format(0.07)),
    _row("pick-out-of-hole", "pick_out_of_hole", _NEAR.format(0.07)),
    _row("pick-place", "pick_place", _NEAR.format(0.07)),
    _row("pick-place-wall", "pick_place_wall", _NEAR.format(0.07)),
    _row("plate-slide", "plate_slide", _NEAR.format(0.07)),
    _row("plate-slide-back", "plate_slide_back", _NEAR.format(0.07)),
    _row("plate-slide-back-side", "plate_slide_back_side", _NEAR.format(0.07)),
    _row("plate-slide-side", "plate_slide_side", _NEAR.format(0.07)),
    _row("push", "push", _NEAR.format(0.05)),
    _row("push-back", "push_back", _NEAR.format(0.07)),
    _row("push-wall", "push_wall", _NEAR.format(0.07)),
    _row("reach", "reach", "norm(hand - target) <= 0.05"),
    _row("reach-wall", "reach_wall", "norm(hand - target) <= 0.05"),
    _row("shelf-place", "shelf_place", _NEAR.format(0.07)),
    _row("soccer", "soccer", _NEAR.format(0.07)),
    _row("stick-pull", "stick_pull", "norm(handle - target) <= 0.12, stick inserted"),
    _row("stick-push", "stick_push", "norm(container - target) <= 0.12, stick held"),
    _row("sweep", "sweep", _NEAR.format(0.05)),
    _row("sweep-into", "sweep_into_goal", _NEAR.format(0.05)),
)

TASKS: Final[Mapping[str, BenchmarkTask]] = MappingProxyType({row.name: row for row in _ROWS})
"""The 50 tasks by name. In a flag x, y and z are the object's position less its target."""


def task_named(name: str) -> BenchmarkTask:
    """Return the task of a name; raise InputError if the name is unknown."""
    if name not in TASKS:
        raise InputError(f"Meta-World has no task {name!r}{nearest(name, TASKS)}")
    return TASKS[name]


def done(name: str) -> Formula:
    """Return the formula of a done task, over the signals of `signals_of`.

    `rtamt_gym.success.reading` turns it into a requirement.

    Raises:
        InputError: If the task is unknown.

    Example:
        >>> from rtamt_gym.success import reading
        >>> print(done("door-open-v3"), "|", done("push-v3"))
        past >= -0.08 | success >= 0.5
        >>> print(reading("kept", done("door-open-v3")))
        eventually always(past >= -0.08 since[0.5:0.5] past >= -0.08)
    """
    task = task_named(name)
    return flag() if task.quantity == "flag" else one_sided("past", at_least=-task.tolerance)


def signals_of(name: str) -> dict[str, SignalLike]:
    """Return the signals of `done` in the environment of a task.

    ``past`` is the distance of the object past its target, in metres or radians. ``success`` is the
    task's own flag; it is 0 at the reset, where the info lacks it.

    Raises:
        InputError: If the task is unknown.

    Example:
        >>> signals_of("push-v3")
        {'success': ("info['success']", 0.0)}
    """
    task = task_named(name)
    return (
        {"success": ("info['success']", 0.0)} if task.quantity == "flag" else {"past": Past(task)}
    )


@dataclass(frozen=True)
class Past:
    """Reads the distance of the object of a task past its target.

    The observation of a reset may lag: in ``window-close-v3`` it shows a closed window, which is
    open from the first step on.
    """

    task: BenchmarkTask

    def __call__(self, step: Step) -> float:
        """Return the distance past the target, negative before it."""
        simulation: Any = step.env.unwrapped
        if self.task.quantity == "lever":
            angle = -float(simulation.data.joint("LeverAxis").qpos.item())
            return angle - _LEVER
        axis = _AXES.index(self.task.quantity)
        target = float(simulation._target_pos[axis])  # noqa: SLF001 - the observation may hide it
        return self.task.side * (float(step.obs[4 + axis]) - target)


class SeededTask(gym.Wrapper[Any, Any, Any, Any]):
    """A task of Meta-World where ``reset(seed=)`` places the objects.

    In Meta-World's own environments from ``gymnasium.make``, a seed does not. An episode ends at
    Meta-World's time limit, which truncates it; success does not end it.

    Args:
        env: An environment of the task.
        tasks: Its variations; a seed selects one by its number, modulo their count.
    """

    def __init__(self, env: gym.Env[Any, Any], tasks: list[Any]) -> None:
        super().__init__(env)
        self._tasks = tasks
        self._set(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; without a seed in the last variation."""
        if seed is not None:
            self._set(seed)
        return self.env.reset(seed=seed, options=options)

    def _set(self, seed: int) -> None:
        simulation: Any = self.env.unwrapped
        simulation.set_task(self._tasks[seed % len(self._tasks)])


def make(task: str, **arguments: Any) -> SeededTask:  # noqa: ANN401 - Meta-World's own
    """Return a task of Meta-World, with the scripted policy as its ``baseline``.

    Args:
        task: Its name, such as ``"door-open-v3"``.
        **arguments: Arguments of the environment's class, such as ``render_mode="rgb_array"``.
    """
    metaworld = benchmark("metaworld", "metaworld packaging")
    policies = benchmark("metaworld.policies", "metaworld packaging")
    variations = metaworld.MT1(task_named(task).name, seed=0)
    env = variations.train_classes[task](**arguments)
    scripted = policies.ENV_POLICY_MAP[task]()
    env.baseline = lambda observation: np.clip(scripted.get_action(observation), -1.0, 1.0)
    return SeededTask(env, variations.train_tasks)


for _name in TASKS:
    if f"metaworld/{_name}" not in gym.registry:
        gym.register(
            f"metaworld/{_name}", f"{__name__}:make", kwargs={"task": _name}, order_enforce=False
        )
