"""Texts with constants as numbers, and other values for them."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

_others = st.sampled_from(("0", "1", "2", "3", "-1", "0.5", "2.25"))


@dataclass(frozen=True)
class Named:
    """A text with constants.

    Attributes:
        text: The text, which defines some of them.
        first: Their values in the original formula.
        then: Other values.
    """

    text: str
    first: dict[str, str]
    then: dict[str, str]

    @property
    def written(self) -> str:
        """Return the formula with the other values instead of the names."""
        body = self.text.rpartition("\n")[2]
        return "".join(self.then.get(word, word) for word in words(body))


@st.composite
def with_names(draw: st.DrawFn, formula: str, prefix: str = "k") -> Named:
    """Return the text of a formula in which some numbers have names."""
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
    """Return the parts of a text in which numbers are separate parts."""
    parts, word = [], ""
    for letter in text:
        if letter.isalnum() or letter in "._":
            word += letter
            continue
        parts += [word, letter] if word else [letter]
        word = ""
    return [*parts, word] if word else parts
