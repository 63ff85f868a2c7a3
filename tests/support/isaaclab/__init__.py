"""A stand-in for Isaac Lab, which runs in its simulator alone: what terms of managers ask of it."""
