"""The commands of `rtamt`: a row here, and a module of the same name.

To add a command: a row of `COMMANDS`, a module of the same name here, and a section of
``docs/commands.md``. Then run ``tests/support/command_options.py``, which writes
``docs/reference/commands.md``; ``tests/project/test_docs.py`` compares it with the parsers.
"""

COMMANDS = {
    "demo": "watch a MuJoCo pendulum and a highway with good and bad drivers",
    "init": "write a specification, a test and a job of CI to begin with",
    "envs": "list what can be read from a Gymnasium environment",
    "run": "watch episodes of a Gymnasium environment",
    "evaluate": "say how often a policy satisfies each requirement, and how sure that is",
    "compare": "say which of two evaluated policies satisfies requirements more often",
    "sweep": "run a scenario on many points of a space",
    "falsify": "search for an input that violates a requirement",
    "replay": "run again what was found",
    "report": "show results as a page",
    "monitor": "judge recorded traces",
    "mine": "find the tightest constant for which recorded traces satisfy a requirement",
    "check": "say whether requirements can be satisfied, violated and asked, and agree",
    "examples": "show traces that satisfy and violate requirements, as different as can be",
    "explain": "say which samples of recorded traces decided",
    "export": "write a monitor for Simulink and other tools, as an FMU",
}
"""The help line of each command. Its module is imported when the command is given, and has two
functions: ``add_arguments(parser)``, and ``run(options)``, which returns the exit code."""

OF_TRACES = ("monitor", "explain", "mine")
"""The commands whose specifications and traces ``--`` separates."""

SEPARATOR = "\0"
"""What their parsers get in its place: argparse drops ``--``, and nobody can write this."""
