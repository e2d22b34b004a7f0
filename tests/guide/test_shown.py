"""What a guide shows besides commands is read by the program that reads it: files, panels, pages, benches."""

from __future__ import annotations

import re
import types
from pathlib import Path

import pytest

from robotree.proxy.kinds import KINDS
from robotree.sim.kinds import KINDS as SIMULATED
from robotree.tui.panels.author import RobotPanel
from robotree.tui.realm_file.reading import read_file
from robotree.tui.screen import keymap, themes
from robotree.vr import VirtualRobot
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.panel import read_panel
from tests.guide.words import DOCS, GUIDES

ROOT = DOCS.parent
BLOCK = re.compile(r"^```(\w+)(?: ([\w./]+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def shown(page: str, language: str) -> list[tuple[str, str]]:
    """Return file name and body of each fenced block of a language."""
    found = BLOCK.findall((DOCS / page).read_text())
    return [(name, body) for each, name, body in found if each == language]


def test_the_realm_file_of_the_guide_is_one() -> None:
    ((_, text),) = shown("operating.md", "yaml")
    found = read_file(text, "cell.yaml", {"proxy": KINDS.keys(), "sim": SIMULATED.keys()})
    assert [robot.name for robot in found.robots] == ["mover", "team"]


@pytest.mark.parametrize(
    ("page", "names"), [("services-of-robots.md", ["listener"]), ("guide/after-a-crash.md", ["h1", "h2"])]
)
def test_a_part_of_a_realm_file_is_one(page: str, names: list[str]) -> None:
    ((_, text),) = shown(page, "yaml")
    found = read_file(text, "cell.yaml")
    assert [one.name for one in (*found.processes, *found.robots)] == names


def test_the_keys_and_the_theme_of_the_guide_are_taken() -> None:
    (_, keys), (_, theme) = shown("your-own-screen.md", "toml")
    assert keymap.read(keys, "keys.toml").keys("enslave") == ("E",)
    assert themes.read(theme, "desk", "desk.toml").primary == "#005F87"


def test_the_panels_of_the_guide_are_panels() -> None:
    ((_, words),) = shown("panels.md", "yaml")
    assert len(read_panel(words.encode(), "arm.panel.yaml").parts) == 7
    ((_, source),) = shown("panels.md", "python")
    module = types.ModuleType("waving")
    exec(compile(source, "waving.panel.py", "exec"), vars(module))  # noqa: S102 # a test of the guide
    assert issubclass(module.Waving, RobotPanel)


def test_a_named_page_outside_of_the_chapters_is_a_page(tmp_path: Path) -> None:
    pages = [each for path in DOCS.glob("*.md") for each in shown(path.name, "python") if each[0]]
    assert len(pages) >= 2
    for name, body in pages:
        (tmp_path / name).write_text(body)
        assert issubclass(Bundle.read(tmp_path / name).load(), VirtualRobot)


def test_every_program_that_a_figure_names_is_there() -> None:
    text = "\n".join(path.read_text() for path in GUIDES)
    named = {ROOT / path for path in re.findall(r"python ((?:bench|docs|tests)/[\w/]+\.py)", text)}
    modules = set(re.findall(r"python -m (tests(?:\.\w+)+)", text))
    assert len(named) > 30
    assert len(modules) > 4
    assert [path for path in sorted(named) if not path.exists()] == []
    for module in modules:
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), module
