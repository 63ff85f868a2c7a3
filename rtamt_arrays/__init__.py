"""Monitors as pure functions of arrays, for simulators that run on tensors.

`rtamt_arrays.jax` runs on arrays of JAX and `rtamt_arrays.torch` on tensors of torch. In a
checkout, ``pip install '.[jax]'`` and ``pip install '.[torch]'`` install their dependencies.
"""
