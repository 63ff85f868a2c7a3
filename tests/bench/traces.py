"""Inputs of the workloads; the start of a chunk is the seed of its random samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[np.float64]]

VARIABLES = {
    "w1": ("a", "b"),
    "saw": ("a", "b"),
    "resp": ("req", "gnt"),
    "nested": ("cmd", "pos"),
    "until": ("a", "b"),
    "since": ("a", "b"),
    "always": ("s",),
    "sum": ("a", "b"),
}
"""The variables of every kind of trace, in the order of the formulas."""


def columns(kind: str, start: int, n: int, k: int = 0) -> Columns:
    """Return samples start to start + n - 1; ``k`` is the period of the saw-tooth less 1."""
    positions = np.arange(start, start + n)
    if kind == "saw":
        tooth = positions % (k + 1)
        rising = np.where(tooth == k, -1.0, tooth * 1e-6)
        return {"a": rising, "b": rising}
    noise = np.random.default_rng([7, start])
    if kind in ("w1", "sum"):
        a, b = noise.standard_normal((2, n))
        return {"a": a, "b": b}
    if kind == "always":
        return {"s": noise.standard_normal(n)}
    u = noise.random((3, n))
    if kind == "resp":
        return {
            "req": np.where(u[0] < 0.1, 5.0, 1.0) + 0.1 * u[1],
            "gnt": np.where(u[2] < 0.4, 5.0, 1.0) + 0.1 * u[1],
        }
    if kind == "nested":  # a command that changes every 500 samples, and its response
        phase, command = positions % 500, (positions // 500 % 2) * 1.5
        return {
            "cmd": command,
            "pos": command + (1.5 - 2 * command) * np.exp(-phase / 30) + 0.02 * (u[0] - 0.5),
        }
    return {  # until and since: a holds mostly, b now and then
        "a": u[0] * 2 - 0.05,
        "b": np.where(u[1] < 0.05, 1.0, -1.0) * (0.5 + u[2]),
    }


def short(count: int) -> list[Columns]:
    """Return traces of 200 samples of x, a and b."""
    noise = np.random.default_rng(11)
    return [dict(zip("xab", noise.standard_normal((3, 200)), strict=True)) for _ in range(count)]


def rows(trace: Columns) -> list[tuple[float, ...]]:
    """Return the samples of a trace as tuples of Python floats."""
    return list(zip(*(column.tolist() for column in trace.values()), strict=True))


def moments(start: int, n: int) -> NDArray[np.float64]:
    """Return times of events start to start + n - 1: about a thousand per second, irregular."""
    jitter = np.random.default_rng([13, start]).random(n)
    return np.asarray((np.arange(start, start + n) + 0.9 * jitter) / 1_000)


def summed(kind: str, trace: Columns) -> Columns:
    """Return the trace for tools whose predicates compare one signal with a number."""
    if kind in ("w1", "saw", "sum"):
        return {"s": trace["a"] + trace["b"]}
    if kind == "nested":
        return {"cmd": trace["cmd"], "d": np.abs(trace["cmd"] - trace["pos"])}
    return trace
