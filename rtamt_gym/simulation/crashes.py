"""Simulations that crash: the samples that an error carries, and `SystemExit` as an error."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rtamt import InputError
from rtamt_gym.inputs.case import Case
from rtamt_gym.results.trial import Trial
from rtamt_gym.simulation.run import Run
from rtamt_gym.tables import sample_text

__all__ = ["carry", "exited", "failed", "no_exit"]


def carry(error: BaseException, run: Run) -> None:
    """Makes a run the attribute ``run`` of an error, and says so in a note.

    The run of a simulation inside of this one, which the error has crashed before, gives way.
    """
    before = getattr(error, "run", None)
    with suppress(AttributeError):  # of an error that takes no attributes
        crashed: Any = error
        crashed.run = run
        if isinstance(before, Run):
            crashed.__notes__.remove(_note(before))
        error.add_note(_note(run))


def exited(what: str, end: SystemExit, where: str = "") -> InputError:
    """The error of what calls ``sys.exit``: it would end the program without a verdict.

    Args:
        what: What calls it, in words.
        end: What it has raised.
        where: Its place in a file, as `rtamt_gym.simulation.imported.line_in` writes it.
    """
    code = "" if end.code is None else repr(end.code)
    return InputError(
        f"{what} called sys.exit({code}){where}, which is no end of a simulation; let it return, "
        "or raise an error"
    )


class no_exit:  # noqa: N801 - a context, used as a word
    """Raises the error of `exited` where what runs inside calls ``sys.exit``.

    Other errors are not touched, not even their tracebacks, as some take no attributes.

    Args:
        what: What runs.

    Raises:
        InputError: If it does.
    """

    def __init__(self, what: str) -> None:
        self._what = what

    def __enter__(self) -> None:
        """Nothing is to be done before."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, SystemExit):
            raise exited(self._what, error) from error


def failed(error: Exception, case: Case, seed: int | None, wall: float) -> Trial:
    """The trial that an error has ended, with what the samples that it carries came to."""
    text = f"{type(error).__name__}: {error}"
    run = getattr(error, "run", None)
    if isinstance(run, Run):
        return run.trial(case, text)
    return Trial(case, seed, {}, "error", 0.0, wall, text)


def _note(run: Run) -> str:
    samples = f"{run.steps + 1} samples" if run.steps else "1 sample"
    return f"error.run holds {samples}, up to {sample_text(run.last_sample, run.period)}"
