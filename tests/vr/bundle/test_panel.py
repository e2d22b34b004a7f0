"""A panel is read by its schema, judged by this machine's trust, and never has more rights than its robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.errors import BadBundle, BadPanel, NotSigned, UnknownSigner
from robotree.vr.base.permissions import Permissions
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.panel import (
    LARGEST,
    MOST,
    BarPart,
    ButtonPart,
    FormPart,
    PicturePart,
    PlotPart,
    ReadingPart,
    TextPart,
    read_panel,
)
from robotree.vr.supervision.panels import JudgedPanel, judged
from tests.vr.bundle.signed import key_of, of, page, signer, trusting

EXAMPLES = Path(__file__).parents[3] / "examples"
PANEL = """
title: Guide
parts:
  - text: What it does.
  - reading: battery
    label: Battery
  - bar: battery
    from: 0
    to: 100
  - plot: z
    seconds: 10
  - picture: cell.wrist
    mark: [u, v]
  - button: wave
    label: Wave
    arguments: {times: 3}
    confirm: Is the way free?
  - form: wave
"""
GUIDE = RobotDescription(
    address=Address("robot", "guide", "1"),
    kinds=("Guide", "VirtualRobot"),
    commands=(CommandSpec(name="wave", parameters=(FieldSpec(name="times", type="int"),)),),
)


def refused(text: str | bytes) -> str:
    with pytest.raises(BadPanel) as error:
        read_panel(text.encode() if isinstance(text, str) else text, "guide.panel.yaml")
    said = str(error.value)
    assert said.startswith("the panel guide.panel.yaml is not shown: ")
    return said.removeprefix("the panel guide.panel.yaml is not shown: ")


def test_a_panel_is_a_list_of_parts() -> None:
    panel = read_panel(PANEL.encode(), "guide.panel.yaml")
    assert panel.title == "Guide"
    assert panel.parts == (
        TextPart("What it does."),
        ReadingPart("battery", "Battery"),
        BarPart("battery", 0.0, 100.0),
        PlotPart("z", 10.0),
        PicturePart("cell", "wrist", ("u", "v")),
        ButtonPart("wave", "Wave", {"times": 3}, "Is the way free?"),
        FormPart("wave"),
    )


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.panel.yaml")), ids=lambda path: path.name)
def test_the_panels_of_the_examples_fit_their_pages(path: Path) -> None:
    found = Bundle.read(path.with_name(path.name.replace(".panel.yaml", ".py")))
    panel = read_panel(found.files[path.name], path.name)
    commands = set(dir(found.load()))
    named = {one.command for one in panel.parts if isinstance(one, ButtonPart | FormPart)}
    assert named
    assert named <= commands


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "write `title: …` and `parts:`"),
        ("title: x", "it has no list `parts:`"),
        ("parts: []", "it has no list `parts:`"),
        ("title: x\nparts:\n  - text: a\nscript: x", "line 4, column 1: a panel has no 'script'"),
        ("parts:\n  - buton: wave", "line 2, column 5: there is no part 'buton' (did you mean 'button'?)"),
        ("parts:\n  - button: wave\n    robot: arm-1", "line 3, column 5: a button has no 'robot'"),
        ("parts:\n  - text: a\n    command: stop", "a text has no 'command'"),
        ("parts:\n  - bar: z\n    from: 3\n    to: 3", "the bar goes from 3 to 3"),
        ("parts:\n  - bar: z\n    to: high", "to is a number"),
        ("parts:\n  - plot: z\n    seconds: 100000", "a plot shows 1 to 600 seconds"),
        ("parts:\n  - picture: cell", "write VIEW.CAMERA"),
        ("parts:\n  - picture: cell.wrist\n    mark: [x]", "a mark is two readings"),
        ("parts:\n  - button: wave\n    arguments: [1]", "arguments are written {name: value}"),
        ("parts:\n  - button: wave\n    arguments: {times: {a: 1}}", "a single value belongs here"),
        ("parts:\n  - text: " + "a" * 300, "a text of 1 to 200 characters belongs here"),
        ("parts:\n" + "  - text: a\n" * (MOST + 1), f"it has {MOST + 1} parts, and {MOST} are allowed"),
        ("parts:\n  - &a text: a\n  - *a", "cannot be used"),
        ("parts:\n  - text: !!python/object:os.system x", "line 2"),
        ("parts:\n  - text: a\x1b[31m", "line 2"),
        (b"\xff\xfe", "it is not UTF-8 text"),
        (b"#" * (LARGEST + 1), f"it has {LARGEST + 1} bytes, and {LARGEST} are allowed"),
        ("parts:\n  - text: " + "[" * 50, "line 2"),
    ],
)
def test_what_the_schema_does_not_know_is_refused_with_its_place(text: str | bytes, reason: str) -> None:
    assert reason in refused(text)


def brought(panel: str = PANEL) -> dict[str, bytes]:
    return {"guide.panel.yaml": panel.encode()}


def test_a_trusted_panel_is_shown(tmp_path: Path) -> None:
    gate = Gate(trusting(tmp_path, signer("anna")))
    streams = Permissions((), (), ("cell.wrist",))
    for here in (True, False):
        panel = judged(of("anna", streams, files=brought()), GUIDE, gate, here=here).panel
        assert panel is not None
        assert panel.title == "Guide"
    own = judged(page(brought()), GUIDE, Gate(), here=True).panel
    assert own is not None


def test_a_robot_without_a_panel_has_the_generated_form_and_no_reason() -> None:
    assert judged(page(), GUIDE, Gate(), here=True) == JudgedPanel()


def test_without_trust_a_panel_is_not_shown(tmp_path: Path) -> None:
    with pytest.raises(UnknownSigner):
        judged(of("bob", files=brought()), GUIDE, Gate(trusting(tmp_path, signer("anna"))), here=True)
    with pytest.raises(NotSigned):
        judged(page(brought()), GUIDE, Gate(), here=False)


def test_a_program_is_judged_as_a_panel_is(tmp_path: Path) -> None:
    files = {"guide.panel.py": b"x = 1\n", "helper.py": b"y = 2\n"}
    gate = Gate(trusting(tmp_path, signer("anna")))
    signed = of("anna", Permissions(), files=files)
    assert signed.signed is not None
    assert b'"panel":"guide.panel.py"' in signed.signed.manifest
    program = judged(signed, GUIDE, gate, here=False).program
    assert program is not None
    assert (program.source, program.files) == ("x = 1\n", {"helper.py": b"y = 2\n"})
    assert program.permissions == Permissions()  # it sees no camera
    with pytest.raises(UnknownSigner):
        judged(of("bob", files=files), GUIDE, gate, here=True)
    with pytest.raises(NotSigned):
        judged(page(files), GUIDE, Gate(), here=False)
    with pytest.raises(BadPanel, match="200000 are allowed"):
        judged(page({"guide.panel.py": b"#" * 300_000}), GUIDE, Gate(), here=True)


def test_a_forged_panel_is_not_shown(tmp_path: Path) -> None:
    """Somebody on the way has put another panel into a signed bundle."""
    from msgspec.structs import replace

    gate = Gate(trusting(tmp_path, signer("anna")))
    good = of("anna", files=brought())
    forged = replace(good, files=brought(PANEL.replace("wave", "melt")))
    with pytest.raises(BadBundle, match=r"guide\.panel\.yaml was changed after it was signed"):
        judged(forged, GUIDE, gate, here=True)
    assert key_of("anna").public in gate.signers().known[0].line()


@pytest.mark.parametrize(
    ("panel", "reason"),
    [
        ("parts:\n  - button: melt", "Guide has no command 'melt'"),
        ("parts:\n  - form: melt", "Guide has no command 'melt'"),
        ("parts:\n  - button: wave\n    arguments: {times: often}", "times"),
        ("parts:\n  - button: wave\n    arguments: {to: you}", "to"),
        ("parts:\n  - button: wave", "times"),
    ],
)
def test_a_panel_asks_for_nothing_that_its_robot_does_not_offer(panel: str, reason: str) -> None:
    with pytest.raises(BadPanel, match=reason):
        judged(page(brought(panel)), GUIDE, Gate(), here=True)


def test_a_panel_shows_no_picture_that_its_manifest_does_not_permit(tmp_path: Path) -> None:
    gate = Gate(trusting(tmp_path, signer("anna")))
    with pytest.raises(BadPanel, match=r"does not permit the stream cell\.wrist"):
        judged(of("anna", Permissions(), files=brought()), GUIDE, gate, here=True)
