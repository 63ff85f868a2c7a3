"""The data of a report: strict JSON, complete, with infinities as text."""

import json

from report_example import EXAMPLE


def test_json_is_strict_and_complete() -> None:
    plain = json.loads(EXAMPLE.to_json(), parse_constant=_refuse)
    assert plain == EXAMPLE.plain()
    assert [section["kind"] for section in plain["sections"]] == [
        *("evaluation", "sweep", "search", "matrix", "comparison")
    ]
    upright, centred = plain["sections"][0]["requirements"]
    assert upright["interval"] == [0.6395894, 0.9476195]
    assert centred["robustness"][0] == "-inf"
    assert centred["robustness"][-1] == "inf"
    (episode,) = upright["worst"]
    assert len(episode["times"]) == len(episode["signals"]["angle"]) == 101
    assert episode["deciding"][0]["predicate"] in episode["predicates"]


def _refuse(text: str) -> None:
    raise AssertionError(text)
