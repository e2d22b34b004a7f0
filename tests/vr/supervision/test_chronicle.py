"""Lookup services remember who came, left, died and hung; hosts remember the logs of their ended robots."""

from __future__ import annotations

import pytest

from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import NotVirtual
from robotree.vr.base.presence import Held, Presence
from robotree.vr.base.requests import LoggedLine, Remembered
from robotree.vr.lookup.chronicle import APART, Chronicle, merged, site_told
from robotree.vr.world.testing import until
from tests.vr.supervision.world import World

HOST, ARM = "host/host-1/1", "robot/arm-1/2"


class Watched:
    """A chronicle, with what the system would say of the process of every agent."""

    def __init__(self) -> None:
        self.hang: set[str] = set()
        self.live = {HOST, ARM}
        self.presence = Presence(held=self._held, unheard=self._unheard)
        self.chronicle = Chronicle(self.presence, lambda: 1000.0)

    def _held(self, pattern: str) -> list[Held]:
        return [Held(pattern, "process 7", "")]

    def _unheard(self, pattern: str) -> list[tuple[Held, bool]]:
        return [(Held(one, "process 7", ""), True) for one in self.hang if one == pattern]

    @property
    def texts(self) -> list[str]:
        return [line.line.text for line in self.chronicle.lines]


def test_a_death_and_a_hang_are_told_apart_with_the_process() -> None:
    watched = Watched()
    watched.chronicle.seen(HOST, there=True)
    watched.chronicle.seen(HOST, there=False)
    watched.chronicle.seen(ARM, there=True)
    watched.hang = {ARM}
    watched.chronicle.seen(ARM, there=False)
    watched.hang = set()
    watched.chronicle.seen(ARM, there=True)
    assert watched.texts == [
        "host-1 (host, process 7) has come",
        "host-1 (host, process 7) has died: its process has gone",
        "arm-1 (robot, process 7) has come",
        "arm-1 (robot, process 7) hangs and does not answer",
        "arm-1 (robot, process 7) answers again",
    ]
    assert [line.line.level for line in watched.chronicle.lines] == ["info", "error", "info", "error", "info"]


def test_an_agent_that_ends_while_it_hangs_has_died() -> None:
    watched = Watched()
    watched.chronicle.seen(ARM, there=True)
    watched.hang = {ARM}
    watched.chronicle.seen(ARM, there=False)
    watched.chronicle.look()
    assert watched.texts[-1].endswith("hangs and does not answer")
    watched.hang = set()
    watched.chronicle.look()
    watched.chronicle.look()
    assert watched.texts[2:] == ["arm-1 (robot, process 7) has died: its process has gone"]


def test_what_two_services_saw_is_one_line_and_what_a_robot_said_twice_is_two() -> None:
    def seen(unix: float, text: str = "arm-1 has died", key: str = ARM, command: str = "") -> Remembered:
        return Remembered("arm-1", LoggedLine(1, unix, "error", text, command, key))

    here, there, again = seen(5.0), seen(5.4), seen(5.4 + APART)
    assert merged([there, again, here]) == [here, again]
    said = [seen(1.0, "go_to is done", "k1", "go_to"), seen(1.0, "go_to is done", "k1", "go_to")]
    assert merged(said) == said


def test_what_another_site_saw_of_an_agent_counts_less_than_what_was_told_where_it_is() -> None:
    def seen(unix: float, text: str) -> Remembered:
        return Remembered("arm-1", LoggedLine(1, unix, "info", text, "", ARM))

    died = seen(5.0, "arm-1 (robot, site hall, process 7) has died: its process has gone")
    gone = seen(5.3, "arm-1 (robot, site hall) is not seen any more")
    cut = seen(5.3 + 2 * APART, "arm-1 (robot, site hall) is not seen any more")
    assert merged([gone, cut, died]) == [died, cut]
    watched = Watched()
    for key in ("gateway/lab/3", "site/hall", f"at/hall/{ARM}"):
        watched.presence.count(key, there=True)
    for key in (HOST, ARM):
        watched.chronicle.seen(key, there=True)
    watched.chronicle.seen(ARM, there=False)
    assert watched.texts == [
        "host-1 (host, site lab, process 7) has come",
        "arm-1 (robot, site hall) has come",
        "arm-1 (robot, site hall) is not seen any more",
    ]
    assert [site_told(line.line) for line in watched.chronicle.lines] == ["lab", "hall", "hall"]


async def test_the_realm_remembers_by_whom_a_robot_was_created_stopped_and_deleted(world: World) -> None:
    with sitting_at("pts/3"):
        await world.create("carrier")
        await world.realm_client.stop(None)
        await world.realm_client.resume(None)
        await world.realm_client.delete("carrier")
        with pytest.raises(NotVirtual):
            await world.realm_client.delete("r1")
    logged = [line.text for line in world.agents["r1"].runtime.log.since(0)]
    assert not [text for text in logged if "deleted" in text], "a refusal is no deletion"
    await until(lambda: not world.host.agents, "it has ended")
    history = [one.line for one in await world.realm_client.read_history() if one.name == "carrier"]
    texts = [line.text for line in history]
    assert any(text.startswith("carrier (robot") and text.endswith(") has come") for text in texts)
    assert any("created from" in text and text.endswith("@pts/3") for text in texts)
    stops = [text for text in texts if text.startswith("stopped: ")]
    assert len(stops) == 1, "two ways to a robot are one stop"
    assert stops[0].endswith("@pts/3's protective stop")
    assert any(text.startswith("resumed by") and text.endswith("@pts/3") for text in texts)
    assert any(text.startswith("deleted by") and text.endswith("@pts/3") for text in texts)
    assert any(text.endswith(") has left") for text in texts)
    assert all(line.unix > 0 for line in history)
