"""The README: its Python and its commands produce the output shown."""

import doctest

import pytest
from pages import blocks, broken_links, check_session
from paths import ROOT

README = ROOT / "README.md"
TEXT = README.read_text(encoding="utf-8")


def test_the_python_runs_in_order_and_shows_what_it_says() -> None:
    python = blocks(TEXT, "python")
    assert python
    names: dict[str, object] = {}
    parser = doctest.DocTestParser()
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for number, block in enumerate(python):
        if ">>>" in block:
            test = parser.get_doctest(block, names, f"block {number}", "README.md", 0)
            runner.run(test, clear_globs=False)
            names = test.globs
        else:
            exec(compile(block, f"README.md, block {number}", "exec"), names)  # noqa: S102 - ours
    assert not runner.failures


@pytest.mark.parametrize("session", blocks(TEXT, "console"))
def test_the_commands_print_what_it_shows(
    session: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    check_session(session, capsys)


def test_the_first_two_lines_that_make_an_environment_are_the_demo_and_the_tests() -> None:
    lines = [line for line in TEXT.splitlines() if line.startswith("python3 -m venv")]
    demo, tests, *_ = lines
    assert demo.endswith(".venv/bin/rtamt demo")
    assert tests.endswith(".venv/bin/pytest -q")


def test_its_links_lead_somewhere() -> None:
    assert "](docs/demo.png)" in TEXT
    assert broken_links(README) == []


def test_its_picture_is_small() -> None:
    assert (ROOT / "docs" / "demo.png").stat().st_size < 150_000
