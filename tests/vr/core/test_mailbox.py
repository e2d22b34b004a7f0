from __future__ import annotations

import pytest

from robotree.vr.errors import Busy
from robotree.vr.mailbox import MOST_READERS, Mailbox


def test_one_command_at_a_time_in_the_order_they_came() -> None:
    box = Mailbox("arm-1")
    assert [box.offer(key, reads=False) for key in "abc"] == [True, False, False]
    assert (box.running, box.waiting) == ("a", ("b", "c"))
    assert box.leave("a") == "b"
    assert box.leave("b") == "c"
    assert box.leave("c") == ""
    assert box.running == ""


def test_what_only_reads_runs_beside() -> None:
    box = Mailbox("arm-1")
    box.offer("a", reads=False)
    assert box.offer("r", reads=True)
    assert box.leave("r") == ""
    assert box.running == "a"


def test_a_full_queue_says_so() -> None:
    box = Mailbox("arm-1", limit=2)
    for key in "abc":
        box.offer(key, reads=False)
    with pytest.raises(Busy, match="arm-1 already has 2 commands waiting"):
        box.offer("d", reads=False)
    box.leave("b")
    assert not box.offer("d", reads=False)


def test_readers_are_bounded_too() -> None:
    box = Mailbox("arm-1")
    for number in range(MOST_READERS):
        box.offer(str(number), reads=True)
    with pytest.raises(Busy):
        box.offer("one more", reads=True)


def test_a_command_that_gave_up_waiting_does_not_get_its_turn() -> None:
    box = Mailbox("arm-1")
    for key in "abc":
        box.offer(key, reads=False)
    assert box.leave("b") == ""
    assert box.leave("a") == "c"
