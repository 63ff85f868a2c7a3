"""The commands of `rtamt`: a row here, and a module of the same name."""

__all__ = ["COMMANDS"]

COMMANDS = {
    "demo": "watch a MuJoCo pendulum and a highway with good and bad drivers",
    "envs": "list what can be read from a Gymnasium environment",
    "run": "watch episodes of a Gymnasium environment",
    "monitor": "judge a recorded trace",
    "explain": "say which samples of a recorded trace decided",
}
"""The help line of each command. Its module is imported when the command is given, and has two
functions: ``add_arguments(parser)``, and ``run(options)``, which returns the exit code."""
