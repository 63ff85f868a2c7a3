"""Notebooks as users run them: their cells in order, and the output of each.

Run: python tests/support/notebooks.py docs/notebooks/*.ipynb, which writes the outputs of cells.

To add a notebook: a file in ``docs/notebooks``, and its entry in ``docs/examples.md``. Run this
script; ``tests/project/test_notebooks.py`` compares the output of the cells.
"""

import ast
import base64
import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

__all__ = ["Output", "play"]

Output = dict[str, Any]
"""The output of a cell in the format of notebooks."""


def play(path: Path) -> Iterator[tuple[dict[str, Any], list[Output]]]:
    """Run a notebook; yield each code cell with its new output."""
    names: dict[str, Any] = {"__name__": "__main__"}
    plt.close("all")  # a notebook starts without a picture, also after others in this process
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] == "code":
            where = f"{path.name}, cell {number}"
            yield cell, list(_outputs("".join(cell["source"]), where, names))


def _outputs(source: str, where: str, names: dict[str, Any]) -> Iterator[Output]:
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    value = None
    pictures: list[Output] = []

    def show() -> None:
        for number in plt.get_fignums():
            file = BytesIO()
            plt.figure(number).savefig(file, format="png", dpi=72, bbox_inches="tight")
            text = base64.b64encode(file.getvalue()).decode()
            data = {"image/png": text, "text/plain": ["<Figure>"]}
            pictures.append({"output_type": "display_data", "data": data, "metadata": {}})
        plt.close("all")

    with redirect_stdout(StringIO()) as said, mpl.rc_context(), patch.object(plt, "show", show):
        exec(compile(ast.Module(body, []), where, "exec"), names)  # noqa: S102 - our own
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), where, "eval"), names)  # noqa: S307
    if said.getvalue():
        text = said.getvalue().splitlines(keepends=True)
        yield {"name": "stdout", "output_type": "stream", "text": text}
    yield from pictures
    if value is not None:
        data = {"text/plain": repr(value).splitlines(keepends=True)}
        if hasattr(value, "_repr_html_"):
            data["text/html"] = value._repr_html_().splitlines(keepends=True)
        yield {"output_type": "execute_result", "data": data, "metadata": {}, "execution_count": 1}


def main(paths: list[str]) -> None:
    """Write the outputs of cells into notebooks."""
    for path in map(Path, paths):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        cells = (cell for cell in notebook["cells"] if cell["cell_type"] == "code")
        for number, (cell, (_, outputs)) in enumerate(zip(cells, play(path), strict=True), 1):
            cell["execution_count"] = number
            cell["outputs"] = outputs
            for output in outputs:
                if "execution_count" in output:
                    output["execution_count"] = number
        text = json.dumps(notebook, indent=1, ensure_ascii=False)
        path.write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
