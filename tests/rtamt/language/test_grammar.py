"""The grammar, its generated parser, and the words of the table of operators."""

import re

from paths import ROOT

from rtamt.language.operators import KEYWORDS, OPERATORS

GRAMMAR = ROOT / "rtamt" / "language" / "grammar"


def test_grammar_and_table_know_the_same_symbols() -> None:
    rules = re.findall(
        r"^(?:SYMBOL|MINUS|SLASH)\s*:([^;]*);", (GRAMMAR / "Stl.g4").read_text(), re.MULTILINE
    )
    symbols = {s for rule in rules for s in re.findall(r"'([^']+)'", rule)}
    spellings = {s for row in OPERATORS.values() for s in row.spellings if s}
    assert symbols == spellings - OPERATORS.words.keys()


def test_the_grammar_has_the_keywords_and_no_other_word() -> None:
    words = re.findall(r"'([A-Za-z_]+)'", (GRAMMAR / "Stl.g4").read_text())
    assert set(words) == KEYWORDS


def test_the_committed_parser_holds_no_path_of_a_machine() -> None:
    paths = [path for path in (GRAMMAR / "generated").glob("*.py") if path.name != "__init__.py"]
    assert len(paths) == 2
    for path in paths:
        assert "from Stl.g4" in path.read_text().splitlines()[0]
