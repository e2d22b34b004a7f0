"""docs/bring-your-own-robot.md cannot rot: its words are looked up, its class is run (test_guide.py)."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.dialect import by_name
from robotree.protocol.dialect.table import FIRST_OWN_ID
from robotree.protocol.messages import ClaimWish, GoalState, ModeKind, Reason
from robotree.vr.bundle.loader import forget, load_module

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "bring-your-own-robot.md"


def test_every_message_of_the_guide_is_in_the_dialect() -> None:
    pattern = r"\b(?:ROBOTREE_[A-Z_]+|HEARTBEAT|LOCAL_POSITION_NED|NAMED_VALUE_FLOAT)\b"
    named = set(re.findall(pattern, GUIDE.read_text())) - {"ROBOTREE_VERB", "ROBOTREE_CONTROLLER"}
    assert len(named) > 8
    assert named <= by_name().keys()


def test_every_state_reason_and_mode_of_the_guide_is_in_the_dialect() -> None:
    known = {member.name for words in (GoalState, Reason, ModeKind, ClaimWish) for member in words}
    rules = GUIDE.read_text().partition("### The rules that matter")[2].partition("### Another language")[0]
    others = {"NaN", "STATUS", "SET_MODE", "HEARTBEAT", "ROBOTREE_MODE", "LINK"}
    others |= {"CLAIM", "CLAIM_STATUS", "FENCE_MEMORY", "EEPROM"}
    assert set(re.findall(r"\b[A-Z][A-Z_]{4,}\b", rules)) - others <= known


def test_the_message_of_ones_own_in_the_guide_is_read(tmp_path: Path) -> None:
    text = GUIDE.read_text().partition("### A message of your own")[2]
    for kind, suffix in (("xml", "xml"), ("python", "py")):
        (block,) = re.findall(rf"```{kind}\n(.*?)```", text, re.DOTALL)
        (tmp_path / f"crane.{suffix}").write_text(block)
    source = (tmp_path / "crane.py").read_text()
    module = load_module(source, str(tmp_path / "crane.py"), "0" * 64)
    said = encode(module.CraneState(height=0.5, magnet=1), sequence=0, system=1, component=1)
    (frame,) = Parser().feed(said)
    assert (frame.name, frame.message) == ("CRANE_STATE", module.CraneState(0.5, 1))
    assert frame.msgid == FIRST_OWN_ID
    forget(module.__name__)


def test_every_file_that_the_guide_points_to_is_there() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", GUIDE.read_text())
    assert links
    assert [link for link in links if not (GUIDE.parent / link).exists()] == []


pytestmark = pytest.mark.e2e
CONTROLLER = ROOT / "examples" / "controller_py" / "controller.py"
LINES = 113
"""Lines of code; blank ones and the first words do not count."""


def test_it_is_one_page_and_needs_nothing_but_pymavlink() -> None:
    text = CONTROLLER.read_text()
    code = text.split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= LINES
    tree = ast.walk(ast.parse(text))
    names = {
        alias.name if isinstance(each, ast.Import) else each.module
        for each in tree
        if isinstance(each, ast.Import | ast.ImportFrom)
        for alias in each.names
    }
    assert names - sys.stdlib_module_names == {"rover_wire", "keys", "memory"}, (
        "pymavlink generates one, the others are here"
    )
