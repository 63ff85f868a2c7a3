"""Tianshou's collector reads what the wrappers give; the program is that of docs/learners.md."""

from pathlib import Path

from programs import BOUND, run


def test_the_statistics_of_the_collector_are_those_of_a_hand_count(tmp_path: Path) -> None:
    program, rides = run("Tianshou", tmp_path)
    statistics = program["statistics"]
    ended = rides.ended(early=False)[-40:]
    assert list(statistics.successes) == [ride.success for ride in ended]
    assert list(statistics.costs) == [ride.outside for ride in ended]
    assert statistics.returns.tolist() == [ride.steps for ride in ended]
    assert 0 < sum(statistics.successes) < 40
    assert max(statistics.costs) > 1

    kept = program["training"].buffer.sample(0)[0]
    outside = abs(kept.obs_next[:, 0].astype(float)) >= BOUND
    assert kept.info.cost.tolist() == outside.astype(float).tolist()
    assert kept.info.is_success.sum() == sum(statistics.successes)
    assert not kept.info.is_success[~kept.done].any()
