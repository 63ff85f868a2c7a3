"""The commands of `rtamt`: a row here, and a module of the same name.

To add a command: a row of `COMMANDS`, a module of the same name here, and a row of the first table
of ``docs/commands.md``, with a section there or a link to its page. Then run
``tests/support/command_options.py``, which writes ``docs/reference/commands.md``;
``tests/project/test_docs.py`` compares it with the parsers. ``tests/project/test_suites.py``
expects a quick test that runs the command. A command with specifications and traces, which ``--``
separates, is in `OF_TRACES`; one that needs an extra is in ``_NEEDS`` of
`rtamt_gym.commands.errors`. For ``--json``, see `rtamt_gym.results.codec`.
"""

COMMANDS = {
    "demo": "monitor a MuJoCo pendulum and a highway with good and bad drivers",
    "init": "write a specification, a test and a CI job to start from",
    "envs": "list the signals of a Gymnasium environment",
    "run": "monitor episodes of a Gymnasium environment",
    "evaluate": "measure how often a policy satisfies requirements, with intervals",
    "compare": "compare how often two evaluated policies satisfy requirements",
    "plot": "draw logs of training with requirements",
    "sweep": "simulate a scenario at many points of a space",
    "falsify": "search for an input that violates a requirement",
    "replay": "run a saved case again",
    "report": "show results as a page of HTML",
    "monitor": "evaluate recorded traces",
    "watch": "evaluate a stream of samples while it comes",
    "mine": "find the tightest constant for which recorded traces satisfy a requirement",
    "check": "check requirements for contradictions, tautologies and vacuity",
    "examples": "show different traces that satisfy and violate requirements",
    "explain": "show which samples of recorded traces decided a verdict",
    "export": "write a monitor as an FMU, for Simulink and other tools",
}
"""The help line of each command. Its module is imported when the command is given, and has two
functions: ``add_arguments(parser)``, and ``run(options)``, which returns the exit code."""

OF_TRACES = ("monitor", "explain", "mine")
"""The commands whose specifications and traces ``--`` separates."""

LISTED = "\0list"
"""The word that stands for the traces of ``--files-from`` if the command line names no trace."""

SEPARATOR = "\0"
"""The word that parsers receive for ``--``, which argparse drops; no argument can contain it."""
