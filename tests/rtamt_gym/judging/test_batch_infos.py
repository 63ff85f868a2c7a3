"""Infos of many environments from before a reset: each has its own episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from hypothesis import given
from hypothesis import strategies as st

from rtamt_gym.wrappers.vector_forms import final_infos

Info = dict[str, Any]

numbers: st.SearchStrategy[Info] = st.dictionaries(
    st.sampled_from(["x", "y"]), st.integers(-9, 9).map(float)
)


@st.composite
def entries(draw: st.DrawFn) -> Info:
    """Infos of an environment, which may contain another."""
    info, inner = draw(numbers), draw(st.none() | numbers)
    return info if inner is None else {**info, "inner": inner}


def together(infos: Sequence[Info | None]) -> Info:
    """Return the infos of some environments, joined as in Gymnasium."""
    envs: VectorEnv[Any, Any, Any] = VectorEnv()
    envs.num_envs = len(infos)
    found: Info = {}
    for number, info in enumerate(infos):
        if info is not None:
            found = envs._add_info(found, info, number)
    return found


def alone(infos: Mapping[str, Any], number: int) -> Info:
    """Return the info of one environment."""
    assert all(key[1:] in infos for key in infos if key.startswith("_"))
    return {
        key: alone(value, number) if isinstance(value, Mapping) else value[number]
        for key, value in infos.items()
        if not key.startswith("_") and infos[f"_{key}"][number]
    }


@given(st.lists(st.tuples(entries(), st.none() | entries()), min_size=1, max_size=4))
def test_final_infos_replace_infos_of_resets(rows: list[tuple[Info, Info | None]]) -> None:
    ended = np.array([final is not None for _, final in rows])
    infos = together([info for info, _ in rows])
    if ended.any():
        infos |= {"final_info": together([final for _, final in rows]), "_final_info": ended}
    found = final_infos(infos, ended)
    for number, (info, final) in enumerate(rows):
        assert alone(found, number) == (info if final is None else final)
