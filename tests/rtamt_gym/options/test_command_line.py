"""Rows of command-line options."""

import argparse
from pathlib import Path

import pytest

from rtamt_gym.options.command_line import (
    Option,
    add_options,
    positive,
    read_evaluation_options,
    shared,
    whole,
)


def parser_of(*options: str | Option) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="rtamt")
    add_options(parser, *options, trial="episode")
    return parser


def test_rows_become_arguments() -> None:
    parser = parser_of(
        Option("SPEC", "texts", nargs="+", dest="specs"),
        Option("--count N", "a share of 80%", 10, read=positive),
        Option("-o FILE", "the file", read=Path, required=True, dest="output", alias="--output"),
        Option("--kind", "a kind", choices=("a", "b"), usual="the nearest"),
        Option("--all", "everything"),
        Option("--name NAME", "a name", repeat=True),
        Option("--range TEXT", "a range", several=True),
    )
    options = parser.parse_args(["x", "y", "-o", "file", "--name", "a", "--name", "b"])
    assert options.specs == ["x", "y"]
    assert (options.count, options.output, options.kind) == (10, Path("file"), None)
    assert (options.all, options.name, options.range) == (False, ["a", "b"], [])
    text = " ".join(parser.format_help().split())
    for line in (
        "--count N a share of 80% (default: 10)",
        "--output FILE the file --kind {a,b} a kind (default: the nearest) --all everything",
        "--name NAME a name; may be repeated --range TEXT a range",
    ):
        assert line in text


def test_shared_rows_with_changes() -> None:
    parser = parser_of("--seed", shared("--timeout", default=3.0), "--below", "--end")
    text = " ".join(parser.format_help().split())
    assert "seed of the first episode; each further episode adds 1 (default: 0)" in text
    assert parser.parse_args([]) == argparse.Namespace(seed=0, timeout=3.0)
    assert read_evaluation_options(parser.parse_args(["--below", "--end", "open"])).options() == {
        "below": True,
        "end": "open",
    }
    with pytest.raises(KeyError):
        shared("--stages")


@pytest.mark.parametrize(("read", "wrong"), [(whole, "-1"), (whole, "²"), (positive, "0")])
def test_whole_number_errors(read: type, wrong: str) -> None:
    assert read("7") == 7
    with pytest.raises(argparse.ArgumentTypeError, match="expected a whole number"):
        read(wrong)
