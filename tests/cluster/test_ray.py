"""Campaigns on a local Ray of two workers."""

from __future__ import annotations

from pathlib import Path

import pytest
import ray
from clusters import check


def test_a_campaign_runs_on_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # otherwise it writes a file next to the user's
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        check("ray", tmp_path)
    finally:
        ray.shutdown()
