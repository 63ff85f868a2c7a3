"""A node ends when a signal, another thread or a callback asks for it."""

import os
import signal
import threading

import pytest

from rtamt_ros.ending import Ending

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@pytest.mark.parametrize("number", SIGNALS)
def test_signals_end_it_and_are_what_they_were_afterwards(number: signal.Signals) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    ending = Ending()
    timer = threading.Timer(0.05, os.kill, (os.getpid(), number))
    timer.start()
    ending.wait()
    timer.join()
    assert ending.asked
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_it_ends_for_good_and_for_all_who_wait() -> None:
    ending = Ending()
    assert not ending.asked
    waiting = [threading.Thread(target=ending.wait) for _ in range(3)]
    for each in waiting:
        each.start()
    ending.ask()
    for each in waiting:
        each.join(5)
    assert not any(each.is_alive() for each in waiting)
    ending.wait()
