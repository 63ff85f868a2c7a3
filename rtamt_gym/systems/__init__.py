"""What can run: environments, MuJoCo models, FMUs, functions and samples, with their policies."""
