"""Which changes of the source no test notices, and which tests notice nothing that others do not.

    git worktree add ../mutants && cd ../mutants && make setup
    .venv/bin/python bench/mutants.py switch
    .venv/bin/python bench/mutants.py tests vr/sites tests/vr/sites
    .venv/bin/python bench/mutants.py laws vr/sites tests/vr/sites

`switch` rewrites all sources of this worktree, once: each function notes that it was entered, and each of its
mutants (a statement left out, a condition that is always true or false, an operand left out, another
comparison, another result) waits to be switched on by its number. So no module is imported again for a
mutant: a fork of one process has it, which costs 0.1 s (Untch, Offutt and Harrold, Mutation analysis using
mutant schemata, ISSTA 1993). `git checkout .` takes all back.

`tests` looks for tests that add nothing: of the functions that a test reaches, it tries mutants in those that
the fewest others reach. A test whose mutants are all caught by others that stay is listed. That is a reason
to look at it, no proof: the mutants are a sample, and know no tables and no texts.
`laws` tries mutants of a room, and lists those that no test caught: what does nothing, or is not tested.

A test that does not pass in the rewritten sources, or takes longer than `SLOWEST`, does not take part.
"""

from __future__ import annotations

import argparse
import ast
import gc
import importlib
import json
import mmap
import os
import random
import select
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import pytest
from _pytest.runner import runtestprotocol

from robotree.files import forks

ROOT = Path(__file__).parents[1]
ROOMS = ("files", "kinds", "protocol", "vr", "proxy", "client", "sim", "testing", "tui", "assistants")
TABLE = ROOT / "mutants.json"
SWITCH = ROOT / "front" / "mutants.py"
SLOWEST = 1.5
"""[s] of a test that takes part."""
LONGEST, MOST = 2.5, 40
"""[s] of tests, and how many, that are tried against one mutant."""
ENOUGH, LEAST = 8, 3
"""Mutants that a test and others caught: after so many it is tried no further; with so many it is listed."""
OTHER: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
CODE = """import mmap, os
on = int(os.environ.get("ROBOTREE_MUTANT", "0"))
entered = bytearray({functions})
"""


class Function(NamedTuple):
    """One that the source defines."""

    file: str
    name: str
    line: int


class Mutant(NamedTuple):
    """One change of a function; its number is its place in the table, from 1."""

    function: int
    kind: str
    line: int
    text: str


class Rewriter(ast.NodeTransformer):
    """Puts marks and mutants into modules, and keeps a table of them."""

    def __init__(self) -> None:
        self.functions: list[Function] = []
        self.mutants: list[Mutant] = []
        self._file, self._names, self._inside = "", list[str](), list[int]()

    def rewrite(self, source: str, file: str) -> str:
        """Return a module with marks and mutants."""
        self._file = file
        tree = self.visit(ast.parse(source))
        after = 0
        while after < len(tree.body) and (
            isinstance(tree.body[after], ast.Expr) or getattr(tree.body[after], "module", "") == "__future__"
        ):
            after += 1
        tree.body.insert(after, ast.parse("from robotree import mutants as _mutants").body[0])
        return ast.unparse(ast.fix_missing_locations(tree))

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Rewrite the methods of a class, and nothing else in it."""
        outside, self._inside = self._inside, []
        self._names.append(node.name)
        node.body = [self.visit(part) for part in node.body]
        self._names.pop()
        self._inside = outside
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> ast.AST:
        """Mark a function, and rewrite its body."""
        documented = isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant)
        if documented and len(node.body) == 1:
            return node
        self._names.append(node.name)
        self._inside.append(len(self.functions))
        self.functions.append(Function(self._file, ".".join(self._names), node.lineno))
        mark = ast.parse(f"_mutants.entered[{self._inside[-1]}] = 1").body
        node.body = [*node.body[:documented], *mark, *map(self.visit, node.body[documented:])]
        self._names.pop()
        self._inside.pop()
        return node

    visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815 # names of ast

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Leave alone what stands outside of functions, and what has no place for another value."""
        plain = (ast.Lambda, ast.JoinedStr, ast.pattern) if self._inside else (ast.expr, ast.arguments)
        return node if isinstance(node, plain) else super().generic_visit(node)

    def _mutant(self, kind: str, node: ast.expr | ast.stmt) -> int:
        text = ast.unparse(node)
        self.mutants.append(Mutant(self._inside[-1], kind, node.lineno, text))
        return len(self.mutants)

    def _left_out(self, node: ast.stmt) -> ast.AST:
        if not self._inside:
            return node
        number = self._mutant("left out", node)
        return ast.If(_is_not_on(number), [cast("ast.stmt", super().generic_visit(node))], [])

    visit_AugAssign = visit_Raise = visit_Delete = visit_Continue = _left_out  # noqa: N815 # names of ast

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Leave out a call."""
        return (
            self._left_out(node) if isinstance(node.value, ast.Call | ast.Await) else self.generic_visit(node)
        )

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        """Leave out what is kept in an object; without a name, a function would only fail."""
        kept = all(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets)
        return self._left_out(node) if kept else self.generic_visit(node)

    def visit_Return(self, node: ast.Return) -> ast.AST:
        """Return nothing, or the other truth."""
        if not self._inside or node.value is None or ast.unparse(node.value) == "None":
            return node
        number, truth = self._mutant("result", node), getattr(node.value, "value", None)
        other = ast.Constant(not truth if isinstance(truth, bool) else None)
        return ast.Return(ast.IfExp(_is_on(number), other, self.visit(node.value)))

    def _condition(self, node: ast.expr, *, true: bool = True) -> ast.expr:
        if not self._inside:
            return node
        numbers = [self._mutant(kind, node) for kind in ("false", "true")[: 1 + true]]
        either = self.visit(node)
        if true:
            either = ast.BoolOp(ast.Or(), [_is_on(numbers[1]), either])
        return ast.BoolOp(ast.And(), [_is_not_on(numbers[0]), either])

    def visit_If(self, node: ast.If | ast.IfExp) -> ast.AST:
        """Have a condition always be true, or false."""
        test, node.test = node.test, ast.Constant(value=True)
        node = super().generic_visit(node)  # type: ignore[assignment] # it is the same
        node.test = self._condition(test)
        return node

    visit_IfExp = visit_If  # noqa: N815 # names of ast

    def visit_While(self, node: ast.While) -> ast.AST:
        """Have a loop never begin; one that never ends says nothing."""
        test, node.test = node.test, ast.Constant(value=True)
        node = super().generic_visit(node)  # type: ignore[assignment] # it is the same
        node.test = test if isinstance(test, ast.Constant) else self._condition(test, true=False)
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Compare otherwise."""
        if not self._inside or len(node.ops) > 1 or _acts(node):
            return self.generic_visit(node)
        number = self._mutant("comparison", node)
        other = ast.Compare(node.left, [OTHER[type(node.ops[0])]()], node.comparators)
        return ast.IfExp(_is_on(number), _copy(other), cast("ast.expr", self.generic_visit(node)))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        """Leave out the first operand, or the last."""
        if not self._inside or _acts(node):
            return self.generic_visit(node)
        parts = node.values[1:], node.values[:-1]
        fewer = [_copy(part[0] if len(part) == 1 else ast.BoolOp(node.op, part)) for part in parts]
        numbers = [
            self._mutant(kind, node) for kind in ("without its first operand", "without its last operand")
        ]
        both = cast("ast.expr", self.generic_visit(node))
        return ast.IfExp(_is_on(numbers[0]), fewer[0], ast.IfExp(_is_on(numbers[1]), fewer[1], both))


def _is_on(number: int) -> ast.expr:
    return ast.parse(f"_mutants.on == {number}", mode="eval").body


def _is_not_on(number: int) -> ast.expr:
    return ast.parse(f"_mutants.on != {number}", mode="eval").body


def _copy(node: ast.expr) -> ast.expr:
    return ast.parse(ast.unparse(node), mode="eval").body


def _acts(node: ast.expr) -> bool:
    """Return whether a part of it gives a name to something or waits, which a copy must not."""
    return any(
        isinstance(part, ast.NamedExpr | ast.Await | ast.Yield | ast.YieldFrom) for part in ast.walk(node)
    )


def switch() -> None:
    """Rewrite the sources of this worktree."""
    if (ROOT / ".git").is_dir() or SWITCH.exists():
        sys.exit("mutants: only sources of a linked worktree are rewritten, and only once (git worktree add)")
    rewriter = Rewriter()
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            path.write_text(rewriter.rewrite(path.read_text(), str(path.relative_to(ROOT))))
    SWITCH.write_text(CODE.format(functions=len(rewriter.functions)))
    TABLE.write_text(json.dumps([rewriter.functions, rewriter.mutants]))
    print(f"{len(rewriter.functions)} functions, {len(rewriter.mutants)} mutants")


class Trial:
    """A test, or all cases of one, and what it reaches."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.items: list[pytest.Item] = []
        self.seconds = 0.0
        self.reached = frozenset[int]()

    def fails(self, session: pytest.Session) -> bool:
        """Run it."""
        rest = _Rest(session)
        return any(
            report.failed
            for item in self.items
            for report in runtestprotocol(item, log=False, nextitem=rest)  # type: ignore[arg-type] # see there
        )


class _Rest:
    """What pytest takes for the next test: fixtures of the session stay."""

    def __init__(self, session: pytest.Session) -> None:
        self._session = session

    def listchain(self) -> list[pytest.Session]:
        return [self._session]


class Laboratory:
    """A plugin of pytest that tries mutants where tests would run."""

    def __init__(self, rooms: Sequence[str], seconds: float, *, laws: bool) -> None:
        self._rooms, self._seconds, self._laws = rooms, seconds, laws
        functions, mutants = json.loads(TABLE.read_text())
        self._functions = [Function(*function) for function in functions]
        self._mutants = [Mutant(*mutant) for mutant in mutants]
        self._of = defaultdict[int, list[int]](list)
        for number, mutant in enumerate(self._mutants, 1):
            self._of[mutant.function].append(number)
        self._switch: Any = importlib.import_module("robotree.mutants")
        self._trials: list[Trial] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Learn what each test reaches, then try mutants."""
        trials: dict[str, Trial] = {}
        for item in session.items:
            name = (
                item.nodeid.split("::")[0] if item.get_closest_marker("story") else item.nodeid.split("[")[0]
            )
            trials.setdefault(name, Trial(name)).items.append(item)
        self._session = session
        self._trials = [trial for trial in trials.values() if self._learns(trial)]
        gc.collect()
        gc.freeze()
        print(f"\n{len(self._trials)} of {len(trials)} tests take part", flush=True)
        (self.find_laws if self._laws else self.find_tests)(time.monotonic() + self._seconds)
        return True

    def _learns(self, trial: Trial) -> bool:
        began = time.monotonic()
        with mmap.mmap(-1, len(self._functions)) as marks:

            def run() -> bool:
                self._switch.entered = marks
                return trial.fails(self._session)

            passed = _in_fork(run, SLOWEST * 4) is False
            trial.reached = frozenset(number for number, mark in enumerate(marks[:]) if mark)
        trial.seconds = time.monotonic() - began
        return passed and trial.seconds <= SLOWEST

    def _catches(self, trials: Sequence[Trial], number: int) -> bool:
        """Return whether one of some tests fails with a mutant, or does not end."""

        def run() -> bool:
            self._switch.on = number
            os.environ["ROBOTREE_MUTANT"] = str(number)
            return any(trial.fails(self._session) for trial in trials)

        return _in_fork(run, 6 + 4 * sum(trial.seconds for trial in trials)) is not False

    def _cheapest(self, trials: Iterable[Trial]) -> list[Trial]:
        """Return what is tried of some tests: cheap and specific ones first."""
        some, seconds = list[Trial](), 0.0
        for trial in sorted(trials, key=lambda trial: trial.seconds * (1 + len(trial.reached) / 60))[:MOST]:
            seconds += trial.seconds
            if some and seconds > LONGEST:
                break
            some.append(trial)
        return some

    def _shown(self, number: int) -> str:
        mutant = self._mutants[number - 1]
        function = self._functions[mutant.function]
        return f"{number}: {function.file}:{mutant.line} {function.name}: {mutant.kind}: `{mutant.text}`"

    def find_tests(self, until: float) -> None:
        """List tests that catch nothing that others do not; the longest first."""
        stay = set(self._trials)
        for trial in sorted(self._trials, key=lambda trial: -_lines(trial)):
            if time.monotonic() > until:
                break
            if caught := self._also_caught(trial, stay - {trial}):
                stay.discard(trial)
                print(f"{trial.name} ({_lines(trial)} lines)", flush=True)
                for number in caught[:LEAST]:
                    print(f"    also caught: {self._shown(number)}", flush=True)

    def _also_caught(self, trial: Trial, others: set[Trial]) -> list[int]:
        """Return mutants that a test and others caught; none if there is one that only this test caught."""
        reach = {
            function: [other for other in others if function in other.reached] for function in trial.reached
        }
        chance, caught = random.Random(trial.name), list[int]()
        for function in sorted(reach, key=lambda function: len(reach[function]))[:14]:
            for number in chance.sample(self._of[function], min(2, len(self._of[function]))):
                if self._catches([trial], number):
                    if not self._catches(self._cheapest(reach[function]), number):
                        return []
                    caught.append(number)
                if len(caught) == ENOUGH:
                    return caught
        return caught if len(caught) >= LEAST else []

    def find_laws(self, until: float) -> None:
        """List mutants of the rooms that no test caught."""
        here = [
            number
            for number, mutant in enumerate(self._mutants, 1)
            if self._functions[mutant.function].file.startswith(tuple(self._rooms))
        ]
        random.Random(0).shuffle(here)
        tried = caught = 0
        for number in here:
            if time.monotonic() > until:
                break
            function = self._mutants[number - 1].function
            reached = self._cheapest(trial for trial in self._trials if function in trial.reached)
            tried += 1
            if reached and self._catches(reached, number):
                caught += 1
            else:
                print(self._shown(number) if reached else f"{self._shown(number)} (not reached)", flush=True)
        print(f"{caught} of {tried} mutants were caught")


def _lines(trial: Trial) -> int:
    """Return how long the function of a test is."""
    code = getattr(trial.items[0], "function", None)
    return (
        max((line for *_, line in code.__code__.co_lines() if line), default=0) - code.__code__.co_firstlineno
        if code
        else 0
    )


def _in_fork(work: Callable[[], bool], seconds: float) -> bool | None:
    """Return what some work returns in a fork of this process; None if it does not end in time, or dies."""
    reader, writer = os.pipe()
    if not (child := os.fork()):
        try:
            os.setsid()
            forks.be_process()
            null = os.open(os.devnull, os.O_RDWR)
            for descriptor in range(3):
                os.dup2(null, descriptor)
            os.write(writer, b"1" if work() else b"0")
        finally:
            os._exit(0)
    os.close(writer)
    answer = os.read(reader, 1) if select.select([reader], [], [], seconds)[0] else b""
    os.close(reader)
    os.killpg(child, signal.SIGKILL)  # with all that the tests have started
    os.waitpid(child, 0)
    return answer == b"1" if answer else None


def main() -> None:
    """Rewrite the sources, or try tests."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", choices=["switch", "tests", "laws"])
    parser.add_argument("folders", nargs="*", help="rooms of the source, and folders or files of tests")
    parser.add_argument("--seconds", type=float, default=600.0)
    options = parser.parse_args()
    if options.work == "switch":
        switch()
        return
    tests = [folder for folder in options.folders if folder.startswith("tests")]
    rooms = [folder for folder in options.folders if not folder.startswith("tests")]
    laboratory = Laboratory(rooms, options.seconds, laws=options.work == "laws")
    usual = ["-q", "--tb=native", "-p", "no:unraisableexception", "-p", "no:xdist"]
    sys.exit(pytest.main([*usual, "-m", "not e2e and not speed and not soak", *tests], plugins=[laboratory]))


if __name__ == "__main__":
    main()
