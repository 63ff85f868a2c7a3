"""The table of a dense judgement agrees with its headline."""

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main


@pytest.mark.parametrize(
    ("formula", "headline", "row"),
    [
        # x is 1 at 4 s, the last instant, which the window of 0 s alone reaches.
        ("always[4:4](x < 0)", "VIOLATED, robustness -1,", ["-1", "-1", "0", "s", "0", "s"]),
        ("eventually[4:4](x > 0)", "SATISFIED, robustness 1,", ["1", "-inf", "0", "s", "0", "s"]),
        ("always[0:1](x > 0)", "VIOLATED, robustness -1,", ["-1", "-1", "0", "s", "0", "s"]),
    ],
)
def test_table_has_the_robustness_of_the_headline(
    formula: str,
    headline: str,
    row: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "d.csv"
    path.write_text("time,x\n0,1\n1,-1\n1.5,2\n4,1\n")
    main(["monitor", formula, str(path), "--dense", "--time-unit", "s"])
    first, *_, last = capsys.readouterr().out.splitlines()
    assert first.startswith(headline)
    assert last.split() == ["(result)", *row]
