"""Three sites and two hubs: a hub is killed, a site is cut off, a gateway is stopped, and nobody is lost."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from robotree.vr.base.history_event import HistoryEvent
from tests.command_line import ran
from tests.laboratory.campaign import stale_in

ROOT = Path(__file__).parents[2]


@pytest.mark.e2e
@pytest.mark.timeout(400)
@pytest.mark.usefixtures("place")
def test_no_robot_is_lost_and_no_tree_of_a_site_waits_when_hub_line_and_gateway_fail() -> None:
    faults = "kill:hub-1,cut:yard,stop:gateway-hall"
    words = ("-m", "tests.laboratory.campaign", "--faults", "3", "--only", faults, "--json")
    played = ran([sys.executable, *words], cwd=ROOT, within=380)
    assert played.stdout, played.stderr[-3000:]
    counted = json.loads(played.stdout.splitlines()[-1])
    assert counted["good"] is True, counted
    assert set(counted["faults"]) == set(faults.split(","))
    assert {"leaf-lab", "leaf-hall", "leaf-yard", "far", "open-lab"} <= set(counted["works"])
    assert counted["calls"]["done"] > 0


def test_the_count_finds_a_command_of_a_stale_epoch() -> None:
    def event(kind: str, epoch: int) -> HistoryEvent:
        return HistoryEvent(kind=kind, unix=0.0, robot="far", epoch=epoch)  # type: ignore[arg-type]

    assert not stale_in([event("lease", 1), event("accepted", 1), event("lease", 2), event("accepted", 2)])
    assert stale_in([event("lease", 1), event("lease", 2), event("accepted", 1)])
    assert not stale_in([event("accepted", 3), event("accepted", 0)]), "a person has none"
