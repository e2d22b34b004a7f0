"""How quick scripts are; prints medians, 99th percentiles and the bounds that they must keep.

python bench/scripts.py [REPETITIONS]
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import clips
from measuring import clock, count_given, quantile

from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import Engine, ScriptError
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.when_then import read_yaml

RULES, FACTS = 100, 1000


def yaml_source(facts: int = 0) -> str:
    """Return a script of 100 rules."""
    rules = "".join(
        f"  - rule: r{i}\n    when:\n      - go{i}: {{place: $p}}\n"
        f"      - place: {{id: $p, kind: k{i % 10}}}\n        as: f\n    then:\n"
        "      - do: robot.go_to\n        with: {place: $p}\n"
        for i in range(RULES)
    )
    hears = "".join(f"  go{i}: {{place: text}}\n" for i in range(RULES))
    begin = "".join(f"  - place: {{id: p{i}, kind: k{i % 10}}}\n" for i in range(facts))
    begin = f"begin with:\n{begin}" if begin else ""
    head = "script: bench\npartners: {robot: Rover}\nfacts: {place: {id: none, kind: none}}\n"
    return f"{head}hears:\n{hears}{begin}rules:\n{rules}"


ENDLESS = """
(deftemplate v (slot n))
(defrule s (msg (act start)) => (assert (v (n 1))))
(defrule a ?f <- (v (n 1)) => (retract ?f) (assert (v (n 2))))
(defrule b ?f <- (v (n 2)) => (retract ?f) (assert (v (n 1))))
"""


def crowd(facts: int) -> str:
    """Return so many facts, and a rule which must look at all of them whenever the pair fires."""
    begin = "".join(f"(place (id p{i}) (near 1))" for i in range(facts))
    look = "(defrule c (v (n ?n)) (place (id ?p) (near ?n)) (test (> ?n 9)) => (log ?p))"
    return f"(deftemplate place (slot id) (slot near)) (deffacts crowd {begin}) {look}" if facts else ""


def each(repetitions: int, action: Callable[[int], object]) -> list[float]:
    """Return how long each repetition took [s]."""
    numbers = iter(range(repetitions))
    return [taken / 1e6 for taken in clock(lambda: action(next(numbers)), repetitions)]


def show(what: str, seconds: list[float], bound: float) -> None:
    """Print one line: median, 99th percentile and bound [ms]."""
    worst, median = quantile(seconds, 0.99), statistics.median(seconds)
    kept = "" if not bound else f"bound {bound * 1e3:g} ms: {'kept' if median <= bound else 'NOT KEPT'}"
    print(f"{what:58} {median * 1e3:9.3f} {worst * 1e3:9.3f} ms  n={len(seconds)}  {kept}")


def alone() -> Callable[[int], object]:
    """Return one message through clipspy alone: assert, one firing, one callback, among as many rules."""
    environment = clips.Environment()
    environment.define_function(lambda *_: None, "do")
    environment.build("(deftemplate msg (slot act) (multislot args))")
    environment.build("(deftemplate place (slot id) (slot kind))")
    place, message = environment.find_template("place"), environment.find_template("msg")
    for i in range(RULES):
        environment.build(
            f"(defrule r{i} ?m <- (msg (act go{i}) (args ?p)) (place (id ?p) (kind k{i % 10}))"
            " => (retract ?m) (do robot ?p))"
        )
    for i in range(FACTS):
        place.assert_fact(id=clips.Symbol(f"p{i}"), kind=clips.Symbol(f"k{i % 10}"))

    def once(number: int) -> object:
        i = number % RULES
        message.assert_fact(act=clips.Symbol(f"go{i}"), args=[clips.Symbol(f"p{i}")])
        return environment.run()

    return once


def endless(tries: int, facts: int) -> list[float]:
    """Return how long it took to end two rules that set each other off, among so many facts [s]."""
    pair = read_clp(ENDLESS + crowd(facts), "x.clp", "x")
    engines = [Engine(pair, spent=time.thread_time) for _ in range(tries)]

    def once(number: int) -> None:
        try:
            engines[number].feed(Happening(act="start"))
        except ScriptError:
            return
        raise RuntimeError("two rules went on for ever and were not ended")

    return each(tries, once)


if __name__ == "__main__":
    repetitions = count_given(1, 2000)
    source = yaml_source(FACTS)
    engine = Engine(read_yaml(source, "bench.yaml"), spent=time.thread_time)

    def message(number: int) -> None:
        """Tell the rules one message; exactly one order must come out."""
        i = number % RULES
        if len(engine.feed(Happening(act=f"go{i}", sender="bench", arguments=(f"p{i}",)))) != 1:
            raise RuntimeError("a message gave no order")

    print(f"{'':58} {'median':>9} {'99 %':>9}")
    show("clipspy alone: message in, callback, 1,000 facts, 100 rules", each(repetitions, alone()), 0.0)
    show("message in to order out, 1,000 facts, 100 rules", each(repetitions, message), 200e-6)
    tries = max(repetitions // 100, 5)
    show("an endless pair of rules ended", endless(tries, 0), 0.1)
    show(f"an endless pair of rules ended, {FACTS:,} facts", endless(tries, FACTS), 0.1)
    small = yaml_source()
    show("YAML of 100 rules compiled", each(tries, lambda _: read_yaml(small, "bench.yaml")), 0.1)
