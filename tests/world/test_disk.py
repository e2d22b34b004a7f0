"""Hosts keep their robots, and end at any moment of their work: no seed breaks a law, and each repeats."""

from __future__ import annotations

import pytest

from tests.world.crashes import play


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_whatever_ends_when_the_robots_go_on(first: int) -> None:
    """In 23 a call comes while a host's robots are not all back; in 40 a host ends while it asks for a child.

    In 14 a disk is read-only: what can neither be written nor removed is not to become untrue.
    """
    assert [
        (seed, story.judge.broken)
        for seed in range(first, first + 10)
        if (story := play(seed)[1]).judge.broken
    ] == []


def test_a_message_of_a_process_that_has_ended_does_not_keep_its_heir_away() -> None:
    """In 192 the last renewal of a host's robot arrives after the host's end was seen."""
    assert play(192)[1].judge.broken == []


def test_a_log_that_the_power_has_torn_keeps_no_host_away() -> None:
    """In 5157 the next host ends, too, when its own file is written and the torn one is not yet removed."""
    assert play(5157)[1].judge.broken == []


def test_nobody_is_asked_about_a_step_of_a_command_that_has_ended() -> None:
    """In 20249 a command ends at its deadline, while one of its parts waits until another has asked."""
    assert play(20249)[1].judge.broken == []


@pytest.mark.parametrize("seed", [5, 12])
def test_a_seed_gives_one_trace(seed: int) -> None:
    first, story = play(seed)
    assert play(seed)[0] == first
    assert story.ends
    assert story.done > 3
