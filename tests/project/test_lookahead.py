"""The example that looks ahead keeps what its feedback alone breaks."""

import contextlib
import importlib.util
import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from paths import EXAMPLES

EXAMPLE = EXAMPLES / "lookahead.py"


def test_looking_ahead_keeps_the_cart_in_the_corridor_and_feedback_alone_does_not(
    tmp_path: Path,
) -> None:
    spec = importlib.util.spec_from_file_location("lookahead", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    picture = tmp_path / "lookahead.png"
    with contextlib.redirect_stdout(io.StringIO()) as out, mpl.rc_context():
        module.main(["--plot", str(picture)])
        plt.close("all")
    lines = out.getvalue().splitlines()
    *_, alone, ahead = (line.split() for line in lines)
    assert (alone[2], ahead[4]) == ("VIOLATED", "UNDECIDED")
    assert float(alone[-1]) < 0.0 < float(ahead[-1])
    assert max(map(len, lines)) <= 80
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) < 80
    assert picture.read_bytes().startswith(b"\x89PNG")
