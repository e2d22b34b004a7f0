"""What a page asks of others, as its tree says: the permissions of its manifest, unless it names them. Pure.

`self.arm.move(…)` with `arm = Child("Arm")` needs `Arm.move`. What cannot be seen needs more: a slot that is
handed on as a value needs `Arm.*`, and a class whose base is not in the page, or a script, everything.
"""

from __future__ import annotations

import ast

from robotree.vr.author.usage import READINGS
from robotree.vr.base.permissions import ALL, ANY, EVERYTHING, Permissions
from robotree.vr.bundle.child_calls import OF_A_GROUP
from robotree.vr.bundle.reading import ROOT, Page, dotted, last, pages_of
from robotree.vr.bundle.syntax import parse


def needs(source: str, wanted: str = "") -> Permissions:
    """Return what a page asks of others.

    Args:
        source: of the page.
        wanted: name of the class; empty: all classes of the page count.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    tree = parse(source)
    found = pages_of(tree)
    pages = [page for page in found.values() if wanted in ("", page.name)]
    if not pages or any(_derives_from_elsewhere(tree, page.name, set(found)) for page in pages):
        return ALL
    commands: set[str] = set()
    readings: set[str] = set()
    for page in found.values():  # a base class of the page counts, too
        _collect(page, commands, readings)
    return Permissions(_fewest(commands), _fewest(readings))


def choosing(source: str) -> dict[str, str] | None:
    """Return the slots for which a page chooses children itself, with kinds; None: it cannot be seen."""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):
        return {}
    pages = pages_of(tree)
    if any(_derives_from_elsewhere(tree, name, set(pages)) for name in pages):
        return None
    return {slot: kind for page in pages.values() for slot, kind in page.slots.items() if slot in page.chosen}


def _derives_from_elsewhere(tree: ast.Module, name: str, known: set[str]) -> bool:
    """Whether a class has a base that is not in the page, so that its slots cannot be seen."""
    bases = {
        node.name: [last(base) for base in node.bases] for node in tree.body if isinstance(node, ast.ClassDef)
    }
    return any(
        base != ROOT and (base not in known or _derives_from_elsewhere(tree, base, known - {name}))
        for base in bases.get(name, ())
    )


def _collect(page: Page, commands: set[str], readings: set[str]) -> None:
    for slot, command, _ in page.exposed:
        commands.add(f"{page.slots.get(slot, ANY)}.{command}")
    if _hands_itself_on(page):
        for kind in page.slots.values():
            commands.add(f"{kind}.{ANY}")
            readings.add(f"{kind}.{ANY}")
    for method in page.methods:
        named = {node.value: node for node in ast.walk(method) if isinstance(node, ast.Attribute)}
        for node in ast.walk(method):
            if isinstance(node, ast.Attribute) and dotted(node.value) == "self" and node.attr in page.slots:
                kind, above = page.slots[node.attr], named.get(node)
                if above is None or node.attr in page.groups:  # handed on, or a group: anything may follow
                    commands.add(f"{kind}.{ANY}")
                    readings.add(f"{kind}.{ANY}")
                elif above.attr == READINGS:
                    reading = named.get(above)
                    readings.add(f"{kind}.{reading.attr if reading is not None else ANY}")
                elif above.attr not in OF_A_GROUP:
                    commands.add(f"{kind}.{above.attr}")


def _hands_itself_on(page: Page) -> bool:
    """Whether a method uses `self` as a whole, so that what follows cannot be seen."""
    for method in page.methods:
        owners = {node.value for node in ast.walk(method) if isinstance(node, ast.Attribute)}
        names = (node for node in ast.walk(method) if isinstance(node, ast.Name) and node.id == "self")
        if any(name not in owners for name in names):
            return True
    return False


def _fewest(permissions: set[str]) -> tuple[str, ...]:
    """Return the permissions without those that others contain."""
    if EVERYTHING in permissions:
        return (EVERYTHING,)
    wide = {one.partition(".")[0] for one in permissions if one.endswith(f".{ANY}")}
    return tuple(
        sorted(one for one in permissions if one.endswith(f".{ANY}") or one.partition(".")[0] not in wide)
    )
