"""A signal, another thread or a callback can end a node."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from rtamt_ros.process import Ending

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def as_in_a_terminal() -> Iterator[None]:
    """A process that a shell script starts in the background ignores SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", SIGNALS)
def test_signals_end_and_handlers_are_restored(number: signal.Signals) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    ending = Ending()
    timer = threading.Timer(0.05, os.kill, (os.getpid(), number))
    timer.start()
    ending.wait()
    timer.join()
    assert ending.requested
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_it_ends_for_good_and_for_all_who_wait() -> None:
    ending = Ending()
    assert not ending.requested
    waiting = [threading.Thread(target=ending.wait) for _ in range(3)]
    for each in waiting:
        each.start()
    ending.request()
    for each in waiting:
        each.join(5)
    assert not any(each.is_alive() for each in waiting)
    ending.wait()


@pytest.fixture
def at_once() -> Iterator[None]:
    """SIGINT ends the process at once, as `run_module` sets it until there is a node."""
    before = [signal.getsignal(each) for each in SIGNALS]
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_before_it_is_waited_for_counts(number: signal.Signals) -> None:
    ending = Ending()
    os.kill(os.getpid(), number)
    assert ending.requested
    ending.wait()


def test_python_signal_handlers_stay() -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    assert before[0] is signal.default_int_handler
    Ending()
    assert [signal.getsignal(each) for each in SIGNALS] == before


INTERRUPTED = """
import os, signal, sys
from rtamt_ros.process import run_module

left = int(sys.argv[2])

def interrupt(*_):
    global left
    left -= 1
    if not left:
        os.kill(os.getpid(), signal.SIGINT)

sys.addaudithook(interrupt)
sys.exit(run_module(sys.argv[1], sys.argv[3:]))
"""


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("event", [1, 3, 30, 100, 300])
@pytest.mark.parametrize("module", ["rtamt_ros.command", "rtamt_ros.simulator.robots"])
def test_ctrl_c_before_there_is_a_node_says_nothing(module: str, event: int) -> None:
    """At any point of Python: at the number of an audit event."""
    words = [module, str(event), "--ros", "1"] + ["--spec", "x > 1"] * ("command" in module)
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")
