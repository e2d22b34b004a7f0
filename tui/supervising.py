"""The supervisor over a realm: the full screen of operators, of users, of the composer; or lines.

The lines, `--plain`, are for screen readers and slow terminals: they say what has changed. Nothing moves,
nothing is drawn over, and no line has a frame, a bar or a colour. What a person types is a verb, as at the
`:` of the full screen; the terminal edits it. Commands go on beside what is typed next, so `stop` can be
typed at any time.
"""

from __future__ import annotations

import asyncio
import codecs
import os
import re
import time
from typing import TYPE_CHECKING

from robotree.tui import exit_codes
from robotree.tui.errors import NeedsTerminal, SupervisorError, UnknownVerb, sentence
from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.installed import require
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Outcome
from robotree.tui.processes.ending import to_the_end
from robotree.tui.processes.realm import only_looking
from robotree.tui.seen.feeding import Feed
from robotree.tui.seen.rows import natural
from robotree.tui.seen.store import Store
from robotree.tui.terminal import harmless, no_screen, one_line, put, typed

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.supervision.realm_client import RealmClient


def supervise(line: Line, realm: str) -> int:
    """Show what is in a realm: drawn, or in lines."""
    if line.flag("--plain") or os.environ.get("ROBOTREE_PLAIN", "") not in {"", "0"}:
        readonly = only_looking(given=line.flag("--readonly"))
        return to_the_end(supervise_in_lines(realm, readonly=readonly), on_screen=True)
    require(line.verb, "tui")
    take_calm(line)
    return to_the_end(_shown(line, realm), on_screen=True)


def compose(line: Line, realm: str) -> int:
    """Make a page of a file, also where no realm is; or open the composer."""
    if not line.text("--from"):
        require(line.verb, "tui")
        return to_the_end(_shown(line, realm), on_screen=True)
    from robotree.tui.line.shell import apart

    return to_the_end(apart(line, realm))


def take_calm(line: Line) -> None:
    """Hand `--calm` over to the screen, and to whatever it starts."""
    if line.flag("--calm"):
        os.environ["ROBOTREE_CALM"] = "1"


async def _shown(line: Line, realm: str) -> int:
    """Join the realm and show the screen of a verb."""
    if without := no_screen():
        raise NeedsTerminal(without)
    from robotree.client.joining import joined
    from robotree.tui.line import taken
    from robotree.tui.line.carrying import Silent
    from robotree.tui.screen import keymap
    from robotree.tui.screen.app import Composer, Supervisor
    from robotree.tui.screen.supervise import supervise
    from robotree.tui.screen.user_app import UserApp

    keymap.load()  # one that is wrong is told before anything begins
    app = {"user": UserApp, "compose": Composer}.get(line.verb, Supervisor)
    readonly = only_looking(given=line.flag("--readonly"))
    async with joined(realm) as realm_client:
        await taken.merge(realm_client, Silent())
        return await supervise(realm_client, realm, readonly=readonly, screen=app)


# -- in lines --------------------------------------------------------------------------------------

LOOK = 0.25
"""[s] between two looks at what has changed."""
LONGEST = 10_000
"""Letters of a line."""
COUNTING = re.compile(r" \d+ (?:%|s\b|min\b|h\b)")
"""What is otherwise each second, and no news."""
LEAVE = frozenset({"quit", "q", "exit"})
DRAWN = re.compile("[\u2500-\u259f\u2800-\u28ff\u25a0-\u25ff]+")
"""Lines of boxes, blocks, braille and signs: a screen reader spells each of them."""


def spoken(text: str) -> str:
    """Return a text without what is only drawn; the indent of a tree stays."""
    return "\n".join(
        DRAWN.sub(lambda found: "  " if found.start() == 0 else " ", line) for line in text.split("\n")
    )


class Lines:
    """One operator at one realm, who reads lines and types them."""

    def __init__(self, realm_client: RealmClient, realm: str, *, readonly: bool) -> None:
        """Supervise a realm that has been joined."""
        self.realm_client, self.realm = realm_client, realm
        shell = f"robotree --realm {realm}"
        self.surface = Surface(Where.PROMPT, readonly, shell=shell)
        self.store = Store()
        self.feed = Feed(realm_client, self.store, time.monotonic)
        self._said: dict[str, str] = {}
        """How each robot was, as it was said last."""
        self._told = 0.0
        """[s] of the last entry of the log that was said."""
        self._asked: Line | None = None
        """A line that waits for a yes."""
        self._under_way: set[asyncio.Task[None]] = set()
        self._left = asyncio.Event()

    # -- telling (`verbs.Teller`) -----------------------------------------------------------------

    def say(self, text: str) -> None:
        """Write lines at once."""
        for line in spoken(text).splitlines():
            put(line.rstrip())

    def progress(self, fraction: float, text: str) -> None:
        """Take how far a verb is: `ls` says it when it is asked."""
        del fraction, text

    def warn(self, text: str) -> None:
        """Say what a person should know before a verb has ended."""
        self.say(f"Warning: {one_line(text)}")

    def outcome(self, outcome: Outcome) -> None:
        """Say one of many outcomes of a verb."""
        self.say(outcome.text)

    # -- what has changed -------------------------------------------------------------------------

    def changes(self, now: float) -> list[str]:
        """Return what is to be said since the last time: who came, left, or is otherwise than before."""
        found = list[str]()
        for entry in list(self.store.entries):
            if entry.at > self._told:
                self._told = entry.at
                weight = {"error": "Attention: ", "warning": "Warning: "}.get(entry.weight, "")
                found.append(f"{weight}{one_line(entry.text)}")
        known = [name for name in sorted(self.store.known, key=natural) if self.store.is_explained(name, now)]
        present = {name: self._how(name, now) for name in known}
        for name, how in present.items():
            key = COUNTING.sub("", how)
            if self._said.get(name) != key:
                self._said[name] = key
                found.append(f"{name}: {one_line(how)}")
        for name in self._said.keys() - present.keys():
            del self._said[name]
            found.append(f"{name}: no longer here")
        return found

    def _how(self, name: str, now: float) -> str:
        doing, status = self.store.doing(name, now), self.store.status(name, now)
        return f"busy: {doing}" if status == "busy" else doing

    async def _tell_changes(self) -> None:
        while True:
            for line in self.changes(time.monotonic()):
                self.say(line)
            await asyncio.sleep(LOOK)

    # -- what is typed ----------------------------------------------------------------------------

    def take(self, text: str) -> None:
        """Do what was typed in one line."""
        typed, asked = text.strip(), self._asked
        self._asked = None
        if asked is not None and typed.lower() in {"yes", "y"}:
            self._begin(asked)
        elif asked is not None:
            self.say("Not done.")
        elif typed in LEAVE:
            self._left.set()
        elif typed == "?" or typed.split()[:1] == ["help"]:
            self._help(typed.partition(" ")[2].strip().lower())
        elif typed:
            self._understand(typed)

    def _help(self, about: str) -> None:
        """Say which verbs there are, by topic; or all of one topic; or one verb with its examples."""
        groups = {
            topic: verbs
            for topic, actions in self.surface.groups.items()
            if (verbs := [one for one in actions if one.run])
        }
        found = next((one for verbs in groups.values() for one in verbs if one.verb == about), None)
        topics = [topic for topic in groups if about and topic.lower().startswith(about)]
        if found is not None:
            examples = (f"Example: {one}" for one in found.examples)
            self.say("\n".join([f"{found.usage}: {found.help}", *examples]))
        elif topics:
            self.say("\n".join(f"{one.usage}: {one.help}" for topic in topics for one in groups[topic]))
        elif about:
            self.say(f"Error: {about!r} is no verb and no topic; type help for all topics")
        else:
            for topic, verbs in groups.items():
                self.say(f"{topic}: {', '.join(one.verb for one in verbs)}")
            self.say("Type help and the first word of a topic, or a verb, for more.")
            self.say("quit: Leave; the robots stay as they are.")

    def _understand(self, typed: str) -> None:
        from robotree.vr.base.errors import VrError

        try:
            line = self.surface.parse(grammar.split(typed))
        except UnknownVerb as error:
            near = f"did you mean {' or '.join(error.near)}?" if error.near else "type help for all verbs"
            self.say(f"Error: no verb {error.verb!r}; {near}")
        except (SupervisorError, VrError) as error:
            self.say(f"Error: {one_line(sentence(error))}")
        else:
            if BY_VERB[line.verb].danger:
                self._asked = line
                self.say(f"{typed}? Type yes to do it, anything else not to.")
            else:
                self._begin(line)

    def _begin(self, line: Line) -> None:
        task = asyncio.create_task(self._do(line), name=f"does {line.verb}")
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)

    async def _do(self, line: Line) -> None:
        outcome = await carry_out(self.realm_client, line, self)
        self.feed.hint()
        if isinstance(outcome, Refusal):
            self.say(f"Error: {one_line(str(outcome))}")
            return
        self.say(outcome.text or f"{line.verb}: done")
        if outcome.doubt is not None:
            self.warn(str(outcome.doubt))

    # -- for as long as somebody is there ---------------------------------------------------------

    async def last(self) -> None:
        """Say and take lines until the person leaves, or the input ends."""
        self.say(
            f"robotree, realm {self.realm}. Type help for all verbs, stop to stop every robot, quit to leave."
        )
        await self.feed.open()
        telling = asyncio.create_task(self._tell_changes(), name="tells what has changed")
        listening = asyncio.create_task(self._listen(), name="reads lines")
        leaving = asyncio.create_task(self._left.wait(), name="waits for the end")
        try:
            await asyncio.wait({telling, listening, leaving}, return_when=asyncio.FIRST_COMPLETED)
            if telling.done():
                telling.result()  # it failed
            if listening.done() and not self._left.is_set():
                listening.result()
                await asyncio.gather(*self._under_way)  # a pipe that ends: what it asked for is done first
        finally:
            for task in (telling, listening, leaving, *self._under_way):
                task.cancel()
            await asyncio.gather(telling, listening, leaving, *self._under_way, return_exceptions=True)
            await self.feed.close()

    async def _listen(self) -> None:
        """Read lines from standard input, which may be anything, without holding up the loop."""
        decode, rest = codecs.getincrementaldecoder("utf-8")("replace").decode, ""
        while True:
            read = await typed()
            rest += decode(read, final=not read)
            *lines, rest = rest.split("\n")
            for line in [*lines, *([rest] if not read and rest else [])]:
                self.take(harmless(line[:LONGEST]))
            if not read:
                return


async def supervise_in_lines(realm: str, *, readonly: bool) -> int:
    """Join a realm and supervise it in lines."""
    from robotree.client.joining import joined

    async with joined(realm) as realm_client:
        await Lines(realm_client, realm, readonly=readonly).last()
    return exit_codes.DONE
