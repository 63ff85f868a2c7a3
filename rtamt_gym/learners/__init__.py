"""Callbacks for learners that measure satisfaction during training.

`sb3` and `rllib` need the learner of their name; `metrics` and `best` do not.

To add a learner: ``tests/learners/NAME.txt`` with its requirements, a program in
``examples/learners``, a section in ``docs/learners.md`` that links the program and shows lines of
it, and ``tests/learners/test_NAME.py``, which runs it. It needs a module here only if the learner
has callbacks of its own.
"""
