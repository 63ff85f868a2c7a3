"""The scenarios' models written a second time, for SciPy's solvers, by the equations alone."""
