"""Independent implementations of the scenarios' models, for SciPy's solvers."""
