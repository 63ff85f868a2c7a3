"""Steps of `episode` for many entries, in each library and in the C++ machine."""

from __future__ import annotations

from typing import Any

import numpy as np
from measuring import Case, answer, least, processor_seconds

SPECS = {
    "W1": "always[0:100](a + b > -2)",
    "resp": "always((a >= 3) implies eventually[0:5](b >= 3))",
    "nested": "always((a >= 1) implies eventually[0:200] always[0:50] (abs(a - b) < 0.1))",
}


def samples(case: Case) -> Any:
    """Return samples of two variables in all entries, for several steps."""
    steps = max(4, min(16, 262_144 // case["entries"]))
    steps = max(2, steps // 8) if case["spec"] == "nested" else steps
    random = np.random.default_rng(7)
    return random.normal(size=(steps, case["entries"], 2)).astype(np.float32) * 3


def repeats(case: Case) -> int:
    return 5 if case["quick"] else 15


def per_step(case: Case, seconds: float) -> float:
    return seconds * 1e9 / (len(samples(case)) * case["entries"])


def cpp(case: Case) -> Case:
    import rtamt

    monitor = rtamt.VectorEpisodeMonitor(SPECS[case["spec"]], case["entries"])
    inputs = [np.ascontiguousarray(sample, dtype=np.float64) for sample in samples(case)]

    def run() -> None:
        for sample in inputs:
            monitor.update(sample)

    for _ in range(1 + 256 // len(inputs)):  # until the windows are full
        run()
    return {"step": per_step(case, least(run, repeats(case)))}


def of_jax(case: Case) -> Case:
    import jax

    import rtamt_arrays.jax

    monitor = rtamt_arrays.jax.episode(SPECS[case["spec"]])
    inputs, state = jax.device_put(samples(case)), monitor.init(case["entries"])

    def step(state: Any, sample: Any) -> Any:
        state, reading = monitor.update(state, sample)
        return state, reading.lower

    run = jax.jit(lambda state, inputs: jax.lax.scan(step, state, inputs), donate_argnums=0)
    compiling = processor_seconds(lambda: run.lower(state, inputs).compile())
    held = [state]

    def once() -> None:
        state, lower = run(held[0], inputs)
        held[0] = jax.block_until_ready(state)
        lower.block_until_ready()

    once()
    memory = sum(array.nbytes for array in held[0]) / case["entries"]
    step_ns = per_step(case, least(once, repeats(case)))
    return {"step": step_ns, "compile": compiling, "bytes an entry": memory}


def of_torch(case: Case, how: str) -> Case:
    import torch

    import rtamt_arrays.torch

    device = case["device"]
    if device == "cpu":
        torch.set_num_threads(1)
    monitor = rtamt_arrays.torch.episode(SPECS[case["spec"]], device=device)
    inputs, state = torch.from_numpy(samples(case)).to(device), monitor.init(case["entries"])

    def wait() -> None:
        if device != "cpu":
            torch.cuda.synchronize()

    step: Any = monitor.update_
    sample = inputs[0].clone()
    if how == "compiled":
        step = torch.compile(step, fullgraph=True)
    compiling = processor_seconds(lambda: (step(state, sample), wait()))
    if how == "graph":
        # Warm-up calls before a graph is recorded must run in another stream.
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            step(state, sample)
        torch.cuda.current_stream().wait_stream(side)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            monitor.update_(state, sample)

        def step(_: Any, new: Any) -> None:
            sample.copy_(new)
            graph.replay()

    def run() -> None:
        for new in inputs:
            step(state, new)
        wait()

    with torch.no_grad():
        run()
        figures = {"step": per_step(case, least(run, repeats(case)))}
    return figures | ({"compile": compiling} if how == "compiled" else {})


answer(
    {
        "C++": cpp,
        "jax": of_jax,
        "torch compiled": lambda case: of_torch(case, "compiled"),
        "torch eager": lambda case: of_torch(case, "eager"),
        "torch CUDA graph": lambda case: of_torch(case, "graph"),
    }
)
