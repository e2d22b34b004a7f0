"""When a host has been silent for too long: as far as the one that stands by has watched."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from robotree.vr.agents.standby import LOOK, Silence, StandBy
from robotree.vr.journal.store import Owner


def owner(number: int = 1, beat: int = 0, *, lives: bool = True) -> Owner:
    return Owner(number, "h1", beat, lives)


def watched(silence: Silence, began: float, seconds: float, seen: Owner | None) -> float | None:
    """Look again and again for so long [s]; return after how long it was too long, None: it was not."""
    for step in range(round(seconds / LOOK) + 1):
        if silence.look(seen, began + step * LOOK):
            return step * LOOK
    return None


def test_an_owner_without_a_sign_is_silent_whether_its_process_has_ended_or_not() -> None:
    for lives in (True, False):
        found = watched(Silence(3.0), 100.0, 5.0, owner(lives=lives))
        assert found is not None
        assert 3.0 <= found < 3.0 + 2 * LOOK


def test_each_sign_and_each_new_owner_begins_the_time_anew() -> None:
    silence = Silence(3.0)
    assert watched(silence, 0.0, 2.9, owner()) is None
    assert watched(silence, 2.9, 2.9, owner(beat=1)) is None
    assert watched(silence, 5.8, 2.9, owner(number=2, beat=1)) is None
    assert watched(silence, 8.7, 3.2, owner(number=2, beat=1)) is not None


def test_what_nobody_watched_is_no_silence() -> None:
    silence = Silence(3.0)
    assert not silence.look(owner(), 0.0)
    assert not silence.look(owner(), 1000.0), "this process was paused itself"
    assert not silence.look(None, 1000.1), "the log could not be looked at"
    assert watched(silence, 1000.2, 2.8, owner()) is None


def test_where_there_was_never_an_owner_nothing_is_taken() -> None:
    assert watched(Silence(3.0), 0.0, 10.0, None) is None


@pytest.mark.parametrize(("host", "least", "most"), [("h1", 3.0, 3.5), ("h2", 0.0, 0.1)])
async def test_who_stands_by_waits_for_a_host_that_has_ended_and_takes_its_own_log_at_once(
    realm: Any, host: str, least: float, most: float
) -> None:
    """A host that comes back in time finds its robots."""
    place: Any = SimpleNamespace(look=lambda: Owner(7, host, 0, lives=False), take=lambda *values: values)
    began = realm.runner.now()
    taken = await StandBy(realm.network.join("h2"), "h2", place, of="h1", after=3.0).take_over()
    assert taken == ("h2", 7)
    assert least <= realm.runner.now() - began <= most
