"""Lists without a lookup service: known robots are shown, marked as possibly old."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from robotree.tui import exit_codes
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import parse
from robotree.tui.line.shell import Console, obey
from robotree.tui.terminal import answering
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until

if TYPE_CHECKING:
    from conftest import Realm


async def newcomer(realm: Realm) -> RealmClient:
    """A realm client that came after the last lookup service had gone: nobody ever told it a list."""
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    realm_client = RealmClient(realm.network.join("newcomer"))
    await realm_client.start()
    return realm_client


@pytest.mark.parametrize("words", [["ls"], ["ls", "--views"]])
async def test_without_a_lookup_service_what_is_known_is_listed_as_stale(
    words: list[str], realm: Realm, capsys: pytest.CaptureFixture[str]
) -> None:
    realm_client = await newcomer(realm)
    line = parse(words, shapes(Where.SHELL), {})
    assert await obey(realm_client, line, Console(as_json=False)) == exit_codes.NOBODY
    people = capsys.readouterr()
    assert "no lookup service answers; this list may be old" in people.err
    listed = [row.split()[0] for row in people.out.splitlines()]
    assert listed == (["NAME", "cell"] if "--views" in words else ["NAME", "mover", "rover-1"])
    assert all("stale" in row for row in people.out.splitlines()[1:])

    with answering(as_json=True):
        assert await obey(realm_client, line, Console(as_json=True)) == exit_codes.NOBODY
    programs = capsys.readouterr()
    data = json.loads(programs.out)
    assert data
    assert all(one["stale"] is True for one in data)
    assert json.loads(programs.err)["error"] == "OldList"
    await realm_client.close()


async def test_who_saw_the_last_lookup_service_go_still_knows_its_list_which_was_not_in_doubt(
    realm: Realm, capsys: pytest.CaptureFixture[str]
) -> None:
    line = parse(["ls"], shapes(Where.SHELL), {})
    assert await obey(realm.realm_client, line, Console(as_json=False)) == exit_codes.DONE
    said = capsys.readouterr()
    assert "stale" not in said.out
    assert said.err == ""
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    assert await obey(realm.realm_client, line, Console(as_json=False)) == exit_codes.NOBODY
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in rows] == ["NAME", "arm-1", "rover-1"]
