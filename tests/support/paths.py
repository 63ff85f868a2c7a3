"""Folders of the checkout."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
GOLDEN = ROOT / "tests" / "golden"


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Make a folder, and let one worker at a time build in it."""
    import fcntl  # not on Windows

    folder.mkdir(parents=True, exist_ok=True)
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
