"""Robustness at the start of traces, and its gradient, in each library.

The windows fit into the traces, so that all tools compute the same. The column "differs" is the
maximum difference from the C++ machines.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from measuring import Case, answer, least, processor_seconds

SAMPLES, TRACES = 1_000, 16
SPECS = {
    "response": "always[0:900]((a < 2) or eventually[0:50](b > 1))",
    "reach": "eventually[0:900] always[0:50](a > b)",
}


def signals() -> Any:
    """Return two signals of several traces."""
    steps = np.random.default_rng(7).normal(size=(2, TRACES, SAMPLES)) * 0.3
    return np.cumsum(steps, axis=-1).astype(np.float32)


def expected(case: Case) -> Any:
    import rtamt

    a, b = signals().astype(np.float64)
    pairs = zip(a, b, strict=True)
    return np.array([rtamt.evaluate(SPECS[case["spec"]], {"a": x, "b": y})[0] for x, y in pairs])


def found(case: Case, values: Any, value: Any, gradient: Any) -> Case:
    """Return microseconds per trace of two functions; their first calls compile."""
    compiling = processor_seconds(value) + processor_seconds(gradient)
    repeats = 3 if case["quick"] else 7
    return {
        "value": least(value, repeats) * 1e6 / TRACES,
        "gradient": least(gradient, repeats) * 1e6 / TRACES,
        "compile": compiling,
        "differs": float(np.abs(np.asarray(values()) - expected(case)).max()),
    }


def cpp(case: Case) -> Case:
    return {"value": least(lambda: expected(case), 7) * 1e6 / TRACES}


def of_jax(case: Case, robustness: Any) -> Case:
    import jax

    x = jax.device_put(signals())
    value = jax.jit(robustness)
    gradient = jax.jit(jax.grad(lambda x: robustness(x).sum()))
    return found(
        case,
        lambda: value(x),
        lambda: value(x).block_until_ready(),
        lambda: gradient(x).block_until_ready(),
    )


def jax_ours(case: Case) -> Case:
    import rtamt_arrays.jax

    def robustness(x: Any) -> Any:
        return rtamt_arrays.jax.evaluate(SPECS[case["spec"]], {"a": x[0], "b": x[1]})[:, 0]

    return of_jax(case, robustness)


def peer(case: Case, module: Any) -> Any:
    """Return the formula of stljax and STLCG++ for signals of shape (samples, 2)."""
    a, b = (module.Predicate(name, partial(column, i)) for i, name in enumerate("ab"))
    if case["spec"] == "reach":
        ahead = module.Predicate("a - b", lambda x: x[:, 0] - x[:, 1])
        stay = module.Always(module.GreaterThan(ahead, 0.0), interval=[0, 50])
        return module.Eventually(stay, interval=[0, 900])
    answered = module.Eventually(module.GreaterThan(b, 1.0), interval=[0, 50])
    return module.Always(module.Or(module.LessThan(a, 2.0), answered), interval=[0, 900])


def column(i: int, x: Any) -> Any:
    return x[:, i]


def stljax(case: Case) -> Case:
    import jax
    import stljax.formula as module

    formula = peer(case, module)
    return of_jax(case, jax.vmap(lambda x: formula.robustness(x.T), in_axes=1))


def of_torch(case: Case, robustness: Any) -> Case:
    import torch

    if case["device"] == "cpu":
        torch.set_num_threads(1)
    x = torch.from_numpy(signals()).to(case["device"]).requires_grad_()

    def wait() -> None:
        if case["device"] != "cpu":
            torch.cuda.synchronize()

    def value() -> None:
        with torch.no_grad():
            robustness(x)
        wait()

    def gradient() -> None:
        torch.autograd.grad(robustness(x).sum(), x)
        wait()

    return found(case, lambda: robustness(x).detach().cpu(), value, gradient)


def torch_ours(case: Case) -> Case:
    import rtamt_arrays.torch

    def robustness(x: Any) -> Any:
        return rtamt_arrays.torch.evaluate(SPECS[case["spec"]], {"a": x[0], "b": x[1]})[:, 0]

    return of_torch(case, robustness)


def stlcgpp(case: Case) -> Case:
    import stlcgpp.formula as module
    import torch

    formula = peer(case, module)
    return of_torch(case, torch.func.vmap(lambda x: formula(x.T)[0], in_dims=1))


answer({"C++": cpp, "jax": jax_ours, "stljax": stljax, "torch": torch_ours, "stlcgpp": stlcgpp})
