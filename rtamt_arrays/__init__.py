"""Monitors as pure functions of arrays, for simulators that run on tensors.

`rtamt_arrays.jax` takes arrays of JAX, and `rtamt_arrays.torch` takes tensors of torch. In a
checkout, ``pip install '.[jax]'`` and ``pip install '.[torch]'`` install their dependencies.
"""
