"""The contract of every cluster: its record equals one process, also after deaths and hangs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from campaign_systems import tank_runner, troubled

from rtamt_gym import Parameter, evaluate_policy, falsify, sweep
from rtamt_gym.play.campaign import run_campaign
from rtamt_gym.results import Record

__all__ = ["check"]


def check(backend: Any, folder: Path) -> None:  # noqa: ANN401
    """Run campaigns on an existing cluster.

    Args:
        backend: The name of the backend.
        folder: A folder for files.
    """
    runner = tank_runner(troubled(folder))
    fine = [({"inflow": i / 40, "trouble": 0}, None) for i in range(40)]
    here = run_campaign(runner, fine)
    assert run_campaign(runner, fine, backend=backend, folder=folder / "runs") == here
    assert Record.load(folder / "runs") == here
    troubles = [
        (case | {"trouble": trouble}, None)
        for (case, _), trouble in zip(fine, [1, 0, 4], strict=False)
    ]
    record = run_campaign(runner, troubles, backend=backend, timeout=5)
    assert [row.error for row in record] == [
        "ChildProcessError: the run ended its process with exit status 3, twice",
        "",
        "TimeoutError: the run was ended after timeout=5 s",
    ]
    assert record[1] == here[1]
    options: Any = {"samples": 20, "progress": False}
    grants: Any = ("rtamt/RequestGrant-v0", "always(gnt < 3)", [Parameter("noise", 0.1, 1)])
    there = sweep(*grants, **options, batch=4, backend=backend)
    assert there.record == sweep(*grants, **options).record
    played: Any = ("random", "rtamt/RequestGrant-v0", "always(gnt < 3)")
    evaluation = evaluate_policy(*played, episodes=8, backend=backend)
    assert evaluation == evaluate_policy(*played, episodes=8)
    search: Any = {"system": "rtamt/RequestGrant-v0", "space": [Parameter("noise", 0.1, 1)]}
    for requirement in ("always(gnt < 3)", "always(gnt < 30)"):
        found = falsify(requirements=requirement, budget=40, backend=backend, batch=4, **search)
        assert found.record == falsify(requirements=requirement, budget=40, **search).record
