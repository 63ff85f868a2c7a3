"""Recordings of two releases are paired by the names below their folders."""

import itertools
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
        """Return the names below each folder that contains all of them."""
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
    rival = False
    if len(choices) == 1:
        (whole,) = choices
        left = len(whole) < max(len(a), len(b))
        most = [
            len(pairs)
            for one, two in itertools.product(every_folder(a), every_folder(b))
            if (pairs := below_folders(a, one, b, two)) != whole
        ]
        itself = any(one == two for one, two in whole)
        rival = left and max(most, default=0) >= len(whole) + (not itself)
    if len(choices) != 1 or rival:
        with pytest.raises(InputError):
            pair_recordings(a, b)
        return
    found = pair_recordings(a, b)
    assert frozenset(found.pairs.values()) == choices.pop()
    assert len(found.pairs) + len(found.only_a) == len(a)
    assert len(found.pairs) + len(found.only_b) == len(b)


def every_folder(names: list[str]) -> set[tuple[str, ...]]:
    parts = [PurePath(name).parts for name in names]
    return {path[:depth] for path in parts for depth in range(len(path))}


def below_folders(
    a: list[str], one: tuple[str, ...], b: list[str], two: tuple[str, ...]
) -> frozenset[tuple[str, str]]:
    """The recordings with equal names below a folder of A and one of B."""
    return frozenset(
        (x, y)
        for x, y in itertools.product(a, b)
        if f"{x}/".startswith("/".join([*one, ""]))
        and f"{y}/".startswith("/".join([*two, ""]))
        and PurePath(x).parts[len(one) :] == PurePath(y).parts[len(two) :] != ()
    )


def test_file_of_the_other_release_is_no_reason_to_drop_all() -> None:
    old = ["old/a.csv", "old/b.csv", "old/c.csv"]
    new = ["new/a.csv", "new/b.csv", "new/c.csv"]
    for b in ([*new, "old/a.csv"], [*new, *old]):
        with pytest.raises(InputError, match=r"set --folders \. \., or --folders old new$"):
            pair_recordings(old, b)
        found = pair_recordings(old, b, ["old", "new"])
        assert len(found.pairs) == 3
        assert found.only_b == tuple(b[3:])
        assert pair_recordings(old, b, [".", "."]).only_b[:3] == tuple(new)
    with pytest.raises(InputError, match=r"--folders old new$"):
        pair_recordings(old, [*new, "tmp/z.csv"])
    assert pair_recordings(old, [*new, "tmp/z.csv"], ["old", "new"]).only_b == ("tmp/z.csv",)


def test_groups_of_a_file_of_the_other_release() -> None:
    old, new = ([f"{side}.csv[car={i}]" for i in range(3)] for side in ("old", "new"))
    with pytest.raises(InputError, match=r"or --folders old\.csv new\.csv$"):
        pair_recordings(old, [*new, *old])


def test_new_scenarios_need_no_folders() -> None:
    a = ["old/1/run.csv", "old/2/run.csv"]
    b = ["new/1/run.csv", "new/2/run.csv", "new/3/run.csv"]
    assert pair_recordings(a, b).only_b == ("3/run.csv",)
    # as many pairs below new/y, but the folder x is in both
    assert pair_recordings(["old/x/1", "old/x/2"], ["new/x/1", "new/x/2", "new/y/1", "new/y/2"])


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
    with pytest.raises(InputError, match="no recording is in the folder c"):
        pair_recordings(["a/1.csv"], ["b/1.csv"], ["c", "b"])
    with pytest.raises(InputError, match="2 times"):
        pair_recordings(["a/1.csv", "a/1.csv"], ["b/1.csv"])
