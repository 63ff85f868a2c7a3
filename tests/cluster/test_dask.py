"""Campaigns on a Dask cluster of two worker processes."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaign_systems import tank_runner, tank_tasks
from clusters import check
from distributed import Client, LocalCluster

from rtamt import InputError
from rtamt_gym.play.campaign import run_campaign


def test_a_campaign_runs_on_the_workers_of_the_present_client(tmp_path: Path) -> None:
    workers = {"n_workers": 2, "threads_per_worker": 1, "processes": True}
    with LocalCluster(**workers, dashboard_address=None) as cluster, Client(cluster):
        check("dask", tmp_path)


def test_without_a_client_it_says_that_one_is_needed() -> None:
    with pytest.raises(InputError) as refused:
        run_campaign(tank_runner(), tank_tasks(1), backend="dask")
    assert str(refused.value).startswith(
        "cannot use backend='dask': To use Joblib with Dask first create a Dask Client"
    )
