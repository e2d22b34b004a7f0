"""Why a robot moved: the tree of calls is the tree of keys, across hosts."""

from __future__ import annotations

from typing import Any

from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.supervision.past import explain, last_motion


def event(kind: Any, robot: str, key: str, unix: float = 1.0, **more: Any) -> HistoryEvent:
    return HistoryEvent(kind=kind, unix=unix, robot=robot, key=key, **more)


ANNA = event("accepted", "team", "k", person="anna@pts/3", caller="anna@pts/3")
STEP = event("accepted", "arm", "k/2/1", 2.0, caller="team", line=12, epoch=7)
END = event("ended", "arm", "k/2/1", 3.0)
HEARD = event("answered", "team", "k/2/1", 4.0)


def test_a_motion_leads_up_to_the_person_across_hosts() -> None:
    chain = explain("k/2/1", [("host h1", ANNA), ("host h2", STEP), ("host h2", END), ("host h1", HEARD)])
    assert chain is not None
    assert [(link.call.robot, link.source, link.step) for link in chain.links] == [
        ("arm", "host h2", "2/1"),
        ("team", "host h1", ""),
    ]
    assert (chain.links[0].ended, chain.links[0].answered) == (END, HEARD)
    assert (chain.person, chain.missing) == ("anna@pts/3", "")


def test_a_caller_of_which_nothing_is_kept_is_named() -> None:
    chain = explain("k/2/1", [("host h2", STEP)])
    assert chain is not None
    assert (chain.missing, chain.person) == ("team", "")


def test_of_a_key_that_nobody_knows_nothing_is_said() -> None:
    assert explain("k/3", [("host h1", ANNA)]) is None


def test_the_last_motion_is_the_latest_of_all_hosts() -> None:
    assert last_motion(
        [STEP, event("accepted", "arm", "old", 1.5), event("ended", "arm", "x", 9.0)], "arm"
    ) == ("k/2/1")
    assert last_motion([ANNA], "arm") == ""
