"""Partners of scripts: which robot is one, groups, those that are only watched, and what they read."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Literal

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.line.known_kinds import checked_script
from robotree.vr import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.errors import BrokenScript, CommandFailed, RequirementUnreadable
from robotree.vr.base.group import RobotGroup
from robotree.vr.network.group_file import groups_beside
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.scripts.known import check_known
from robotree.vr.scripts.requirement import KnownRobot, requirement
from robotree.vr.scripts.trial import Rehearsal
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.conftest import Charged, Companion, Listed, Stage
from tests.waiting import until

# -- what a robot must be to be chosen, read and judged --------------------------------------------


R1 = KnownRobot(
    name="r1",
    kinds=("FastRover", "Rover"),
    commands=frozenset({"move"}),
    words={
        "battery": 62.0,
        "place": "hall",
        "charged": "yes",
        "x": 1.0,
        "y": -2.0,
        "colour": "red",
        "share": 0.4,
    },
)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "battery > 30 and near hall",
        "kind = Rover & battery>30",
        "kind = FastRover",
        "kind != Arm",
        "name = r1 | name = r2",
        "battery >= 62 and battery <= 62 and battery = 62",
        "not near kitchen",
        "!near kitchen",
        "near Hall",
        "near 'hall'",
        "charged",
        "colour = red",
        "colour != blue",
        "x*x + y*y < 6",
        "share > 30 %",
        "share < 50%",
        "has move and not has fly",
        "(battery > 90 or near hall) and charged",
        "place = hall",
    ],
)
def test_a_robot_fulfils_it(text: str) -> None:
    assert requirement(text).holds(R1) is True


@pytest.mark.parametrize(
    "text",
    [
        "battery > 70",
        "kind = Arm",
        "near kitchen",
        "speed > 0",
        "not charged",
        "colour > 3",
        "x / 0 > 1",
        "missing",
        "missing = 3",
        "share > 50 %",
        "has fly",
    ],
)
def test_a_robot_does_not_fulfil_it(text: str) -> None:
    assert requirement(text).holds(R1) is False


def test_a_listing_without_readings_leaves_it_open() -> None:
    listed = KnownRobot(name="r1", kinds=("Rover",), words={"place": "hall"}, whole=False)
    assert requirement("battery > 30").holds(listed) is None
    assert requirement("battery > 30 and near hall").holds(listed) is None
    assert requirement("battery > 30 and near kitchen").holds(listed) is False
    assert requirement("battery > 30 or near hall").holds(listed) is True
    assert requirement("not battery > 30").holds(listed) is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("battery >", "something is missing at the end"),
        ("battery > 30 and", "something is missing at the end"),
        ("battery > 30 near hall", "'near' is not expected"),
        ("near", "a name is missing after 'near'"),
        ("near 3", "a name is missing after 'near'"),
        ("(battery > 3", "a bracket is not closed"),
        ("battery $ 3", "'$' cannot stand"),
        ("3", "'3' alone is no condition"),
        ("kind > 3", "kind is no number"),
        ("(near hall) > 3", "a condition cannot stand where a number"),
        ("battery = (x > 3)", "a condition cannot stand where a number"),
        ("not " * 61 + "a", "more than 60 words"),
        ("(" * 13 + "a" + ")" * 13, "more than 12 brackets"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(text: str, reason: str) -> None:
    with pytest.raises(RequirementUnreadable) as refusal:
        requirement(text)
    assert reason in str(refusal.value), refusal.value
    assert "\n" not in str(refusal.value)


def test_what_was_seen_is_told_where_it_was_asked_for() -> None:
    assert requirement("battery > 30 and near hall").seen(R1) == "battery 62, place hall"
    assert requirement("speed > 3").seen(R1) == "no speed"


# -- partners that a script chooses while it leads, and releases when it is over -------------------


SCRIPT = """
script: greet
partners:
  robot: {kind: Companion, needs: [say], choose: free, where: "battery > 30 and near hall", returns: 5 s}
rules:
  - rule: hello
    when: [start]
    then: [do: [robot, say, hello]]
"""
EXPERT = """
(defscript greet "Greets."
  (partner robot (kind Companion) (needs say) (choose free) (where "battery > 30 and near hall")))
(defrule hello (msg (act start)) => (do robot say hello))
"""


@pytest.mark.parametrize(("source", "suffix"), [(SCRIPT, ".yaml"), (EXPERT, ".clp")])
async def test_a_partner_is_chosen_when_the_script_begins_and_free_when_it_is_over(
    listed: Listed, source: str, suffix: str
) -> None:
    low, fit = Charged("low", 10.0, "hall"), Charged("fit", 80.0, "hall")
    for robot in (low, fit, Charged("far", 90.0, "kitchen")):
        await listed.start(robot)
    await listed.script(source, "greet", suffix)
    assert listed.agents["fit"].description().bond is None
    running = listed.begin("greet")
    await until(lambda: bool(fit.done), "the chosen one says hello")
    slot = listed.agents["greet"].description().slot("robot")
    assert slot is not None
    assert slot.why.startswith("fit is free and has battery 80, place hall"), slot.why
    assert not low.done
    await listed.call("greet", "finish")
    await running
    await until(lambda: listed.agents["fit"].description().bond is None, "the partner is free again")


async def test_who_needs_a_partner_waits_until_one_fits(listed: Listed) -> None:
    robot = Charged("c1", 10.0, "hall")
    await listed.start(robot)
    await listed.script(SCRIPT, "greet")
    running = listed.begin("greet")
    lines = listed.agents["greet"].runtime.log.since
    await until(lambda: any("stays empty" in line.text for line in lines(0)), "it says why it waits")
    assert not robot.done
    robot.battery = 50.0
    await until(lambda: bool(robot.done), "it is chosen when it fits")
    await listed.call("greet", "finish")
    await running


# -- a group as a partner: an act goes to each member, each answers, and it ends once --------------


TEAM = """
script: team
partners:
  team: {kind: Companion, count: 3}
facts:
  said: {robot: nobody, ok: no, what: none}
hears:
  go: {place: text}
  quit: {}
rules:
  - rule: go
    when: [go: {place: $p}]
    then:
      - do: team.go_to
        with: {place: $p}
  - rule: answers
    when: [answer: {partner: team, robot: $r, ok: $ok, result: $what}]
    then: [remember: {said: {robot: $r, ok: $ok, what: $what}}]
  - rule: all
    when: [done: {partner: team, act: go_to}]
    then: [log: all of them are there]
  - rule: not-all
    when: [failed: {partner: team, act: go_to, reason: $why}]
    then: [log: $why]
  - rule: one-less
    when: [lost: {partner: team, robot: $r}]
    then: [log: we have lost $r]
  - rule: whole
    priority: 1
    when: [go: {place: $p}, no partner: {name: team, state: missing}]
    then: [log: all of us go to $p]
"""


async def led_team(stage: Stage, source: str = TEAM) -> tuple[list[Companion], asyncio.Task[object]]:
    robots = [await stage.companion(f"c{each}") for each in (1, 2, 3)]
    script = await stage.script(source, "team")
    for each in (1, 2, 3):
        await stage.enslave("team", f"team_{each}", f"c{each}")
    running = stage.begin("team")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 4)
    return robots, running


async def test_an_act_goes_to_each_member_and_ends_once_when_all_have_answered(stage: Stage) -> None:
    robots, running = await led_team(stage)
    robots[1].go.clear()
    await stage.call("team", "go", place="hall")
    await stage.until(lambda: robots[0].done and robots[2].done)
    assert "all of us go to hall" in stage.lines("team")
    assert "all of them are there" not in stage.lines("team"), "one of them is on its way"
    robots[1].go.set()
    await stage.until(lambda: "all of them are there" in stage.lines("team"))
    assert [robot.done for robot in robots] == [["go_to hall at 0.5"]] * 3
    facts = await stage.call("team", "facts")
    assert all(f"said: {{robot: c{each}, ok: yes" in facts for each in (1, 2, 3)), facts
    await stage.call("team", "finish")
    await running


async def test_who_does_not_do_it_is_named_and_the_others_have_done_it(stage: Stage) -> None:
    robots, running = await led_team(stage)
    robots[2].fails = "go_to"
    await stage.call("team", "go", place="hall")
    await stage.until(
        lambda: any(line.startswith("1 of 3 did not do it: c3: ") for line in stage.lines("team"))
    )
    assert [bool(robot.done) for robot in robots] == [True, True, False]
    facts = await stage.call("team", "facts")
    assert "said: {robot: c3, ok: no" in facts, facts
    await stage.call("team", "finish")
    await running


async def test_a_member_that_is_lost_is_left_out(stage: Stage) -> None:
    robots, running = await led_team(stage)
    await stage.release("team", "team_2")
    await stage.until(lambda: "we have lost c2" in stage.lines("team"))
    await stage.call("team", "go", place="hall")
    await stage.until(lambda: "all of them are there" in stage.lines("team"))
    assert [bool(robot.done) for robot in robots] == [True, False, True]
    assert "all of us go to hall" not in stage.lines("team")
    await stage.call("team", "finish")
    await running


async def test_a_failure_of_a_group_that_no_rule_handles_ends_the_script(stage: Stage) -> None:
    source = TEAM.replace("failed: {partner: team, act: go_to", "failed: {partner: team, act: wave")
    robots, running = await led_team(stage, source)
    robots[0].fails = "go_to"
    await stage.call("team", "go", place="hall")
    with pytest.raises(CommandFailed, match=r"team.go_to failed \(1 of 3 did not do it: c1: "):
        await running


GROUPED = """
script: pair
partners:
  pair: {kind: Companion, count: 2, group: hall, where: "battery > 30"}
rules:
  - rule: hello
    when: [start]
    then: [do: [pair, say, hello]]
  - rule: over
    when: [done: {partner: pair, act: say}]
    then: [end: both have said it]
"""
EXPERT_PAIR = """
(defscript pair "A pair."
  (partner pair (kind Companion) (count 2) (group hall) (choose free) (where "battery > 30")))
(defrule hello (msg (act start)) => (do pair say hello))
(defrule over (msg (perf inform) (from pair) (act done)) => (end "both have said it"))
"""


@pytest.mark.parametrize(("source", "suffix"), [(GROUPED, ".yaml"), (EXPERT_PAIR, ".clp")])
async def test_the_partners_are_chosen_among_the_members_of_a_group_of_the_realm(
    tmp_path: Path, source: str, suffix: str
) -> None:
    stage = Listed()
    stage.network.gate = PolicyFile(tmp_path)
    await stage.open()
    groups_beside(stage.network.gate).write(RobotGroup(name="hall", names=("a", "b", "low")))
    robots = {
        name: Charged(name, battery, "hall")
        for name, battery in {"a": 80.0, "b": 60.0, "low": 10.0, "stranger": 90.0}.items()
    }
    for robot in robots.values():
        await stage.start(robot)
    await stage.script(source, "pair", suffix)
    assert await stage.begin("pair") == "both have said it"
    assert [name for name, robot in robots.items() if robot.done] == ["a", "b"]
    await until(lambda: stage.agents["a"].description().bond is None, "they are free again")
    await stage.close()


@pytest.mark.parametrize(
    ("partner", "reason"),
    [
        ("{kind: Companion, choose: best}", "'best' is no way to choose a partner"),
        ('{kind: Companion, where: "battery > 3"}', "a partner with a where is chosen"),
        ('{kind: Companion, choose: free, where: "battery >"}', "something is missing at the end"),
        ("{kind: Companion, group: hall}", "partner robot is of group hall: say how many"),
        ("{kind: Companion, count: 0}", "'0' is no number of robots"),
        ("{kind: Companion, count: many}", "'many' is no number of robots"),
        ("{kind: Companion, count: 2, group: '-'}", "'-'"),
    ],
)
async def test_a_choice_or_a_group_that_cannot_be_a_partner_is_refused_with_its_place(
    stage: Stage, partner: str, reason: str
) -> None:
    with pytest.raises(BrokenScript, match=reason) as refusal:
        await stage.script(f"script: greet\npartners:\n  robot: {partner}\n", "greet")
    assert refusal.value.data["line"] == 3


# -- a partner that is only watched: its readings are known, and nothing is taken from who commands it


WATCHES = """
script: guard
partners:
  cart: {kind: Cart, watch: yes}
  robot: {kind: Companion, needs: [say]}
rules:
  - rule: low
    when: [reading: {partner: cart, name: battery, value: {below: 0.2}}]
    then: [do: [robot, say, the cart is empty]]
"""


class Cart(Robot):
    """A cart."""

    battery = 0.9

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery}

    @command
    def load(self) -> None:
        """Take something on."""


async def test_the_readings_of_a_watched_partner_reach_the_rules_and_it_stays_free(stage: Stage) -> None:
    robot, cart = await stage.companion(), Cart("cart")
    agent = await stage.start(cart)
    script = await stage.script(WATCHES, "guard")
    await stage.enslave("guard", "robot", "c1")
    assert script.condition == "inactive: needs cart (Cart)"
    await stage.enslave("guard", "cart", "cart")
    running = stage.begin("guard")
    await stage.until(lambda: script.condition == "active")
    assert agent.runtime.lease is None, "watching takes no lease"
    await stage.call("cart", "load")
    assert robot.done == []
    cart.battery = 0.1
    await stage.until(lambda: bool(robot.done), within=60.0)
    assert robot.done == ["say the cart is empty [plain]"]
    await stage.call("guard", "finish")
    await running


def test_what_is_only_watched_is_asked_nothing() -> None:
    source = WATCHES.replace("do: [robot, say, the cart is empty]", "do: [cart, load]")
    with pytest.raises(BrokenScript, match="cart is only watched, and is asked nothing"):
        check_known(read_yaml(source, "guard.yaml"), {})
    with pytest.raises(BrokenScript, match="partner cart is only watched: it has no needs"):
        read_yaml(WATCHES.replace("watch: yes", "watch: yes, needs: [load]"), "guard.yaml")


@pytest.mark.parametrize("given", ["pictures", "[pictures, force]"])
def test_a_script_that_wants_streams_of_who_is_watched_is_told_that_it_has_readings(given: str) -> None:
    with pytest.raises(BrokenScript, match=r"watch is yes or no; .* has the readings, and no streams"):
        read_yaml(WATCHES.replace("watch: yes", f"watch: {given}"), "guard.yaml")


@pytest.mark.parametrize("watch", ["", ", watch: yes"])
def test_a_reading_that_is_a_stream_is_refused_where_it_stands(watch: str) -> None:
    source = (
        f"script: guard\npartners:\n  arm: {{kind: Arm{watch}}}\nrules:\n  - rule: pushed\n"
        "    when: [reading: {partner: arm, name: force, value: {above: 3}}]\n    then: [end: it is pushed]\n"
    )
    sentence = r"guard.yaml:6:\d+: force is a stream of arm, and no reading: a page with Watch"
    with pytest.raises(BrokenScript, match=sentence):
        checked_script(source, "guard.yaml")
    assert checked_script(source.replace("force", "fz"), "guard.yaml") == 1


def test_the_role_of_a_service_passes_the_checks_though_it_is_nearly_one_that_comes_along() -> None:
    source = WATCHES.replace("[do: [robot, say, the cart is empty]]", "[role: {robot: desk-butler}]")
    assert checked_script(source, "guard.yaml") == 1
    with pytest.raises(BrokenScript, match="there is no role 'buttler'"):
        checked_script(source.replace("desk-butler", "buttler"), "guard.yaml")


# -- what a partner reads and what its commands take are facts -------------------------------------


TIRED = """\
script: small
partners: {robot: {kind: Companion}}
facts:
  asked: {place: none}
hears:
  go: {place: text}
rules:
  - rule: tired
    when:
      - reading: {partner: robot, name: battery, value: {below: 0.2}}
      - no asked: {place: dock}
    then:
      - remember: {asked: {place: dock}}
      - do: robot.go_to
        with: {place: dock}
  - rule: known
    when:
      - go: {place: $p}
      - choice: {partner: robot, argument: place, value: $p}
    then:
      - do: robot.go_to
        with: {place: $p}
  - rule: unknown
    when:
      - go: {place: $p}
      - no choice: {partner: robot, argument: place, value: $p}
    then:
      - log: "where is $p?"
"""


class Tired(Companion):
    """A companion that publishes how full its battery is."""

    battery = 0.9

    @classmethod
    def kinds(cls) -> tuple[str, ...]:
        return ("Companion", *super().kinds())

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery, "x": 1.0}

    @command
    def go_to(self, place: Literal["hall", "dock"]) -> None:  # type: ignore[override]
        """Go to a place."""
        self.note(f"go_to {place}")


async def led_tired(stage: Stage) -> tuple[Tired, Any]:
    robot = Tired("c1")
    await stage.start(robot)
    script = await stage.script(TIRED)
    await stage.enslave("guide", "robot", "c1")
    stage.begin("guide")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 2)
    return robot, script


async def test_a_reading_that_the_robot_publishes_is_a_fact_and_each_new_value_is_told(stage: Stage) -> None:
    robot, script = await led_tired(stage)
    await stage.until(lambda: "(value 0.9)" in " ".join(script._run.engine.facts()))
    assert robot.done == []
    robot.battery = 0.15
    await stage.until(lambda: robot.done == ["go_to dock"])
    facts = await stage.call("guide", "facts")
    assert "reading: {partner: robot, name: battery, value: 0.15}" in facts
    assert "value: 0.9" not in facts, "the old one is gone"
    assert "name: x" not in facts, "no rule is about it"
    await stage.release("guide", "robot")
    await stage.until(lambda: script._run is None)


async def test_the_choices_of_a_partners_commands_are_facts(stage: Stage) -> None:
    robot, _ = await led_tired(stage)
    await stage.call("guide", "go", place="moon")
    await stage.until(lambda: "where is moon?" in stage.lines("guide"))
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: robot.done == ["go_to hall"])


def test_a_table_tells_readings_and_knows_the_places_of_the_kind() -> None:
    rehearsal = Rehearsal(read_yaml(TIRED, "small.yaml"), choices={"Companion": [("place", "sofa")]})
    assert rehearsal.play("reading robot battery 0.5").orders == ()
    assert rehearsal.play("reading robot battery 0.15").orders == ("do robot go_to place=dock",)
    assert rehearsal.play("reading robot battery 0.14").orders == ()
    assert rehearsal.play("go sofa").orders == ("do robot go_to place=sofa",)
    assert rehearsal.play("go moon").orders == ('log "where is moon?"',)


def test_an_argument_that_no_command_takes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(
        TIRED.replace("no choice: {partner: robot, argument: place", "no choice: {argument: palce")
    )
    assert main(["rules", "check", str(path)]) != exit_codes.DONE
    assert "no act takes 'palce'; do you mean 'place'?" in capsys.readouterr().err
