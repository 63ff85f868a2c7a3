"""The site: pages of this folder and docstrings, by Sphinx, MyST and the theme of PyData.

`sphinx-build -W -n docs build/site` makes a folder of files that needs no server and no network.
Sphinx renders docstrings itself, fails on broken links and searches without a server. Material for
MkDocs, the alternative, leaves docstrings to a plugin and has announced the end of its development.
"""

import json
from collections.abc import Iterator
from typing import Any, ClassVar

from docutils.nodes import document
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

import rtamt

project = "rtamt"
author = "the rtamt contributors"
project_copyright = author
version = release = rtamt.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown", ".ipynb": "notebook"}

# Pages: links to files and headings as on the pages of a repository.
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]

# Docstrings: single backticks mark names, which are linked if they are on a page.
default_role = "py:obj"
smartquotes = False  # curly quotes would break copied code
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "description"
autodoc_mock_imports = ["jax", "torch"]  # large, and the page of rtamt_arrays shows our names alone
autodoc_typehints_description_target = "documented"
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
nitpicky = True
# Names of other packages and of private types have no link.
nitpick_ignore_regex = [("py:.*", ".*")]

html_theme = "pydata_sphinx_theme"
html_title = f"rtamt {version}"
html_theme_options = {
    "navbar_align": "left",
    "show_prev_next": True,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False


def _tables(*hooked: Any) -> None:  # noqa: ANN401 - the last one is the lines
    """Tables of docstrings, which are written as on the pages, as Sphinx takes them."""
    lines: list[str] = hooked[-1]
    made: list[str] = []
    for line in lines:
        text = line.strip()
        if not (text.startswith("|") and text.endswith("|")):
            made.append(line)
            continue
        cells = [cell.strip() for cell in text.strip("|").split("|")]
        if all(set(cell) <= {"-", ":"} and cell for cell in cells):
            continue
        indent = line[: len(line) - len(line.lstrip())]
        if not (made and made[-1].startswith(f"{indent}     ")):
            made += ["", f"{indent}.. list-table::", f"{indent}   :header-rows: 1", ""]
        for i, cell in enumerate(cells):
            made.append(f"{indent}   {'  -' if i else '* -'} {cell}")
    lines[:] = made


class Notebook(MystParser):
    """Notebooks as pages: their cells, and what is kept in them of what they show."""

    supported: ClassVar[tuple[str, ...]] = ("notebook",)

    def parse(self, inputstring: str, document: document) -> None:
        """Writes a notebook as a page of MyST, and parses that."""
        parts = (part for cell in json.loads(inputstring)["cells"] for part in _of_cell(cell))
        super().parse("\n\n".join(parts), document)


def _of_cell(cell: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield f"```python\n{source}\n```"
    for output in cell["outputs"]:
        data = output.get("data", {})
        if "image/png" in data:
            source = f"data:image/png;base64,{data['image/png']}"
            yield f'```{{raw}} html\n<img alt="what the cell draws" src="{source}">\n```'
        elif "text/html" in data:
            table = "".join(data["text/html"])
            yield f'```{{raw}} html\n<div class="notebook-output">{table}</div>\n```'
        else:
            yield f"```text\n{''.join(data.get('text/plain') or output['text'])}\n```"


def setup(app: Sphinx) -> None:
    """Sphinx calls this; the hook comes before that of napoleon."""
    app.add_source_parser(Notebook)
    app.connect("autodoc-process-docstring", _tables, priority=400)
