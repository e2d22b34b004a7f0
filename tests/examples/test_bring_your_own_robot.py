"""docs/bring-your-own-robot.md cannot rot: its class is run, its words are looked up."""

from __future__ import annotations

import random
import re
import runpy
from pathlib import Path

import pytest

from robotree.protocol.dialect import by_name
from robotree.protocol.messages import GoalState, ModeKind, Reason
from robotree.proxy import kinds
from robotree.proxy.agent import standing_for
from robotree.sim.server import serving
from robotree.vr.errors import BadArgument
from robotree.vr.host.client import RobotClient
from robotree.vr.host.memory import MemoryNetwork
from robotree.vr.testing import until

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "bring-your-own-robot.md"


async def test_the_guides_gripper_opens_and_closes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (page,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    file = tmp_path / "gripper.py"
    file.write_text(page)
    monkeypatch.setattr(kinds, "KINDS", dict(kinds.KINDS))
    runpy.run_path(str(file))
    network = MemoryNetwork()
    async with serving("arm", "tcp:127.0.0.1:0") as cell:
        robot = kinds.make("gripper", "gripper-1", cell.address, chance=random.Random(1))
        async with standing_for(robot, network.join("proxy")) as agent:
            client = RobotClient(network.join("caller"), agent.address)
            await until(lambda: robot.online, "its controller is found")
            await client.call("open", {"opening": 50})
            info = await client.call("get_info", {})
            assert (info["opening"], info["holding"]) == (pytest.approx(50, abs=3), False)
            assert await client.call("close", {}) is False
            assert (await client.call("get_info", {}))["opening"] < 3
            with pytest.raises(BadArgument):
                await client.call("open", {"opening": 101})
            described = await client.describe()
            assert described.kinds == ("Gripper", "RobotProxy", "Robot")


def test_every_message_of_the_guide_is_in_the_dialect() -> None:
    pattern = r"\b(?:ROBOTREE_[A-Z_]+|HEARTBEAT|LOCAL_POSITION_NED|NAMED_VALUE_FLOAT)\b"
    named = set(re.findall(pattern, GUIDE.read_text())) - {"ROBOTREE_VERB", "ROBOTREE_CONTROLLER"}
    assert len(named) > 8
    assert named <= by_name().keys()


def test_every_state_reason_and_mode_of_the_guide_is_in_the_dialect() -> None:
    known = {member.name for words in (GoalState, Reason, ModeKind) for member in words}
    rules = GUIDE.read_text().partition("### The rules that matter")[2].partition("### Another language")[0]
    others = {"NaN", "STATUS", "SET_MODE", "HEARTBEAT", "ROBOTREE_MODE", "LINK"}
    assert set(re.findall(r"\b[A-Z][A-Z_]{4,}\b", rules)) - others <= known


def test_every_file_that_the_guide_points_to_is_there() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", GUIDE.read_text())
    assert links
    assert [link for link in links if not (GUIDE.parent / link).exists()] == []
