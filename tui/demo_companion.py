"""The demo of the companion: visitors come, are greeted, guided and served; a script leads the robot.

Without a person the demo is what a recogniser, an operator and a clock would be: it reports to the script
who has come and who leaves, by what the robot's ears report; changes the role in the middle; tries what must
be refused; stops everything, and releases it again.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import Counter
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.tui.demo import EXAMPLES, Tell, said
from robotree.tui.errors import ValueRefused
from robotree.tui.terminal import aside
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient

NAME = "companion"
SITES = "sites"
AWAY = "away"
TRAVEL = "travel"
MCP = "mcp"
COMPOSE = "compose"
STORIES = ("", "cell", NAME, SITES, AWAY, TRAVEL, MCP, COMPOSE)
"""The demos by name; the cell needs none."""
ROBOT, SCRIPT, VIEW, EYES = "companion", "evening", "flat", "recogniser"
ERRAND, BUSY_CART = "errand", "cart-1"
"""The script that chooses a robot itself, and the one that has something else to do then."""
MOUTH, EARS = "mouth", "ears"
PEOPLE = {11: "anna", 12: "bela", 13: "cleo"}
"""The names of people by their tags."""
LONGEST = 900.0
"""[s] that the evening may take."""
LEADS = "active"
"""The condition of a script that leads all its partners."""
LISTEN = 0.2
"""[s] between two questions what was heard."""
DOOR, NEAR = (-1.55, -1.10), 0.5
"""[m] Where the companion receives visitors, and by how much it may stand beside that."""
BY_EAR = 30.0
"""[s] after which somebody who has said a name counts as seen, also if no camera has recognised the tag."""
WORD, OTHER_WORDS = "wait", ("good bye", "go on", "thank you")
"""A spoken word that interrupts; what else the ears expect, the first of which tries them."""
TRIES, HEARS = 3, 20.0
"""How often a word is said until it is understood, and [s] that the ears may take: they load a model."""
OBEYS = 10.0
"""[s] in which it has ended what it did then, at most."""
ROLE = "child"
"""Played after the change."""
COUNTED = (
    *("greeted", "recognised", "cups", "left_early", "dropped", "role_changes", "stops", "refused"),
    *("interrupted", "orders", "errands"),
)
"""The counters of the evening, by their names in the verdict."""
FORCE = 60.0
"""[N] that no hand may feel on the way."""


def wanted(story: str) -> bool:
    """Whether this demo is meant by what stands on the command line.

    Raises:
        ValueRefused: there is no such story.
    """
    if story not in STORIES:
        raise ValueRefused("STORY", f"there is no demo {story!r}; there is: {', '.join(STORIES[1:])}")
    return story == NAME


class Companion:
    """A flat with visitors, and the companion in it."""

    file, goals = EXAMPLES / "companion" / "flat.realm.yaml", None

    async def open(self, realm_client: RealmClient) -> str:
        """Lead the companion to the door, and give it to its script: a person starts that.

        Visitors come only when it stands at the door, and once the script has it nobody else can lead it
        there.
        """
        aside("the companion goes to the door: about 10 s …")
        await realm_client.call(ROBOT, "go_to", {"place": "door"}, deadline=60.0)
        await realm_client.enslave(SCRIPT, "robot", ROBOT)
        return f"next: select {SCRIPT}, ⏎ opens its panel, ^r runs start; ? shows all keys"

    async def accompany(self, realm_client: RealmClient, tell: Tell) -> None:  # noqa: ARG002 # the robots speak
        """Be the recogniser: report to the script who has come and who leaves, to each run of it anew."""
        number, runs, here, reported = 0, 0, set[str](), set[str]()
        while True:
            await asyncio.sleep(LISTEN)
            with suppress(VrError):  # the script may not run yet, or not any more
                number, who, text = await heard(realm_client, number)
                here |= {who} - {""}
                script = await realm_client.describe(SCRIPT)
                started = script.calls.get("start", 0)
                runs, reported = started, reported if started == runs else set[str]()
                if "have to go" in text or "Thank you" in text:
                    here.discard(who)
                if script.attributes.get("condition") != LEADS:
                    continue  # it would refuse, and each refusal is a line of its log
                if "have to go" in text:
                    await realm_client.call(SCRIPT, "person_left", {"who": who})
                for one in sorted(here - reported):
                    await realm_client.call(SCRIPT, "person_seen", {"who": one})
                    reported.add(one)

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:  # noqa: ARG002  a fixed course
        """Play the evening and print, as the last line, what came of it as one JSON object."""
        from robotree.client.joining import joined

        began = time.monotonic()
        async with joined(realm) as realm_client:
            evening = Evening(realm_client, folder)
            try:
                async with asyncio.timeout(LONGEST):
                    await evening.run()
            except (VrError, TimeoutError) as error:
                evening.trouble = str(error) or f"the evening took longer than {LONGEST:g} s"
            await evening.end()
            verdict = await evening.verdict()
        verdict["wall_s"] = round(time.monotonic() - began, 1)
        return said(verdict)


STORY = Companion()


async def heard(realm_client: RealmClient, after: int) -> tuple[int, str, str]:
    """Return the newest utterance of a visitor: its number, who spoke, the words; nobody if it is not new.

    Args:
        realm_client: the robots.
        after: number of the utterance that was taken last.
    """
    number, _, rest = (await realm_client.describe("head")).attributes.get("heard", "").partition(" ")
    if not number or int(number) <= after:
        return after, "", ""
    tag, _, text = rest.partition(" ")
    return int(number), PEOPLE.get(int(tag), ""), text


class Evening:
    """One evening.

    Args:
        realm_client: the robots.
        folder: for pictures.
    """

    def __init__(self, realm_client: RealmClient, folder: Path) -> None:
        self._realm_client, self._folder = realm_client, folder
        self._said: Counter[str] = Counter()
        self._reported: set[str] = set()
        """Of whom the script knows that they have come."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._number = 0
        self._pictures: list[str] = []
        self.trouble = ""
        self._counts = Counter[str]()
        self._by_ear = False
        """Whether there are a mouth and ears: else words go to the script as text."""
        self._chosen = self._because = ""
        """The robot that was chosen for the errand, and why."""
        self._began = time.monotonic()

    async def run(self) -> None:
        """From the first visitor to the charging place."""
        realm_client = self._realm_client
        await self._open_mouth_and_ears()
        await self._call(ROBOT, "go_to", place="door")
        await realm_client.enslave(SCRIPT, "robot", ROBOT)
        await realm_client.tell(SCRIPT, "start", {}, deadline=LONGEST)
        self._do(self._watch_the_door())
        await self._look("waiting")
        await self._refused("head.look", "head", "look", pan=0.5, tilt=0.0)
        while not (self._counts["cups"] >= 2 and self._counts["left_early"]):
            await self._listen()
            await asyncio.sleep(LISTEN)
        await self._stop()
        await realm_client.cancel(SCRIPT)
        await realm_client.release(SCRIPT, "robot")
        await self._refused("too fast", ROBOT, "go_to", place="table", speed=0.7)
        await self._refused("out of reach", ROBOT, "reach", x=2.9, y=2.3, z=1.0)
        order = asyncio.create_task(self._leave_an_order())
        errand = asyncio.create_task(self._run_an_errand())
        self._note(f"the battery holds {100 * await self._charge():.1f} %")
        await self._look("charging")
        await errand
        await self._until_carried_out(await order)

    async def verdict(self) -> dict[str, Any]:
        """Return the result of the demo."""
        counts = self._counts
        peak = 0.0
        for hand in ("left", "right"):
            peak = max(peak, (await self._realm_client.describe(hand)).readings.get("peak_force", 0.0))
        expected = counts["greeted"] == len(PEOPLE) and counts["cups"] >= 2 and counts["left_early"] == 1
        handled = counts["dropped"] == 1 and counts["stops"] == 1 and counts["role_changes"] >= 1
        handled = handled and counts["interrupted"] == 1 and counts["orders"] == 1 and counts["errands"] == 1
        return {
            "ok": not self.trouble and expected and handled and peak < FORCE,
            **{each: counts[each] for each in COUNTED},
            "spoken": "by mouth and ears" if self._by_ear else "as text",
            "chosen": self._chosen,
            "because": self._because,
            "peak_force_n": round(peak, 1),
            "trouble": self.trouble,
            "pictures": self._pictures,
        }

    # -- what people do

    async def _listen(self) -> None:
        """Take the utterances of visitors, and report to the script who has come and who goes."""
        self._number, who, text = await heard(self._realm_client, self._number)
        if not text:
            return
        self._note(f"{who}: {text}")
        self._said[who] += 1
        if self._said[who] == 1:
            self._counts["greeted"] += 1
            self._do(self._report_by_ear(who))
            if self._counts["greeted"] == 1:
                self._do(self._interrupt())
            await self._look(f"{who}-comes")
        elif "have to go" in text:
            self._counts["left_early"] += 1
            await self._realm_client.call(SCRIPT, "person_left", {"who": who})
        elif "fall" in text:
            self._counts["dropped"] += 1
            await self._look("a-cup-falls")
        elif "Thank you" in text:
            self._counts["cups"] += 1
            await self._look(f"{who}-has-a-cup")
            if self._counts["cups"] == 1:
                await self._change_role()

    async def _watch_the_door(self) -> None:
        """Have the recogniser tell who comes, by the pictures of the companion's eye."""
        while True:
            try:
                at = (await self._realm_client.describe("base")).readings
                if math.dist((at["x"], at["y"]), DOOR) > NEAR:
                    await asyncio.sleep(1.0)  # no pictures are taken on the way
                    continue
                who = str(await self._call(EYES, "newcomer", within=5.0))
            except (VrError, KeyError):  # nobody new came, or it is not there
                await asyncio.sleep(LISTEN)
                continue
            self._note(f"the camera recognises {who}")
            self._counts["recognised"] += 1
            await self._report(who)

    async def _report_by_ear(self, who: str) -> None:
        """Report somebody who has said a name and was not recognised in time."""
        await asyncio.sleep(BY_EAR)
        await self._report(who)

    async def _report(self, who: str) -> None:
        if who not in self._reported:
            self._reported.add(who)
            await self._realm_client.call(SCRIPT, "person_seen", {"who": who})

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        """Do something beside the evening, which ends with it."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def end(self) -> None:
        """End what is done beside the evening."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _change_role(self) -> None:
        """Another role, under the running script."""
        await self._realm_client.call(SCRIPT, "play", {"role": ROLE, "at": "robot"})
        self._counts["role_changes"] += 1
        self._note(f"from now on it plays the role {ROLE!r}")

    async def _stop(self) -> None:
        """Stop everything while the robot goes about, see that it stands, and release it."""
        await asyncio.sleep(4.0)
        await self._realm_client.stop(None)
        await asyncio.sleep(1.0)
        before = (await self._realm_client.describe("base")).readings
        await asyncio.sleep(1.0)
        after = (await self._realm_client.describe("base")).readings
        if abs(after["x"] - before["x"]) + abs(after["y"] - before["y"]) > 0.01:
            self.trouble = "it moved while it was stopped"
        self._counts["stops"] += 1
        self._note("everything stands; it is released")
        await self._realm_client.resume(None)

    async def _interrupt(self) -> None:
        """Say a word while it leads a visitor to the sofa: it stands, and goes on after a while."""
        realm_client, word = self._realm_client, ""
        while not (await self._goes() and (word := await self._spoken(WORD)) and await self._goes()):  # noqa: ASYNC110
            await asyncio.sleep(LISTEN)  # it arrived before the word was understood: on its next way
        began = time.monotonic()
        await realm_client.call(SCRIPT, "spoken", {"word": word})
        while await self._goes() and time.monotonic() - began < OBEYS:  # noqa: ASYNC110 # it is asked
            await asyncio.sleep(LISTEN / 4)
        if (took := time.monotonic() - began) < OBEYS:
            self._counts["interrupted"] += 1
        self._note(f"somebody says {word!r}: it has ended what it did after {took:.1f} s")

    async def _goes(self) -> bool:
        return (await self._realm_client.describe(ROBOT)).busy == "go_to"

    async def _open_mouth_and_ears(self) -> None:
        """Have two services join, and try them; without what they stand on, words go as text."""
        realm_client = self._realm_client
        try:
            for name in (MOUTH, EARS):
                await realm_client.create(EXAMPLES / "services" / f"{name}.py", name)
            await realm_client.enslave(EARS, MOUTH, MOUTH)
            await self._call(EARS, "expect", sentences=[WORD, *OTHER_WORDS])
            await realm_client.tell(EARS, "listen", {}, deadline=LONGEST)
            async with asyncio.timeout(HEARS):
                while not (await realm_client.describe(MOUTH)).streams[0].listeners:  # noqa: ASYNC110 # asked
                    await asyncio.sleep(LISTEN)
            self._by_ear = True
            await self._spoken(OTHER_WORDS[0])
        except (VrError, TimeoutError) as error:
            self._by_ear = False
            self._note(f"words go as text, for there is no mouth with ears: {error or 'they do not listen'}")

    async def _spoken(self, word: str) -> str:
        """Have the mouth say a word, and return what the ears understand; without them the word itself."""
        for _ in range(TRIES if self._by_ear else 0):
            before = (await self._call(EARS, "latest"))["number"]
            await self._call(MOUTH, "say", text=word)
            understood = await self._call(EARS, "next", after=before, within=HEARS)
            self._note(f"the mouth says {word!r}, the ears understand {understood['text']!r}")
            if understood["text"]:
                return str(understood["text"])
        self._by_ear = False
        return word

    async def _run_an_errand(self) -> None:
        """Have whoever is free do an errand while the companion is away: chosen by bids, held by a lease."""
        realm_client = self._realm_client
        await self._until_it_charges()
        await realm_client.tell(BUSY_CART, "move", {"x": 0.5, "y": 0.0, "speed": 0.01}, deadline=120.0)
        errand = asyncio.create_task(self._call(ERRAND, "start", deadline=120.0))
        while not errand.done():
            slot = (await realm_client.describe(ERRAND)).slot("robot")
            if slot and slot.child and slot.why and not self._chosen:
                self._chosen, self._because = slot.child.name, slot.why
                self._note(f"an errand: {slot.why}")
            await asyncio.sleep(LISTEN / 4)
        self._note(f"the errand of {self._chosen}: {await errand}")
        self._counts["errands"] += 1

    async def _until_it_charges(self) -> None:
        while (await self._realm_client.describe(ROBOT)).busy != "charge":  # noqa: ASYNC110 # it is asked
            await asyncio.sleep(LISTEN)

    async def _leave_an_order(self) -> str:
        """Leave an order while it is away at its charging place; return its key."""
        await self._until_it_charges()
        left = await self._realm_client.orders.leave(ROBOT, "say", {"text": "I am back."}, may_take=60.0)
        self._note(f"order {left.order.ticket} is left for it while it charges")
        return left.order.key

    async def _until_carried_out(self, key: str) -> None:
        """Wait until the order has its result: once, after it has charged."""
        while True:
            orders = {each.key: each for each in (await self._realm_client.orders.board()).orders}
            if key in orders and orders[key].over:
                break
            await asyncio.sleep(LISTEN)
        order = orders[key]
        if order.state == "done":
            self._counts["orders"] += 1
        self._note(f"order {order.ticket} is {order.state}: {order.value or order.why}")

    async def _charge(self) -> float:
        """Go and charge a little."""
        now = (await self._realm_client.describe("base")).readings.get("battery", 0.0)
        return float(await self._call(ROBOT, "charge", until=min(now + 0.001, 1.0), deadline=120.0))

    # -- helpers

    async def _call(self, robot: str, command: str, *, deadline: float = 60.0, **arguments: Any) -> Any:
        return await self._realm_client.call(robot, command, arguments, deadline=deadline)

    async def _refused(self, what: str, robot: str, command: str, **arguments: Any) -> None:
        """Try what must be refused."""
        try:
            await self._realm_client.call(robot, command, arguments)
        except VrError as error:
            self._counts["refused"] += 1
            self._note(f"refused, as it must be: {error}")
        else:
            self.trouble = f"{what} was not refused"

    async def _look(self, name: str) -> None:
        """Take a picture; a view that does not answer spoils nothing."""
        try:
            picture = await self._realm_client.look(VIEW, width=480, height=300)
        except VrError:
            return
        path = self._folder / f"{len(self._pictures) + 1:02}-{name}.jpg"
        await asyncio.to_thread(path.write_bytes, picture.jpeg)
        self._pictures.append(str(path))

    def _note(self, text: str) -> None:
        aside(f"{time.monotonic() - self._began:6.1f} s  {text}")
