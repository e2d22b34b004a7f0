"""Examinations that any new link or codec must pass, called from its tests, and what tests need besides."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
from collections.abc import Awaitable, Callable, Generator
from typing import TYPE_CHECKING, Any, cast

from robotree.protocol.dialect.table import Definition, Field, by_name, definitions
from robotree.protocol.errors import LinkClosed, LinkError, LinkRefused
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Pausable
from robotree.protocol.messages.base import CODECS, TYPED, codec_of, fields_of
from robotree.protocol.parser import Parser

if TYPE_CHECKING:
    from robotree.protocol.codec import Value
    from robotree.protocol.frame import Signer
    from robotree.protocol.links.link import Accept, Link

MakePair = Callable[["Accept", "Accept"], Awaitable[tuple["Link", "Link"]]]
"""Opens a link between two handlers."""
Settle = Callable[[], Awaitable[None]]
"""Returns when everything under way has arrived."""
Attempt = Callable[["Accept"], Awaitable[object]]
"""Opens a link, or listens, where that is impossible."""
Reference = Callable[[Definition, dict[str, "Value"], int, int, int], bytes]
"""Another encoder: definition, values by field, sequence, system, component."""


async def until(condition: Callable[[], object], patience: float = 60.0) -> None:
    """Let the event loop run until a condition holds that has no event.

    Args:
        condition: looked at again and again.
        patience: [s]

    Raises:
        TimeoutError: it is not the case within `patience`.
    """
    async with asyncio.timeout(patience):
        while not condition():  # noqa: ASYNC110  sockets and ports have no event for this
            await asyncio.sleep(0.001)


@contextlib.contextmanager
def forgetting_messages() -> Generator[None]:
    """Have the messages and classes that the block adds to the process forgotten at its end.

    Yields:
        Nothing; what was known before is known inside.
    """
    tables = cast("tuple[dict[Any, Any], ...]", (definitions(), by_name(), TYPED))
    before = [dict(table) for table in tables]
    try:
        yield
    finally:
        added = (definitions().keys() - before[0].keys()) | (TYPED.keys() - before[2].keys())
        for table, kept in zip(tables, before, strict=True):
            table.clear()
            table.update(kept)
        for msgid in added:
            CODECS.pop(msgid.to_bytes(3, "little"), None)


class RecordingHandler:
    """A handler that remembers what it was told."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.data = b""
        self.reasons: list[LinkError] = []

    def received(self, data: bytes) -> None:
        """Remember some bytes.

        Raises:
            AssertionError: the link had ended before.
        """
        assert not self.reasons, "nothing is told after the end"  # noqa: S101  an examination asserts
        self.data += data

    def closed(self, reason: LinkError) -> None:
        """Remember the end."""
        self.reasons.append(reason)


class RecordingHandlers(list[RecordingHandler]):
    """Accepts links, and keeps the handler of each, the first one first: give it to `listen` or `connect`."""

    def __call__(self, link: Link) -> RecordingHandler:
        """Accept a link (`robotree.protocol.links.link.Accept`)."""
        self.append(RecordingHandler(link))
        return self[-1]


async def check_link(
    make_pair: MakePair,
    settle: Settle,
    *,
    congests: bool = True,
    tells_the_end: bool = True,
    pauses: bool = False,
) -> None:
    """Examine a link without faults, both ends of which live on this event loop.

    Args:
        make_pair: opens one.
        settle: waits until everything has arrived.
        congests: whether one end notices that the other does not read (a datagram link cannot).
        tells_the_end: whether one end hears that the other has closed (nor this).
        pauses: whether it is `robotree.protocol.links.link.Pausable`, too.

    Raises:
        AssertionError: a promise of `robotree.protocol.links.link.Link` is broken.
    """
    recorders = RecordingHandlers()
    near, far = await make_pair(recorders, recorders)
    await _settled(lambda: len(recorders) > 1, settle)
    recorder_of = {id(each.link): each for each in recorders}
    assert len(recorder_of) == 2, "each end is accepted once"  # noqa: S101
    assert near.address, "a link has a name for people"  # noqa: S101
    at_near, at_far = recorder_of[id(near)], recorder_of[id(far)]
    await _check_bytes(near, at_far, settle)
    await _check_bytes(far, at_near, settle)
    if congests:
        await _check_congestion(near, at_far, settle)
        await _check_congestion(far, at_near, settle)
    await _check_pause(near, at_far, settle, pauses=pauses)
    await _check_pause(far, at_near, settle, pauses=pauses)
    await _check_end(near, at_near, settle)
    if tells_the_end:
        await _settled(lambda: at_far.reasons, settle)
    far_heard = [type(each) for each in at_far.reasons]
    assert far_heard == ([LinkClosed] if tells_the_end else []), "the far end hears of it"  # noqa: S101
    far.close()
    await _settled(lambda: at_far.reasons, settle)
    assert len(at_far.reasons) == 1, "the end is told exactly once"  # noqa: S101


async def check_close_in_accept(dial: Attempt, settle: Settle) -> None:
    """Examine a link whose handler sends a word and hangs up before it hears anything.

    Args:
        dial: opens one; the end that is examined is the one that it hands to what it is given.
        settle: waits until everything has arrived.

    Raises:
        AssertionError: a promise of `robotree.protocol.links.link.Link` is broken.
    """
    recorders: list[RecordingHandler] = []

    def accept(link: Link) -> RecordingHandler:
        recorders.append(RecordingHandler(link))
        link.send(b"you are not served")
        link.close()
        link.close()
        return recorders[-1]

    await dial(accept)
    await _settled(lambda: recorders, settle)
    assert len(recorders) == 1, "the end is accepted once"  # noqa: S101
    (recorder,) = recorders
    await _check_end(recorder.link, recorder, settle)


async def check_refused(dial: Attempt) -> LinkRefused:
    """Examine what is said of a link that cannot be had.

    Args:
        dial: asks for it.

    Returns:
        What was said.

    Raises:
        AssertionError: it was not refused in one sentence that names it, or somebody was told of a link.
    """
    met: list[Link] = []

    def accept(link: Link) -> RecordingHandler:
        met.append(link)
        return RecordingHandler(link)

    refusal: LinkRefused | None = None
    try:
        await dial(accept)
    except LinkRefused as refused:
        refusal = refused
    assert refusal is not None, "what cannot be had is refused"  # noqa: S101
    assert not met, "nobody is told of a link that never was"  # noqa: S101
    assert refusal.cause, "the reason is told"  # noqa: S101
    assert str(refusal).startswith(f"{refusal.address} cannot be opened: "), "and the place"  # noqa: S101
    assert "\n" not in str(refusal), "in one sentence"  # noqa: S101
    return refusal


async def _check_bytes(sender: Link, receiver: RecordingHandler, settle: Settle) -> None:
    frames = [bytes((i,)) * (1 + 40 * i) for i in range(7)]
    topics = [None, "telemetry", None, "telemetry", "other", None, None]
    receiver.data = b""  # a datagram link needs a word to open
    sent, received = sender.statistics.sent, receiver.link.statistics.received
    for frame, topic in zip(frames, topics, strict=True):
        sender.send(frame, topic)
        await settle()
    await _settled(lambda: len(receiver.data) >= sum(map(len, frames)), settle)
    assert receiver.data == b"".join(frames), "bytes arrive complete and in order"  # noqa: S101
    assert sender.statistics.sent - sent == len(receiver.data), "what was sent is counted"  # noqa: S101
    assert receiver.link.statistics.received - received == len(receiver.data), "and what arrived"  # noqa: S101
    assert not sender.congested, "an idle link is not congested"  # noqa: S101


async def _settled(condition: Callable[[], object], settle: Settle) -> None:
    """Wait until something is the case; a busy machine may take longer than it usually does."""
    await settle()
    for _ in range(MOST_SETTLINGS):
        if condition():
            return
        await settle()


MOST_SETTLINGS = 10_000
"""Times that what is under way is waited for: nearly a minute, where it settles in 5 ms."""
MOST_ROUNDS = 100_000
"""Rounds of telemetry after which a link that notices nothing has failed its examination."""
RECOVERY = 60.0
"""[s] that a link may take to deliver what waited."""


async def _check_congestion(sender: Link, receiver: RecordingHandler, settle: Settle) -> None:
    """Nobody reads for a while: telemetry is superseded, all else waits in order, frames stay whole."""
    receiver.data = b""
    before = sender.statistics
    rounds = 0
    # The event loop does not turn in here, so the far end does not read.
    while sender.statistics.superseded - before.superseded < 10:
        assert rounds < MOST_ROUNDS, "telemetry that waits is superseded"  # noqa: S101
        sender.send(_numbered(b"T", rounds), "telemetry")
        if rounds % 50 == 0:
            sender.send(_numbered(b"A", rounds))
        rounds += 1
    assert sender.congested, "a link whose far end does not read is congested"  # noqa: S101
    assert sender.statistics.waiting, "what waits is counted"  # noqa: S101
    sender.send(_numbered(b"A", rounds))
    async with asyncio.timeout(RECOVERY):
        while sender.statistics.waiting or len(receiver.data) < sender.statistics.sent - before.sent:
            await settle()
    await settle()
    frames = [receiver.data[i : i + _NUMBERED] for i in range(0, len(receiver.data), _NUMBERED)]
    heard = {kind: [int(frame[1:]) for frame in frames if frame[:1] == kind] for kind in (b"T", b"A")}
    assert sum(map(len, heard.values())) == len(frames), "frames arrive whole"  # noqa: S101
    assert heard[b"A"] == [*range(0, rounds, 50), rounds], "what must arrive arrives, in order"  # noqa: S101
    assert heard[b"T"] == sorted(set(heard[b"T"])), "telemetry never goes back"  # noqa: S101
    assert heard[b"T"][-1] == rounds - 1, "and its newest frame arrives"  # noqa: S101
    superseded = sender.statistics.superseded - before.superseded
    assert len(heard[b"T"]) + superseded == rounds, "what was superseded is counted"  # noqa: S101
    assert not sender.congested, "and the link recovers"  # noqa: S101


_NUMBERED = 250


def _numbered(kind: bytes, number: int) -> bytes:
    """A frame of the size of a picture's piece, with its number inside."""
    return kind + b"%0*d" % (_NUMBERED - 1, number)


async def _check_pause(sender: Link, receiver: RecordingHandler, settle: Settle, *, pauses: bool) -> None:
    """A reader that pauses finds everything when it reads on."""
    link = receiver.link
    assert isinstance(link, Pausable) == pauses, "what can wait says so"  # noqa: S101
    if not isinstance(link, Pausable):
        return
    receiver.data = b""
    link.pause_reading()
    link.pause_reading()
    frame = bytes(range(100))
    sender.send(frame)
    await settle()
    assert not receiver.data, "nothing is told while reading is paused"  # noqa: S101
    link.resume_reading()
    link.resume_reading()
    await _settled(lambda: receiver.data, settle)
    assert receiver.data == frame, "what waited is told"  # noqa: S101


async def _check_end(link: Link, recorder: RecordingHandler, settle: Settle) -> None:
    link.close()
    link.close()
    await _settled(lambda: recorder.reasons, settle)
    assert [type(each) for each in recorder.reasons] == [LinkClosed], "the end is told once"  # noqa: S101
    dropped = link.statistics.dropped
    link.send(b"too late")
    assert link.statistics.dropped == dropped + 1, "what is sent after the end is counted"  # noqa: S101
    if isinstance(link, Pausable):
        link.pause_reading()
        link.resume_reading()


def check_codec(reference: Reference, *, seed: int = 0, rounds: int = 4, signer: Signer | None = None) -> int:
    """Compare our bytes with those of another encoder, and what we read from them with what was meant.

    Args:
        reference: the other encoder; signs as `signer` does.
        seed: of the random values.
        rounds: sets of values per message.
        signer: signs our frames.

    Returns:
        How many frames were compared.

    Raises:
        AssertionError: naming the message that differs.
    """
    chance, count = random.Random(seed), 0
    for definition in definitions().values():
        for _ in range(rounds):
            values = random_values(definition, chance)
            message = codec_of(definition.id).build(*values.values())
            ids = count & 0xFF, 1 + count % 255, count % 256
            theirs = reference(definition, values, *ids)
            ours = encode(message, sequence=ids[0], system=ids[1], component=ids[2], signer=signer)
            assert ours == theirs, f"{definition.name} {values}: {ours.hex()} is not {theirs.hex()}"  # noqa: S101
            (frame,) = Parser().feed(ours)
            assert fields_of(frame.message) == values, f"{definition.name}: read otherwise than written"  # noqa: S101
            assert (frame.sequence, frame.system, frame.component) == ids, "the header is read"  # noqa: S101
            count += 1
    return count


def random_values(definition: Definition, chance: random.Random) -> dict[str, Value]:
    """Values for every field, extremes among them, that survive the wire unchanged."""
    return {field.name: _random_value(field, chance) for field in definition.fields}


def _random_value(field: Field, chance: random.Random) -> Value:
    if field.type == "char":
        letters = "".join(chance.choices("abcXYZ 019_", k=chance.randint(0, field.length)))
        return letters if field.length else "a"
    if field.is_bytes:
        return chance.choice([bytes(field.length), chance.randbytes(field.length)])
    numbers = tuple(_random_number(field.type, chance) for _ in range(field.length or 1))
    return numbers if field.length else numbers[0]


def _random_number(kind: str, chance: random.Random) -> int | float:
    if kind in ("float", "double"):
        mantissa = chance.randint(-(2**24), 2**24)
        return chance.choice([0.0, -0.0, math.ldexp(mantissa, chance.randint(-60, 60))])
    bits = int("".join(filter(str.isdigit, kind)))
    lowest, highest = (0, (1 << bits) - 1) if kind.startswith("u") else (-1 << bits - 1, (1 << bits - 1) - 1)
    return chance.choice([0, lowest, highest, chance.randint(lowest, highest)])
