"""Monitors as pure functions of arrays, for simulators that run on tensors.

`rtamt_arrays.jax` has them on arrays of JAX; from the checkout, ``pip install '.[jax]'`` installs
what it needs.
"""
