"""The notebooks: their cells run in order, with the outputs in the files."""

import json
import re
from pathlib import Path

import pytest
from notebooks import Output, play
from paths import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def told(output: Output) -> object:
    """Return the text of an output; a picture, which depends on fonts, only by its presence."""
    if output["output_type"] == "stream":
        return output["text"]
    return {kind: kind == "image/png" or shown for kind, shown in output["data"].items()}


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_its_cells_give(path: Path) -> None:
    shown = 0
    for cell, outputs in play(path):
        assert [told(each) for each in cell["outputs"]] == [told(each) for each in outputs]
        shown += len(outputs)
    assert shown > 1


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_leads_to_pages_that_are_there(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    prose = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    links = re.findall(r"\]\(([^)#:]+)\)", prose)
    assert links
    assert [link for link in links if not (path.parent / link).is_file()] == []


def test_there_are_some_that_show_objects_and_pictures() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in NOTEBOOKS)
    assert text.count('"text/html"') > 4
    assert text.count('"image/png"') > 3
