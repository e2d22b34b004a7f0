"""A script leads robots: figure 4 of the NBSA paper, and what the paper claims of scripts and roles."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from robotree import kinds
from robotree.vr.agents.host import Host
from robotree.vr.author.kind import promises_of
from robotree.vr.base.errors import (
    BadArgument,
    BrokenScript,
    CommandFailed,
    NoRoles,
    NoSuchRole,
    UnderWay,
)
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.scripts import run
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.roles import read_profile, resolve
from robotree.vr.scripts.roles.profile import shipped
from robotree.vr.scripts.run import LONGEST
from robotree.vr.scripts.trial import Rehearsal, read_table
from robotree.vr.scripts.trial import run as run_trial
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.conftest import EXAMPLES, Companion, Stage

GUIDE = (EXAMPLES / "guide.yaml").read_text()
HEAD = "script: small\npartners:\n  robot: Companion\nhears:\n  go: {place: text}\nrules:\n"
GO = (
    HEAD
    + "  - rule: go\n    when: [go: {place: $p}]\n    then:\n"
    + "      - do: robot.go_to\n        with: {place: $p}\n"
)


async def led(
    stage: Stage, source: str = GO, name: str = "guide"
) -> tuple[Companion, Any, asyncio.Task[Any]]:
    """Return a companion, the script that leads it, and the running start."""
    robot, script = await stage.companion(), await stage.script(source, name)
    await stage.enslave(name, "robot", "c1")
    running = stage.begin(name)
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 2)
    return robot, script, running


async def test_a_message_goes_through_the_rules_to_the_robot_and_its_end_comes_back(stage: Stage) -> None:
    robot, script = await stage.companion(), await stage.script(GUIDE)
    assert script.condition == "inactive: needs robot (Companion)"
    running = stage.begin("guide")
    await stage.until(lambda: script._run is not None and script._run.missing)
    with pytest.raises(CommandFailed, match=r"it is inactive: needs robot"):
        await stage.call("guide", "person_seen", who="Anna", place="kitchen")
    await stage.enslave("guide", "robot", "c1")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened)
    await stage.call("guide", "person_seen", who="Anna Maria", place="kitchen")
    await stage.until(lambda: len(robot.done) == 4)
    assert robot.done == [
        "wave 1",
        "say Welcome, Anna Maria [plain]",
        "go_to kitchen at 0.5",
        "say Here is the kitchen. [plain]",
    ]
    await stage.call("guide", "finish")
    assert await running == "finished on request"
    assert script.condition == "ready"


async def test_a_script_that_leads_is_not_started_twice(stage: Stage) -> None:
    _, script, running = await led(stage)
    with pytest.raises(UnderWay, match=r"guide.start already runs or waits for its turn, called by operator"):
        await stage.call("guide", "start")
    await stage.call("guide", "finish")
    stage.begin("guide")  # it waits for the end of the first one
    assert await running == "finished on request"
    await stage.until(lambda: script._run is not None and script._run.engine.happened >= 2)
    with pytest.raises(UnderWay):
        await stage.call("guide", "start")


async def test_a_script_that_failed_can_still_be_asked_why(stage: Stage) -> None:
    robot, script, running = await led(stage)
    robot.fails = "go_to"
    await stage.call("guide", "go", place="hall")
    with pytest.raises(
        CommandFailed, match=r"robot.go_to failed \(.*a motor is hot.*\) and no rule handles it"
    ):
        await running
    await stage.until(lambda: script.condition == "ready")
    assert "a motor is hot" in script.attributes["ended"]
    assert "  go: {place: hall, from: operator" in await stage.call("guide", "why", rule="go")
    told = await stage.call("guide", "facts")
    assert "a motor is hot" in told
    assert "partner: {name: robot, robot: c1, state: here}" in told


async def test_a_script_is_listed_described_and_commanded_like_any_robot(stage: Stage) -> None:
    await stage.script(GUIDE)
    robot = stage.agents["guide"].description()
    assert robot.kinds[:3] == ("Guide", "Script", "VirtualRobot")
    assert [command.name for command in robot.commands if command.name.startswith("person")] == [
        "person_seen",
        "person_left",
    ]
    assert [field.name for field in robot.command("start").parameters] == ["welcome", "patience"]
    assert robot.slot("robot").kind == "Companion"
    with pytest.raises(BadArgument, match=r"guide.person_seen: place: is missing"):
        await stage.call("guide", "person_seen", who="Anna")


async def test_a_script_starts_and_leads_another_script(stage: Stage) -> None:
    robot, small = await stage.companion(), await stage.script(GO, "small")
    above = (
        "script: boss\npartners:\n  team: Small\nrules:\n"
        "  - rule: begin\n    when: [start]\n    then: [do: [team, start], do: [team, go, hall]]\n"
        "  - rule: not-yet\n    when: [failed: {act: go}]\n    then: [wait: {name: again, for: 20 ms}]\n"
        "  - rule: again\n    when: [timer: again]\n    then: [do: [team, go, hall]]\n"
        "  - rule: over\n    when: [done: {act: go}]\n    then: [wait: {name: end, for: 200 ms}]\n"
        "  - rule: end\n    when: [timer: end]\n    then: [end: it is told]\n"
    )
    await stage.script(above, "boss")
    await stage.enslave("small", "robot", "c1")
    await stage.enslave("boss", "team", "small")
    assert await stage.call("boss", "start") == "it is told"
    assert robot.done == ["go_to hall at 0.5"]
    await stage.until(lambda: small.condition == "ready")  # it ended with the act of the one that led it


async def test_an_act_that_the_robot_does_not_have_is_a_failure_in_the_facts(stage: Stage) -> None:
    source = HEAD.replace("rules:", "rules:\n  - rule: fly\n    when: [go]\n    then: [do: robot.fly]")
    source += "  - rule: no-wings\n    when: [failed: {act: fly, reason: $why}]\n    then: [end: $why]\n"
    _, _, running = await led(stage, source)
    await stage.call("guide", "go", place="hall")
    assert "has no command 'fly'" in await running


async def test_a_lost_partner_ends_the_script_and_its_acts(stage: Stage) -> None:
    robot, _, running = await led(stage)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
    await stage.release("guide", "robot")
    with pytest.raises(
        CommandFailed, match=r"robot is lost \(it was released\) and no rule of small handles it"
    ):
        await running
    await stage.until(lambda: not stage.agents["c1"].description().busy)
    assert robot.done == []


async def test_a_partner_without_what_is_needed_does_not_make_a_script_active(stage: Stage) -> None:
    source = GO.replace("robot: Companion", "robot: {kind: Companion, needs: [fly]}")
    await stage.companion()
    script = await stage.script(source)
    await stage.enslave("guide", "robot", "c1")
    assert script.condition == "inactive: needs robot (Companion): c1 has no fly"


async def test_only_those_who_may_start_a_script_start_it(stage: Stage) -> None:
    await stage.script(GO.replace("hears:", "start: {by: [butler]}\nhears:"))
    with pytest.raises(CommandFailed, match=r"operator may not start it; those may: butler"):
        await stage.call("guide", "start")


async def test_a_request_waits_for_the_answer_of_a_rule(stage: Stage) -> None:
    source = HEAD.replace("rules:", "rules:\n  - rule: answer\n    when:\n") + (
        "      - message: {performative: request, act: ready, conversation: $c, arguments: [$who]}\n"
        '    then: [reply: [$c, agree, "yes, $who"]]\n'
        "  - rule: refuse\n    when:\n"
        "      - message: {performative: request, act: dance, conversation: $c}\n"
        "    then: [reply: [$c, refuse, it has no legs]]\n"
    )
    await led(stage, source)
    answer = await stage.call("guide", "message", act="ready", arguments="Anna", performative="request")
    assert answer == "agree yes, Anna"
    with pytest.raises(CommandFailed, match=r"refuse: it has no legs"):
        await stage.call("guide", "message", act="dance", performative="request")
    with pytest.raises(CommandFailed, match=r"no rule answered within 0.1 s"):
        await stage.call("guide", "message", act="sing", performative="request", reply_by=0.1)


async def test_a_script_that_floods_is_ended_with_one_sentence(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "MOST_A_SECOND", 20)  # also a busy machine does so many
    source = HEAD + (
        "  - rule: begin\n    when: [go: {place: $p}]\n    then: [do: [robot, fly, $p]]\n"
        "  - rule: again\n    when: [failed: {act: fly}]\n    then: [do: [robot, fly, again]]\n"
    )
    robot, _, running = await led(stage, source)
    await stage.call("guide", "go", place="hall")
    with pytest.raises(CommandFailed, match=r"it floods: more than 20 orders in one second"):
        await running
    assert robot.done == []


async def test_who_floods_a_script_is_refused(stage: Stage) -> None:
    _, script, _ = await led(stage)
    with script._run.lock:  # the rules are at work for a long time
        message = Happening(act="go", arguments=("x",))
        script._run.put(message)
        while script._run.inbox:  # noqa: ASYNC110 # the rules take one, and wait for the lock with it
            await asyncio.sleep(0)
        script._run.inbox.extend([message] * LONGEST)
        with pytest.raises(
            CommandFailed,
            match=r"guide.go failed: it is flooded: too many messages wait for its rules; send fewer",
        ):
            await stage.call("guide", "go", place="hall")


# -- roles -------------------------------------------------------------------------------------------


async def test_the_next_act_follows_a_new_role_and_the_script_is_untouched(stage: Stage) -> None:
    robot, script, running = await led(stage, GUIDE)
    before, rules = script.program.hash, script.program.listing
    robot.go.clear()
    await stage.call("guide", "person_seen", who="Anna", place="kitchen")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
    assert await stage.call("guide", "play", role="child") == "child"
    robot.go.set()
    await stage.until(lambda: len(robot.done) == 4)
    assert robot.done[:2] == ["wave 1", "say Welcome, Anna [plain]"]
    assert robot.done[2] == "go_to kitchen at 0.5", "an act that runs goes on as it began"
    assert robot.done[3] == "say Look, the kitchen. [child-1]"
    await stage.call("guide", "person_seen", who="Bob", place="hall")
    await stage.until(lambda: len(robot.done) == 8)
    assert robot.done[4:7] == ["wave with both arms", "say Hi, Bob [child-1]", "go_to hall at 0.3"]
    assert (script.program.hash, script.program.listing) == (before, rules)
    assert not running.done()


async def test_a_rule_changes_the_role_of_a_partner(stage: Stage) -> None:
    source = HEAD + (
        "  - rule: play\n    when: [go]\n    then: [role: {robot: child}, do: [robot, say, Welcome]]\n"
        "  - rule: played\n    when:\n      - done: {act: say, result: $said}\n"
        "      - role: {partner: robot, name: $r}\n    then: [end: $r says $said]\n"
    )
    robot, _, running = await led(stage, source)
    await stage.call("guide", "go", place="x")
    assert await running == "child says Hi"
    assert robot.role == "child"


async def test_two_roles_at_once_are_refused_in_one_sentence(stage: Stage) -> None:
    source = HEAD + (
        "  - rule: one\n    when: [go]\n    then: [role: {robot: child}]\n"
        "  - rule: two\n    when: [go]\n    then: [role: {robot: man}]\n"
    )
    robot, _, running = await led(stage, source)
    await stage.call("guide", "go", place="x")
    with pytest.raises(
        CommandFailed, match=r"robot is given two roles at once \((man and child|child and man)\)"
    ):
        await running
    assert robot.role == "neutral"


async def test_an_unknown_role_and_a_robot_without_roles_are_refused(stage: Stage) -> None:
    await stage.companion()
    with pytest.raises(NoSuchRole, match=r"c1 knows no role 'king'; it knows: neutral, butler, child"):
        await stage.call("c1", "play", role="king")
    await stage.script(GO)
    with pytest.raises(NoRoles, match=r"none of its partners plays roles"):
        await stage.call("guide", "play", role="child")


async def test_a_robot_that_a_script_leads_learns_a_role_through_it(stage: Stage) -> None:
    robot, _, _ = await led(stage)
    assert await stage.call("guide", "learn_role", source="role: waiter\ninherits: butler\n") == "waiter"
    await stage.call("guide", "play", role="waiter")
    assert robot.attributes["role"] == "waiter"


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("limits: {sped: 0.3}", "role w limits 'sped', and c1 has no such limit; it has: speed, distance"),
        ("manner: {speed: fast}", "role w: speed must be a number, not 'fast'"),
        ("acts: {go_to: {speed: yes}}", "role w: speed must be a number, not True"),
    ],
)
async def test_a_limit_that_would_not_be_kept_is_refused(stage: Stage, line: str, sentence: str) -> None:
    await stage.companion()
    with pytest.raises(BrokenScript, match=sentence):
        await stage.call("c1", "learn_role", source=f"role: w\n{line}\n")


async def test_a_role_can_only_narrow_a_safety_limit(stage: Stage) -> None:
    await stage.companion()
    await stage.call("c1", "play", role="child")
    with pytest.raises(BadArgument, match=r"speed: 0.5 is above 0.3, the limit of c1 as child"):
        await stage.call("c1", "go_to", place="hall", speed=0.5)
    from robotree.vr.base.errors import TooWide

    with pytest.raises(TooWide, match=r"role racer: speed 2 is wider than the 0.7 of c1"):
        await stage.call("c1", "learn_role", source="role: racer\nlimits: {speed: 2}\n")
    with pytest.raises(TooWide, match=r"role hugger: distance 0.1 is wider than the 0.5 of c1"):
        await stage.call("c1", "learn_role", source="role: hugger\nlimits: {distance: 0.1}\n")
    with pytest.raises(TooWide, match=r"role teen: speed 0.6 is wider than the 0.3 of role child"):
        await stage.call("c1", "learn_role", source="role: teen\ninherits: child\nlimits: {speed: 0.6}\n")


# -- scripts that ask people -----------------------------------------------------------------------


ASKS = """
script: asker
hears:
  ring: {who: text}
facts:
  let: {who: none, in: none, by: none}
rules:
  - rule: ask
    when: [ring: {who: $w}]
    then:
      - ask: {question: "May $w come in?", answers: [yes, later]}
        as: $w
  - rule: hear
    when: [answered: {answer: $a, by: $by, conversation: $w}]
    then: [remember: {let: {who: $w, in: $a, by: $by}}]
"""


async def asked(stage: Stage, *names: str) -> tuple[Any, asyncio.Task[Any]]:
    script = await stage.script(ASKS, "asker")
    running = stage.begin("asker")
    await stage.until(lambda: script._run is not None and script._run.engine.happened)
    for name in names:
        await stage.call("asker", "ring", who=name)
    await stage.until(lambda: not names or "question" in script.attributes)
    return script, running


async def test_a_question_is_shown_and_its_answer_reaches_the_rules(stage: Stage) -> None:
    script, running = await asked(stage, "Anna")
    shown = stage.agents["asker"].description().attributes
    assert (shown["question"], shown["answers"]) == ("May Anna come in?", "yes | later")
    with pytest.raises(CommandFailed, match="'perhaps' is no answer to that; there are: yes, later"):
        await stage.call("asker", "answer", answer="perhaps")
    await stage.call("asker", "answer", answer="later", question="Anna")
    await stage.until(lambda: "question" not in script.attributes)
    assert "let: {who: Anna, in: later, by: operator}" in await stage.call("asker", "facts")
    with pytest.raises(CommandFailed, match="that question waits for no answer any more"):
        await stage.call("asker", "answer", answer="yes", question="Anna")
    with pytest.raises(CommandFailed, match="it asks nothing"):
        await stage.call("asker", "answer", answer="yes")
    await stage.call("asker", "finish")
    await running


async def test_several_questions_wait_in_their_order_and_each_has_one_answer(stage: Stage) -> None:
    script, running = await asked(stage, "Anna", "Bela")
    await stage.until(lambda: script.attributes.get("asked") == "and 1 more")
    ends = await asyncio.gather(
        *(stage.call("asker", "answer", answer="yes", question="Anna") for _ in range(4)),
        return_exceptions=True,
    )
    assert sum(end is None for end in ends) == 1, ends
    assert (await stage.call("asker", "facts")).count("let: {who: Anna") == 1
    await stage.until(lambda: script.attributes.get("question") == "May Bela come in?")
    await stage.call("asker", "finish")
    await running
    assert "question" not in script.attributes, "a script that has ended asks nothing"


def test_a_table_of_tests_knows_questions_and_answers() -> None:
    played = Rehearsal(read_yaml(ASKS, "asker.yaml"))
    assert played.play("ring Anna").orders == ('ask "May Anna come in?" yes later',)
    assert played.play("answered yes as Anna").fault == ""
    assert "(let (who Anna) (in yes) (by operator))" in " ".join(played.engine.facts())


NUMBERS = """
script: foreman
hears:
  order: {number: number}
facts:
  open: {number: 0}
rules:
  - rule: ask
    when: [order: {number: $n}]
    then:
      - remember: {open: {number: $n}}
      - ask: "Shall order $n begin?"
        as: $n
      - wait: {name: silence, for: 1 min, conversation: $n}
  - rule: hear
    when: [answered: {answer: $a, conversation: $n}, open: {number: $n}]
    then: [log: "order $n: $a"]
  - rule: give-up
    when: [timer: {name: silence, conversation: $n}, open: {number: $n}]
    then: [cancel: $n, log: "nobody answers of order $n"]
"""


@pytest.mark.parametrize("number", ["7", "2.5"])
def test_what_is_asked_under_a_number_is_heard_under_that_number(number: str) -> None:
    """A conversation is a text on its way, and a number again for the rules."""
    played = Rehearsal(read_yaml(NUMBERS, "foreman.yaml"))
    assert played.play(f"order {number}").fault == ""
    assert played.play(f"answered yes from Anna as {number}").fired == ("hear",)
    assert played.play(f"timer silence as {number}").fired == ("give-up",)


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ("ask: {answers: [a]}", "the question"),
        ("ask: {question: x, answer: [a]}", "ask has no 'answer'"),
        ("ask: x\n        with: {a: b}", "only `do` has `with`"),
    ],
)
def test_a_question_that_cannot_be_asked_is_refused(action: str, reason: str) -> None:
    source = f"script: s\nrules:\n  - rule: r\n    when: [start]\n    then:\n      - {action}\n"
    with pytest.raises(BrokenScript, match=reason):
        read_yaml(source, "s.yaml")


# -- what the guide shows is so: its script and its table are taken from it and played -------------


PAGE = (Path(__file__).parents[3] / "docs" / "scripts.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


def test_the_first_script_of_the_guide_passes_the_table_of_the_guide() -> None:
    script, table, _ = BLOCKS
    program = read_yaml(script, "doorman.yaml")
    name, trials = read_table(table, "doorman.test.yaml")
    assert name == "doorman.yaml"
    played = [one for trial in trials for one in run_trial(program, trial)]
    assert [one.fault for one in played] == [""] * 4


def test_the_dry_run_of_the_guide_greets_whoever_comes() -> None:
    rehearsal = Rehearsal(read_yaml(BLOCKS[0], "doorman.yaml"))
    assert rehearsal.play('bell "Mister Li"').orders == ('do robot say text="Welcome, Mister Li"',)


def test_the_role_of_the_guide_can_be_played() -> None:
    waiter = read_profile(BLOCKS[2], "waiter.yaml")
    known = {**shipped(), waiter.name: waiter}
    role = resolve("waiter", known)
    assert role.chain == ("waiter", "butler", "man")
    assert role.manner["voice"] == "man-2"
    assert role.manner["pitch"] == 0.8
    assert role.words["Welcome"] == "Your table is ready"


def test_the_companion_of_the_guide_loads_and_plays_its_roles() -> None:
    (page,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    robot = Bundle(page, "companion.py").create("companion")
    assert robot.play(role="child") == "child"
    assert robot.way_to("wave").__name__ == "_wave_as_child"
    assert robot.manner_of("wave").number("speed", 0.5) == 0.3


def test_the_guide_names_the_acts_places_and_things_of_the_companion() -> None:
    (section,) = re.findall(r"## What the companion can do\n(.*?)\n## ", PAGE, re.DOTALL)
    commands = {one.name: one for one in promises_of(kinds.Companion)}
    rows = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    acts = {act for row in rows for act in re.findall(r"`(\w+)`", row)}
    others = {"play", "learn_role", "roles", "listen", "heard", "reach"}
    assert acts == commands.keys() - others
    for act, argument, title in (("go_to", "place", "Places"), ("take", "what", "Things")):
        (told,) = re.findall(rf"{title}: (.*?)(?:\.|$)", section)
        assert set(re.findall(r"`([\w ]+)`", told)) == {*commands[act].by_name[argument].choices}


# -- scripts of both forms, made by a host of their source, as `robotree create` does it -----------


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
async def hosted() -> AsyncIterator[Hosted]:
    hosted = Hosted()
    await hosted.open()
    yield hosted
    await hosted.host.close()
    await hosted.close()


async def test_rules_of_clips_come_from_a_host_and_lead_a_robot(hosted: Hosted) -> None:
    robot = await hosted.companion()
    client = await hosted.create(Bundle.read(EXAMPLES / "receptionist.clp"), "desk")
    described = await client.describe()
    assert described.kinds[:2] == ("Receptionist", "Script")
    assert described.attributes["condition"].startswith("inactive: needs ")
    (slot,) = (one.name for one in described.slots if not one.optional)
    await hosted.enslave("desk", slot, "c1")
    running = hosted.begin("desk")
    script = hosted.agents["desk"].robot
    await hosted.until(lambda: script._run is not None and script._run.engine.happened >= 2)
    await hosted.call("desk", "person_seen", who="Anna", place="kitchen")
    await hosted.until(lambda: "go_to kitchen at 0.5" in robot.done)
    await hosted.call("desk", "finish")
    assert await running == "finished on request"


async def test_a_script_that_starts_itself_waits_for_its_partner_and_leads_it(hosted: Hosted) -> None:
    await hosted.create(Bundle(ITSELF, "watch.yaml"), "watch")
    script = hosted.agents["watch"].robot
    await hosted.until(lambda: script._run is not None, within=5.0)
    assert script.condition == "inactive: needs robot (Companion)"
    robot = await hosted.companion()
    await hosted.enslave("watch", "robot", "c1")
    await hosted.until(lambda: script.attributes.get("ended") == "said")
    assert robot.done == ["say I am awake [plain]"]


@pytest.mark.parametrize(
    ("source", "name", "sentence"),
    [
        ("(defrule a => (system ls))", "bad.clp", r"bad.clp:1:15: .*system"),
        ("script: bad\n\tpartners: {}\n", "bad.yaml", r"bad.yaml:2:1: .*tab"),
    ],
)
async def test_a_host_says_where_a_script_is_wrong(
    hosted: Hosted, source: str, name: str, sentence: str
) -> None:
    with pytest.raises(BrokenScript, match=sentence):
        await hosted.create(Bundle(source, name), "bad")
    assert not hosted.host.agents
