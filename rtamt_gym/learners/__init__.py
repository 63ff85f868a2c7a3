"""What learners call while they train: callbacks that measure satisfaction.

`sb3` and `rllib` need the learner of their name; `metrics` and `best` need none.
"""
