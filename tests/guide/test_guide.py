"""The guide is played: every page is loaded, every test run, every command line typed, chapter by chapter."""

from __future__ import annotations

import re
import types
from pathlib import Path

import pytest

from robotree.testing import cell, rehearse
from robotree.testing.team import unended
from robotree.tui.demo import ARM, ROVER
from robotree.vr import VirtualRobot
from robotree.vr.bundle import Bundle
from robotree.vr.world.world import World
from tests.guide.stage import Stage

GUIDE = Path(__file__).parents[2] / "docs" / "guide"
CHAPTERS = sorted(GUIDE.glob("*.md"))
BLOCK = re.compile(r"^```(?P<language>\w*) ?(?P<name>[\w./]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(chapter: Path) -> list[tuple[str, str, str]]:
    """Return language, file name and body of each fenced block."""
    found = BLOCK.finditer(chapter.read_text())
    return [(each["language"], each["name"], each["body"]) for each in found]


def run_tests(source: str, name: str) -> int:
    """Run the test functions of a source; returns how many there were."""
    module = types.ModuleType(name)
    exec(compile(source, name, "exec"), vars(module))  # noqa: S102 # a test of the guide
    tests = [value for key, value in vars(module).items() if key.startswith("test_")]
    for test in tests:
        test()
        for team in unended():
            team.close()
    return len(tests)


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_is_played(chapter: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    lines: list[str] = []
    for language, name, body in blocks(chapter):
        if language == "python":
            assert name, "a block of Python in the guide names its file: ```python page.py"
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_text(body)
            if Path(name).name.startswith("test_"):
                assert run_tests(body, name)
            elif "VirtualRobot)" in body:
                assert issubclass(Bundle.read(name).load(), VirtualRobot)
            else:
                compile(body, name, "exec")
        elif not language:
            lines += body.splitlines()
    if lines:
        with World(7) as world:
            Stage(world).play(lines, tmp_path)


def test_the_two_arms_of_the_guide_bring_the_blocks_of_their_simulated_cells(tmp_path: Path) -> None:
    bodies = {name: body for _, name, body in blocks(GUIDE / "second-arm.md")}
    page = tmp_path / "bench_for_two.py"
    page.write_text(bodies[page.name])
    left, right = cell("arm"), cell("arm")
    with rehearse(Bundle.read(page).load(), left=left, right=right) as team:
        assert team.call("bring", to="box", within=120) == 2
        for arm in (left, right):
            assert arm.world.block_place == pytest.approx((0.3, -0.3, 0.02), abs=0.005)


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_starts_each_robot_that_the_demo_lacks_before_it_is_used(chapter: Path) -> None:
    here = {ARM, ROVER}
    for line in "".join(body for language, _, body in blocks(chapter) if not language).splitlines():
        if started := re.match(r"robotree proxy \w+ ([\w-]+)", line):
            here.add(started[1])
        elif line.startswith("robotree "):
            assert set(re.findall(r"\b(?:arm|rover)-\d+\b", line)) <= here, line


def test_the_contents_name_every_chapter() -> None:
    contents = (GUIDE.parent / "virtual-robots.md").read_text()
    assert set(re.findall(r"\]\(guide/([\w-]+)\.md\)", contents)) == {path.stem for path in CHAPTERS}
