"""Benchmarks of robots as environments whose success can be judged: robosuite and Meta-World."""
