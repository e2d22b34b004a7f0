"""What a partner reads and what its commands take are facts: battery, places, things."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.vr import command
from robotree.vr.scripts.trial import Rehearsal
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.stage import Companion, Stage

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


async def led(stage: Stage) -> tuple[Tired, Any]:
    robot = Tired("c1")
    await stage.start(robot)
    script = await stage.script(TIRED)
    await stage.enslave("guide", "robot", "c1")
    stage.begin("guide")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 2)
    return robot, script


async def test_a_reading_that_the_robot_publishes_is_a_fact_and_each_new_value_is_told(stage: Stage) -> None:
    robot, script = await led(stage)
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
    robot, _ = await led(stage)
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
