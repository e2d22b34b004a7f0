"""The Companion's page alone, its parts faked: what it tells when an action cannot go on."""

from __future__ import annotations

import pytest

from robotree.examples.companion.companion import Companion
from robotree.proxy.base import Base
from robotree.proxy.head import Head
from robotree.proxy.limb import Limb
from robotree.testing import Fake, rehearse
from robotree.vr.base.errors import BadArgument, CommandFailed


def test_an_error_names_the_command_that_was_asked_for() -> None:
    hands = {side: Fake(Limb, get_info={"holding": False, "width": 0.0}) for side in ("left", "right")}
    robot = rehearse(Companion, base=Fake(Base), head=Fake(Head, see={"seen": False}), **hands)
    with pytest.raises(BadArgument, match=r"place: .*'moon'.*door, sofa, table, shelf, middle, dock"):
        robot.call("go_to", place="moon")
    with pytest.raises(CommandFailed, match=r"companion.take failed: red cup was not seen yet"):
        robot.call("take", what="red cup")
    with pytest.raises(CommandFailed, match=r"companion.give failed: both hands are empty"):
        robot.call("give", who="anna")
