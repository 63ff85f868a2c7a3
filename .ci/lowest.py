"""Print pip constraints that pin each requirement of an extra to its lowest allowed version.

Usage: ``python3 .ci/lowest.py EXTRA >FILE``
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

PYPROJECT = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
# A name, extras, and the lowest version: "gymnasium[mujoco]>=1.1".
REQUIREMENT = re.compile(r"([\w.-]+)(?:\[([\w,-]+)\])?(?:>=([\d.]+))?")


def lowest(requirements: list[str]) -> Iterator[tuple[str, str]]:
    """Yield names and versions of requirements and of this project's extras among them."""
    for requirement in requirements:
        match = REQUIREMENT.fullmatch(requirement)
        if match is None:
            sys.exit(f"pyproject.toml: expected NAME>=VERSION, got {requirement!r}")
        name, extras, version = match.groups()
        if name == PROJECT["name"]:
            for extra in extras.split(","):
                yield from lowest(PROJECT["optional-dependencies"][extra])
        elif version is None:
            sys.exit(f"pyproject.toml: expected a lowest version, got {requirement!r}")
        else:
            yield name, version


def order(version: str) -> list[int]:
    """Return the numbers of a version."""
    return [int(part) for part in version.split(".")]


if __name__ == "__main__":
    extra = PROJECT["optional-dependencies"][sys.argv[1]]
    required = [*PYPROJECT["build-system"]["requires"], *PROJECT["dependencies"], *extra]
    # Of two bounds of one package the higher one holds.
    pins = dict(sorted(lowest(required), key=lambda pin: order(pin[1])))
    print("\n".join(f"{name}=={version}" for name, version in sorted(pins.items())))
