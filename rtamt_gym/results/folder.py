"""The names of the files in a folder of ``rtamt monitor --results``."""

from __future__ import annotations

from typing import Final

RESULTS: Final = "results.parquet"
"""The file of all rows, once a run has ended."""

IDENTITY: Final = "recordings.json"
"""The specification and the options of the rows."""
