"""What the guide shows is so: its script and its table are taken from it and played."""

from __future__ import annotations

import re
from pathlib import Path

from robotree import kinds
from robotree.vr.author.kind import promises_of
from robotree.vr.bundle import Bundle
from robotree.vr.scripts.roles import read_profile, resolve
from robotree.vr.scripts.roles.profile import shipped
from robotree.vr.scripts.trial import Rehearsal, read_table, run
from robotree.vr.scripts.when_then import read_yaml

GUIDE = (Path(__file__).parents[3] / "docs" / "scripts.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```yaml\n(.*?)```", GUIDE, re.DOTALL)


def test_the_first_script_of_the_guide_passes_the_table_of_the_guide() -> None:
    script, table, _ = BLOCKS
    program = read_yaml(script, "doorman.yaml")
    name, trials = read_table(table, "doorman.test.yaml")
    assert name == "doorman.yaml"
    played = [one for trial in trials for one in run(program, trial)]
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
    (page,) = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    robot = Bundle(page, "companion.py").create("companion")
    assert robot.play(role="child") == "child"
    assert robot.way_to("wave").__name__ == "_wave_as_child"
    assert robot.manner_of("wave").number("speed", 0.5) == 0.3


def test_the_guide_names_the_acts_places_and_things_of_the_companion() -> None:
    (section,) = re.findall(r"## What the companion can do\n(.*?)\n## ", GUIDE, re.DOTALL)
    commands = {one.name: one for one in promises_of(kinds.Companion)}
    rows = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    acts = {act for row in rows for act in re.findall(r"`(\w+)`", row)}
    others = {"play", "learn_role", "roles", "listen", "heard", "reach"}
    assert acts == commands.keys() - others
    for act, argument, title in (("go_to", "place", "Places"), ("take", "what", "Things")):
        (told,) = re.findall(rf"{title}: (.*?)(?:\.|$)", section)
        assert set(re.findall(r"`([\w ]+)`", told)) == {*commands[act].by_name[argument].choices}
