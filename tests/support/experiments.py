"""The scripts of the experiments on learning, as modules."""

import importlib
import sys
from typing import Any

from paths import EXAMPLES

SCRIPTS = ("train_corridor", "train_speed_limit", "train_patrol", "train_contact")


def script(name: str) -> Any:  # noqa: ANN401 - a module that no path of the tests knows
    """A module of the examples, which import each other as scripts in one folder do."""
    if str(EXAMPLES) not in sys.path:
        sys.path.append(str(EXAMPLES))
    return importlib.import_module(name)
