"""Information: answers questions from facts that people, robots and other services have told it.

    robotree service examples/services/information.py facts on host-1
    robotree call facts.tell subject="red cup" relation=in object=table
    robotree call facts.tell subject=table relation=in object=kitchen
    robotree call facts.find relation=in object=kitchen          red cup, table
    robotree call facts.why subject="red cup" relation=in object=kitchen

What follows from the facts, CLIPS works out (`robotree[services]`). The facts themselves are state of the
page: on a host they outlive the run, a kill of the host and a move to another one. Without `on HOST` the
service has a process of its own, which keeps nothing.
"""

from dataclasses import dataclass
from typing import Annotated

import clips

from robotree.vr import CommandFailed, Range, Service, Unit, Watch, command, state

MOST = 1000
"""Facts that were told; what follows from them is not counted."""
LONGEST = 100
"""Characters of a word."""
TEMPLATE = "(deftemplate fact (slot subject) (slot relation) (slot object) (multislot because))"
RULES = (
    """(defrule what-is-in-a-thing-is-where-that-is
         (fact (subject ?a) (relation in) (object ?b))
         (fact (subject ?b) (relation in) (object ?c))
         (test (neq ?a ?c))
         (not (fact (subject ?a) (relation in) (object ?c)))
         => (assert (fact (subject ?a) (relation in) (object ?c)
              (because (str-cat ?a " in " ?b) (str-cat ?b " in " ?c)))))""",
    """(defrule what-is-near-is-near-both-ways
         (fact (subject ?a) (relation near) (object ?b))
         (not (fact (subject ?b) (relation near) (object ?a)))
         => (assert (fact (subject ?b) (relation near) (object ?a) (because (str-cat ?a " near " ?b)))))""",
    """(defrule who-has-something-is-where-it-is
         (fact (subject ?who) (relation has) (object ?what))
         (fact (subject ?who) (relation in) (object ?where))
         (not (fact (subject ?what) (relation in) (object ?where)))
         => (assert (fact (subject ?what) (relation in) (object ?where)
              (because (str-cat ?who " has " ?what) (str-cat ?who " in " ?where)))))""",
)
"""What follows from what. Another service brings other rules."""

Word = Annotated[str, "a name or a word"]


@dataclass(frozen=True)
class Fact:
    """One fact: a subject, how it is related, and to what."""

    subject: str
    relation: str
    object: str

    def __str__(self) -> str:
        """Return it in words."""
        return f"{self.subject} {self.relation} {self.object}"


class Information(Service):
    """Knows facts, and what follows from them."""

    eyes = Watch("Recogniser", "who tells where things are", optional=True)
    facts: list[Fact] = state([])

    def readings(self) -> dict[str, float]:
        """See `Robot.readings`."""
        return {"facts": float(len(self.facts))}

    @command(offline="queue")
    def tell(self, subject: Word, relation: Word, object: Word) -> int:  # noqa: A002 # as people say it
        """Tell a fact; returns how many there are."""
        fact = Fact(*(self.checked(word) for word in (subject, relation, object)))
        if fact not in self.facts:
            if len(self.facts) >= MOST:
                raise self.failed(f"it knows {MOST} facts already; have it forget some")
            self.facts = [*self.facts, fact]
        return len(self.facts)

    @command(offline="queue")
    def forget(self, subject: Word, relation: str = "", object: str = "") -> int:  # noqa: A002
        """Forget what was told of a subject; returns how many facts are left."""
        self.facts = [
            each
            for each in self.facts
            if each.subject != subject
            or relation not in ("", each.relation)
            or object not in ("", each.object)
        ]
        return len(self.facts)

    @command(effect="read", offline="memory")
    def known(self) -> list[str]:
        """Tell all facts that were told."""
        return [str(each) for each in self.facts]

    @command(effect="read")
    def ask(self, subject: Word, relation: Word) -> list[str]:
        """Tell to what a subject is related."""
        return sorted(
            {fact.object for fact in self.all() if (fact.subject, fact.relation) == (subject, relation)}
        )

    @command(effect="read")
    def find(self, relation: Word, object: Word) -> list[str]:  # noqa: A002
        """Tell what is related to an object."""
        return sorted(
            {fact.subject for fact in self.all() if (fact.relation, fact.object) == (relation, object)}
        )

    @command(effect="read")
    def why(self, subject: Word, relation: Word, object: Word) -> list[str]:  # noqa: A002
        """Tell from which facts another one follows; none: it was told."""
        because = self.all().get(Fact(subject, relation, object))
        if because is None:
            raise self.failed(f"nothing says that {subject} {relation} {object}")
        return list(because)

    @command(effect="read")
    def answer(self, question: Annotated[str, "where is X, who is in X, what is in X"]) -> str:
        """Answer a question in words."""
        words = question.strip().rstrip("?").lower().split()
        match words:
            case ["where", "is", *rest] if rest:
                return self.phrase(self.ask(_name(rest), "in"), "I do not know")
            case [("who" | "what"), "is", ("in" | "near") as relation, *rest] if rest:
                return self.phrase(self.find(relation, _name(rest)), "nobody and nothing that I know of")
            case _:
                raise self.failed("it understands: where is X, who is in X, what is near X")

    @command(effect="read")
    def learn(self, seconds: Annotated[float, Unit("s"), Range(0.0, 86400.0)] = 86400.0) -> int:
        """Take from a recogniser where things are, until the time is over; returns how many were new."""
        end, before = self.now() + seconds, len(self.facts)
        while (left := end - self.now()) > 0:
            try:
                seen = next(self.eyes.seen(within=min(left, 5.0)))
            except TimeoutError:
                continue
            others = [each for each in self.facts if (each.subject, each.relation) != (seen.what, "in")]
            self.facts = [*others, Fact(seen.what, "in", place_of(seen.x, seen.y))]
        return len(self.facts) - before

    # -- how it is done

    def all(self) -> dict[Fact, tuple[str, ...]]:
        """Return each fact that holds, and from which others it follows."""
        environment = clips.Environment()
        environment.build(TEMPLATE)
        for rule in RULES:
            environment.build(rule)
        template = environment.find_template("fact")
        for fact in self.facts:
            template.assert_fact(
                subject=fact.subject, relation=clips.Symbol(fact.relation), object=fact.object
            )
        environment.run()
        return {
            Fact(str(each["subject"]), str(each["relation"]), str(each["object"])): tuple(
                str(one) for one in each["because"]
            )
            for each in template.facts()
        }

    def checked(self, word: str) -> str:
        """Return a word as it is kept."""
        word = " ".join(word.split())
        if not word or len(word) > LONGEST:
            raise self.failed(f"each word has 1 to {LONGEST} characters")
        return word

    def phrase(self, names: list[str], nothing: str) -> str:
        """Return names in words."""
        return ", ".join(names) or nothing

    def failed(self, why: str) -> CommandFailed:
        """What to raise when the running command cannot go on."""
        return CommandFailed(robot=self.name, command=self.context.command, detail=why)


def place_of(x: float, y: float) -> str:
    """Return the part of the flat in which a point is [m]."""
    if x > 1.2 and y > 0.2:
        return "table"
    if y < -1.0 and 0.0 < x < 2.0:
        return "sofa"
    return "door" if x < -1.5 and y < -0.8 else "flat"


def _name(words: list[str]) -> str:
    return " ".join(words[1:] if words[0] in {"the", "a", "an"} and len(words) > 1 else words)
