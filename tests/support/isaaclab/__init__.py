"""A stand-in for Isaac Lab, which needs its simulator: the parts that terms of managers use."""
