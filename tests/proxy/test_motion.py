"""Laws of the motions: how each reads on the wire."""

from __future__ import annotations

import math
import re
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.dialect import compile as compiler
from robotree.protocol.frame import encode
from robotree.protocol.messages import Goal, Verb
from robotree.protocol.parser import Parser
from robotree.protocol.services.goal_client import GoalClient
from robotree.protocol.services.peer import Send
from robotree.proxy.arm import GoTo, Grip
from robotree.proxy.guard import Limits
from robotree.proxy.kinds import KINDS
from robotree.proxy.motion import Hold, Motion
from robotree.proxy.rover import Move

MOTIONS: dict[Verb, type[Motion]] = {Verb.GO_TO: GoTo, Verb.GRIP: Grip, Verb.MOVE: Move, Verb.HOLD: Hold}
XML = Path(compiler.DIALECT).with_name("robotree.xml")
numbers = st.floats(-10, 10, width=32)


def arguments(verb: Verb) -> list[str]:
    """What the dialect says that the arguments of a verb are, in order, without units."""
    entry = rf'name="ROBOTREE_VERB_{verb.name}">\s*<description>(.*?)</description>'
    (said,) = re.findall(entry, XML.read_text(), re.DOTALL)
    return re.findall(r"\w+", re.sub(r"\[[^]]*\]", "", said.partition("args: ")[2]))


@pytest.mark.parametrize("verb", MOTIONS)
@given(data=st.data())
def test_a_motion_crosses_the_wire_with_the_arguments_of_its_verb_in_the_dialects_order(
    verb: Verb, data: st.DataObject
) -> None:
    names = [field.name for field in fields(MOTIONS[verb])]
    motion = MOTIONS[verb](**{name: data.draw(numbers) for name in names})
    request = motion.request()
    (send,) = GoalClient(1, 1).start(7, request.verb, request.args, epoch=3, now=0.0)
    assert isinstance(send, Send)
    (frame,) = Parser().feed(encode(send.message, sequence=0, system=255, component=190))
    goal = frame.message
    assert isinstance(goal, Goal)
    assert goal.verb == verb
    said = [name.removeprefix("d") for name in arguments(verb)]
    assert said == names, "the dialect names them in this order"
    assert goal.args[: len(said)] == tuple(getattr(motion, name) for name in said)
    assert all(math.isnan(rest) for rest in goal.args[len(said) :])


COUNTS = {"hand", "number"}
"""Limits of whole numbers, which have no unit."""


@pytest.mark.parametrize("limits", [kind.limits for kind in KINDS.values()])
def test_every_limit_of_a_kind_has_a_unit_but_those_of_numbers(limits: Limits) -> None:
    assert limits
    assert {name for name, span in limits.items() if not span.unit} <= COUNTS
