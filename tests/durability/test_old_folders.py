"""An old copy of a host's folder is put back: its robots repeat nothing that was done since."""

from __future__ import annotations

import asyncio
import shutil

import pytest

from robotree.vr.base.errors import VrError
from tests.durability.stage import PATIENCE, Stage

pytestmark = pytest.mark.e2e


async def test_a_command_whose_old_folder_was_put_back_ends_and_nothing_is_done_twice(stage: Stage) -> None:
    host = stage.host()
    folder, copy = stage.folder / "h1.journal", stage.folder / "copy"
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "tour", {"steps": 400, "pause": 0.01}))
    await stage.until_effects(5)
    await host.kill()
    shutil.copytree(folder, copy)
    for lives in range(1, 3):
        acted = len(stage.ended)
        await host.start()
        await stage.until_effects(acted + 5 * lives)
        await host.kill()
    acted = len(stage.ended)
    shutil.rmtree(folder)
    shutil.copytree(copy, folder)
    await host.start()
    with pytest.raises(VrError):
        await call
    assert len(stage.ended) <= acted + 1, "but for what was under way"
    assert stage.twice() == []
    assert "was commanded by start 3 of the host of tourist, and this is start 2: an old" in stage.told()
    stage.expect_silence()


async def free(stage: Stage, child: str) -> None:
    """Wait until nobody commands a robot any more."""
    async with asyncio.timeout(PATIENCE):
        while (await stage.realm_client.describe(child)).bond is not None:  # noqa: ASYNC110 # it is asked
            await asyncio.sleep(0.05)


async def test_a_person_binds_the_children_of_an_old_folder_again_and_all_goes_on(stage: Stage) -> None:
    host = stage.host()
    host.environment = {}  # its children are free when they have waited as long as usual
    folder, copy = stage.folder / "h1.journal", stage.folder / "copy"
    await stage.furnish(host)
    await stage.realm_client.call("tourist", "tour", {"steps": 4})
    await host.kill()
    shutil.copytree(folder, copy)
    await host.start()
    await stage.realm_client.call("tourist", "tour", {"steps": 4})
    await host.kill()
    shutil.rmtree(folder)
    shutil.copytree(copy, folder)
    await host.start()
    for place, child in (("tourist.arm", "arm-1"), ("helper.arm", "arm-2")):
        await free(stage, child)
        await stage.realm_client.enslave(*place.split("."), child)
    stage.effects_file.write_text("")
    assert await stage.realm_client.call("tourist", "tour", {"steps": 4}) == [8.0, 8.0]
    assert stage.ended == [0, 1, 2, 3]
