"""The simulated arm in a rehearsal: real physics, firmware and proxy, faster than real time."""

from __future__ import annotations

import time

import pytest

from robotree.examples.move_to import MoveTo
from robotree.examples.open_close_lever import OpenCloseLever
from robotree.testing import Page, cell, rehearse
from robotree.vr import CommandFailed
from robotree.vr.base.errors import Stopped

FASTER = 5.0
"""Virtual time by processor time that authors are promised; it is about 15 on a machine of 2026."""


@pytest.mark.speed
def test_a_lever_is_closed_by_the_simulated_arm_faster_than_real_time() -> None:
    began = time.process_time()
    with rehearse(OpenCloseLever, mover=Page(MoveTo, arm=cell("arm"))) as team:
        force = team.call("close", within=120)
        assert 0 < force < 40
        assert team["mover.arm"].world.lever_angle == pytest.approx(0.785, abs=0.02)
        assert team.now > FASTER * (time.process_time() - began)


def test_a_cable_that_is_cut_fails_the_command_and_is_found_again() -> None:
    arm = cell("arm")
    with rehearse(MoveTo, arm=arm) as team:
        team.call("go_to", x=0.4, y=0, z=0.3, twist=0)
        going = team.start("go_to", x=0.4, y=0.2, z=0.3, twist=0)
        team.wait(0.3)
        arm.cut()
        with pytest.raises(CommandFailed):
            going.result()
        arm.mend()
        team.wait(3.0)
        team.call("go_to", x=0.4, y=0.2, z=0.3, twist=0)
        assert team.call("get_info").y == pytest.approx(0.2, abs=0.005)


def test_a_stop_stops_the_simulated_arm() -> None:
    with rehearse(MoveTo, arm=cell("arm")) as team:
        going = team.start("go_to", x=0.4, y=0.3, z=0.3, twist=0)
        team.wait(0.5)
        team.stop()
        assert going.done
        where = team.call("get_info").y
        team.wait(1.0)
        assert team.call("get_info").y == pytest.approx(where, abs=0.002)
        with pytest.raises(Stopped):
            team.call("go_to", x=0.4, y=0, z=0.3, twist=0)


def test_a_kind_that_cannot_be_simulated_alone_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no simulated robot 'leg'; there is: arm, rover"):
        cell("leg")
