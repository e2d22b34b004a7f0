"""Roles as they are written: inheritance, and one sentence for what cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.line import verbs
from robotree.tui.line.carrying import Silent
from robotree.tui.line.grammar import Line
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, CommandSpec, RobotDescription
from robotree.vr.base.errors import BrokenScript, NoRoles
from robotree.vr.scripts.roles.profile import read_profile, resolve, shipped


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
