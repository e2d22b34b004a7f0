"""The protective stop of a process that cannot join a realm: it has too few descriptors, threads or memory.

It asks one process after another, over one connection at a time, in one thread, and writes no file. A robot
that has been asked already, under the same order id, answers again and counts one stop.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from robotree.vr.base.address import Address, everyone
from robotree.vr.base.envelope import seal
from robotree.vr.base.errors import NoSuchRobot, VrError
from robotree.vr.base.pattern import matches
from robotree.vr.base.requests import Done, Raised, SafeStop, decode_reply
from robotree.vr.base.system import Socket
from robotree.vr.core.confirmation import HOPELESS, Confirmations, unmeasured
from robotree.vr.network.lean_stop import REASON
from robotree.vr.network.link import (
    PIECE,
    VERSION,
    AskFrame,
    Channel,
    EndFrame,
    Hello,
    LinkFrame,
    NotAFrame,
    ReplyFrame,
    Topic,
    Unpacker,
    pack,
)
from robotree.vr.network.mesh import LOST_FILES, held_by
from robotree.vr.network.realms import asleep, dial, leads_to, process_of
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.supervision.stop import CONFIRM

Answer = Sequence[str] | VrError


def stop_in_turn(directory: Path, name: str | None, order: str) -> Sequence[str]:
    """Stop one robot or all of a realm, and return the names of those that have confirmed it.

    Args:
        directory: of the realm.
        name: of the robot; None: all.
        order: see `SafeStop.order`.

    Raises:
        NoSuchRobot: there is none of this name.
        NotConfirmed: a robot has not confirmed it, or may not have been reached; names both groups.
    """
    place = Rendezvous(directory.name, directory.parent, listed=False)
    pattern = everyone("robot", name or "*")
    confirmations, asked, unknown = Confirmations("the protective stop"), False, list[int]()
    for tag in sorted(place.living()):
        process = _Process(place, tag, pattern, order)
        process.ask()
        asked = asked or bool(process.answers)
        for held in held_by(process_of(tag), process.answers):
            answer, address = process.answers[held.key], Address.parse(held.key)
            if address is not None and answer is not None:
                confirmations.take(address.name, answer)
            elif address is not None:
                confirmations.miss(address.name, f"in {held.in_words}", held.remedy)
        if not process.known:
            unknown.append(process_of(tag))
    if name is not None and not asked and not unknown:
        raise NoSuchRobot(name=name)
    if name is None or not asked:
        for number in unknown:
            confirmations.miss(f"process {number}", LOST_FILES, f"`kill {number}` ends it")
    return confirmations.settle()


class _Process:
    """One process that is asked to stop its robots."""

    def __init__(self, place: Rendezvous, tag: str, pattern: str, order: str) -> None:
        self._place, self._tag, self._pattern = place, tag, pattern
        self._stop = SafeStop(reason=REASON, order=order, within=unmeasured(CONFIRM))
        self._unpacker = Unpacker()
        written = place.keys_of(tag)
        self.known = written is not None
        """Whether it is known which robots it has."""
        self.answers: dict[str, Answer | None] = {key: None for key in written or () if matches(pattern, key)}
        """Of each of its robots, by key; None: there is none yet."""
        self._greeted = False
        self._asked: list[str] = []

    def ask(self) -> None:
        """Ask, and wait until all have answered, for `CONFIRM` at most."""
        latest = time.monotonic() + (HOPELESS if asleep(process_of(self._tag)) else CONFIRM)
        try:
            with dial(self._place.place_of(self._tag), self._tag, HOPELESS) as line:
                if not leads_to(line, self._place.place_of(self._tag), self._tag):
                    return
                line.sendall(pack(Hello(VERSION, self._place.tag, Channel.URGENT, {})))
                self._ask_new(line)
                while not self._greeted or None in self.answers.values():
                    line.settimeout(max(latest - time.monotonic(), 0.001))
                    data = line.recv(PIECE)
                    if not data:
                        return
                    for frame in self._unpacker.feed(data):
                        self._take(frame)
                    self._ask_new(line)
        except (OSError, NotAFrame):
            return  # it ended, hangs or is not understood: the answers that are missing say so

    def _ask_new(self, line: Socket) -> None:
        """Ask the robots that have not been asked yet."""
        for key in self.answers.keys() - set(self._asked):
            self._asked.append(key)
            body = seal(self._stop, now=time.monotonic(), within=CONFIRM).body
            line.sendall(pack(AskFrame(len(self._asked), key, body)))

    def _take(self, frame: LinkFrame) -> None:
        match frame:
            case Hello():
                self._greeted = self.known = True
                held = frame.known.get(Topic.HOLDS, ())
                self.answers |= {
                    key: None for key in held if matches(self._pattern, key) and key not in self.answers
                }
            case ReplyFrame(number, body) | EndFrame(number, bytes(body)) if 0 < number <= len(self._asked):
                self._answered(self._asked[number - 1], body)
            case _:
                pass

    def _answered(self, key: str, body: bytes) -> None:
        try:
            reply = decode_reply(body, key=key)
        except VrError as error:
            self.answers[key] = error
            return
        if isinstance(reply, Raised):
            self.answers[key] = reply.revive()
        elif isinstance(reply, Done):
            self.answers[key] = reply.confirmed
