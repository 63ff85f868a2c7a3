"""Monitors as pure functions of arrays, for simulators that run on tensors.

`rtamt_arrays.jax` has them on arrays of JAX, `rtamt_arrays.torch` on tensors of torch; from the
checkout, ``pip install '.[jax]'`` and ``pip install '.[torch]'`` install what they need.
"""
