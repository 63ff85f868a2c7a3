"""Callbacks for learners that measure satisfaction during training.

`sb3` and `rllib` need the learner of their name; `metrics` and `best` do not.

To add a learner: ``tests/learners/NAME.txt`` with its requirements, a section with a program in
``docs/learners.md``, and ``tests/learners/test_NAME.py``, which runs the program. It needs a module
here only if the learner has callbacks of its own.
"""
