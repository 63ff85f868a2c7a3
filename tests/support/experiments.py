"""The scripts of the experiments on learning, as modules."""

import importlib
import sys
from typing import Any

from paths import EXAMPLES

SCRIPTS = ("train_corridor", "train_speed_limit", "train_patrol", "train_contact")


def script(name: str) -> Any:  # noqa: ANN401 - a module that no path of the tests knows
    """Return a module of the examples, which import each other like scripts in one folder."""
    if str(EXAMPLES) not in sys.path:
        sys.path.append(str(EXAMPLES))
    return importlib.import_module(name)
