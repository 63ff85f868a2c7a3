"""Texts in which numbers are constants, and other values for these."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

_others = st.sampled_from(("0", "1", "2", "3", "-1", "0.5", "2.25"))


@dataclass(frozen=True)
class Named:
    """A text with constants.

    Attributes:
        text: The text, which defines some of them.
        first: Their values in the formula that the text was made of.
        then: Other values.
    """

    text: str
    first: dict[str, str]
    then: dict[str, str]

    @property
    def written(self) -> str:
        """The formula with the other values in the places of the names."""
        body = self.text.rpartition("\n")[2]
        return "".join(self.then.get(word, word) for word in words(body))


@st.composite
def with_names(draw: st.DrawFn, formula: str, prefix: str = "k") -> Named:
    """The text of a formula in which some numbers have names."""
    used: dict[str, str] = {}
    found = []
    for word in words(formula):
        if word.replace(".", "").isdigit() and draw(st.booleans()):
            name = f"{prefix}{draw(st.integers(0, 4))}"
            if used.setdefault(name, word) == word:
                found.append(name)
                continue
        found.append(word)
    defined = draw(st.sets(st.sampled_from(sorted(used)))) if used else set()
    head = "".join(f"const float {name} = {used[name]};\n" for name in sorted(defined))
    return Named(head + "".join(found), used, {name: draw(_others) for name in used})


def words(text: str) -> list[str]:
    """The parts of a text of which numbers are whole parts."""
    parts, word = [], ""
    for letter in text:
        if letter.isalnum() or letter in "._":
            word += letter
            continue
        parts += [word, letter] if word else [letter]
        word = ""
    return [*parts, word] if word else parts
