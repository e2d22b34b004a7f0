"""A process that has gone is started again only by a line that was noted for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.errors import CannotRestart
from robotree.tui.processes import restarting
from robotree.tui.processes.restarting import StartedLine, note_started, start_again


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The lines that were started, in a home without systemd."""
    found: list[tuple[str, ...]] = []
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(restarting.shutil, "which", lambda _: None)
    monkeypatch.setattr(
        restarting,
        "start_detached",
        lambda realm, _, words, environment: found.append((realm, *words, *environment)),
    )
    return found


async def test_what_was_noted_is_started_with_its_words_and_variables(started: list[tuple[str, ...]]) -> None:
    note_started("cell", "host", "host-1", StartedLine(["host", "host-1", "--most", "3"]))
    note_started("cell", "proxy", "arm-1", StartedLine(["proxy", "arm", "arm-1"], {"ROBOTREE_KEY": "realm"}))
    assert "as `apply` started it" in await start_again("cell", "host-1")
    await start_again("cell", "arm-1")
    assert started == [
        ("cell", "host", "host-1", "--most", "3"),
        ("cell", "proxy", "arm", "arm-1", "ROBOTREE_KEY"),
    ]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"host host-1": {"words": ["demo"]}}', "\0"])
async def test_a_file_with_nonsense_starts_nothing(
    started: list[tuple[str, ...]], tmp_path: Path, text: str
) -> None:
    (tmp_path / "robotree" / "cell").mkdir(parents=True, mode=0o700)
    (tmp_path / "robotree" / "cell" / "started.json").write_text(text)
    with pytest.raises(CannotRestart, match="host-1 is not started again: it is no service of systemd here"):
        await start_again("cell", "host-1")
    assert started == []
