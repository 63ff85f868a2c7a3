"""What learners call while they train: callbacks that measure satisfaction.

`sb3` and `rllib` need the learner of their name; `metrics` and `best` need none.

To add a learner: ``tests/learners/NAME.txt`` with its requirements, a section with a program in
``docs/learners.md``, and ``tests/learners/test_NAME.py``, which runs the program. It needs a module
here only if the learner has callbacks of its own.
"""
