"""Pages of reports in a headless Chromium; every message and request is a failure."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report

if TYPE_CHECKING:  # installed only for the tests in the browser
    from playwright.sync_api import Browser, ConsoleMessage, Page, Request

ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
)
PATIENCE = 30_000
"""Milliseconds; only a broken page takes this long."""
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def executable() -> str:
    """Return the browser of the machine."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    assert found, f"expected one of {', '.join(NAMES)}; on Debian: apt-get install chromium"
    return found


@contextmanager
def launched() -> Iterator[Browser]:
    """Run a browser with a fresh profile until the end of the block."""
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(ARGUMENTS))
        yield browser
        browser.close()


def written(report: Report, path: Path) -> Path:
    """Write the page of a report."""
    path.write_text(render(report), encoding="utf-8")
    return path


@contextmanager
def opened(
    browser: Browser,
    path: Path,
    fragment: str = "",
    width: int = 1280,
    theme: str = "light",
    **context: Any,  # noqa: ANN401 - options of the browser's context
) -> Iterator[Page]:
    """Open a page in a profile of its own; it must not log a message or send a request."""
    seen: list[str] = []

    def message(of: ConsoleMessage) -> None:
        seen.append(f"{of.type}: {of.text}")

    def request(of: Request) -> None:
        if of.url.partition("#")[0] != path.as_uri() and not of.url.startswith(("data:", "blob:")):
            seen.append(f"request: {of.url}")

    profile = browser.new_context(
        viewport={"width": width, "height": 900},
        color_scheme=theme,
        reduced_motion="reduce",
        **context,
    )
    profile.set_default_timeout(PATIENCE)
    page = profile.new_page()
    page.on("console", message)
    page.on("pageerror", lambda error: seen.append(f"error: {error}"))
    page.on("request", request)
    page.goto(path.as_uri() + fragment)
    yield page
    profile.close()
    assert seen == []


def draw_all(page: Page) -> None:
    """Scroll to every chart, so that the page draws it."""
    plots = page.locator("[data-chart]:visible")
    for i in range(plots.count()):
        plots.nth(i).scroll_into_view_if_needed()
        plots.nth(i).locator(".main-svg").first.wait_for()
