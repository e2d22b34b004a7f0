"""Writes the pages of `docs/reference/` anew: verbs and keys, the rules for controllers, and the public API.

python docs/reference.py

Each page is made from what the program itself uses: the registry of actions, the rules of `wire conform`, and
the docstrings in the source of the public modules.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent / "reference"
MADE = "<!-- made by `python docs/reference.py` -->\n"
PUBLIC = {
    "robotree": "robotree.client.blocking robotree.client.asynchronous",
    "robotree.vr": "",
    "robotree.kinds": "",
    "robotree.testing": "",
    "robotree.proxy": "",
    "robotree.protocol": "",
    "robotree.vr.scripts.roles": "",
    "robotree.tui.panels.author": "",
}
"""The public modules; with each, the modules whose classes its functions return."""
SPECIAL = {"__call__", "__getitem__", "__await__"}
"""Methods with underscores that a reader of the reference calls."""


def pages() -> dict[str, str]:
    """Return the text of each page of the folder, by the name of its file."""
    return {
        "verbs.md": _verbs(),
        "conformance.md": _conformance(),
        **{f"{name}.md": _module(name, others.split()) for name, others in PUBLIC.items()},
    }


def _verbs() -> str:
    from robotree.tui.line import manual
    from robotree.tui.line.page_keys import PAGE_KEYS

    names: dict[str, list[str]] = {}
    for key in PAGE_KEYS:
        names.setdefault(key.page, []).append(key.name)
    return (
        f"{MADE}# Verbs and keys\n\nVerbs work at the `:` prompt, after `robotree` in a shell and in session "
        "scripts; those marked (shell) only after `robotree`. [Supervising](../operating.md) explains them."
        f"\n\n{manual.tables()}\n"
        "## Names of the keys of pages\n\nFor `keys.toml`, as `page.name`:\n\n"
        + "\n".join(f"* `{page}.` {', '.join(dict.fromkeys(each))}" for page, each in names.items())
        + "\n"
    )


def _conformance() -> str:
    from robotree.protocol.tools.conform import RULES

    rows = "\n".join(f"| `{rule.id}` | {rule.level} | {rule.text} |" for rule in RULES.values())
    return (
        f"{MADE}# The rules that `robotree wire conform` tries\n\n"
        f"[Bring your own robot](../bring-your-own-robot.md) explains them.\n\n"
        f"| rule | level | a controller |\n|---|---|---|\n{rows}\n"
    )


def _module(name: str, others: list[str]) -> str:
    module = import_module(name)
    lines = [MADE + f"# `{name}`", "", *_markdown(inspect.getdoc(module) or "")]
    exported = getattr(module, "__all__", None) or [
        each
        for each, value in vars(module).items()
        if getattr(value, "__module__", "") == name and not each.startswith("_")
    ]
    for each in exported:
        lines += ["", *_entry(each, getattr(module, each))]
    classes = [node for other in others for node in _source(other).body if isinstance(node, ast.ClassDef)]
    methods = {
        f"{node.name}.{each.name}": each
        for node in classes
        for each in node.body
        if isinstance(each, ast.AsyncFunctionDef)
    }
    for node in classes:
        if not node.name.startswith("_"):
            lines += ["", *_class(node, methods)]
    return "\n".join(lines) + "\n"


def _source(module: str) -> ast.Module:
    import_module(module)
    return ast.parse(Path(inspect.getsourcefile(sys.modules[module]) or "").read_text(encoding="utf-8"))


def _entry(name: str, value: object) -> Iterator[str]:
    """Describe what a module exports: a class or a function where it is written, else its name alone."""
    home = getattr(value, "__module__", None)
    written = getattr(value, "__name__", name)
    nodes = _source(home).body if isinstance(home, str) and home.startswith("robotree") else []
    for node in nodes:
        if isinstance(node, ast.ClassDef) and node.name == written:
            yield from _class(node)
            return
        if (
            isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            and node.name == written
            and not _is_overload(node)
        ):
            yield from (f"## `{_signature(node)}`", "", *_markdown(ast.get_docstring(node) or ""))
            return
    yield f"## `{name}`"


def _class(node: ast.ClassDef, methods: Mapping[str, ast.AsyncFunctionDef] | None = None) -> Iterator[str]:
    """Describe a class; `methods`: those of which another class makes its own, as `ls = waits(Realm.ls)`."""
    bases = ", ".join([ast.unparse(each) for each in node.bases])
    yield f"## `class {node.name}{f'({bases})' if bases else ''}`"
    yield ""
    yield from _markdown(ast.get_docstring(node) or "")
    for each, after in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(each, ast.Assign) and isinstance(each.value, ast.Call):
            made = (methods or {}).get(ast.unparse(each.value.args[0])) if each.value.args else None
            if made is not None:
                signature = _signature(made).removeprefix("async ")
                yield from ("", f"### `{signature}`", "", *_markdown(ast.get_docstring(made) or ""))
        elif isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
            about = ast.get_docstring(each)
            if about and _is_public(each.name) and not _is_overload(each):
                yield from ("", f"### `{_signature(each)}`", "", *_markdown(about))
        elif isinstance(each, ast.AnnAssign | ast.Assign) and (about := _text(after)):
            target = each.target if isinstance(each, ast.AnnAssign) else each.targets[0]
            if _is_public(ast.unparse(target)):
                kind = f": {ast.unparse(each.annotation)}" if isinstance(each, ast.AnnAssign) else ""
                yield from ("", f"### `{ast.unparse(target)}{kind}`", "", *_markdown(about))


def _text(node: ast.stmt | None) -> str:
    """Return the text that stands as a statement, as it does below an attribute; empty: it is none."""
    value = node.value.value if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) else ""
    return inspect.cleandoc(value) if isinstance(value, str) else ""


def _is_public(name: str) -> bool:
    return not name.startswith("_") or name in SPECIAL


def _is_overload(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any(ast.unparse(each) == "overload" for each in node.decorator_list)


def _signature(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    if any(ast.unparse(each) == "property" for each in node.decorator_list):
        return f"{node.name}{f': {ast.unparse(node.returns)}' if node.returns else ''}"
    start = "async " if isinstance(node, ast.AsyncFunctionDef) else ""
    result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{start}{node.name}({ast.unparse(node.args)}){result}"


def _markdown(text: str) -> Iterator[str]:
    """Write a docstring as Markdown: its sections become lists, for they are indented as code would be."""
    within = False
    for line in text.splitlines():
        if re.fullmatch(r"(Args|Raises|Returns|Yields):", line):
            within = True
            yield from (line, "")
        elif within and line.startswith("        "):
            yield f"  {line.strip()}"
        elif within and line.startswith("    "):
            name, colon, about = line.strip().partition(": ")
            yield f"* `{name}`: {about}" if colon else f"* {name}"
        else:
            within = within and not line
            yield line


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for page, text in pages().items():
        (FOLDER / page).write_text(text, encoding="utf-8")
