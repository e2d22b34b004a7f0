"""The verbs about what robots did: `history`, also as spans for OpenTelemetry, and `why`."""

from __future__ import annotations

import importlib
import io
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar, cast

from robotree.tui.errors import NotInstalled, SupervisorError, ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.seen import wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, RobotDescription
    from robotree.vr.base.history_event import HistoryEvent
    from robotree.vr.base.requests import EventsRead, ReadEvents
    from robotree.vr.history.file import HistoryFile
    from robotree.vr.supervision.past import CallSpan, Chain, Link
    from robotree.vr.supervision.realm_client import RealmClient

Known: TypeAlias = "Mapping[str, CommandSpec]"
"""Commands by `robot.command`: what is not in it is written without units."""
_CLOCK = re.compile(r"(\d{1,2}):(\d\d)(?::(\d\d))?")
_R = TypeVar("_R")

MOST_EVENTS = 10_000
"""That are asked for of what was shown."""
LOOKS = 0.1
"""[s] between two looks whether all that was begun is over."""


class _Kept(NamedTuple):
    """The answers of all processes that keep events."""

    answers: Mapping[str, EventsRead]
    """By who has kept them, in words: `host h1`."""
    notes: tuple[str, ...]
    """The parts that may be incomplete, as sentences."""

    def events(self) -> list[tuple[str, HistoryEvent]]:
        """Return all events, the oldest first, each with who has kept it."""
        found = [(source, event.event) for source, read in self.answers.items() for event in read.events]
        return sorted(found, key=lambda kept: kept[1].unix)


async def history(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell what a robot did; or whether what is kept of it is what was written."""
    from robotree.vr.base.errors import NoHistory
    from robotree.vr.base.requests import ReadEvents

    name = line.text("NAME")
    kept = await kept_events(realm_client, ReadEvents(robot=name, since=_since(line.text("--since"))))
    if line.flag("--verify"):
        return await _verified(realm_client, name, kept)
    events = kept.events()
    for note in kept.notes:
        teller.warn(note)
    if not events:
        raise NoHistory(name=name, detail=_nothing(line.text("--since"), kept))
    if line.flag("--otel"):
        from robotree.vr.supervision.past import spans_of

        spans = spans_of(event for _, event in events)
        printed = export_spans(spans)
        return Outcome(plain(spans), printed or f"{len(spans)} spans are exported")
    if any(read.more for read in kept.answers.values()):
        teller.warn("there are older events; ask with --since, from a later time on")
    known = await known_commands(realm_client, [name], [event for _, event in events])
    text = "\n".join(event_line(event, known) for _, event in events)
    return Outcome([{"source": source, **plain(event)} for source, event in events], text)


async def why(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell who asked for the last motion of a robot, or for the command of a key."""
    from robotree.vr.base.address import parted
    from robotree.vr.base.errors import NoHistory
    from robotree.vr.base.requests import ReadEvents
    from robotree.vr.supervision.past import explain, last_motion

    name = line.text("NAME|KEY")
    key = name
    if "/" not in name:  # else it is the key of a step, and no name
        kept = await kept_events(realm_client, ReadEvents(robot=name, last=True))
        key = last_motion((event for _, event in kept.events()), parted(name)[1]) or name
    kept = await kept_events(realm_client, ReadEvents(key=key, robot="" if key == name else name))
    for note in kept.notes:
        teller.warn(note)
    chain, place = explain(key, kept.events()), await _place(realm_client, name)
    if chain is None and not place:
        raise NoHistory(name=name, detail=_nothing("", kept))
    text = "\n".join(f"{word}: {sentence}" for word, sentence in place.items())
    if chain is None:
        return Outcome({"place": place}, text)
    data = {"person": chain.person, **plain(chain)} | ({"place": place} if place else {})
    observed = [event for link in chain.links for event in link.observed]
    robots = [name, *(link.call.robot for link in chain.links)]
    known = await known_commands(realm_client, robots, observed)
    return Outcome(data, "\n\n".join(filter(None, (chain_text(chain, known), text))))


async def _place(realm_client: RealmClient, name: str) -> dict[str, str]:
    """Return why a robot is where it is, as far as anything but people has to do with it."""
    from robotree.vr.base.errors import VrError

    if "/" in name:
        return {}
    try:
        robot = await realm_client.describe(name)
    except VrError:  # it is away: only what it did is known
        return {}
    if robot.placement == "manual" and not robot.placed:
        return {}
    facts = {"placement": robot.placement, "placed": robot.placed, "advice": robot.advice}
    return {word: text for word, text in facts.items() if text}


# -- who has kept it -------------------------------------------------------------------------------


async def kept_events(realm_client: RealmClient, request: ReadEvents) -> _Kept:
    """Ask all who live and keep events, and read the files of the others and of proxies on this machine."""
    import msgspec

    answers = dict(await realm_client.read_events(request))
    notes = [
        f"{source} is behind by {_events(read.waiting)}; what has just happened may be missing"
        for source, read in answers.items()
        if read.waiting
    ]
    notes += [f"{source} keeps nothing at the moment: {read.trouble}" for source, read in answers.items()
              if read.trouble]  # fmt: skip
    places = realm_client.places
    site, plain = realm_client.whereabouts(request.robot) if request.robot else ("", "")
    elsewhere = site not in {"", places.own}
    notes += [
        f"site {one} is not heard; what is kept there is missing"
        for one in places.sites()
        if places.silent(one) and (request.key or site in {"", one})
    ]
    if elsewhere and not request.key:
        return _Kept(answers, tuple(notes))
    here = msgspec.structs.replace(request, robot=plain)
    read, faults = await _from_files(realm_client, answers, lambda file: file.read(here))
    return _Kept(answers | read, (*notes, *faults))


async def settled_events(
    realm_client: RealmClient, robot: str, since: float, within: float = 5.0
) -> list[HistoryEvent]:
    """Return what a robot did since a time, when all that it began is over, or after `within` [s]."""
    import asyncio

    from robotree.vr.base.requests import ReadEvents

    latest = time.monotonic() + within
    while True:
        kept = await kept_events(realm_client, ReadEvents(robot=robot, since=since, most=MOST_EVENTS))
        events = [event for _, event in kept.events()]
        begun = {event.key for event in events if event.kind == "accepted"}
        if begun <= {event.key for event in events if event.kind == "ended"} and begun:
            return events
        if time.monotonic() > latest:
            return events
        await asyncio.sleep(LOOKS)


async def _from_files(
    realm_client: RealmClient, answered: Iterable[str], look: Callable[[HistoryFile], _R]
) -> tuple[dict[str, _R], list[str]]:
    """Look into the files of all whose process has not answered."""
    import asyncio

    from robotree.tui.processes.state_files import history_files
    from robotree.vr.base.errors import HistoryUnusable
    from robotree.vr.history.file import HistoryFile

    found, faults = dict[str, _R](), list[str]()
    silent = set(answered)

    def read() -> None:
        for (role, name), path in history_files(realm_client.realm).items():
            source = f"{role} {name}"
            if source in silent:
                continue
            try:
                with closing(HistoryFile(path)) as file:
                    found[source] = look(file)
            except HistoryUnusable as error:
                faults.append(str(error))

    await asyncio.to_thread(read)
    return found, faults


async def _verified(realm_client: RealmClient, name: str, kept: _Kept) -> Outcome:
    """Examine the files of all who have kept anything of a robot."""
    from robotree.vr.base.errors import HistoryChanged, NoHistory

    of_robot = [source for source, read in kept.answers.items() if read.events]
    if not of_robot:
        raise NoHistory(name=name, detail=_nothing("", kept))
    answers = dict(await realm_client.verify_events(name))
    files, _ = await _from_files(realm_client, answers, lambda file: file.verify())
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    faults: list[str] = []
    for source in of_robot:
        found = (answers | files)[source]
        rows.append({"source": source, **plain(found)})
        if found.fault:
            faults.append(f"{source}: {found.fault}")
        lines.append(
            f"{source}: {_events(found.count)} from number {found.first} on, as they were written; "
            f"the last has the hash {found.last_hash}"
        )
    if faults:
        raise HistoryChanged(detail="; ".join(faults))
    return Outcome(rows, "\n".join(lines))


def _events(number: int) -> str:
    return "1 event" if number == 1 else f"{number} events"


def _nothing(since: str, kept: _Kept) -> str:
    """Say why nothing may be kept."""
    if since:
        return f" since {since}"
    if kept.notes:
        return f": {'; '.join(kept.notes)}"
    return (
        "; is the name right? Else it has carried nothing out, or only what reads; a host, or who commands"
        " it, keeps what it did until it is started with --forget"
    )


def _since(text: str) -> float:
    """Read a time as seconds since 1970: how long ago, a clock of today, or a date.

    Raises:
        ValueRefused: it is none.
    """
    if not text:
        return 0.0
    now = time.time()
    if found := _CLOCK.fullmatch(text):
        hour, minute, second = (int(part or 0) for part in found.groups())
        at = time.mktime((*time.localtime(now)[:3], hour, minute, second, 0, 0, -1))
        return at if at <= now else at - 24 * 3600.0
    try:
        return now - values.duration(text)
    except ValueRefused:
        from datetime import datetime

        try:
            return datetime.fromisoformat(text).timestamp()
        except ValueError:
            raise ValueRefused(
                "WHEN", f"{text!r} is no time; write for example 10min, 14:30 or 2026-11-24T14:30"
            ) from None


# -- in words --------------------------------------------------------------------------------------


async def known_commands(
    realm_client: RealmClient, robots: Iterable[str], observed: Iterable[HistoryEvent] = ()
) -> dict[str, CommandSpec]:
    """Return the commands of those robots that answer: with them their arguments have units.

    What an event has `observed` has those of the child that is in its slot now, under `mover.arm`: no command
    of a robot has the name of a slot.
    """
    from robotree.vr.base.address import parted
    from robotree.vr.base.description import CommandSpec, FieldSpec

    described = await _described(realm_client, robots)
    known = {name: command for robot in described for name, command in commands_by_name(robot).items()}
    slots = {(event.robot, str(event.arguments)) for event in observed if event.kind == "observed"}
    held = {
        f"{parted(robot.name)[1]}.{slot.name}": slot.child.name
        for robot in described
        for slot in robot.slots
        if slot.child is not None and (parted(robot.name)[1], slot.name) in slots
    }
    units = {parted(child.name)[1]: child.units for child in await _described(realm_client, held.values())}
    for place, child in held.items():
        read = units.get(parted(child)[1], {}).items()
        fields = tuple(FieldSpec(name=name, type="float", unit=unit) for name, unit in read)
        known[place] = CommandSpec(name="readings", result=fields)
    return known


async def _described(realm_client: RealmClient, robots: Iterable[str]) -> list[RobotDescription]:
    """Return the descriptions of those robots that answer."""
    import asyncio

    from robotree.vr.base.errors import VrError

    asked = [realm_client.describe(name) for name in sorted({name for name in robots if "/" not in name})]
    found: list[RobotDescription] = []
    for robot in await asyncio.gather(*asked, return_exceptions=True):
        if isinstance(robot, VrError):
            continue
        if isinstance(robot, BaseException):
            raise robot
        found.append(robot)
    return found


def commands_by_name(robot: RobotDescription) -> dict[str, CommandSpec]:
    """Return the commands of a robot by what events call them: `arm-1.go_to`, without a site."""
    from robotree.vr.base.address import parted

    return {f"{parted(robot.name)[1]}.{command.name}": command for command in robot.commands}


def call_words(robot: str, command: str, arguments: Any, known: Known) -> str:
    """Write a call: `arm-1.go_to x=0.3 m`."""
    name = f"{robot}.{command}"
    fields = {field.name: field for field in known[name].parameters} if name in known else {}
    given = cast("dict[str, Any]", arguments) if isinstance(arguments, Mapping) else {}
    return " ".join([name, *(f"{key}={wording.given(fields.get(key), one)}" for key, one in given.items())])


def event_line(event: HistoryEvent, known: Known) -> str:
    """Return one event as a line: when, what, who, under which lease."""
    return f"{_at(event.unix, day=True)}  {event.kind:9}  {_said(event, known)}"


def _said(event: HistoryEvent, known: Known) -> str:
    match event.kind:
        case "accepted":
            lease = f", epoch {event.epoch}" if event.epoch else ""
            line = f", line {event.line} of its page" if event.line else ""
            told = f"  {event.text}" if event.text else ""
            call = call_words(event.robot, event.command, event.arguments, known)
            return f"{call}  by {event.person or event.caller}{line}{lease}  [{event.key}]{told}"
        case "ended" | "answered":
            return f"{event.command}: {_outcome(event)}  [{event.key}]"
        case "observed":
            return f"{_observed(event, known)}  [{event.key}]"
        case "lease":
            return f"{event.text}, epoch {event.epoch}"
        case _:
            return event.text


def _observed(event: HistoryEvent, known: Known) -> str:
    """Write what was read of a child: `arm = x 0.35 m, twist 90.0 °`."""
    spec = known.get(f"{event.robot}.{event.arguments}")
    rows = wording.result(spec.result if spec else (), event.value)
    return f"{event.arguments} = {', '.join(f'{name} {text}'.lstrip() for name, text in rows) or '-'}"


def _outcome(event: HistoryEvent) -> str:
    return f"{event.error}: {event.text}" if event.error else "done"


def _at(unix: float, *, day: bool = False) -> str:
    form = "%Y-%m-%d %H:%M:%S" if day else "%H:%M:%S"
    return f"{time.strftime(form, time.localtime(unix))}.{int(unix % 1 * 1000):03}"


def chain_text(chain: Chain, known: Known) -> str:
    """Return why a robot moved, for people: the motion first, who asked for it last."""
    lines = [line for link, over in zip(chain.links, (*chain.links[1:], None), strict=True)
             for line in _link_lines(link, over, known)]  # fmt: skip
    if chain.missing:
        lines.append(f"asked by {chain.missing}, of whose command nothing is kept")
    else:
        top = chain.links[-1].call
        lines.append(f"asked by {chain.person or 'nobody who has a name'} (process {top.process})")
    return "\n".join(lines)


def _link_lines(link: Link, over: Link | None, known: Known) -> list[str]:
    call, ended = link.call, link.ended
    words = call_words(call.robot, call.command, call.arguments, known)
    lines = [f"{words}   on {link.source}, key {call.key}"]
    if call.text:
        lines.append(f"  {call.text}")
    times = [f"accepted {_at(call.unix, day=True)}"]
    if ended is not None:
        began = f"began {_at(ended.began)}" if ended.began else "never began"
        times += [began, f"ended {_at(ended.unix)} ({_outcome(ended)})"]
    else:
        times.append("its end is not known: it goes on, or was interrupted")
    if link.answered is not None:
        times.append(f"its caller heard that {_at(link.answered.unix)}")
    lines.append(f"  {', '.join(times)}")
    page = f", page {call.page[:12]}" if call.page else ""
    lease = f"  under epoch {call.epoch} of {call.caller}" if call.epoch else "  under no lease"
    lines.append(f"{lease}{page}")
    lines += [f"  {_at(event.unix)}: {event.text}" for event in link.back]
    lines += [f"  observed {_at(event.unix)}: {_observed(event, known)}" for event in link.observed]
    if over is not None:
        line = f", line {call.line} of its page {over.call.page[:12]}" if call.line else ""
        lines.append(f"step {link.step} of {over.call.robot}.{over.call.command}{line}:")
    return lines


# -- spans for OpenTelemetry, if its SDK is installed: to a collector, else as JSON ----------------

ENDPOINT = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
"""Variables that name a collector, as OpenTelemetry's specification says; one of them is enough."""


class NotExported(SupervisorError):
    """The collector has not taken the spans."""

    def __init__(self) -> None:
        """Say where to look."""
        super().__init__(f"the collector that {ENDPOINT[1]} names did not take the spans; does it run?")


def _module(name: str, package: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise NotInstalled("history --otel", package, f"pip install {package}") from None


def export_spans(spans: Sequence[CallSpan]) -> str:
    """Send spans to the collector that the environment names; without one return them as JSON.

    Raises:
        NotInstalled: OpenTelemetry's SDK is not there, or its exporter for collectors.
        NotExported: the collector did not take them.
    """
    sdk = _module("opentelemetry.sdk.trace", "opentelemetry-sdk")
    ready = [_readable(span) for span in spans]
    output = io.StringIO()
    if any(os.environ.get(name) for name in ENDPOINT):
        name = "opentelemetry.exporter.otlp.proto.http.trace_exporter"
        package = "opentelemetry-exporter-otlp-proto-http"
        exporter = _module(name, package).OTLPSpanExporter()
    else:
        exporter = importlib.import_module(f"{sdk.__name__}.export").ConsoleSpanExporter(out=output)
    result = exporter.export(ready)
    exporter.shutdown()
    if result.name != "SUCCESS":
        raise NotExported
    return output.getvalue().strip()


def _readable(span: CallSpan) -> Any:
    """Return a span as the SDK has it."""
    sdk = importlib.import_module("opentelemetry.sdk.trace")
    api = importlib.import_module("opentelemetry.trace")
    resources = importlib.import_module("opentelemetry.sdk.resources")

    def context(number: int) -> Any:
        flags = api.TraceFlags(api.TraceFlags.SAMPLED)
        return api.SpanContext(span.trace, number, is_remote=False, trace_flags=flags)

    code = api.StatusCode.ERROR if span.error else api.StatusCode.OK
    return sdk.ReadableSpan(
        span.name,
        context=context(span.span),
        parent=context(span.parent) if span.parent else None,
        resource=resources.Resource({"service.name": "robotree"}),
        attributes=span.attributes,
        kind=api.SpanKind.SERVER,
        status=api.Status(code, span.error or None),
        start_time=span.begin,
        end_time=span.end,
    )
