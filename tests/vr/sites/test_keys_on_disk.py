"""Keys are on the disk when they have been made: their files, and the names of these in their folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from robotree.protocol.links import keyring
from robotree.vr.sites import keys


@pytest.mark.parametrize("how", ["site", "link"])
def test_a_key_file_is_synced_before_its_name_and_then_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    synced: list[Path] = []
    names: list[set[str]] = []
    fsync = os.fsync

    def note(handle: int) -> None:
        synced.append(Path(f"/proc/self/fd/{handle}").resolve())
        names.append({each.name for each in tmp_path.iterdir()})
        fsync(handle)

    monkeypatch.setattr(os, "fsync", note)
    path = tmp_path / "own.key"
    if how == "site":
        keys.write(path, b"0" * 32)
    else:
        keyring.replace(path, "0" * 64)
    assert [each.parent if each.is_file() or not each.exists() else each for each in synced] == [tmp_path] * 2
    assert synced[-1] == tmp_path, "the folder last"
    assert "own.key" not in names[0], "its content is on the disk before it has its name"
    assert names[1] == {"own.key"}
