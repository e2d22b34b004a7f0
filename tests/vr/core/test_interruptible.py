"""An author's thread is interrupted in the middle of anything, and leaves nothing behind."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading

from robotree.vr.running.interruptible import Interrupted, InterruptibleThread

PROFILED = """
import sys, threading
from {module} import InterruptibleThread

ended = threading.Event()
InterruptibleThread(lambda: 1, lambda *_: ended.set(), name="quick").start()
ended.wait()
sys.setprofile(lambda *_: None)
(lambda: None)()
sys.setprofile(None)
print("alive")
"""


def run(work: object) -> tuple[InterruptibleThread, threading.Event, list[object]]:
    """Begin some work; what came of it is in the list once the event is set."""
    ended, outcome = threading.Event(), list[object]()

    def done(*told: object) -> None:
        outcome.extend(told)
        ended.set()

    thread = InterruptibleThread(work, done, name="author")  # type: ignore[arg-type]
    thread.start()
    return thread, ended, outcome


def test_a_loop_that_asks_nobody_is_interrupted() -> None:
    began = threading.Event()

    def work() -> None:
        for _ in itertools.count():
            began.set()

    thread, ended, outcome = run(work)
    began.wait()
    thread.interrupt()
    assert ended.wait(10)
    assert isinstance(outcome[1], Interrupted)


def test_an_interruption_at_the_very_end_is_heard_once_or_not_at_all() -> None:
    for _ in range(300):
        thread, ended, outcome = run(lambda: 7)
        thread.interrupt()
        assert ended.wait(10)
        assert outcome[0] == 7 or isinstance(outcome[1], Interrupted)


def test_what_has_ended_does_not_make_a_profiled_process_turn_on_the_spot() -> None:
    script = PROFILED.format(module=InterruptibleThread.__module__)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "alive\n"
