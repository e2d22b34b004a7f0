"""What the matcher does in C is bounded, and the bound changes nothing that rules do below it."""

from __future__ import annotations

import random
import resource
import threading
import time

import clips
import pytest

from robotree.vr.base.errors import BrokenScript
from robotree.vr.scripts import joins
from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import MOST_MEMORY, Engine, ScriptError
from robotree.vr.scripts.expression import show
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.program import SYSTEM, Program, template_form
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.stage import EXAMPLES

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


def rule(conditions: str) -> Program:
    return read_clp(f"{FACTS}\n(defrule crowd {conditions} => (bind ?z 1))\n{ADD}", "x.clp", "x")


@pytest.mark.speed
@pytest.mark.parametrize("name", CROWDED)
def test_no_combination_of_conditions_computes_for_long(name: str) -> None:
    engine, longest = Engine(rule(CROWDED[name])), 0.0
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
    engine, longest, over = Engine(rule(CROWDED["comparisons that all fail"])), 0.0, threading.Event()

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
            one = rule(random_program(chance)).rules[0]
        except BrokenScript:
            continue
        numbers = [chance.choices(range(3), k=4) for _ in range(6)]
        facts = [f"(p (id {i}) (n {n}) (l {a} {b}))" for i, n, a, b in numbers]
        program = rule("(p)")
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
        rule("(p (l $? ?a $? ?b $? ?c $?))")
    assert rule("(p (l $? ?a $? ?b $?))").rules


def test_rules_without_a_shared_variable_are_named() -> None:
    def found(conditions: str) -> tuple[str, ...]:
        one = joins.loose(rule(conditions).rules[0])
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
