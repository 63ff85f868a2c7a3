"""Recordings of two releases are paired by the names below their folders."""

from pathlib import PurePath

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import InputError
from rtamt_gym.evaluation.recording_pairs import pair_recordings

paths = st.lists(
    st.lists(st.sampled_from("xy"), min_size=1, max_size=3).map("/".join), min_size=1, unique=True
)


@settings(max_examples=examples(200))
@given(paths, paths)
def test_pairs_match_every_choice_of_folders(a: list[str], b: list[str]) -> None:
    def below(names: list[str]) -> list[dict[str, str]]:
        """The names below each folder that contains all of them."""
        results = []
        for depth in range(4):
            parts = [PurePath(name).parts for name in names]
            if all(len(p) >= depth for p in parts) and len({p[:depth] for p in parts}) == 1:
                results.append({"/".join(p[depth:]): n for p, n in zip(parts, names, strict=True)})
        return results

    choices = {
        frozenset((one[name], two[name]) for name in one.keys() & two.keys())
        for one in below(a)
        for two in below(b)
    }
    choices.discard(frozenset())
    if len(choices) != 1:
        with pytest.raises(InputError):
            pair_recordings(a, b)
        return
    found = pair_recordings(a, b)
    assert frozenset(found.pairs.values()) == choices.pop()
    assert len(found.pairs) + len(found.only_a) == len(a)
    assert len(found.pairs) + len(found.only_b) == len(b)


def test_folders_decide_between_two_pairs() -> None:
    a, b = ["old/city/run.csv"], ["new/run.csv", "new/city/run.csv"]
    with pytest.raises(InputError, match="--folders old/city new, or --folders old new"):
        pair_recordings(a, b)
    assert pair_recordings(a, b, ["old", "new"]).only_b == ("run.csv",)
    assert pair_recordings(a, b, ["old/city", "new"]).only_b == ("city/run.csv",)


def test_groups_of_one_file_are_pairs() -> None:
    a = ["old.xml[id=a/b]", "old.xml[id=c]"]
    found = pair_recordings(a, ["out/new.xml[id=c]", "out/new.xml[id=d]"])
    assert found.pairs == {"[id=c]": ("old.xml[id=c]", "out/new.xml[id=c]")}
    assert found.only_a == ("[id=a/b]",)
    assert found.only_b == ("[id=d]",)


def test_two_single_files_are_a_pair() -> None:
    assert pair_recordings(["a.csv"], ["b.csv"]).pairs == {"": ("a.csv", "b.csv")}


def test_no_pairs_error() -> None:
    with pytest.raises(InputError, match=r"A has a/1.csv, a/2.csv, B has b/3.csv, b/4.csv"):
        pair_recordings(["a/1.csv", "a/2.csv"], ["b/3.csv", "b/4.csv"])
    with pytest.raises(InputError, match="is not in the folder c"):
        pair_recordings(["a/1.csv"], ["b/1.csv"], ["c", "b"])
    with pytest.raises(InputError, match="2 times"):
        pair_recordings(["a/1.csv", "a/1.csv"], ["b/1.csv"])
