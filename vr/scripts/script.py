"""A script as a robot: it is created, enslaved, exposed, stopped and listed like any other.

Its class is made of the program: a slot for each partner, a command for each message that it hears, and
`start`, which leads until the script is over.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

from robotree.vr.author.child import Child
from robotree.vr.author.command import command
from robotree.vr.author.context import running
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.author.watch import Watch
from robotree.vr.base.errors import CommandFailed, NoRoles, NoSuchFile, VrError
from robotree.vr.base.principal import is_person
from robotree.vr.base.units import Range, Unit
from robotree.vr.base.written import Scalar
from robotree.vr.scripts import explain
from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import ScriptError
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.program import Hears, Partner, Program
from robotree.vr.scripts.questions import wrong
from robotree.vr.scripts.roles.player import forward
from robotree.vr.scripts.run import ANSWERED, LONGEST, ScriptRun, flat, lacking, words
from robotree.vr.scripts.when_then import read_yaml

OPERATOR = "operator"
"""How scripts call every person who asks."""
PAUSE = 0.1
"""[s] after which a message looks again whether it was taken, or answered: it is woken before."""
_TYPES: Mapping[str, Any] = {"text": str, "number": float, "yes/no": bool}


class Script(VirtualRobot):
    """Rules that lead partners."""

    program: ClassVar[Program]
    reading_units: ClassVar[Mapping[str, str]] = dict.fromkeys(("heard", "fired", "acts"), "count")

    def __init__(self, name: str, attributes: Mapping[str, str] | None = None) -> None:
        """Name the script; it is not started. See `VirtualRobot`."""
        super().__init__(name, attributes)
        self._run: ScriptRun | None = None
        self._latest: ScriptRun | None = None
        """The one that runs, or else the last one: what it knew at its end can be asked for."""
        self._numbers = 0
        self._ended = ""
        self.one_at_a_time = frozenset({"start"})

    @property
    def attributes(self) -> dict[str, str]:
        """Free pairs, its condition among them."""
        run = self._run
        asks: Mapping[str, str] = {} if run is None else run.questions.attributes()
        ended = {"ended": self._ended} if self._ended and self._run is None else {}
        return {**self._given, "condition": self.condition, "script": self.program.hash[:12], **ended, **asks}

    @attributes.setter
    def attributes(self, given: dict[str, str]) -> None:
        self._given = given

    @property
    def condition(self) -> str:
        """How it is: `inactive: needs robot (Companion)`, `ready`, `active`."""
        missing = lacking(self, self.program)
        if missing:
            return f"inactive: {missing}"
        return "ready" if self._run is None else "active"

    def readings(self) -> dict[str, float]:
        run = self._run
        if run is None:
            return {}
        return {"heard": run.engine.happened, "fired": run.engine.fired, "acts": run.under_way}

    def lead(self, parameters: Mapping[str, Scalar]) -> str:
        """Run until the script is over; return what it says at the end."""
        caller = self._sender
        allowed = self.program.starters
        if allowed and caller not in {*allowed, self.name}:
            raise self._failed("start", f"{caller} may not start it; those may: {', '.join(allowed)}")
        try:
            run = ScriptRun(self, self.program, parameters, running())
        except ScriptError as error:
            raise self._failed("start", str(error)) from None
        self._run = self._latest = run
        self.one_at_a_time = frozenset({"start"})
        try:
            said = run.whole()
        except VrError as error:
            self._ended = str(error)
            raise
        else:
            self._ended = said or "a rule ended it"
            return said
        finally:
            self._end()
            self._run = None

    def _end(self) -> None:
        """Let a further `start` wait: this one is about to end."""
        self.one_at_a_time = frozenset()

    def hear(self, act: str, values: tuple[Scalar, ...]) -> None:
        """Take a message of a caller in."""
        self._deliver(act, arguments=values)

    @command(effect="read", resume="restart")
    def finish(self) -> None:
        """End the script; what it has begun is cancelled."""
        self._deliver("finish")
        self._end()

    @command(effect="read", resume="restart")
    def answer(
        self,
        answer: Annotated[str, "to what it asks"],
        question: Annotated[str, "id of the question; empty: the oldest one that waits"] = "",
    ) -> None:
        """Answer what the script asks a person."""
        run = self._running("answer")
        if self.context.key in run.taken:  # before its host was started again
            return
        asked = run.questions.meant(question)
        if asked is None:
            why = "that question waits for no answer any more" if question else "it asks nothing"
            raise self._failed("answer", why)
        if why := wrong(asked, answer):
            raise self._failed("answer", why)
        by = self.context.caller or "nobody"
        run = self._deliver(ANSWERED, arguments=(answer, by), conversation=asked.conversation)
        if self.context.key in run.late:
            raise self._failed("answer", "somebody else has just answered that")

    @command(effect="read", resume="restart")
    def message(
        self,
        act: Annotated[str, "what it is about"],
        arguments: Annotated[str, "values, separated by blanks; texts of several words in quotes"] = "",
        performative: Annotated[str, "inform, request, query, agree, refuse …"] = "inform",
        reply_by: Annotated[float, Unit("s"), Range(0, 3600), "time for the answer to a request"] = 10.0,
    ) -> str:
        """Say something to the rules; a request or query waits for the answer and returns it."""
        waits = performative in {"request", "query"} and reply_by > 0.0
        run = self._deliver(
            act,
            performative=performative,
            arguments=words(arguments),
            reply_by=reply_by if waits else 0.0,
        )
        return self._answer(run, act, reply_by) if waits else ""

    @command(effect="read", resume="restart")
    def facts(self) -> str:
        """Show what the rules know now, or knew at their end, and which of them would fire next."""
        run = self._latest
        if run is None:
            return f"{self.condition}\n(no facts: it is not started)"
        over = "" if run is self._run else f"\nit has ended: {self._ended}"
        with run.lock:
            return explain.state(run.engine, self.condition + over)

    @command(effect="read", resume="restart")
    def why(self, rule: Annotated[str, "name of a rule; empty: the latest firings of all"] = "") -> str:
        """Tell why a rule fired, or why it does not: which condition lacks which fact."""
        run = self._latest
        if run is None:
            raise self._failed("why", self._not_started)
        with run.lock:
            return explain.why(run.engine, rule)

    @command(effect="read", resume="restart")
    def play(
        self,
        role: Annotated[str, "role of the partner from its next act on"],
        at: Annotated[str, "slot of the partner; empty: the only one that plays roles"] = "",
    ) -> str:
        """Give a partner another role; the script goes on as it is."""
        at = at or self._only_player()
        played = forward(self, role, at)
        if self._back() is not None and "." not in at:
            self._deliver("role", sender=at, arguments=(played,))
        return played

    @command(effect="read", resume="restart")
    def learn_role(self, source: str, at: str = "") -> str:
        """Teach a partner a role."""
        return forward(self, source, at or self._only_player(), act="learn_role", argument="source")

    # -- inside ------------------------------------------------------------------------------------

    def _only_player(self) -> str:
        """Return the slot of the only partner that plays roles.

        Raises:
            NoRoles: none does, or more than one.
        """
        bonds = self.child_slots.bonds().items()
        able = [name for name, bond in bonds if bond.description.command("play") is not None]
        if len(able) != 1:
            which = f"say which partner is meant: {', '.join(able)}"
            raise NoRoles(robot=self.name, reason=which if able else "none of its partners plays roles")
        return able[0]

    @property
    def _sender(self) -> str:
        """The asker: a robot by its name; `operator`: a person."""
        caller = self.context.caller or "nobody"
        return OPERATOR if is_person(caller) else caller

    @property
    def _not_started(self) -> str:
        return f"it is not started; `robotree call {self.name}.start --detach` starts it"

    def _failed(self, command: str, detail: str) -> CommandFailed:
        return CommandFailed(robot=self.name, command=command, detail=detail)

    def _back(self) -> ScriptRun | None:
        """Return what runs, once its rules know what they knew before a crash; None: it is not started."""
        activity = running()

        def is_there() -> bool:
            run = self._run
            return not activity.is_under_way("start") if run is None else run.is_current

        while not activity.wait_for(is_there, PAUSE):
            pass
        return self._run

    def _running(self, what: str) -> ScriptRun:
        run = self._back()
        if run is None:
            raise self._failed(what, self._not_started)
        if run.missing and not run.engine.happened:
            raise self._failed(what, f"it is inactive: {run.missing}")
        return run

    def _deliver(
        self,
        act: str,
        *,
        sender: str = "",
        performative: str = "inform",
        arguments: tuple[Scalar, ...] = (),
        reply_by: float = 0.0,
        conversation: str = "",
    ) -> ScriptRun:
        """Say something to the rules; return when it is kept that they are told: see `Happening`."""
        run, activity, key = self._running(act), running(), self.context.key
        if key in run.taken:  # before its host was started again
            return run
        if not conversation:
            self._numbers = max(self._numbers, run.talks) + 1
            conversation = f"talk-{self._numbers}"
        message = Happening(
            act=act,
            performative=performative,
            sender=sender or self._sender,
            arguments=flat(arguments),
            conversation=conversation,
            reply_by=reply_by,
            key=key,
        )
        run.waiting[key] = activity.wake
        try:
            if len(run.inbox) >= LONGEST:
                raise self._failed(act, "it is flooded: too many messages wait for its rules; send fewer")
            run.put(message)
            while not activity.wait_for(lambda: key in run.taken or self._run is not run, PAUSE):
                pass
        finally:
            run.waiting.pop(key, None)
        if key not in run.taken:
            raise self._failed(act, f"it has ended before its rules were told: {self._ended}")
        return run

    def _answer(self, run: ScriptRun, act: str, within: float) -> str:
        activity, key = running(), self.context.key
        conversation, until = run.taken[key], activity.now() + within
        run.waiting[key] = activity.wake
        try:
            while activity.now() < until and self._run is run:
                if reply := run.answers.pop(conversation, None):
                    text = " ".join(str(value) for value in reply.values)
                    if reply.performative in {"refuse", "failure"}:
                        raise self._failed(act, f"{reply.performative}: {text or 'no reason given'}")
                    return f"{reply.performative} {text}".strip()
                activity.wait_for(lambda: conversation in run.answers, min(PAUSE, until - activity.now()))
        finally:
            run.waiting.pop(key, None)
            run.open_conversations.discard(conversation)
        raise self._failed(act, f"no rule answered within {within:g} s")


def read_program(source: str, path: str) -> Program:
    """Read a script of either form.

    Raises:
        NoSuchFile: it has the name of neither.
        BrokenScript: it cannot be used, and where.
    """
    suffix = re.search(r"\.\w+\Z", path)
    match suffix.group().lower() if suffix else "":
        case ".yaml" | ".yml":
            return read_yaml(source, path)
        case ".clp":
            name = re.sub(r"[^a-z0-9_]", "_", re.sub(r"\.\w+\Z|.*/", "", path).lower()) or "script"
            return read_clp(source, path, name)
        case _:
            raise NoSuchFile(path=path, reason="the name of a script ends in .yaml, .yml or .clp")


def script_class(program: Program) -> type[Script]:
    """Make the class of a script's robot."""
    kind = "".join(part[:1].upper() + part[1:] for part in re.split(r"[-_]", program.name))
    members: dict[str, Any] = {
        "__doc__": program.doc or f"The script {program.name}.",
        "__module__": __name__,
        "program": program,
        "begins": "start" if program.itself else "",
    }
    for partner in program.partners:
        for slot in partner.slots:
            members[slot] = _slot(partner)
    members["start"] = _start(program)
    for hears in program.hears:
        members[hears.name] = _hearing(hears)
    return type(kind, (Script,), members)


def _slot(partner: Partner) -> Child[Any] | Watch:
    """Return a slot for one robot of a partner."""
    if partner.watched:
        return Watch(partner.kind, partner.doc, optional=partner.optional)
    return Child(
        partner.kind,
        partner.doc,
        optional=partner.optional,
        returns=partner.returns,
        choose="free" if partner.choose else "",
        where=_required(partner) if partner.choose else "",
    )


def _required(partner: Partner) -> str:
    """Return what a robot must be to be chosen: what its author asks for, and what the rules use."""
    parts = [f"({partner.where})"] if partner.where else []
    parts += [f"has {need}" for need in partner.needs]
    parts += [f"{key} = '{wanted}'" for key, wanted in partner.attributes.items()]
    return " and ".join(parts)


def _start(program: Program) -> Callable[..., Any]:
    def start(self: Script, **parameters: Scalar) -> str:
        return self.lead(parameters)

    parts = [
        (parameter.name, _type(parameter.default, parameter.doc), parameter.default)
        for parameter in program.parameters
    ]
    start.__doc__ = "Lead the partners until the script is over; returns what it says at the end."
    return command(_signed(start, "start", parts, str))


def _type(default: Scalar, doc: str) -> Any:
    kind: Any = str if isinstance(default, str) else bool if isinstance(default, bool) else float
    return Annotated[kind, doc] if doc else kind


def _hearing(hears: Hears) -> Callable[..., Any]:
    names = [name for name, _ in hears.parts]

    def hear(self: Script, **given: Scalar) -> None:
        self.hear(hears.name, tuple(given[name] for name in names))

    hear.__doc__ = hears.doc or f"Tell the script: {hears.name}."
    parts = [(name, _TYPES[kind], inspect.Parameter.empty) for name, kind in hears.parts]
    return command(effect="read", resume="restart")(_signed(hear, hears.name, parts, None))


def _signed(
    function: Callable[..., Any], name: str, parts: list[tuple[str, Any, Any]], returns: Any
) -> Callable[..., Any]:
    """Give a function the name and parameters that callers see."""
    mine = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    parameters = [
        inspect.Parameter(part, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for part, kind, default in parts
    ]
    function.__name__, function.__qualname__ = name, name
    function.__annotations__ = {part: kind for part, kind, _ in parts} | {"return": returns}
    function.__signature__ = inspect.Signature([mine, *parameters])  # type: ignore[attr-defined] # PEP 362
    return function
