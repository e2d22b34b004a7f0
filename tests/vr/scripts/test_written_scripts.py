"""Scripts as people write them: what YAML may say; one clear sentence, with a place, for what it may not."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import yaml

from robotree.vr.base.errors import BrokenScript
from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.happening import Happening, order_line
from robotree.vr.scripts.program import TAKEN
from robotree.vr.scripts.script import Script, read_program
from robotree.vr.scripts.trial import Rehearsal, read_table, run
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.conftest import EXAMPLES
from tests.vr.scripts.test_script_stories import HEAD as STORY_HEAD

HEAD = (
    "script: s\npartners: {robot: Arm}\nfacts: {cup: {id: none, n: 0, colours: []}}\n"
    "hears: {seen: {id: text, n: number}}\n"
)


def rule(when: str, then: str = "- log: x") -> str:
    lines = "".join(f"      {line}\n" for line in when.split("\n"))
    more = "".join(f"      {line}\n" for line in then.split("\n"))
    return f"{HEAD}rules:\n  - rule: r\n    when:\n{lines}    then:\n{more}"


MISTAKES = {
    "an unknown fact": (
        rule("- cat: {}"),
        "s.yaml:8:9: there is no fact or message 'cat'; this script has: cup, seen",
    ),
    "an unknown slot": (
        rule("- cup: {size: 3}"),
        "s.yaml:8:15: fact cup has no slot 'size'; it has: id, n, colours",
    ),
    "an unknown part of a message": (rule("- seen: {who: 3}"), "8:16: message seen has no 'who'"),
    "an unknown variable": (rule("- cup: {}", "- log: $who"), "10:14: variable who is not known here"),
    "a formula of many signs": (rule("- if: " + "not " * 3000 + "yes"), "8:13: more than 60 words and signs"),
    "a formula of many sums": (
        rule("- if: 1" + " + 1" * 3000 + " < 2"),
        "8:13: more than 60 words and signs",
    ),
    "a number of many digits": (rule("- cup: {n: " + "9" * 5000 + "}"), "99999… is too large a number"),
    "a time of two points": (
        rule("- cup: {}", "- wait: {name: t, for: 1.2.3 s}"),
        "'1.2.3 s' is no time: write it as `5 s`",
    ),
    "an unknown action": (
        rule("- cup: {}", "- system: rm"),
        "10:9: there is no action 'system'; there are: do,",
    ),
    "an unknown partner": (
        rule("- cup: {}", "- do: arm.wave"),
        "10:9: there is no partner 'arm'; this script has: robot",
    ),
    "an act without a partner": (rule("- cup: {}", "- do: wave"), "do is written as `do: PARTNER.ACT`"),
    "a tab": (
        rule("- cup: {}").replace("    when", "\twhen"),
        "s.yaml:7:1: a tab cannot indent here: use spaces",
    ),
    "a tab behind spaces": (
        rule("- cup: {}").replace("    when", "  \twhen"),
        "7:3: a tab cannot indent here",
    ),
    "a value that YAML reserves": (
        rule("- cup: {id: @me}"),
        "a value cannot begin with @, `, % or a tab: put it into quotes, or use spaces",
    ),
    "an invisible character": (
        rule("- cup: {id: a\u200bb}"),
        "8:20: the invisible character U+200B cannot stand here",
    ),
    "text written backwards": (rule("- cup: {id: \u202eb}"), "U+202E cannot stand here: remove it"),
    "an alias": (HEAD + "rules: &a [*a]\n", "s.yaml:5:12: an alias (*) cannot be used: write it out"),
    "a bomb of aliases": (
        "script: s\nfacts: &a {x: {y: 1}}\nhears: *a\n",
        "an alias (*) cannot be used: write it out",
    ),
    "a list of 100,000 levels": (
        "[" * 100_000,
        "s.yaml:1:18: this is nested more than 16 levels deep",
    ),
    "a list of 100,000 levels of lines": ("- " * 100_000, "s.yaml:1:35: this is nested more than 16 levels"),
    "a mapping of 100,000 levels": ("{a: " * 100_000, "s.yaml:1:66: this is nested more than 16 levels deep"),
    "100,000 complex keys": ("? " * 100_000, "this is nested more than 16 levels deep"),
    "a tag": ("script: !!python/name:os.system s\n", "a tag (!) cannot be used"),
    "a key twice": (HEAD + "doc: a\ndoc: b\n", "'doc' stands here twice"),
    "two documents": ("script: s\n---\nscript: t\n", "a second document begins here: one file holds one"),
    "a key that means nothing": (
        HEAD + "rule: []\n",
        "a script has no 'rule' (did you mean 'rules'?); it has: script, doc, partners,",
    ),
    "rules that are no list": (HEAD + "rules: {a: b}\n", "rules are a list: each begins with `- rule: NAME`"),
    "a parameter with a word too many": (
        HEAD + "parameters: {p: {defualt: 3}}\n",
        "a parameter has no 'defualt' (did you mean 'default'?)",
    ),
    "a type that is none": (HEAD.replace("id: text", "id: texts"), "'texts' is no type; the types are: text"),
    "a list that begins with something": (
        HEAD.replace("colours: []", "colours: [red]"),
        "a slot that holds several values begins empty: []",
    ),
    "a rule without then": (
        HEAD + "rules:\n  - rule: r\n    when: [start]\n",
        "rule r needs `when` and `then`",
    ),
    "two conditions in one line": (rule("- cup: {}\n  seen: {}"), "write a condition on a line of its own"),
    "two roles at once": (
        rule("- cup: {}", "- role: {robot: man, robot2: child}"),
        "two roles at once cannot be played",
    ),
    "no name": ("partners: {robot: Arm}\n", "`script: NAME` is missing"),
    "a name that the robot uses": (
        "script: s\nhears: {stop: {}, start: {}}\n",
        "'start' cannot be the name of a message",
    ),
    "no script at all": ("- a\n- b\n", "a script is written as `name: value`"),
    "nothing": ("", "s.yaml:1:1: the file is empty"),
    "a second colon": (HEAD + "doc: this: that\n", "a second ':' in one line: put the text into quotes"),
    "a formula that is none": (
        rule("- if: $n <"),
        "8:13: something is missing at the end of the formula: $n <",
    ),
    "a variable without its dollar sign": (
        rule("- cup: {n: $n}\n- if: n > 3"),
        "'n' is no number (a variable is written $n) in the formula: n > 3",
    ),
    "a fact that no condition names": (
        rule("- cup: {}\n  as: c", "- update cup: {n: 1}"),
        "no condition is named cup: write `as: cup` below the condition; named are: c",
    ),
    "a forgotten name": (rule("- cup: {}", "- forget: c"), "no condition is named c"),
    "a time that is none": (
        rule("- cup: {}", "- wait: {name: a, for: soon}"),
        "'soon' is no time: write it as `5 s`",
    ),
    "a text in a condition": (rule('- cup: {id: "a $b"}'), "a condition takes a value, or a variable alone"),
    "a number too large": (
        rule("- cup: {n: 99999999999999999999}"),
        "99999999999999999999 is too large a number",
    ),
    "nine conditions": (rule("\n".join(["- cup: {}"] * 9)), "rule r has more than 8 conditions"),
    "a made message": (rule("- cup: {}", "- remember: {msg: {act: done}}"), "msg facts come from outside"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_sentence_with_line_and_column(name: str) -> None:
    source, sentence = MISTAKES[name]
    with pytest.raises(BrokenScript) as caught:
        read_yaml(source, "s.yaml")
    assert sentence in str(caught.value)
    assert caught.value.data["line"] >= 1
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(5))
def test_no_garbled_script_raises_anything_else(seed: int) -> None:
    good = (EXAMPLES / "guide.yaml").read_text()
    chance = random.Random(seed)
    refused = 0
    for _ in range(60):
        at = chance.randrange(len(good))
        garbled = (
            good[:at]
            + chance.choice(["\t", ":", "{", "- ", "$", '"', "é", "\n", "&a ", "*a"])
            + good[at + chance.randrange(3) :]
        )
        try:
            read_yaml(garbled, "s.yaml")
        except BrokenScript:
            refused += 1
    assert refused > 10


def one(when: str, then: str, *happenings: Happening) -> list[str]:
    engine = Engine(read_yaml(rule(when, then), "s.yaml"))
    return [order_line(order) for happening in happenings for order in engine.feed(happening)]


SEEN = Happening(act="seen", sender="op", arguments=("Ä b", 3))


@pytest.mark.parametrize(
    ("when", "then", "orders"),
    [
        ("- seen: {id: $i, n: $n}\n- if: $n + 1 > 3", "- log: $i", ['log "Ä b"']),
        ("- seen: {id: $i, n: $n}\n- if: $n > 3 or $i = x", "- log: $i", []),
        ("- seen: {n: {above: 2, as: $n}}", "- log: = $n * 2 + 1", ['log "7"']),
        ("- seen: {n: {below: 3}}", "- log: x", []),
        ("- seen: {n: {at least: 3, at most: 3}}", "- log: x", ["log x"]),
        ("- seen: {id: {not: x}}", "- log: x", ["log x"]),
        ("- seen: {id: {any: [x, Ä b]}}", "- log: x", ["log x"]),
        ("- seen: {id: anything, from: $who}", '- log: "from $who, for $$5"', ['log "from op, for $5"']),
        (
            "- seen: {id: $i, n: $n}\n- no cup: {id: $i}",
            "- do: [robot, take, $i, {force: $n}]",
            ['do robot take "Ä b" force=3'],
        ),
        ("- seen: {id: $i}", "- do: robot.take\n  as: $i\n- cancel: $i", ["do robot take", "cancel Ä b"]),
        ("- seen: {}", "- wait: [tea, 2 min]", ["wait tea 120"]),
        ("- seen: {}", "- end: that is all", ['end "that is all"']),
        ("- seen: {}", "- fail: too late", ['fail "too late"']),
    ],
)  # fmt: skip
def test_what_a_rule_can_say(when: str, then: str, orders: list[str]) -> None:
    assert one(when, then, SEEN) == orders


def test_a_list_of_values_can_be_asked_for_one_of_them() -> None:
    source = rule("- cup: {id: $i, colours: {has: red}}\n- seen", "- log: $i") + (
        "begin with:\n  - cup: {id: a, colours: [blue, red]}\n  - cup: {id: b, colours: [blue]}\n"
    )
    engine = Engine(read_yaml(source, "s.yaml"))
    assert [order_line(order) for order in engine.feed(SEEN)] == ["log a"]


def test_the_listing_has_one_rule_of_clips_for_each_rule_of_yaml() -> None:
    source = (EXAMPLES / "guide.yaml").read_text()
    program = read_yaml(source, "guide.yaml")
    written = [one["rule"] for one in yaml.safe_load(source)["rules"]]
    assert [
        line.split()[1] for line in program.listing.splitlines() if line.startswith("(defrule")
    ] == written
    assert len(program.rules) == len(written)


SCRIPTS = sorted(EXAMPLES.rglob("*.test.yaml"))


def test_each_example_script_has_a_table() -> None:
    scripts = {
        path
        for path in EXAMPLES.rglob("*")
        if path.suffix in {".yaml", ".clp"} and not {".test", ".realm", ".panel"} & {*path.suffixes}
    }
    assert {path.parent / read_table(path.read_text(), path.name)[0] for path in SCRIPTS} == scripts


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_the_table_of_an_example_script(path: Path) -> None:
    script, trials = read_table(path.read_text(), path.name)
    program = read_program((path.parent / script).read_text(), script)
    for trial in trials:
        for played in run(program, trial):
            assert not played.fault, f"{trial.name}: {played.fault}"


def test_a_table_that_is_wrong_says_where_and_what_came_instead() -> None:
    program = read_yaml((EXAMPLES / "guide.yaml").read_text(), "guide.yaml")
    source = (
        "script: guide.yaml\ntests:\n  - test: t\n    steps:\n"
        "      - when: person_seen Anna hall\n        then: nothing\n"
    )
    (trial,) = read_table(source, "t.yaml")[1]
    *_, last = run(program, trial)
    assert last.fault == 'orders: do robot wave; do robot say text="Welcome, Anna"; expected: nothing'
    assert last.mark.line == 5


def test_a_table_names_the_slots_that_matter_and_shows_what_is_there_instead() -> None:
    program = read_yaml(rule("- seen: {id: $id}", "- remember: {cup: {id: $id, n: 2}}"), "s.yaml")

    def fault(fact: str) -> str:
        steps = f"    steps:\n      - when: seen anna 1\n        facts: {fact}\n"
        table = f"script: s.yaml\ntests:\n  - test: t\n{steps}"
        (trial,) = read_table(table, "t.yaml")[1]
        (played,) = run(program, trial)
        return played.fault

    assert not fault("(cup (n 2))")
    assert not fault("{cup: {n: 2}}")
    assert not fault("[{cup: {id: anna}}, {cup: {colours: []}}]")
    assert not fault("(cup (id anna) (n 2) (colours))")
    assert (
        fault("{cup: {n: 3}}")
        == "there is no fact cup: {n: 3}; there are: cup: {id: anna, n: 2, colours: []}"
    )
    assert fault("(cat (n 2))") == "there is no fact cat: {n: 2}"
    for wrong in ("cup", "(cup (n 2)", "(cup) (cup)", "{cup: {n: 2}, cat: {}}"):
        with pytest.raises(BrokenScript, match=r"t.yaml:\d+:\d+: a fact is written as `NAME: {slot: value}`"):
            fault(wrong)


def test_a_message_that_no_rule_hears_is_a_mistake_of_a_table() -> None:
    program = read_yaml(rule("- seen: {id: $id}"), "s.yaml")
    with pytest.raises(BrokenScript, match=r"the script does not hear 'sene'; do you mean 'seen'"):
        Rehearsal(program).play("sene anna 1")
    with pytest.raises(
        BrokenScript, match=r"seen needs 2 value\(s\) \(id, n\), and 3 stand here; put a text"
    ):
        Rehearsal(program).play("seen Mister Li 1")
    free = read_yaml(rule("- message: {act: $a}"), "s.yaml")
    assert Rehearsal(free).play("sene").orders == ("log x",)


@pytest.mark.parametrize(
    ("condition", "fault"),
    [("$n / 0 > 1", "it divides by zero"), ("$id > 1", "> takes numbers only")],
)
def test_a_formula_that_cannot_be_computed_names_its_rule(condition: str, fault: str) -> None:
    program = read_yaml(rule(f"- seen: {{id: $id, n: $n}}\n- if: {condition}"), "s.yaml")
    assert Rehearsal(program).play("seen anna 1").fault == f"{program.name}, in rule r: {fault}"


def test_a_happening_that_is_forgotten_is_handled_by_one_rule_only() -> None:
    source = rule("- seen: {n: $n}\n  as: m\n- cup: {id: $c}", "- forget: m\n- log: $c")
    source += "begin with:\n  - cup: {id: one}\n  - cup: {id: two}\n"
    assert len(Rehearsal(read_yaml(source, "s.yaml")).play("seen anna 1").orders) == 1


def test_a_script_does_not_grow_with_its_messages() -> None:
    engine = Engine(read_yaml((EXAMPLES / "guide.yaml").read_text(), "guide.yaml"))

    def some(count: int) -> int:
        for number in range(count):
            engine.feed(Happening(act="person_seen", sender="op", arguments=(f"p{number}", "hall")))
            engine.feed(Happening(act="person_left", sender="op", arguments=(f"p{number}",)))
        return engine.memory

    before = some(1000)
    assert some(1000) < before + 50_000


def test_no_part_of_a_script_takes_the_place_of_what_every_script_has() -> None:
    assert {name for name in dir(Script) if not name.startswith("_")} <= TAKEN
    with pytest.raises(
        BrokenScript, match=r"s.yaml:2:12: 'lead' cannot be the name of a partner: every script"
    ):
        read_yaml("script: s\npartners: {lead: Companion}\n", "s.yaml")


# -- times that are computed, roles in tables, and lines for people in the robot's log -------------


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
    STORY_HEAD
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
