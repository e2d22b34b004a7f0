"""A robot obeys an assistant where the policy says `ask` only with a person's yes to this one call.

The asker here is a hostile program of the same user that speaks the protocol itself, so nothing that the
server of assistants checks is in its way.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from robotree.vr import Robot, command
from robotree.vr.base.envelope import asking_for_assistant, read_envelope, seal
from robotree.vr.base.errors import Denied, NoSuchPermit, PermitRefused, VrError
from robotree.vr.base.permit import GOOD, WAITS, Permit, PermittedCall
from robotree.vr.base.policy import Person, PolicyGate
from robotree.vr.base.principal import Voucher
from robotree.vr.base.requests import Call, Resume
from robotree.vr.network.permit_file import MOST_WAITING, PermitFiles
from robotree.vr.sites.frames import arrived
from robotree.vr.world.network import MemoryNetwork
from tests.vr.policy.conftest import ME, PoliticalRealm

RULES = f"""
persons: {{'{ME}': all}}
assistants: {{claude: helper, other: helper}}
roles:
  all: {{see: '*', command: '*', resume: '*', administrate: yes}}
  helper: {{see: '*', command: rover-1.look, ask: ['*.move'], resume: '*', administrate: yes, release: '*'}}
"""


class Rover(Robot):
    """A rover."""

    def __init__(self, name: str) -> None:
        """Take its name."""
        super().__init__(name)
        self.moved: list[float] = []

    @command
    def move(self, x: float) -> None:
        """Move."""
        self.moved.append(x)

    @command(effect="read")
    def look(self) -> int:
        """Look."""
        return len(self.moved)


class Gate(PolicyGate):
    """The policy of a test, with permits."""

    def __init__(self, folder: Path) -> None:
        """Take the folder of the permits."""
        self.unix = 1e6
        self.permits = PermitFiles(folder, lambda: self.unix)

    def expect_permit(self, asker: Person, call: PermittedCall) -> None:
        self.permits.expect(asker.assistant, call)


@pytest.fixture
async def realm(tmp_path: Path) -> AsyncIterator[Any]:
    network = MemoryNetwork(delay=0.001)
    found = PoliticalRealm(network)
    found.gate = network.gate = Gate(tmp_path)
    found.operator.gate = network.gate
    await found.open()
    found.rule(RULES)
    yield found
    found.gate.policy = None
    await found.close()


def asked(agent: Any, **changes: Any) -> Permit:
    described = agent.description()
    permit = Permit(
        id="abcdefgh", assistant="claude", robot=described.name, life=described.address.key,
        stops=described.stops, command="move", arguments={"x": 1.0}, asked=1e6,
    )  # fmt: skip
    return replace(permit, **changes)


def call_of(agent: Any, permit: str, key: str = "k", x: float = 1.0) -> tuple[Call, PermittedCall]:
    described = agent.description()
    call = Call(key=key, command="move", arguments={"x": x}, deadline=5.0, permit=permit)
    sent = PermittedCall(permit, described.address.key, described.stops, "move", {"x": x}, key)
    return call, sent


async def obeyed(realm: Any, agent: Any, call: Call, assistant: str = "claude") -> str:
    """Return why the robot refuses a call; empty: it has carried it out."""
    with asking_for_assistant(assistant):
        try:
            await realm.client(agent).carry_out(call)
        except VrError as error:
            return str(error)
    return ""


async def test_a_yes_is_for_one_call_and_is_used_once(realm: Any) -> None:
    rover = Rover("rover-1")
    agent, permits = await realm.start(rover), realm.gate.permits
    call, sent = call_of(agent, "abcdefgh")
    assert "there is none" in await obeyed(realm, agent, replace(call, permit=""))
    assert "there is none" in await obeyed(realm, agent, call)
    permits.ask(asked(agent))
    with pytest.raises(PermitRefused, match="nobody has said yes"):
        permits.begin("abcdefgh", "claude", sent)
    permits.answer("abcdefgh", yes=True, by="anna@pts/1")
    assert "for none" in await obeyed(realm, agent, call), "a yes that has not begun is no yes to this key"
    permits.begin("abcdefgh", "claude", sent)
    assert await obeyed(realm, agent, call) == ""
    assert rover.moved == [1.0]
    assert await obeyed(realm, agent, call) == "", "the same call again is answered"
    assert rover.moved == [1.0], "and not carried out again"
    with pytest.raises(PermitRefused, match="it was used"):
        permits.begin("abcdefgh", "claude", sent)
    assert "for another call" in await obeyed(realm, agent, replace(call, key="other"))
    assert rover.moved == [1.0]


@pytest.mark.parametrize("attack", ["arguments", "robot", "assistant", "stop", "expiry", "life", "no"])
async def test_what_differs_from_the_call_that_was_allowed_is_refused(realm: Any, attack: str) -> None:
    rover, second = Rover("rover-1"), Rover("rover-2")
    agent, other, permits = await realm.start(rover), await realm.start(second), realm.gate.permits
    permits.ask(asked(agent, life="robot/rover-1/earlier") if attack == "life" else asked(agent))
    if attack == "no":
        permits.answer("abcdefgh", yes=False, by="anna@pts/1")
        with pytest.raises(PermitRefused, match="already"):
            permits.answer("abcdefgh", yes=True, by="anna@pts/1")
    else:
        permits.answer("abcdefgh", yes=True, by="anna@pts/1")
    target, who = (other if attack == "robot" else agent), "other" if attack == "assistant" else "claude"
    if attack == "stop":
        await realm.client(agent).safe_stop("a hand")
        await realm.until(lambda: agent.description().stopped)
        await realm.client(agent).resume()
        await realm.until(lambda: not agent.description().stopped)
    if attack == "expiry":
        realm.gate.unix += GOOD
    call, sent = call_of(target, "abcdefgh", x=2.0 if attack == "arguments" else 1.0)
    with pytest.raises(PermitRefused):
        permits.begin("abcdefgh", who, sent)
    # a forged file of the server's side does not help either, for the robot compares for itself
    if attack != "no":
        forged = replace(permits.find("abcdefgh"), state="begun", key=call.key)
        (permits.folder / "abcdefgh.json").write_bytes(msgspec.json.encode(forged))
    assert await obeyed(realm, target, call, who) != ""
    assert rover.moved == second.moved == []


@pytest.mark.parametrize(
    "attack", ["", "arguments", "assistant", "stop", "expiry", "life", "no", "key", "id", "none"]
)
async def test_a_yes_that_was_given_at_another_site_is_checked_by_the_robot(realm: Any, attack: str) -> None:
    """As the gateway brings it: `test_enforced.py` has the whole way."""
    rover = Rover("rover-1")
    agent = await realm.start(rover)
    realm.rule(RULES.replace(f"'{ME}': all", "anna@lab: all"))
    call, _ = call_of(agent, "abcdefgh", x=2.0 if attack == "arguments" else 1.0)
    changes = {"life": {"life": "robot/rover-1/earlier"}, "no": {"state": "denied"}, "key": {"key": "other"},
               "id": {"id": "aaaaaaaa"}}.get(attack, {})  # fmt: skip
    begun = asked(agent, **{"state": "begun", "key": call.key, "answered": 1e6, **changes})
    if attack == "none":  # nobody looks at the state of the robot for a call that names no permit
        call, begun = replace(call, permit=""), replace(begun, id="", life="", stops=-1)
    if attack == "stop":
        await realm.client(agent).safe_stop("a hand")
        await realm.until(lambda: agent.description().stopped)
        await realm.ask_as("anna@lab", agent.address.key, Resume())
        await realm.until(lambda: not agent.description().stopped)
    if attack == "expiry":
        realm.gate.unix += GOOD
    who = "mcp/other" if attack == "assistant" else "mcp/claude"
    asking = realm.ask_as("anna@lab", agent.address.key, replace(call, vouched=begun), terminal=who)
    if attack:
        with pytest.raises(PermitRefused):
            await asking
        assert rover.moved == []
    else:
        await asking
        await realm.until(lambda: rover.moved == [1.0])


def test_a_gateway_takes_no_permit_for_a_call_that_names_none() -> None:
    forged = Permit(id="", assistant="claude", robot="r", life="", stops=-1, command="move", asked=1e6)
    for named, put_in in (("", None), ("abcdefgh", forged)):
        call = Call(key="k", command="move", deadline=5.0, permit=named, vouched=replace(forged, robot="x"))
        body = seal(call, now=1.0, within=1.0).body
        found = arrived(body, 0.0, Voucher("lab", "anna", 1), 2.0, known=False, permit=forged)
        assert found is not None
        request = read_envelope(found.body).request
        assert isinstance(request, Call)
        assert request.vouched == put_in


async def test_an_assistant_may_what_the_policy_says_and_never_resumes(realm: Any) -> None:
    agent = await realm.start(Rover("rover-1"))
    client = realm.client(agent)
    with asking_for_assistant("claude"):
        assert await client.call("look", {}) == 0
        for forbidden in (client.resume(), client.delete(), client.cancel()):
            with pytest.raises(Denied, match=r"no assistant may|allows command only"):
                await forbidden
        await client.safe_stop("its own")
    await realm.until(lambda: agent.description().stopped)
    with asking_for_assistant("claude"), pytest.raises(Denied, match="no assistant may resume"):
        await client.resume()
    assert agent.description().stopped
    for nobody in ("eve", ME, "*"):  # a name that no line of assistants has, also a person's
        with asking_for_assistant(nobody), pytest.raises(Denied):
            await client.describe()
    realm.gate.policy = None
    with asking_for_assistant("claude"), pytest.raises(Denied, match="an assistant may only what one allows"):
        await client.describe()


async def test_an_assistant_never_may_more_than_whom_it_serves(realm: Any) -> None:
    agent = await realm.start(Rover("rover-1"))
    realm.rule(RULES.replace("command: '*'", "command: rover-2"))
    with asking_for_assistant("claude"), pytest.raises(Denied, match=f"{ME} may not"):
        await realm.client(agent).call("look", {})


def test_permits_wait_for_a_while_and_not_too_many(tmp_path: Path) -> None:
    now = [1e6]
    permits = PermitFiles(tmp_path, lambda: now[0])
    one = Permit(id="abcdefgh", assistant="a", robot="r", life="l", stops=0, command="c", asked=1e6)
    for number in range(MOST_WAITING):
        permits.ask(replace(one, id=f"abcdef{number:02}", arguments={"x": number}))
    with pytest.raises(PermitRefused, match="wait already"):
        permits.ask(one)
    permits.ask(replace(one, assistant="b", id="bbbbbb"), b"\xff\xd8")
    assert PermitFiles(tmp_path, lambda: now[0]).find("bbbbbb").picture == "bbbbbb.jpg", (
        "it outlives who asked"
    )
    assert len(permits.waiting()) == MOST_WAITING + 1
    with pytest.raises(NoSuchPermit):
        permits.withdraw("bbbbbb", "a")
    now[0] += WAITS
    assert permits.waiting() == []
    with pytest.raises(PermitRefused, match="expired"):
        permits.answer("bbbbbb", yes=True, by="anna")
    with pytest.raises(NoSuchPermit):
        permits.find("../../etc/passwd")


def test_an_argument_forges_no_line_of_what_a_person_is_shown() -> None:
    forged = "a, y=0\n\nabcdefgh  rover-1.look()\n  waits\u202e \u00bb" + "x" * 5000
    one = Permit(id="abcdefgh", assistant="a", robot="r", life="l", stops=0, command="go", asked=1e6,
                 arguments={"to": forged, "x": 0.3}, units={"x": "m"})  # fmt: skip
    assert "\n" not in one.call
    assert "\u202e" not in one.call
    assert f"not shown as it is: {len(forged)} characters" in one.call
    assert one.call.count("\u00bb") == 1, "what it says stands between marks that it cannot end"
    assert one.call.endswith("x=0.3 m)")


def test_a_permit_that_nobody_could_read_is_not_kept(tmp_path: Path) -> None:
    permits = PermitFiles(tmp_path)
    one = Permit(id="abcdefgh", assistant="a", robot="r", life="l", stops=0, command="c", asked=1e6)
    for large in (replace(one, arguments={"x": "x" * 300_000}), replace(one, preview=("x" * 300_000,))):
        with pytest.raises(PermitRefused):
            permits.ask(large)
    assert [each.name for each in permits.folder.iterdir()] == [".lock"]
