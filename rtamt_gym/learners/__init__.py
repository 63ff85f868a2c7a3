"""Callbacks for learners that measure satisfaction during training.

`sb3` and `rllib` need the learner of their name; `metrics` and `best` do not.
"""
