"""The pictures in the guides are whole by themselves, and their words stand apart in every viewer."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree as ET

import pytest
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

DOCS = Path(__file__).parents[2] / "docs"
NS = "{http://www.w3.org/2000/svg}"
PICTURES = sorted([*DOCS.glob("*.svg"), *DOCS.glob("screens/*.svg")])


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 # ours


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("svg", DOCS / "svg.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_word_stands_at_its_own_column(drawing: ModuleType) -> None:
    strip = Strip([Segment("  5 robots ", Style(bold=True)), Segment("· ", Style()), Segment("<b> 日本 x")])
    root = parsed(drawing.svg([strip], "robots & more"))
    words = {one.text: float(one.get("x", "")) // drawing.CELL for one in root.iter(f"{NS}text")}
    words.pop("robots & more")
    assert words == {"5": 2, "robots": 4, "·": 11, "<b>": 13, "日本": 17, "x": 22}


def test_half_blocks_become_one_image(drawing: ModuleType) -> None:
    colours = Style(color="#ff0000", bgcolor="#0000ff")
    root = parsed(drawing.svg([Strip([Segment("  "), Segment("▀▀▀", colours)])] * 2, "a picture"))
    (image,) = root.iter(f"{NS}image")
    assert (image.get("width"), image.get("height")) == (str(3 * drawing.CELL), str(2 * drawing.LINE))
    assert "▀" not in {one.text for one in root.iter(f"{NS}text")}


def test_a_terminal_with_256_colours_is_shown_with_those(drawing: ModuleType) -> None:
    strip = Strip([Segment("x", Style(color="#123456", bgcolor="#14171d"))])
    seen = {colours: parsed(drawing.svg([strip], "t", colours=colours)) for colours in (0, 256)}
    fills = {
        colours: {one.get("fill") for one in root.iter() if one.text == "x"} for colours, root in seen.items()
    }
    assert fills == {0: {"#123456"}, 256: {"#005f5f"}}


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
def test_a_picture_fetches_nothing_from_elsewhere(path: Path) -> None:
    text = path.read_text()
    parsed(text)
    assert "http" not in text.replace("http://www.w3.org/", "")
