"""An old copy of a host's folder is put back: its robots repeat nothing that was done since."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.testing.team import Team
from robotree.vr.base.errors import VrError
from tests.durability.stage import COMPLAINT
from tests.durability.test_pages import acts, tourist


def put_back(team: Team, folder: Any) -> None:
    """Kill the page, and start it again with an older state of its disk."""
    team.crash(after=0.0, away=1.0)
    team.wait(0.5)
    team._homes[""]._medium.put_back(folder)
    team.wait_until(lambda: "" in team._agents, within=60.0)


def test_a_command_whose_old_folder_was_put_back_ends_and_nothing_is_done_twice(
    caplog: pytest.LogCaptureFixture,
) -> None:
    team = tourist()
    call = team.start("tour", steps=400, pause=0.01, within=60.0)
    team.wait_until(lambda: len(acts(team)) > 5)
    old = team._homes[""]._medium.copy()
    for lives in (1, 2):
        team.crash()
        team.wait_until(lambda lives=lives: len(acts(team)) > 5 + 5 * lives)
    acted = len(acts(team))
    put_back(team, old)
    with pytest.raises(VrError):
        call.result()
    assert len(acts(team)) <= acted + 1, "but for what was under way"
    assert sorted(set(acts(team))) == acts(team), "nothing is done twice"
    assert not COMPLAINT.search(caplog.text), caplog.text
    assert "was commanded by start 3 of the host of tourist, and this is start 2: an old" in caplog.text


def test_a_person_binds_the_children_of_an_old_folder_again_and_all_goes_on() -> None:
    team = tourist()
    assert team.call("tour", steps=4) == [4.0, 4.0]
    old = team._homes[""]._medium.copy()
    team.crash()
    assert team.call("tour", steps=4) == [8.0, 8.0]
    put_back(team, old)
    for child in ("arm", "helper"):
        team.wait_until(lambda child=child: team.describe(child).bond is None, within=60.0)
        team._do(lambda child=child: team._client().enslave(child, team._agents[child].address))
    before = len(acts(team))
    assert team.call("tour", steps=4) == [8.0, 8.0]
    assert len(acts(team)) == before + 4
