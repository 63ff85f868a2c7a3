"""Systems to run: environments, MuJoCo models, FMUs, functions and samples, with policies."""
