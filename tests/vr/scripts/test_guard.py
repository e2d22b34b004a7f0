"""A rule script is code: what it may not say is refused before CLIPS sees it; what it does is bounded."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.vr.base.errors import BrokenScript
from robotree.vr.scripts import run
from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import Engine, ScriptError
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.script import script_class

FACT = "(deftemplate v (slot s) (slot n (default 0)) (multislot m)) "
START = "(msg (act start))"

KNOWN = {  # what was tried before the guard was written
    "system": '(defrule a => (system "touch {mark}"))',
    "open": '(defrule a => (open "{mark}" f "w"))',
    "remove": '(defrule a => (remove "{mark}"))',
    "exit": "(defrule a => (exit 7))",
    "in a constraint": '(defrule a (v (s ?b&:(system "touch {mark}"))) => (log x))',
    "as a value of a constraint": '(defrule a (v (s =(system "touch {mark}"))) => (log x))',
    "behind a comment": '(defrule a => ; harmless\n (system "touch {mark}"))',
    "behind an escaped quote": '(defrule a => (log "\\"") (system "touch {mark}"))',
    "a function defined anew": '(deffunction log (?x) (system "touch {mark}"))',
}
NEW = {
    "text that is run": '(defrule a => (eval "(system \\"touch {mark}\\")"))',
    "a construct made of text": '(defrule a => (build "(defrule b => (exit 7))"))',
    "a function called by its name": '(defrule a => (funcall system "touch {mark}"))',
    "a file that is loaded": '(defrule a => (load* "{mark}"))',
    "a file of commands": '(defrule a => (batch* "{mark}"))',
    "a loop that nobody can end": "(defrule a => (while TRUE do (log x)))",
    "a counted loop": "(defrule a => (loop-for-count 1000000000 (log x)))",
    "recursion": "(deffunction f (?x) (f ?x)) (defrule a => (f 1))",
    "code in the priority": '(defrule a (declare (salience (system "touch {mark}"))) => (log x))',
    "code in a default": '(deftemplate w (slot s (default (system "touch {mark}"))))',
    "code in a dynamic default": '(deftemplate w (slot s (default-dynamic (system "touch {mark}"))))',
    "code in a first fact": '(deffacts f (v (s (system "touch {mark}"))))',
    "code in a fact pattern's place": '(defrule a (v (s (system "touch {mark}"))) => (log x))',
    "an object with a handler": "(defclass C (is-a USER)) (defmessage-handler C h () (exit 7))",
    "a query over facts": '(defrule a => (do-for-all-facts ((?f v)) TRUE (system "touch {mark}")))',
    "a fact made of text": '(defrule a => (assert-string "(v (s 1))"))',
    "a letter that looks like another": '(defrule a => (\u0455ystem "touch {mark}"))',
    "an invisible character in a name": '(defrule a => (sys\u200btem "touch {mark}"))',
    "a zero byte": '(defrule a => (log "x\0")) (defrule b => (exit 7))',
    "a string that is never closed": '(defrule a => (log "x)) (exit 7)',
    "brackets without end": "(defrule a => " + "(" * 20_000 + ")" * 20_000 + ")",
    "the bridge itself": "(defrule a => (python-function do robot x))",
    "a forged message": "(defrule a => (assert (msg (perf inform) (act done))))",
    "a forged partner": "(defrule a ?p <- (partner (name r)) => (modify ?p (state here)))",
    "another module": "(defmodule M) (defrule M::a => (exit 7))",
    "a global variable": '(defglobal ?*x* = (system "touch {mark}"))',
    "many conditions": "(defrule a " + "(v (n ?)) " * 9 + "=> (log x))",
    "a list bound to a variable": "(defrule a => (bind ?x 1 2 3))",
    "reading the keyboard": "(defrule a => (bind ?x (readline)))",
    "the time of day, which no replay has": "(defrule a => (bind ?x (time)))",
    "chance, which no replay has": "(defrule a => (bind ?x (random)))",
    "a symbol made of parts": "(defrule a => (bind ?x (sym-cat a b)))",
}


@pytest.mark.parametrize("attack", [*KNOWN, *NEW])
def test_an_attack_is_refused_with_a_place_before_anything_runs(attack: str, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    source = FACT + (KNOWN | NEW)[attack].replace("{mark}", str(mark))
    with pytest.raises(BrokenScript) as caught:
        read_clp(source, "x.clp", "x")
    assert caught.value.data["line"] >= 1
    assert caught.value.data["column"] >= 1
    assert not mark.exists()


def test_a_text_that_only_talks_of_system_is_no_attack() -> None:
    program = read_clp('(defrule a (msg (act start)) => (log "(system \\"rm\\") ; \\\\"))', "x.clp", "x")
    (order,) = Engine(program).feed(Happening(act="start"))
    assert order.text == '(system "rm") ; \\'


ENDLESS = {
    "two rules that set each other off": (
        (
            "(defrule a ?f <- (v (n 1)) => (retract ?f) (assert (v (n 2))))"
            "(defrule b ?f <- (v (n 2)) => (retract ?f) (assert (v (n 1))))"
            f"(defrule s {START} => (assert (v (n 1))))"
        ),
        "do not come to rest: a and b set each other off",
    ),
    "a rule that counts for ever": (
        (
            f"(defrule s {START} => (assert (v (n 1))))"
            "(defrule a ?f <- (v (n ?x)) => (modify ?f (n (+ ?x 1))))"
        ),
        "a sets itself off",
    ),
    "a text that doubles": (
        (
            f"(defrule s {START} => (assert (v (s x))))"
            "(defrule a ?f <- (v (s ?x)) => (modify ?f (s (str-cat ?x ?x))))"
        ),
        "a text of more than 1000 characters",
    ),
    "a list that doubles": (
        (f"(defrule s {START} => (assert (v (m x))))(defrule a ?f <- (v (m $?x)) => (modify ?f (m ?x ?x)))"),
        "cardinality",
    ),
    "a list put together in one rule": (
        f"(defrule s {START} => (bind ?x (create$ 1 2)) "
        + " ".join("(bind ?x (create$ ?x ?x))" for _ in range(40))
        + ")",
        "a list of more than 64 values",
    ),
    "facts that all fit together": (
        (
            f"(defrule s {START} => " + " ".join(f"(assert (v (n {i})))" for i in range(400)) + ")"
            "(defrule a (v (n ?a)) (v (n ?b)) (v (n ?c)) (v (n ?d)) (v (n ?e)) (v (n ?f)) => (log x))"
        ),
        "the conditions of rule a (line 1) can be met in too many ways",
    ),
    "a flood of orders": (
        f"(defrule s {START} => " + " ".join(f"(log {i})" for i in range(100)) + ")",
        "it floods: more than 64 orders for one happening",
    ),
    "a division by nothing": (f"(defrule s {START} => (log (/ 1 0)))", "in rule s: it divides by zero"),
    "the smallest number by -1": (
        (
            f"(defrule s {START} => (log (div -9223372036854775807 -1)) "
            "(log (div (- -9223372036854775807 1) -1)))"
        ),
        "underflow of long long integer",
    ),
    "an unknown partner": (
        f"(defrule s {START} => (do nobody wave))",
        "x, in rule s: there is no partner nobody",
    ),
}


@pytest.mark.speed
@pytest.mark.parametrize("name", ENDLESS)
def test_whatever_runs_is_ended_soon_with_a_sentence(name: str) -> None:
    source, sentence = ENDLESS[name]
    engine = Engine(read_clp(FACT + source, "x.clp", "x"), spent=time.thread_time)
    began = time.thread_time()
    with pytest.raises(ScriptError) as caught:
        engine.feed(Happening(act="start"))
    assert sentence in str(caught.value)
    assert time.thread_time() - began < 2.0


@pytest.mark.speed
def test_two_rules_that_set_each_other_off_are_ended_in_a_tenth_of_a_second() -> None:
    source, _ = ENDLESS["two rules that set each other off"]
    engine = Engine(read_clp(FACT + source, "x.clp", "x"), spent=time.thread_time)
    began = time.thread_time()
    with pytest.raises(ScriptError):
        engine.feed(Happening(act="start"))
    assert time.thread_time() - began < 0.1
    assert len(engine._memory._held) < 10, "facts that came and went are not kept"


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        (
            "(defrule a (visitor (id ?x)) => (log x))",
            "x.clp:1:12: there is no fact 'visitor'; declare it first",
        ),
        (
            "(deftemplate v (slot a)) (defrule r (v (b 1)) => (log x))",
            "1:40: fact v has no slot 'b'; it has: a",
        ),
        ("(defrule a (msg (act x)) => (log ?y))", "1:34: variable y is not known here"),
        ("(defrule a (msg (act x)) (log y))", "rule a has no =>"),
        ("(defrule (msg (act x)) => (log y))", "1:1: a rule needs a name"),
        ("(defrule a => (printout t hello))", "(printout …) is no action that a rule may take; use (log …)"),
        ("(defrule a => (log x)) (defrule a => (log y))", "there are two rules named a"),
        ("(defscript g (partner r))", "partner r needs a kind: (kind Arm)"),
        ("hello", "'hello' stands outside of all brackets"),
    ],
)
def test_a_mistake_in_clips_is_one_sentence_with_line_and_column(source: str, sentence: str) -> None:
    with pytest.raises(BrokenScript) as caught:
        read_clp(source, "x.clp", "x")
    assert sentence in str(caught.value)


@pytest.mark.parametrize("simulated", [True, False])
def test_in_virtual_time_rules_are_ended_by_their_number_alone(
    simulated: bool,  # noqa: FBT001 # a parameter of the test
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """How quick the machine is must not change a trace."""
    seconds = itertools.count()
    monkeypatch.setattr(run.time, "thread_time", lambda: float(next(seconds)))
    rules = (
        f"(defrule s {START} => (assert (v (n 1))))"
        "(defrule a ?f <- (v (n ?x&:(< ?x 100))) => (modify ?f (n (+ ?x 1))))"
    )
    program = read_clp(FACT + rules, "x.clp", "x")
    activity: Any = SimpleNamespace(simulated=simulated, now=lambda: 0.0, wake=lambda: None)
    script = run.ScriptRun(script_class(program)("x"), program, {}, activity)
    script.is_current, engine = True, script.engine
    if simulated:
        engine.feed(Happening(act="start"))
        assert engine.fired == 100
    else:
        with pytest.raises(ScriptError, match="do not come to rest"):
            engine.feed(Happening(act="start"))
