"""The rules at work: which fires next, how much the matcher may do, and what is told about them."""

from __future__ import annotations

import random
import resource
import threading
import time

import clips
import pytest

from robotree.vr.base.errors import BrokenScript
from robotree.vr.scripts import explain, joins
from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import MOST_MEMORY, Engine, ScriptError
from robotree.vr.scripts.explain import in_words
from robotree.vr.scripts.expression import show
from robotree.vr.scripts.happening import Happening, order_line
from robotree.vr.scripts.program import SYSTEM, Program, template_form
from robotree.vr.scripts.trial import Rehearsal
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.conftest import EXAMPLES

# -- which rule fires next: priority, then the order of the script, then the age of the facts ------


CUPS = (
    "script: order\nfacts: {cup: {id: none, state: table}, guest: {who: none}}\n"
    "hears: {go: {}, come: {who: text}}\n"
    "begin with:\n  - cup: {id: a}\n  - cup: {id: b}\n  - cup: {id: c}\nrules:\n"
)


def logged(rules: str, *happenings: Happening) -> list[str]:
    engine = Engine(read_yaml(CUPS + rules, "order.yaml"))
    orders = [order for happening in happenings for order in engine.feed(happening)]
    return [order_line(order).removeprefix("log ") for order in orders]


def rule_of_cups(name: str, *conditions: str, then: str = "log: $id", priority: int = 0) -> str:
    whens = "".join(f"      - {condition}\n" for condition in conditions)
    return f"  - rule: {name}\n    priority: {priority}\n    when:\n{whens}    then:\n      - {then}\n"


CUP = "cup: {id: $id}"


@pytest.mark.parametrize("conditions", [("go", CUP), (CUP, "go")], ids=["happening first", "happening last"])
def test_the_oldest_fact_is_first_wherever_its_condition_stands(conditions: tuple[str, str]) -> None:
    assert logged(rule_of_cups("all", *conditions), Happening(act="go")) == ["a", "b", "c"]


def test_of_two_rules_the_higher_one_in_the_script_is_first_and_a_priority_goes_before() -> None:
    rules = (
        rule_of_cups("one", "go", CUP, then='log: "1 $id"')
        + rule_of_cups("two", "go", CUP, then='log: "2 $id"')
        + rule_of_cups("urgent", "go", then="log: urgent", priority=3)
        + rule_of_cups("last", "go", then="log: last", priority=-3)
    )
    wanted = ["urgent", '"1 a"', '"1 b"', '"1 c"', '"2 a"', '"2 b"', '"2 c"', "last"]
    assert logged(rules, Happening(act="go")) == wanted


def test_a_fact_that_was_changed_keeps_its_age() -> None:
    change = "  - rule: change\n    when:\n      - come\n      - cup: {id: a}\n        as: c\n"
    rules = change + "    then: [update c: {state: used}]\n" + rule_of_cups("all", "go", CUP)
    assert logged(rules, Happening(act="come", arguments=("x",)), Happening(act="go")) == ["a", "b", "c"]


def test_what_a_rule_causes_waits_until_those_before_it_have_fired_unless_it_is_more_urgent() -> None:
    guest = "remember: {guest: {who: $id}}"
    rules = rule_of_cups("all", "go", CUP, then=guest) + rule_of_cups("seen", "guest: {who: $id}")
    assert logged(rules, Happening(act="go")) == ["a", "b", "c"]
    both = rule_of_cups("all", "go", CUP, then="log: $id\n      - " + guest)
    urgent = both + rule_of_cups("seen", "guest: {who: $id}", then='log: "seen $id"', priority=1)
    assert logged(urgent, Happening(act="go")) == ["a", '"seen a"', "b", '"seen b"', "c", '"seen c"']


# -- what the matcher does in C is bounded, and the bound changes nothing that rules do below it ---


FACTS = "(deftemplate p (slot id) (slot n) (multislot l)) (deftemplate q (slot only)) (deftemplate m (multislot l))"  # noqa: E501
ADD = (
    "(defrule add (msg (act add) (args ?i)) => (assert (p (id ?i) (n 1) (l ?i)) (q (only ?i)) (m (l ?i x))))"
)
LONGEST = 0.5
"""[s] of processor time for one happening, whatever it compares (measured: 0.1 on a busy machine)."""

CROWDED = {
    "four conditions without a variable": "(p) (p) (p) (p)",
    "four conditions with variables of their own": "(p (id ?a)) (p (id ?b)) (p (id ?c)) (p (id ?d))",
    "comparisons that all fail": "(p (id ?a)) (p (id ?b)) (p (id ?c)) (p (n ?n&:(> ?n (+ ?a ?b ?c 1000))))",
    "a value that no slot has": "(p (id ?a)) (p (id ?b)) (p (n ?c)) (p (n ~?c))",
    "a fact that must not be there": "(p (id ?a)) (p (id ?b)) (p (id ?c)) (not (p (n ?n&:(> ?n (+ ?a ?b ?c 1000)))))",  # noqa: E501
    "the only slot is one of two": "(q (only ?a)) (q (only ?b)) (q (only ?c)) (not (q (only =(- -1 ?a)|=(- -1 ?b))))",  # noqa: E501
    "lists alone": "(m (l ?a x)) (m (l ?b x)) (m (l ?c x)) (not (m (l $?q&:(> (length$ ?q) (+ ?a ?b ?c 1000)))))",  # noqa: E501
    "alternatives": "(p (id ?a)) (or (p (id ?b)) (q (only ?b))) (p (id ?c)) (p (id ?d))",
    "conditions inside a not": "(not (and (p (id ?a)) (p (id ?b)) (p (id ?c)) (p (n ?n&:(> ?n (+ ?a ?b ?c 1000))))))",  # noqa: E501
    "conditions inside a forall": "(p (id ?a)) (forall (p (id ?b)) (p (id ?c&:(> (+ ?c ?a) ?b))) (p (id ?d)) (p (n ?d)))",  # noqa: E501
    "a variable that all share": "(p (n ?n)) (p (n ?n)) (p (n ?n)) (p (n ?n) (id ?i&:(> ?n ?i)))",
    "the fact as the variable": "?f <- (p) ?g <- (p) ?h <- (p) (test (neq ?f ?g ?h))",
}


def crowded_rule(conditions: str) -> Program:
    return read_clp(f"{FACTS}\n(defrule crowd {conditions} => (bind ?z 1))\n{ADD}", "x.clp", "x")


@pytest.mark.speed
@pytest.mark.parametrize("name", CROWDED)
def test_no_combination_of_conditions_computes_for_long(name: str) -> None:
    engine, longest = Engine(crowded_rule(CROWDED[name])), 0.0
    said, number = "", 0
    while not said and number < 2000:
        began, number = time.thread_time(), number + 1
        try:
            engine.feed(Happening(act="add", arguments=(number,)))
        except ScriptError as error:
            said = str(error)
        longest = max(longest, time.thread_time() - began)
    assert longest < LONGEST
    assert engine.memory < MOST_MEMORY + 16_000_000
    assert "rule crowd" in said or "64 MB" in said or "do not come to rest: crowd sets itself off" in said


def test_the_sentence_names_the_rule_its_conditions_and_the_facts() -> None:
    begin = "\n".join(f"  - place: {{id: p{number}}}" for number in range(200))
    whens = "".join(f"      - place: {{id: ${name}}}\n" for name in "abcd")
    source = (
        "script: crowd\nfacts: {place: {id: none}, seen: {who: none}}\nhears: {look: {}}\n"
        f"begin with:\n{begin}\nrules:\n  - rule: pairs\n    when:\n      - look\n{whens}    then: [log: $a $b $c $d]\n"  # noqa: E501
    )
    engine = Engine(read_yaml(source, "crowd.yaml"))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ScriptError) as ended:
        engine.feed(Happening(act="look"))
    assert str(ended.value) == (
        "crowd: the conditions of rule pairs (line 206) can be met in too many ways, more than 50,000 were compared "  # noqa: E501
        "for one happening; facts that fit are 1 for msg (line 208), 200 for place (line 209), 200 for place (line "  # noqa: E501
        "210), 200 for place (line 211), 200 for place (line 212): let the conditions share a variable, or forget facts"  # noqa: E501
    )
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 40_000, "[kB]"


@pytest.mark.speed
def test_other_threads_of_the_process_go_on_meanwhile() -> None:
    """The interpreter is held for none of it: the other robots of a host answer."""
    engine, longest, over = Engine(crowded_rule(CROWDED["comparisons that all fail"])), 0.0, threading.Event()

    def fill() -> None:
        for number in range(2000):
            engine.feed(Happening(act="add", arguments=(number,)))

    def crowd() -> None:
        with pytest.raises(ScriptError):
            fill()
        over.set()

    thread = threading.Thread(target=crowd)
    thread.start()
    before = time.perf_counter()
    while not over.is_set():
        now = time.perf_counter()
        longest, before = max(longest, now - before), now
    thread.join()
    assert longest < LONGEST


def random_program(chance: random.Random) -> str:
    def slot(name: str) -> str:
        known = chance.sample("abc", 2)
        return chance.choice((
            f"({name} ?{known[0]})", f"({name} ~?a)", f"({name} ?x{chance.randrange(3)}&:(< ?a ?a))",
            f"({name} {chance.randrange(3)})", f"({name} 1|2)", f"({name} ?a&~1)", "", "",
        ))  # fmt: skip

    def pattern() -> str:
        return f"(p {slot('id')} {slot('n')} {chance.choice(('', '', '(l $? ?a $?)', '(l ?a)', '(l $?)'))})"

    def condition() -> str:
        plain, other = pattern(), pattern()
        return chance.choice((
            plain, plain, plain, f"(not {plain})", f"(exists {plain})", f"(or {plain} {other})",
            f"(not (and {plain} {other}))", f"(forall {plain} {other})", f"(and {plain} {other})",
        ))  # fmt: skip

    return f"(p (id ?a)) {' '.join(condition() for _ in range(chance.randrange(1, 4)))}"


def matched(built: str, facts: list[str], *functions: str) -> list[str]:
    environment = clips.Environment()
    for template in (*SYSTEM, *read_clp(FACTS, "x.clp", "x").templates):
        environment.build(template_form(template))
    for function in functions:
        environment.build(function)
    environment.build(built)
    for fact in facts:
        environment.assert_string(fact)
    return sorted(str(activation) for activation in environment.activations())


@pytest.mark.parametrize("cases", [150, pytest.param(5000, marks=pytest.mark.soak)])
def test_a_rule_that_counts_its_comparisons_is_met_by_the_same_facts(cases: int) -> None:
    chance, tried, met = random.Random(17), 0, 0
    for _ in range(cases):
        try:
            one = crowded_rule(random_program(chance)).rules[0]
        except BrokenScript:
            continue
        numbers = [chance.choices(range(3), k=4) for _ in range(6)]
        facts = [f"(p (id {i}) (n {n}) (l {a} {b}))" for i, n, a, b in numbers]
        program = crowded_rule("(p)")
        built = joins.bounded(one.form, 0, program.template)
        try:
            plain = matched(show(one.form), facts)
        except clips.CLIPSError:
            continue  # CLIPS does not take it
        assert built is not None
        function = joins.join_function(0)
        crowded = f"(deffunction {joins.CROWDED} (?rule) FALSE)"
        assert matched(show(built), facts, joins.counter(), crowded, function) == plain, show(one.form)
        tried, met = tried + 1, met + bool(plain)
    assert tried > cases / 3
    assert met > tried / 5, "many rules must be met by something"


def test_a_list_that_fits_in_too_many_ways_is_refused() -> None:
    """One fact with 64 values can be split into five parts in 766,480 ways."""
    with pytest.raises(BrokenScript, match=r"a list is split in too many ways"):
        crowded_rule("(p (l $? ?a $? ?b $? ?c $?))")
    assert crowded_rule("(p (l $? ?a $? ?b $?))").rules


def test_rules_without_a_shared_variable_are_named() -> None:
    def found(conditions: str) -> tuple[str, ...]:
        one = joins.loose(crowded_rule(conditions).rules[0])
        return () if one is None else one.kinds

    assert found("(p (id ?a)) (p (id ?b))") == ("p", "p")
    assert found("(p (id ?a)) (p (id ?b)) (q (only ?c))") == ("p", "p", "q")
    assert found("(p (id ?a) (n ?b)) (p (id ?b) (n ?c)) (p (id ?c))") == ()
    assert found("(msg (act add) (args ?x)) (p (id ?b))") == (), "one happening, so many facts"
    assert found("(p (id ?a)) (not (p (n 3)))") == (), "what is not there multiplies nothing"


@pytest.mark.parametrize(
    ("path", "meant"), [("guide.yaml", []), ("receive.yaml", []), ("companion/evening.yaml", ["fetch"])]
)
def test_the_shipped_scripts_join_nothing_loosely_but_what_is_meant(path: str, meant: list[str]) -> None:
    """Any cup is for any visitor who waits: there are three, and few visitors."""
    program = read_yaml((EXAMPLES / path).read_text(), path)
    assert [one.rule for one in map(joins.loose, program.rules) if one] == meant


def test_many_facts_that_no_condition_above_calls_for_are_not_compared() -> None:
    """1,000 facts for 100 rules: without the message none of them is joined with anything."""
    rules = "".join(
        f"(defrule r{i} (msg (act go) (args ?a)) (p (id ?a) (n {i})) => (log x))" for i in range(100)
    )
    facts = "".join(f"(p (id {i}) (n {i % 100}))" for i in range(1000))
    engine = Engine(read_clp(f"{FACTS} {rules} (deffacts begin {facts})", "x.clp", "x"))
    assert engine._compared.value == 0
    engine.feed(Happening(act="go", arguments=(7,)))
    assert 1 <= engine._compared.value <= 1000, "those with the same hash, of each rule"


# -- what is told about a rule that fired, and about one that does not fire ------------------------


SMALL = """
script: small
partners: {robot: Companion}
parameters: {most: 2}
hears: {bell: {who: text, times: number}}
facts: {count: {guests: 0}, cup: {id: none, stage: full}}
begin with: [{count: {guests: 1}}, {cup: {id: a}}, {cup: {id: b, stage: empty}}]
rules:
- rule: r
  then: [log: x]
  when:
  - """


@pytest.mark.parametrize(
    ("when", "told"),
    [
        ("count: {guests: {above: 3}}", "no fact fits; the nearest is count: {guests: 1}"),
        ("count: {guests: {above: $most}}", "no fact fits; the nearest is count: {guests: 1}"),
        ("cup: {id: a, stage: empty}", "no fact fits; the nearest is cup: {id: b, stage: empty}"),
        ("no cup: {id: a}", "there is such a fact, and there must be none"),
        ("no cup: {id: $any}", "there is such a fact, and there must be none"),
        ("if: $most > 3", "this is not true"),
        ("bell: {who: $who}", "this has not just happened"),
        ("role: {name: child}", "there is no fact role"),
    ],
)
def test_a_rule_that_does_not_fire_names_its_condition_and_what_it_lacks(when: str, told: str) -> None:
    engine = Rehearsal(read_yaml(SMALL + when, "s.yaml")).engine
    assert explain.why(engine, "r").splitlines() == [
        "r does not fire now:",
        f"  line 12: {when}",
        f"    {told}",
    ]


@pytest.mark.parametrize(
    ("second", "told"),
    [
        ("cup: {id: a, stage: $s}", "no fact fits this together with the conditions above it"),
        ("no cup: {stage: $s}", "there is such a fact, and there must be none"),
    ],
)
def test_conditions_that_only_fail_together_name_the_first_that_does_not_fit(second: str, told: str) -> None:
    source = f"{SMALL}cup: {{id: b, stage: $s}}\n  - {second}"
    engine = Rehearsal(read_yaml(source, "s.yaml")).engine
    assert explain.why(engine, "r").splitlines()[1:] == [f"  line 13: {second}", f"    {told}"]


def test_a_rule_that_fired_names_what_made_it_fire() -> None:
    rehearsal = Rehearsal(read_yaml((EXAMPLES / "guide.yaml").read_text(), "guide.yaml"))
    rehearsal.play('person_seen "Mister Li" hall')
    told = explain.why(rehearsal.engine, "note-a-visitor").splitlines()
    assert told[:3] == [
        "note-a-visitor fired last at happening 3 of 3, because of",
        '  person_seen: {who: "Mister Li", place: hall, from: operator}',
        "  no visitor: {id: $who}",
    ]
    shown = explain.state(rehearsal.engine)
    assert 'visitor: {id: "Mister Li", place: hall, stage: greeted}' in shown
    assert "parameters: {welcome: Welcome}" in shown, "as the head of the script writes it"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("start", "start"),
        ("bell Anna 3", "bell: {who: Anna, times: 3, from: operator}"),
        ("done robot say hi as Anna", "done: {partner: robot, act: say, result: hi, conversation: Anna}"),
        ('failed robot say "too hot"', 'failed: {partner: robot, act: say, reason: "too hot"}'),
        ("progress robot go_to 0.5", "progress: {partner: robot, act: go_to, fraction: 0.5}"),
        ("lost robot", 'lost: {partner: robot, robot: robot, reason: "it was lost"}'),
        ("timer bored as Anna", "timer: {name: bored, conversation: Anna}"),
    ],
)
def test_what_happened_is_shown_as_a_condition_would_name_it(line: str, shown: str) -> None:
    source = SMALL.replace("  - ", "  - message: {act: $act}")
    rehearsal = Rehearsal(read_yaml(source, "s.yaml"))
    assert not rehearsal.play(line).fault
    assert explain.why(rehearsal.engine, "r").splitlines()[1] == f"  {shown}"


def test_the_rules_that_fire_next_are_named() -> None:
    engine = Engine(
        read_yaml(
            f"{SMALL}no role: {{name: child}}".replace("- rule: r", "- rule: r\n  priority: 5"), "s.yaml"
        )
    )
    assert "\nnext (1):\n  r\n" in explain.state(engine)


def test_an_expert_reads_clips() -> None:
    source = "(deftemplate cup (slot id)) (defrule r (msg (act start)) (not (cup (id a))) => (log x))"
    engine = Engine(read_clp(source, "s.clp", "s"))
    assert explain.why(engine, "r").splitlines()[1:] == [
        "  line 1: (msg (act start))",
        "    this has not just happened",
    ]
    assert in_words("(cup (id a))", engine.program) == "(cup (id a))"
