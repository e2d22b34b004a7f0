"""Roles: what they inherit, acts that wait for them, and those that services lend."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest

from robotree.client.blocking import Realm
from robotree.tui.line import verbs
from robotree.tui.line.carrying import Silent
from robotree.tui.line.grammar import Line
from robotree.vr import Service, command
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, CommandSpec, RobotDescription
from robotree.vr.base.errors import BrokenScript, BrokenSource, CommandFailed, NoRoles, NoSuchRole, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.scripts.roles.profile import read_profile, resolve, shipped
from tests.plant import Machine
from tests.vr.scripts.conftest import Companion, Listed, Stage
from tests.vr.scripts.test_script_stories import HEAD
from tests.waiting import until, wait_until

# -- roles as they are written: inheritance, and one sentence for what cannot be -------------------


def test_five_roles_come_with_robotree_and_each_can_be_resolved() -> None:
    known = shipped()
    assert set(known) == {"butler", "maid", "man", "woman", "child"}
    assert len({resolve(name, known).manner["voice"] for name in known}) == 5


def test_a_role_says_what_it_does_not_inherit() -> None:
    butler = resolve("butler", shipped())
    assert butler.manner["pitch"] == 0.8, "of a man"
    assert butler.acts["wave"] == {"times": 1, "height": 0.5}, "its own"
    assert butler.acts["nod"] == {"times": 1}, "of a man"


@pytest.mark.parametrize(
    ("sources", "sentence"),
    [
        (["role: a\ninherits: a"], "roles inherit in a circle: a → a"),
        (["role: a\ninherits: b", "role: b\ninherits: c", "role: c\ninherits: a"], "circle: a → b → c → a"),
        (["role: a\ninherits: king"], "role a inherits from 'king', which is not known; known: a"),
        (["role: [a, b]"], "a role has one name: two roles cannot be played at once"),
        (["role: a\ninherits: [b, c]"], "a role inherits from one role"),
        (["inherits: b"], "`role: NAME` is missing"),
        (["role: a\nlimits: {speed: fast}"], "limit speed must be a number"),
        (["role: a\nacts: {go: 5}"], "an act must be written as `name: value`"),
        (["role: a\nvoice: x"], "a role has no 'voice'; it has: role, inherits, doc, manner"),
        (["role: a\n\tdoc: x"], "role:2:1: a tab cannot indent here: use spaces"),
    ],
)
def test_a_role_that_cannot_be_is_refused_in_one_sentence(sources: list[str], sentence: str) -> None:
    with pytest.raises(BrokenScript) as caught:
        resolve("a", {one.name: one for one in (read_profile(source, "role") for source in sources)})
    assert sentence in str(caught.value)


class RealmClient:
    """Robots as they describe themselves; keeps what they were asked."""

    def __init__(self, *robots: RobotDescription) -> None:
        self.robots = {one.name: one for one in robots}
        self.asked: list[tuple[str, str, dict[str, str]]] = []

    async def describe(self, name: str) -> RobotDescription:
        return self.robots[name]

    async def call(self, name: str, command: str, arguments: dict[str, str]) -> str:
        self.asked.append((name, command, arguments))
        return arguments["role"]


def robot(name: str, *commands: str, under: str = "", slot: str = "") -> RobotDescription:
    bond = BondSpec(parent=Address("robot", under, "1"), slot=slot, epoch=1, remaining=1.0) if under else None
    specs = tuple(CommandSpec(name=command) for command in commands)
    return RobotDescription(address=Address("robot", name, "1"), kinds=("X",), commands=specs, bond=bond)


async def test_the_verb_reaches_a_robot_through_those_who_command_it() -> None:
    realm_client = RealmClient(
        robot("boss", "play"),
        robot("guide", "play", under="boss", slot="team"),
        robot("companion", "play", under="guide", slot="robot"),
    )
    outcome = await verbs.role(realm_client, Line("role", {"NAME": "companion", "ROLE": "child"}), Silent())
    assert realm_client.asked == [("boss", "play", {"role": "child", "at": "team.robot"})]
    assert outcome.text == "companion plays child from its next act on"


async def test_the_verb_names_the_file_of_a_role_that_cannot_be_learned(tmp_path: Path) -> None:
    class Strict(RealmClient):
        async def call(self, name: str, command: str, arguments: dict[str, str]) -> str:
            if command == "learn_role":
                read_profile(arguments["source"], "role")
            return await super().call(name, command, arguments)

    file = tmp_path / "waiter.yaml"
    file.write_text("role: waiter\n\tinherits: butler\n")
    realm_client = Strict(robot("companion", "play", "learn_role"))
    with pytest.raises(BrokenScript, match=r"waiter.yaml:2:1: a tab cannot indent here"):
        await verbs.role(realm_client, Line("role", {"NAME": "companion", "ROLE": str(file)}), Silent())


async def test_the_verb_says_who_passes_no_role_on() -> None:
    realm_client = RealmClient(
        robot("square", "move"), robot("companion", "play", under="square", slot="robot")
    )
    with pytest.raises(
        NoRoles, match="companion cannot change its role: square commands it and passes no role on"
    ):
        await verbs.role(realm_client, Line("role", {"NAME": "companion", "ROLE": "child"}), Silent())


# -- an act begins when its partner plays the role that was given before it, however long that takes


WAVE = HEAD + "  - rule: wave\n    when: [go]\n    then: [role: {robot: child}, do: robot.wave]\n"
STOP = "  - rule: stop\n    when: [halt]\n    then: [cancel: WHAT]\n"
ENDS = (
    "  - rule: refused\n    when: [failed: {act: wave, reason: $r}]\n    then: [end: $r]\n"
    "  - rule: without\n    when: [failed: {act: play}]\n    then: [log: it plays nothing]\n"
)


class Slow(Companion):
    """A companion that takes a role when the test says so."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.asked, self.ready = threading.Event(), threading.Event()
        self.refuses = False

    @classmethod
    def kinds(cls) -> tuple[str, ...]:
        return ("Companion", *super().kinds())

    @command(effect="read")
    def play(self, role: str, at: Annotated[str, "as in RolePlayer"] = "") -> str:
        """Play a role, slowly."""
        self.asked.set()
        while not self.ready.is_set():
            self.sleep(0.005)
        if self.refuses:
            raise RuntimeError("the costume is missing")
        self.note(f"plays {role}")
        return super().play(role, at)


async def led(stage: Stage, source: str) -> tuple[Slow, Any, Any]:
    robot = Slow("c1")
    await stage.start(robot)
    script = await stage.script(source)
    await stage.enslave("guide", "robot", "c1")
    running = stage.begin("guide")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 2, 60.0)
    return robot, script, running


async def test_an_act_waits_until_its_partner_plays_the_role_that_was_given_before_it(stage: Stage) -> None:
    robot, script, _ = await led(stage, WAVE)
    await stage.call("guide", "go", place="x")
    await stage.until(robot.asked.is_set, 60.0)
    await stage.until(lambda: script._run.under_way == 2, 60.0)
    assert robot.done == []
    robot.ready.set()
    await stage.until(lambda: len(robot.done) == 2, 60.0)
    assert robot.done == ["plays child", "wave with both arms"]


async def test_an_act_of_a_role_that_is_refused_fails_and_is_not_done_in_the_old_manner(stage: Stage) -> None:
    robot, _, running = await led(stage, WAVE + ENDS)
    robot.refuses = True
    robot.ready.set()
    await stage.call("guide", "go", place="x")
    assert "robot does not play the role for it: " in await running
    assert robot.done == []


async def test_a_role_that_is_refused_ends_a_script_without_a_rule_for_that(stage: Stage) -> None:
    robot, _, running = await led(stage, WAVE)
    robot.refuses = True
    robot.ready.set()
    await stage.call("guide", "go", place="x")
    with pytest.raises(CommandFailed, match=r"robot.play failed .*costume is missing.* no rule handles it"):
        await running
    assert robot.done == []


@pytest.mark.parametrize("what", ["robot", "role"])
async def test_an_act_whose_role_is_cancelled_does_not_begin(stage: Stage, what: str) -> None:
    source = (WAVE + STOP.replace("WHAT", what) + ENDS).replace("text}\n", "text}\n  halt: {}\n")
    robot, script, running = await led(stage, source)
    await stage.call("guide", "go", place="x")
    await stage.until(robot.asked.is_set, 60.0)
    await stage.until(lambda: script._run.under_way == 2, 60.0)
    await stage.call("guide", "halt")
    if what == "role":
        assert await running == "robot does not play the role for it: that was cancelled"
    else:
        await stage.until(lambda: script._run.under_way == 0, 60.0)
    robot.ready.set()
    assert robot.done == []


# -- roles that services lend: played while the service is listed, and forgotten when it leaves ----


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
