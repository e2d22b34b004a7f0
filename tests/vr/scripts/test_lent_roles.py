"""Roles that services lend: robots play them while the service is listed, and forget them when it leaves."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import pytest

from robotree.client.blocking import Realm
from robotree.vr import Service, command
from robotree.vr.base.errors import BrokenScript, BrokenSource, NoSuchRole, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.scripts.roles import read_profile
from tests.plant import Machine
from tests.vr.scripts.stage import Companion, Listed
from tests.waiting import until, wait_until

GREETER = Path(__file__).parents[3] / "examples/services/greeter.py"

CLERK = "role: clerk\ninherits: butler\nwords: {Welcome: Your number please}\n"
CHIEF = "role: chief\ninherits: clerk\nmanner: {voice: deep}\n"
HASTY = "role: hasty\nlimits: {speed: 2.0}\n"
LEADER = """
script: leader
partners:
  desk: {kind: Desk}
  robot: {kind: Companion, optional: yes}
hears: {guest: {}}
rules:
  - rule: guest
    when: [guest]
    then: [role: {robot: desk-chief}, do: [robot, say, Welcome]]
"""


class Desk(Service):
    lends: ClassVar = {"clerk": CLERK, "chief": CHIEF, "hasty": HASTY}

    @command
    def ring(self) -> None:
        """Ring."""


def knows(robot: Companion) -> set[str]:
    return set(robot.attributes["roles"].split())


async def test_a_lent_role_is_played_until_its_service_leaves(listed: Listed) -> None:
    robot = Companion("c1")
    await listed.start(robot)
    own = knows(robot)
    await listed.start(Desk("desk"))
    await until(lambda: knows(robot) == own | {"desk-clerk", "desk-chief"}, "what fits it is offered")
    assert [line for line in listed.lines("c1") if "desk-hasty: role desk-hasty" in line], "too wide"
    await listed.call("c1", "play", role="desk-chief")
    assert await listed.call("c1", "say", text="Welcome") == "Your number please"
    assert robot.done == ["say Your number please [deep]"]

    await listed.agents["desk"].close()
    await until(lambda: knows(robot) == own, "nothing is offered any more")
    assert robot.role == "neutral"
    gone = "the role desk-chief is gone with its service: neutral from the next act on"
    assert listed.lines("c1").count(gone) == 1
    assert await listed.call("c1", "say", text="Welcome") == "Welcome"
    with pytest.raises(NoSuchRole, match="knows no role 'desk-chief'"):
        await listed.call("c1", "play", role="desk-chief")

    await listed.start(Desk("desk"))
    await until(lambda: "desk-chief" in knows(robot), "it is offered again")
    assert robot.role == "neutral", "and played by nobody who was not asked to"


async def test_a_service_that_is_led_by_its_behaviour_still_lends_to_its_partner(listed: Listed) -> None:
    robot = Companion("c1")
    await listed.start(robot)
    await listed.start(Desk("desk"))
    script = await listed.script(LEADER, "leader")
    await listed.enslave("leader", "desk", "desk")
    await listed.enslave("leader", "robot", "c1")
    await until(lambda: "desk-chief" in knows(robot), "it is offered")
    listed.begin("leader")
    await until(lambda: script.condition == "active", "it leads")
    await listed.call("leader", "guest")
    await until(lambda: robot.done == ["say Your number please [deep]"], "it says so in its role")


async def test_the_simplest_service_lends_a_role(listed: Listed) -> None:
    robot = Companion("c1")
    await listed.start(robot)
    await listed.start(Bundle.read(GREETER).create("greeter"))
    await until(lambda: "greeter-porter" in knows(robot), "it is offered")
    await listed.call("c1", "play", role="greeter-porter")
    assert await listed.call("c1", "say", text="Welcome") == "Welcome to our house"


async def test_no_role_is_taken_from_its_owner_by_its_name(listed: Listed) -> None:
    robot = Companion("c1")
    await listed.start(robot)
    await listed.call("c1", "learn_role", source="role: desk-clerk\nwords: {Welcome: Own words}\n")
    await listed.start(Desk("desk"))
    await until(lambda: "desk-chief" in knows(robot), "the others are offered")
    assert any("it has a role 'desk-clerk' of its own" in line for line in listed.lines("c1"))
    await listed.call("c1", "play", role="desk-clerk")
    assert await listed.call("c1", "say", text="Welcome") == "Own words"
    with pytest.raises(BrokenScript, match="a service lends 'desk-chief'; give the role another name"):
        await listed.call("c1", "learn_role", source="role: desk-chief\n")
    await listed.agents["desk"].close()
    await until(lambda: "desk-chief" not in knows(robot), "those are gone")
    assert robot.role == "desk-clerk", "its own stays"


async def test_a_service_that_sets_later_what_cannot_be_lent_lends_nothing(listed: Listed) -> None:
    class Late(Service):
        lends: ClassVar = {"clerk": CLERK}

        @command
        def lend_other(self) -> None:
            """Lend what its class did not name."""
            type(self).lends = {"a-b": "role: a-b\n"}
            self.attributes = {"place": "hall"}  # its listing is made anew

    robot = Companion("c1")
    await listed.start(robot)
    own = knows(robot)
    await listed.start(Late("desk"))
    await until(lambda: knows(robot) == own | {"desk-clerk"}, "it is offered")
    await listed.call("desk", "lend_other")
    assert listed.agents["desk"].description().lends == ()
    await until(lambda: knows(robot) == own, "its listing lends nothing any more")
    sentence = "'a-b' has a '-', which parts a service from its role; leave it out"
    assert len([line for line in listed.lines("desk") if sentence in line]) == 1


async def test_no_role_is_lent_under_the_name_of_another_service(
    listed: Listed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page may get round what its own process looks at, so each robot looks at what it takes."""

    def unlooked(where: str, given: dict[str, str]) -> dict[str, str]:
        del where
        return given

    class Other(Service):
        @command
        def ring(self) -> None:
            """Ring."""

    robot = Companion("c1")
    await listed.start(robot)
    await listed.start(Desk("desk"))
    await until(lambda: "desk-clerk" in knows(robot), "it is offered")
    await listed.start(Desk("desk-a"))
    await until(lambda: "desk-a-clerk" in knows(robot), "that one, too")
    await listed.call("c1", "play", role="desk-a-clerk")
    before = knows(robot)
    Other.lends = {"a-clerk": "role: a-clerk\nwords: {Welcome: Your purse please}\n"}
    monkeypatch.setattr("robotree.vr.agents.publisher.expect_lendable", unlooked)
    await listed.agents["desk"].close()
    await listed.start(Other("desk"))
    await until(lambda: any("it does not take the roles of desk: " in line for line in listed.lines("c1")))
    assert await listed.call("c1", "say", text="Welcome") == "Your number please"
    assert knows(robot) == {known for known in before if known not in {"desk-clerk", "desk-chief"}}
    assert robot.role == "desk-a-clerk"


def test_a_service_that_leaves_while_its_role_is_chosen_takes_it_along() -> None:
    robot = Companion("c1")
    clerk = read_profile(CLERK, "clerk")

    class Leaving(dict[str, object]):
        """The roles of a service that leaves as soon as one has looked."""

        def get(self, name: str, default: object = None) -> object:
            robot.lent = {}
            return super().get(name, default)

    robot.lent = Leaving(clerk=clerk)  # type: ignore[assignment]
    with pytest.raises(NoSuchRole, match="knows no role 'clerk'"):
        robot.play("clerk")
    assert (robot.role, robot.borrowed) == ("neutral", {})


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("5", "Wrong.lends gives a role by name"),
        ("{'butler': 'role: clerk'}", "it is called 'clerk' here, and 'butler' by the service"),
        ("{'clerk': 'voice: deep'}", "Wrong.lends: .* has no 'voice'"),
        ("{'no name!': 'role: x'}", "Wrong.lends: .*no name!"),
        ("{'a-b': 'role: a-b'}", "Wrong.lends: 'a-b' has a '-', which parts a service from its role"),
        ("{'clerk': 'role: clerk\\ndoc: ' + 'x' * 10_000}", "more than 10000 characters"),
    ],
)
def test_a_role_that_cannot_be_lent_is_refused_with_its_page(given: str, sentence: str) -> None:
    page = f"from robotree.vr import Service\n\nclass Wrong(Service):\n    lends = {given}\n"
    with pytest.raises(BrokenSource, match=sentence):
        Bundle(page, "wrong.py").create("wrong")


# -- real processes --------------------------------------------------------------------------------

PLAYER = """
from robotree.vr import command
from robotree.vr.scripts.roles import RolePlayer

class Companion(RolePlayer):
    @command
    def say(self, text: str) -> str:
        return self.manner.words(text)
"""
DESK = f"""
from robotree.vr import Service

class Desk(Service):
    lends = {{"clerk": {CLERK!r}}}
"""


@pytest.mark.e2e
def test_the_role_of_a_service_that_is_killed_goes_and_nothing_else_does(tmp_path: Path) -> None:
    (tmp_path / "companion.py").write_text(PLAYER)
    (tmp_path / "desk.py").write_text(DESK)
    machine = Machine(tmp_path, "hall")
    machine.start("lookup", "lookup", "lookup-1")
    machine.start("house", "host", "house")
    machine.start("services", "host", "services")
    try:
        with machine.joined() as realm:
            _play_until_services_are_killed(machine, realm, tmp_path)
    finally:
        for called in list(machine.running):
            machine.end(called)


def _play_until_services_are_killed(machine: Machine, realm: Realm, folder: Path) -> None:
    page = str(folder / "companion.py")
    machine.say("create", page, "as", "companion", "on", "house")
    machine.say("create", page, "as", "guarded", "on", "house", "--isolate", "process")
    before = realm.describe("companion").address

    def says() -> str:
        said: str = realm["companion"].say(text="Welcome")
        return said

    def shown(robot: str = "companion") -> Mapping[str, str]:
        with contextlib.suppress(VrError):  # its host has just been started
            return realm.describe(robot).attributes
        return {"role": "", "roles": ""}

    def offered(robot: str = "companion") -> bool:
        return "desk-clerk" in shown(robot)["roles"].split()

    told = machine.text("service", str(folder / "desk.py"), "desk", "on", "services")
    assert "it lends desk-clerk" in told, told
    wait_until(offered, "the role is offered")
    wait_until(lambda: offered("guarded"), "also to a robot that is kept apart")
    machine.say("role", "companion", "desk-clerk")
    assert says() == "Your number please"

    machine.end("house", signal.SIGKILL)
    machine.start("house", "host", "house")
    wait_until(lambda: offered() and says() == "Your number please", "its service is here: it goes on")

    here, killed = realm.describe("companion").address, time.time()
    machine.end("services", signal.SIGKILL)
    for robot in ("companion", "guarded"):
        wait_until(lambda robot=robot: "desk-clerk" not in realm.describe(robot).attributes["roles"])
    assert shown()["role"] == "neutral"
    assert realm.describe("companion").address == here == before, "it is the same life"
    assert says() == "Welcome"
    new = [line for line in realm.log("companion") if line.unix > killed]
    bad = [line.text for line in new if line.level in {"warning", "error"}]
    assert bad == ["the role desk-clerk is gone with its service: neutral from the next act on"]

    machine.start("services", "host", "services")
    wait_until(offered, "its host brings the service back")
    assert says() == "Welcome", "and nobody plays its role by accident"
    realm["companion"].play(role="desk-clerk")
    machine.end("services", signal.SIGKILL)
    machine.end("house", signal.SIGKILL)
    machine.start("house", "host", "house")
    wait_until(lambda: shown()["role"] == "neutral", "its service left while it was away")
    assert says() == "Welcome"
