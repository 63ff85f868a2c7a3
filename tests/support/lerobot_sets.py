"""Write LeRobot data sets, version 3, in the layout of the library."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

NAMES = ["pan.pos", "grip.pos"]
"""The names of the elements of a state."""


def write_data_set(
    folder: Path,
    episodes: Sequence[NDArray[Any]],
    *,
    fps: float = 30,
    tasks: Sequence[str] = ("pick",),
    files: int = 1,
    times: Mapping[int, NDArray[Any]] | None = None,
    names: Sequence[str] = NAMES,
) -> Path:
    """Write a data set and return its folder.

    Args:
        folder: The folder.
        episodes: The states of each episode, shape (frames, names).
        fps: Frames per second.
        tasks: The tasks, which episodes use in turn.
        files: The number of Parquet files.
        times: The times of episodes that differ from the times of frames.
        names: The names of the elements of a state.
    """
    features = {
        "observation.state": {"dtype": "float32", "shape": [len(names)], "names": [*names]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    described = {"codebase_version": "v3.0", "fps": fps, "features": features}
    (folder / "meta/episodes/chunk-000").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(described))
    texts = {"__index_level_0__": [*tasks], "task_index": range(len(tasks))}
    pq.write_table(pa.table(texts), folder / "meta/tasks.parquet")
    rows: list[dict[str, Any]] = []
    parts: dict[int, list[dict[str, Any]]] = {}
    for index, states in enumerate(episodes):
        file, task = index * files // len(episodes), index % len(tasks)
        own = (times or {}).get(index, np.arange(len(states)) / fps)
        for frame, state in enumerate(np.asarray(states, np.float32)):
            row = {
                "observation.state": state.tolist(),
                "timestamp": np.float32(own[frame]),
                "frame_index": frame,
                "episode_index": index,
                "task_index": task,
            }
            parts.setdefault(file, []).append(row)
        row = {
            "episode_index": index,
            "length": len(states),
            "tasks": [tasks[task]],
            "data/chunk_index": 0,
            "data/file_index": file,
        }
        rows.append(row)
    pq.write_table(pa.Table.from_pylist(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    for file, part in parts.items():
        pq.write_table(
            pa.Table.from_pylist(part), folder / f"data/chunk-000/file-{file:03d}.parquet"
        )
    return folder
