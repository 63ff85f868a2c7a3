"""What `StlMonitor` says of an episode is what its samples, its end and the options give."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from episode_oracle import chargeable, mismatch, report
from hypothesis import given
from scripts import Case, Scripted, cases, variables

from rtamt import SpecificationError
from rtamt_gym import StlMonitor

VERDICTS = (None, "latched", "first")
INSTANTS = ("violation", "depth")


def monitored(case: Case, lane: int = 0) -> StlMonitor[Any, Any]:
    options: dict[str, Any] = vars(case.options)
    env = Scripted(case.lanes[lane])
    return StlMonitor(env, case.specs, variables(case.specs), period=1, **options)


@contextmanager
def said() -> Iterator[list[str]]:
    """The warnings, in their order."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        texts: list[str] = []
        yield texts
    texts += [str(warning.message) for warning in caught]


def play(env: StlMonitor[Any, Any], samples: int) -> tuple[list[dict[str, Any]], list[Any]]:
    """The infos and the flags of an episode, up to so many samples."""
    infos, flags = [env.reset()[1]], [(False, False)]
    while len(infos) < samples and flags[-1] == (False, False):
        *_, terminated, truncated, info = env.step(0)
        infos.append(info)
        flags.append((terminated, truncated))
    return infos, flags


def check(case: Case) -> None:
    """Plays the scripts one after the other; those without an end are left by the next reset."""
    env = monitored(case)
    records: list[dict[str, Any]] = []
    expected_warnings: list[str] = []
    with said() as warned:
        for script in case.lanes[0]:
            infos, flags = play(env, len(script))
            expected = report(
                case.specs,
                script.trace,
                script.flags,
                case.options,
                own=script.infos,
                left=True,
            )
            assert mismatch(expected.infos, infos) == ""
            assert flags == expected.flags
            assert expected.record is not None
            records.append(expected.record)
            expected_warnings += ["at_termination"] * expected.assumed
            told = any(flags[-1]) and "is_success" in script.infos[len(infos) - 1]
            expected_warnings += ["is_success"] * told
        env.close()
    assert mismatch(records, list(env.stl_episodes)) == ""
    assert sorted(subject(text) for text in warned) == sorted(set(expected_warnings))


def subject(text: str) -> str:
    """The option or the key that a warning is about."""
    return next(word for word in ("at_termination", "is_success") if word in text)


@given(cases(VERDICTS))
def test_infos_ends_and_records_are_those_of_the_definition(case: Case) -> None:
    check(case)


@given(cases(INSTANTS))
def test_the_cost_of_a_step_is_that_of_the_instant_that_it_settles(case: Case) -> None:
    if chargeable(case.specs, case.options.view):
        check(case)
    else:
        with pytest.raises(SpecificationError, match='cost="latched"'):
            monitored(case)
