"""The site builds without a warning, and its files need no network."""

import json
import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from paths import ROOT

import rtamt
import rtamt_gym


class _Page(HTMLParser):
    """The anchors and the links of a page, and the files that it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in (
            "stylesheet",
            "preload",
            "icon",
            "modulepreload",
        ):
            self.loaded.append(given["href"])
        elif "src" in given:
            self.loaded.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-P", "-m", "sphinx", "-W", "-n", "--keep-going", "-q"]
    made = subprocess.run(
        [*command, "-d", str(folder / "doctrees"), str(ROOT / "docs"), str(folder / "html")],
        cwd=folder,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (made.returncode, made.stderr) == (0, "")
    return folder / "html"


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, _Page]:
    made = [path for path in site.rglob("*.html") if "_static" not in path.parts]  # of the theme
    return {path: _Page(path.read_text(encoding="utf-8")) for path in made}


def test_every_link_leads_to_a_place_of_the_site_or_away(pages: dict[Path, _Page]) -> None:
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https", "mailto"):
                continue
            to = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not to.is_file() or (place and to in pages and place not in pages[to].places):
                broken.append(f"{path.name}: {link}")
    assert broken == []
    assert sum(len(page.links) for page in pages.values()) > 1000


def test_opening_a_page_loads_files_of_the_site_alone(pages: dict[Path, _Page]) -> None:
    missing = [
        f"{path.name}: {name}"
        for path, page in pages.items()
        for name in page.loaded
        if not name.startswith("data:image/png;base64,")  # the pictures of notebooks
        and (not (path.parent / unquote(urlsplit(name).path)).is_file() or "//" in name)
    ]
    assert missing == []


def test_every_page_of_the_repository_is_a_page_of_the_site(site: Path) -> None:
    docs = ROOT / "docs"
    pages = [*docs.rglob("*.md"), *docs.rglob("*.ipynb")]
    wanted = {path.relative_to(docs).with_suffix("") for path in pages}
    made = {path.relative_to(site).with_suffix("") for path in site.rglob("*.html")}
    assert wanted <= made


@pytest.mark.parametrize("module", [rtamt, rtamt_gym], ids=lambda module: module.__name__)
def test_every_public_name_has_a_place(pages: dict[Path, _Page], module: object) -> None:
    name = getattr(module, "__name__", "")
    places = set().union(*(page.places for page in pages.values()))
    wanted = {f"{name}.{each}" for each in getattr(module, "__all__", ())}
    modules = {f"module-{each}" for each in wanted}
    missing = [each for each in wanted - places if f"module-{each}" not in places & modules]
    assert missing == []
    assert wanted


def test_it_is_searched_without_a_server(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    found = json.loads(index.removeprefix("Search.setIndex(").rstrip().removesuffix(")"))
    page = found["docnames"].index("falsification")
    hits = found["terms"]["violat"]
    assert page in (hits if isinstance(hits, list) else [hits])


def test_it_is_small(site: Path) -> None:
    assert sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) < 40e6
