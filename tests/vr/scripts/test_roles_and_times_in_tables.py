"""Times that are computed, roles in tables, and lines for people in the robot's log."""

from __future__ import annotations

from robotree.vr.scripts.trial import Rehearsal, read_table, run
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.test_script_stories import HEAD

TIMES = """\
script: times
parameters: {pause: 2 min}
hears: {bell: {within: text, count: number}}
rules:
  - rule: ring
    when: [bell: {within: $t, count: $n}]
    then:
      - wait: {name: told, for: $t}
      - wait: {name: counted, for: $n}
      - wait: {name: minutes, for: $n min}
      - wait: {name: chosen, for: $pause}
  - rule: over
    when: [timer: told]
    then: [log: over]
"""
ROLES = """\
script: roles.yaml
tests:
  - test: a butler bows
    roles: {robot: butler}
    steps:
      - when: go hall
        then: do robot say text="At your service"
      - when: role robot child
      - when: go hall
        then: do robot say text=Hi
        facts: {role: {partner: robot, name: child}}
  - test: without a role nobody speaks
    steps:
      - when: go hall
        then: nothing
"""
SPEAKS = (
    HEAD
    + """\
  - rule: butler
    when: [go: {place: $p}, role: {partner: robot, name: butler}]
    then: [do: [robot, say, {text: At your service}]]
  - rule: child
    when: [go: {place: $p}, role: {partner: robot, name: child}]
    then: [do: [robot, say, {text: Hi}]]
"""
)


def test_a_timer_can_wait_for_a_time_that_a_message_a_number_or_a_parameter_gives() -> None:
    rehearsal = Rehearsal(read_yaml(TIMES, "times.yaml"))
    played = rehearsal.play('bell "90 s" 3')
    assert played.orders == ("wait told 90", "wait counted 3", "wait minutes 180", "wait chosen 120")


def test_what_is_no_time_ends_the_script_with_a_sentence() -> None:
    played = Rehearsal(read_yaml(TIMES, "times.yaml")).play("bell soon 3")
    assert "in rule ring: wait told: soon is no time from 0 s to 7 days" in played.fault


def test_a_table_gives_partners_their_roles() -> None:
    program = read_yaml(SPEAKS, "roles.yaml")
    _, trials = read_table(ROLES, "roles.test.yaml")
    assert [one.fault for trial in trials for one in run(program, trial)] == ["", "", "", ""]
