"""Scripts of both forms, made by a host of their source, as `robotree create` does it."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.base.errors import BrokenScript
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient, RobotClient
from tests.vr.scripts.stage import EXAMPLES, Stage

ITSELF = """
script: watch
start: {itself: yes}
partners: {robot: Companion}
rules:
  - rule: begin
    when: [start]
    then: [do: [robot, say, I am awake]]
  - rule: over
    when: [done: {act: say}]
    then: [end: said]
"""


class Hosted(Stage):
    """A stage with a host on it."""

    async def open(self) -> None:
        self.host = Host(self.network.join("host"), "host-1")
        await self.host.start()

    async def create(self, bundle: Bundle, name: str) -> RobotClient:
        made = await HostClient(self.operator, self.host.address).create(bundle, name)
        self.agents[name] = self.host.agents[name]
        return RobotClient(self.operator, made.address)


@pytest.fixture
async def stage() -> AsyncIterator[Hosted]:
    stage = Hosted()
    await stage.open()
    yield stage
    await stage.host.close()
    await stage.close()


async def test_rules_of_clips_come_from_a_host_and_lead_a_robot(stage: Hosted) -> None:
    robot = await stage.companion()
    client = await stage.create(Bundle.read(EXAMPLES / "receptionist.clp"), "desk")
    described = await client.describe()
    assert described.kinds[:2] == ("Receptionist", "Script")
    assert described.attributes["condition"].startswith("inactive: needs ")
    (slot,) = (one.name for one in described.slots if not one.optional)
    await stage.enslave("desk", slot, "c1")
    running = stage.begin("desk")
    script = stage.agents["desk"].robot
    await stage.until(lambda: script._run is not None and script._run.engine.happened >= 2)
    await stage.call("desk", "person_seen", who="Anna", place="kitchen")
    await stage.until(lambda: "go_to kitchen at 0.5" in robot.done)
    await stage.call("desk", "finish")
    assert await running == "finished on request"


async def test_a_script_that_starts_itself_waits_for_its_partner_and_leads_it(stage: Hosted) -> None:
    await stage.create(Bundle(ITSELF, "watch.yaml"), "watch")
    script = stage.agents["watch"].robot
    await stage.until(lambda: script._run is not None, within=5.0)
    assert script.condition == "inactive: needs robot (Companion)"
    robot = await stage.companion()
    await stage.enslave("watch", "robot", "c1")
    await stage.until(lambda: script.attributes.get("ended") == "said")
    assert robot.done == ["say I am awake [plain]"]


@pytest.mark.parametrize(
    ("source", "name", "sentence"),
    [
        ("(defrule a => (system ls))", "bad.clp", r"bad.clp:1:15: .*system"),
        ("script: bad\n\tpartners: {}\n", "bad.yaml", r"bad.yaml:2:1: .*tab"),
    ],
)
async def test_a_host_says_where_a_script_is_wrong(
    stage: Hosted, source: str, name: str, sentence: str
) -> None:
    with pytest.raises(BrokenScript, match=sentence):
        await stage.create(Bundle(source, name), "bad")
    assert not stage.host.agents
