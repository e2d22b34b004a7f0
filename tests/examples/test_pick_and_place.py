"""The example that other systems are compared with, rehearsed with fakes and with the simulated cell."""

from __future__ import annotations

import pytest

from robotree.examples.pick_and_place import PickAndPlace
from robotree.kinds import Arm
from robotree.testing import Fake, cell, rehearse, rehearse_seeds
from robotree.testing.team import Team
from robotree.vr import BadArgument, CommandCancelled, DeadlineExceeded, Failed
from robotree.vr.base.errors import Stopped

WAY = {"x": "30 cm", "y": 0, "to_x": 0.3, "to_y": "20 cm"}
BLOCK = {"x": "30 cm", "y": "-20 cm", "to_x": "30 cm", "to_y": "-30 cm"}
"""From where the block of the cell lies at first."""
HOLDING = {"holding": True}


def last(team: Team) -> str:
    return team.commanded.names[-1]


def test_it_takes_a_thing_from_here_to_there() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING))
    team.call("pick_and_place", **WAY)
    assert team.commanded == [
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.03, "twist": 0}),
        ("arm", "grip", {"action": "close"}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.03, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.15, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
    ]
    assert team.progress == [(0.5, "gripped")]


def test_it_moves_the_block_of_the_simulated_cell() -> None:
    arm = cell("arm")
    with rehearse(PickAndPlace, arm=arm) as team:
        team.call("pick_and_place", within=120, **BLOCK)
        assert arm.world.block_place == pytest.approx((0.30, -0.30, 0.02), abs=0.005)
        with pytest.raises(Failed, match="nothing is there"):
            team.call("pick_and_place", within=120, **BLOCK)


def test_it_says_that_nothing_is_there() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm))
    with pytest.raises(Failed, match="nothing is there"):
        team.call("pick_and_place", **WAY)
    assert last(team) == "arm.grip"


def test_it_lets_go_when_it_is_cancelled_or_late() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING).cancel(at=4, after=0.5))
    with pytest.raises(CommandCancelled):
        team.call("pick_and_place", **WAY)
    assert team.commanded[-1] == ("arm", "grip", {"action": "open"})
    with pytest.raises(DeadlineExceeded):
        team.call("pick_and_place", within=3.5, **WAY)
    assert team.commanded[-1] == ("arm", "grip", {"action": "open"})


def test_nothing_moves_after_a_stop() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING).stop(at=4, after=0.5))
    with pytest.raises(CommandCancelled):
        team.call("pick_and_place", **WAY)
    team.wait(2)
    assert last(team) == "arm.go_to"
    with pytest.raises(Stopped):
        team.call("pick_and_place", **WAY)


def test_it_refuses_what_is_out_of_reach() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm))
    with pytest.raises(BadArgument, match=r"x: 90 cm is out of range"):
        team.call("pick_and_place", **WAY | {"x": "90 cm"})


def test_it_keeps_the_laws_under_100_seeds() -> None:
    rehearse_seeds(PickAndPlace, "pick_and_place", WAY, arm=Fake(Arm, get_info=HOLDING))
