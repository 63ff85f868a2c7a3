"""What a simulation is given: signals and parameters with their ranges, and cases of them."""
