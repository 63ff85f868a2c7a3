"""A saved case of a model of psy-taliro runs again with the same bits."""

from pathlib import Path

import taliro_systems
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from saved import Kind, check


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(coordinates=st.lists(st.floats(0, 1), min_size=6, max_size=6))
def test_a_saved_case_runs_again_to_the_same_bits(coordinates: list[float], tmp_path: Path) -> None:
    kind = Kind(
        taliro_systems.decay,
        "always[0:4](x < 5)",
        [*taliro_systems.decay.space],
        {},
        {"system": "taliro_systems:decay"},
    )
    check(kind, coordinates, 0, tmp_path / "case.json")
