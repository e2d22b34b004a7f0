"""The declarations of a page, read from its tree: slots, commands, settings, exposed commands. Pure."""

from __future__ import annotations

import ast
from collections.abc import Collection
from typing import Literal

import msgspec

ROOT = "VirtualRobot"
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Finding(msgspec.Struct, frozen=True):
    """One thing that is probably a mistake, or that a page may not mean."""

    line: int
    what: str
    instead: str
    """The advice: what to write instead, or to do."""
    level: Literal["mistake", "warning"] = "mistake"


class Page:
    """One robot's class in a file."""

    def __init__(self, node: ast.ClassDef, base: Page | None) -> None:
        """Read the body of a class; `base` is the class of the same file from which it derives."""
        self.name = node.name
        self.methods = [one for one in node.body if isinstance(one, Function)]
        self.slots: dict[str, str] = dict(base.slots) if base else {}
        """Kind of each slot and group."""
        self.watches: dict[str, str] = dict(base.watches) if base else {}
        """Kind of each slot that only watches."""
        self.groups: set[str] = set(base.groups) if base else set()
        self.chosen: set[str] = set(base.chosen) if base else set()
        """Of both, those for which the robot chooses children itself."""
        self.declared: set[str] = set(base.declared) if base else set()
        """Settings and state."""
        self.settings: set[str] = set(base.settings) if base else set()
        """Of these, what people may set."""
        self.bare: dict[str, ast.AnnAssign] = {}
        """Attributes with a type and no value."""
        self.exposed: list[tuple[str, str, ast.Call]] = []
        """Slot, command and the call of `exposed`."""
        self.commands: set[str] = set(base.commands) if base else set()
        self.plain: dict[str, int] = {}
        """Lines of its other methods and attributes."""
        self.replaced: list[tuple[str, str, int, int]] = []
        """Declarations that a later one replaces: name, what it was, its line, the line of the later one."""
        self._present: dict[str, tuple[str, int]] = dict.fromkeys(self.slots if base else (), ("slot", 0))
        for item in node.body:
            self._read(item)

    def _read(self, item: ast.stmt) -> None:
        match item:
            case ast.AnnAssign(target=ast.Name(id=name), value=None):
                self.bare[name] = item
            case ast.AnnAssign(target=ast.Name(id=name), value=value):
                self.declared.add(name)
                kept = isinstance(value, ast.Call) and last(value.func) == "state"
                (self.settings.discard if kept or name.startswith("_") else self.settings.add)(name)
                self._declare(name, "setting", item.lineno)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._take(name, value)
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                self._take_method(name, item)
            case _:
                pass

    def _take_method(self, name: str, method: Function) -> None:
        if mark(method) is not None:
            self.commands.add(name)
            self._declare(name, "command", method.lineno)
        elif not method.decorator_list:
            self.plain[name] = method.lineno
            self._declare(name, "", method.lineno)

    def _take(self, name: str, value: ast.expr) -> None:
        self.commands.discard(name)
        self.slots.pop(name, None)
        self.groups.discard(name)
        self.chosen.discard(name)
        self.watches.pop(name, None)
        match value:
            case ast.Call(func=ast.Name(id="Watch"), args=[kind, *_]):
                self.watches[name] = _kind(kind)
                self._declare(name, "slot", value.lineno)
            case ast.Call(func=ast.Name(id="Child" | "Children" as way), args=[kind, *_]):
                self.slots[name] = _kind(kind)
                if way == "Children":
                    self.groups.add(name)
                if any(each.arg in ("choose", None) for each in value.keywords):
                    self.chosen.add(name)
                self._declare(name, "slot", value.lineno)
            case ast.Call(func=ast.Attribute(value=ast.Name(id=slot), attr="exposed"), args=given):
                command = given[0].value if given and isinstance(given[0], ast.Constant) else name
                self.exposed.append((slot, str(command), value))
                self.commands.add(name)
                self._declare(name, "command", value.lineno)
            case _:
                self.plain[name] = value.lineno
                self._declare(name, "", value.lineno)

    def _declare(self, name: str, what: str, line: int) -> None:
        """Note what a name of the class stands for now; `what` is empty for what robotree does not use."""
        before, at = self._present.get(name, ("", 0))
        inherited = before == "slot" and at == 0
        if before and not (inherited and what in {"", "slot"}):
            self.replaced.append((name, before, at, line))
        self._present[name] = what, line


def pages_of(tree: ast.Module) -> dict[str, Page]:
    """Return the robots' classes of a file by name."""
    found: dict[str, Page] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            bases = [last(base) for base in node.bases]
            inherited = next((found[base] for base in bases if base in found), None)
            if inherited is not None or ROOT in bases:
                found[node.name] = Page(node, inherited)
    return found


def used_names(tree: ast.AST) -> Collection[str]:
    """Return the names of attributes that a file uses, also those that stand in a text (`getattr`)."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def dotted(node: ast.AST) -> str:
    """Return `a.b.c` as it is written; empty: it is something else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (left := dotted(node.value)):
        return f"{left}.{node.attr}"
    return ""


def last(node: ast.AST) -> str:
    """Return `c` of `a.b.c`."""
    return dotted(node).rpartition(".")[2]


def mark(method: Function) -> str | None:
    """Return the effect of a command; None: the method is none."""
    for one in method.decorator_list:
        call = one if isinstance(one, ast.Call) else ast.Call(one, [], [])
        if last(call.func) == "command":
            effects = (each.value for each in call.keywords if each.arg == "effect")
            return next((str(effect.value) for effect in effects if isinstance(effect, ast.Constant)), "once")
    return None


def _kind(node: ast.expr) -> str:
    return str(node.value) if isinstance(node, ast.Constant) else last(node)
