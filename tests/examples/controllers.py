"""The controllers of the examples, made as their READMEs say, and started as processes of their own."""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from robotree.protocol.tools.conform import RULES, Outcome, Result, examine
from tests.command_line import ROBOTREE

EXAMPLES = Path(__file__).parents[2] / "examples"
COMPILER = shutil.which(os.environ.get("CC", "cc"))
AT_ONCE = 8
"""Controllers of one kind that are tried at the same time: most rules only wait."""
SANITIZERS = "-g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all"


class Running(NamedTuple):
    """A controller that has said that it is ready."""

    url: str
    process: subprocess.Popen[str]
    errors: Path

    def complaints(self) -> str:
        """What it has written to its standard error."""
        return self.errors.read_text()


def compiled(folder: Path) -> list[str]:
    """Make the controller in C in a clean folder, with sanitizers where the compiler has them."""
    for source in (EXAMPLES / "controller_c").iterdir():
        if source.is_file():
            shutil.copy(source, folder)
    probe: list[str | Path] = [str(COMPILER), *SANITIZERS.split(), "-x", "c", "-", "-o", folder / "probe"]
    able = subprocess.run(probe, input=b"int main(void) { return 0; }", capture_output=True, check=False)
    able_to_run = able.returncode == 0 and subprocess.run([folder / "probe"], check=False).returncode == 0
    robotree = f"ROBOTREE={sys.executable} -m robotree.tui"
    words: list[str | Path] = ["make", "-C", folder, robotree, f"CC={COMPILER}"]
    words += [f"CFLAGS={SANITIZERS}"] if able_to_run else []
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return [str(folder / "build" / "controller")]


def generated(folder: Path) -> list[str]:
    """Put the controller in Python and its messages into a clean folder; returns how it is started."""
    for source in (EXAMPLES / "controller_py").glob("*.py"):
        shutil.copy(source, folder)
    words = [*ROBOTREE, "wire", "dialect", "--lang", "python", "rover_wire.py"]
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    return [sys.executable, str(folder / "controller.py")]


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], list[str]]) -> list[str]:
    """Make a controller in a folder, once for all workers of a run; returns how it is started."""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        ready = folder.with_suffix(".json")
        if not ready.exists():
            folder.mkdir()
            ready.write_text(json.dumps(make(folder)))
        words: list[str] = json.loads(ready.read_text())
    return words


@contextmanager
def started(words: Sequence[str | Path], env: Mapping[str, str] | None = None) -> Generator[Running]:
    """A controller that is ready, inside the block. It must not end by itself, only be killed."""
    errors = tempfile.NamedTemporaryFile("w+", prefix="controller-", delete=False)  # noqa: SIM115
    with (
        errors,
        subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=errors, text=True, env={**os.environ, **(env or {})}
        ) as process,
    ):
        assert process.stdout is not None
        try:
            word, _, address = process.stdout.readline().strip().partition(" ")
            assert word == "ready", Path(errors.name).read_text()
            yield Running(address, process, Path(errors.name))
            assert process.poll() in {None, -9}, f"it has ended by itself: {Path(errors.name).read_text()}"
        finally:
            process.kill()
            process.wait()
            Path(errors.name).unlink()


async def tried(url: str, **options: object) -> list[Result]:
    """Try rules at one controller, one after the other."""
    return [result async for result in examine(url, **options)]  # type: ignore[arg-type]


async def tried_at(urls: Sequence[str], **options: object) -> list[Result]:
    """Try all rules, each at one of several controllers of a kind, at the same time."""
    ids = [*RULES]
    parts = (ids[first :: len(urls)] for first in range(len(urls)))
    found = await asyncio.gather(
        *(tried(url, rules=part, **options) for url, part in zip(urls, parts, strict=True))
    )
    return sorted((result for part in found for result in part), key=lambda result: ids.index(result.rule.id))


async def tried_alike(words: Sequence[str | Path], **options: object) -> list[Result]:
    """The same with as many controllers as help, each a process that these words start."""
    with ExitStack() as stack:
        urls = [stack.enter_context(started(words)).url for _ in range(AT_ONCE)]
        return await tried_at(urls, **options)


def not_kept(results: Sequence[Result]) -> dict[str, str]:
    """Return what is not as the rules say: the detail of each, by its rule."""
    return {each.rule.id: each.detail for each in results if each.outcome is not Outcome.KEPT}


JAVASCRIPT = Path(__file__).parents[2] / "examples" / "controller_js"
NODE, NPM, MAKE = (shutil.which(name) for name in ("node", "npm", "make"))


def made_js(folder: Path) -> list[str]:
    """The same for JavaScript, with node-mavlink from npm, once; the test is skipped without node."""
    if NODE is None or NPM is None or MAKE is None:
        pytest.skip("there is no node, no npm or no make here")
    with (JAVASCRIPT / ".npmrc").open() as lock:  # several processes run tests
        fcntl.flock(lock, fcntl.LOCK_EX)
        make_at(JAVASCRIPT, "node_modules/.ready")
    for name in ("controller.js", "rules.js", "package.json", "Makefile"):
        shutil.copy(JAVASCRIPT / name, folder)
    (folder / "node_modules").symlink_to(JAVASCRIPT / "node_modules")
    make_at(folder, "robotree.js", f"ROBOTREE={sys.executable} -m robotree.tui")
    return [NODE, str(folder / "controller.js")]


def make_at(folder: Path, *words: str) -> None:
    done = subprocess.run([str(MAKE), "-C", folder, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
