"""Mistakes that are never meant, as the tree of a page shows them: a host refuses the page. Pure."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator
from difflib import get_close_matches

from robotree.vr.author.robot import HOOKS, call_of
from robotree.vr.author.virtual_robot import RESERVED
from robotree.vr.bundle.reading import Finding, Function, Page, dotted, mark, pages_of, used_names
from robotree.vr.bundle.syntax import parse

_NEAR = 0.75
"""Likeness of two names, 0 to 1, from which on one is taken for a misspelling of the other."""
_OTHER_NAMES = {
    **dict.fromkeys(("on_stop", "on_safe_stop", "on_halt", "emergency_stop", "on_emergency"), "safe_stop"),
    **dict.fromkeys(("on_release", "on_go"), "resume"),
    **dict.fromkeys(("on_readings", "get_readings", "on_read", "telemetry"), "readings"),
}
"""The names of the hooks in other libraries."""


def mistakes(source: str) -> list[Finding]:
    """Return what a host refuses in a page, by line.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    tree = parse(source)
    used = used_names(tree)
    found = [*_of_nested(tree)]
    for page in pages_of(tree).values():
        found += [*_of_assignments(page), *_of_replaced(page), *_of_hooks(page, used)]
    return sorted(set(found), key=lambda one: (one.line, one.what))


def _of_assignments(page: Page) -> Iterator[Finding]:
    """Find slots, and what every robot has, that a method replaces by something else."""
    nodes = (node for method in page.methods for node in ast.walk(method) if isinstance(node, ast.Attribute))
    for node in nodes:
        if isinstance(node.ctx, ast.Load) or dotted(node.value) != "self":
            continue
        instead = f"keep the value under another name, such as self._{node.attr}"
        if node.attr in page.slots:
            yield Finding(node.lineno, f"self.{node.attr} is a slot, and this takes the child away", instead)
        elif node.attr in RESERVED:
            what = f"self.{node.attr} is what every robot uses itself, and this takes it away"
            yield Finding(node.lineno, what, instead)


def _of_replaced(page: Page) -> Iterator[Finding]:
    """Find slots, commands and settings that a later line of the class replaces without a word."""
    for name, what, before, line in page.replaced:
        where = f"in line {before}" if before else "in its base class"
        yield Finding(
            line,
            f"{page.name}.{name} is a {what} {where} already, and this replaces it",
            "give one of them another name",
        )


def _of_nested(tree: ast.Module) -> Iterator[Finding]:
    """Find commands that stand in no class, so that no robot has them."""
    for node in ast.walk(tree):
        body = node.body if isinstance(node, ast.Module | Function) else ()
        for one in body:
            if isinstance(one, Function) and mark(one) is not None:
                yield Finding(
                    one.lineno,
                    f"{one.name} is marked as a command and stands in no class, so no robot has it",
                    "make it a method of the robot's class",
                )


def _of_hooks(page: Page, used: Collection[str]) -> Iterator[Finding]:
    """Find what has nearly the name of a hook, and is used nowhere in the file."""
    for method in page.methods:
        if method.decorator_list or method.name in HOOKS or method.name in used:
            continue
        near = get_close_matches(method.name, HOOKS, n=1, cutoff=_NEAR)
        meant = near[0] if near else _OTHER_NAMES.get(method.name)
        if meant:
            instead = f"did you mean {call_of(meant)}?"
            yield Finding(method.lineno, f"nothing calls {method.name}", instead)
        elif method.name.startswith("on_"):
            instead = f"the hooks of a robot are {', '.join(map(call_of, HOOKS))}"
            yield Finding(method.lineno, f"nothing calls {method.name}", instead)
