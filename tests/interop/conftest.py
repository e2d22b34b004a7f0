"""Other people's tools, installed by `make interop` in an environment of their own, and the simulated arm.

Everything here is a real program in a process of its own; a test types to it and reads what it prints.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.command_line import ROBOTREE

ROOT = Path(__file__).parents[2]
TOOLS = ROOT / ".venv-interop" / "bin"
DIALECT = ROOT / "protocol" / "dialect" / "robotree.xml"
DIALECTS_OF_PYMAVLINK = "import pymavlink.dialects.v20 as dialects; print(dialects.__path__[0])"
PATIENCE = 30.0
"""[s] that a program may take for anything, on a busy machine."""
GRACE = 5.0
"""[s] between asking a program to end and ending it."""


class Program:
    """A running program.

    Args:
        words: its command line.
        env: its environment.
        cwd: where it runs.
    """

    def __init__(self, words: list[str], env: dict[str, str], cwd: Path) -> None:
        self.printed = ""
        """All it has printed, errors too."""
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=env,
            cwd=cwd,
        )
        self._read_up_to = 0
        self._ended = False
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def type(self, line: str) -> None:
        """Type one line."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()

    def reads(self, pattern: str, within: float = PATIENCE) -> re.Match[str]:
        """Wait until it prints something, behind what was read before."""
        wanted = re.compile(pattern)
        with self._news:
            self._news.wait_for(lambda: self._ended or wanted.search(self.printed, self._read_up_to), within)
            found = wanted.search(self.printed, self._read_up_to)
            assert found is not None, f"it never printed {pattern!r}; all it printed:\n{self.printed}"
            self._read_up_to = found.end()
            return found

    def end(self) -> None:
        """End it, whatever it does."""
        self._process.terminate()
        try:
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while data := self._process.stdout.read1(65536):  # type: ignore[attr-defined] # buffered: no bufsize given
            with self._news:
                self.printed += data.decode(errors="replace")
                self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()


class MavsdkClient:
    """MAVSDK, connected to one robot.

    Args:
        program: a running `mavsdk_client.py`.
    """

    def __init__(self, program: Program) -> None:
        self._program = program

    def ask(self, plugin: str, method: str, *arguments: Any) -> Any:
        """Have a method of a plugin called; returns what it answers, `{"error": …}` when it refuses."""
        self._program.type(json.dumps([plugin, method, *arguments]))
        return self.answer()

    def answer(self) -> Any:
        """The next answer."""
        return json.loads(self._program.reads(r"(?m)^answer (.*)\n")[1])

    def begin(self, command: int, *params: float) -> None:
        """Have a COMMAND_LONG carried out; its last COMMAND_ACK is the next answer."""
        named = {f"param{number}": value for number, value in enumerate(_seven(params), 1)}
        fields = {"command": command, "confirmation": 0, **named}
        message = {"name": "COMMAND_LONG", "fields": fields}
        self._program.type(json.dumps(["direct", "send_command", message]))

    def command(self, command: int, *params: float) -> dict[str, Any]:
        """Have a COMMAND_LONG carried out; returns its last COMMAND_ACK."""
        self.begin(command, *params)
        answer: dict[str, Any] = self.answer()
        return answer


def _seven(params: tuple[float, ...]) -> tuple[float, ...]:
    return (*params, *(0.0,) * (7 - len(params)))


@pytest.fixture(scope="session")
def tools() -> Path:
    """The folder with the tools' programs; their pymavlink has our dialect, written by our own verb."""
    if not (TOOLS / ".." / ".ready").exists():
        pytest.fail("the tools are not installed; run `make interop`")
    asked = [TOOLS / "python", "-c", DIALECTS_OF_PYMAVLINK]
    folder = Path(subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip())
    module = folder / "robotree.py"
    module.unlink(missing_ok=True)  # of an earlier run; the verb writes nothing over
    words = ["wire", "dialect", "--lang", "python", "--include", "ardupilotmega", str(module)]
    subprocess.run([*ROBOTREE, *words], check=True)
    return TOOLS


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Program]]:
    """Starts programs, in a home of their own, that end with the test."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    env = {**os.environ, "HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(run), "PYTHONUNBUFFERED": "1"}
    with ExitStack() as stack:

        def begin(*words: str | Path) -> Program:
            program = Program([str(word) for word in words], env, tmp_path)
            stack.callback(program.end)
            return program

        yield begin


@pytest.fixture
def simulate(start: Callable[..., Program]) -> Callable[..., str]:
    """Starts simulated arms; returns the HOST:PORT where each listens."""

    def begin(*options: str | Path, name: str = "") -> str:
        listen = f"tcp:127.0.0.1:0?controller={name}" if name else "tcp:127.0.0.1:0"
        words = ("sim", "arm", "--listen", listen, *options)
        return start(*ROBOTREE, *words).reads(r"ready tcp:([\d.:]+)\S*\n")[1]

    return begin


@pytest.fixture
def arm(simulate: Callable[..., str]) -> str:
    """HOST:PORT of a simulated arm."""
    return simulate()


@pytest.fixture
def mavproxy(start: Callable[..., Program], tools: Path) -> Callable[..., Program]:
    """Starts MAVProxy at an arm, as its users do."""

    def begin(arm: str) -> Program:
        modules = "--default-modules=param,link,cmdlong,messagerate"
        options = (f"--master=tcp:{arm}", "--mav20", "--no-state", "--dialect=robotree", modules)
        return start(tools / "python", tools / "mavproxy.py", *options)

    return begin


@pytest.fixture
def mavsdk(start: Callable[..., Program], tools: Path) -> Callable[[str], MavsdkClient]:
    """Connects MAVSDK to an arm."""

    def begin(arm: str) -> MavsdkClient:
        client = Path(__file__).with_name("mavsdk_client.py")
        program = start(tools / "python", client, f"tcpout://{arm}", DIALECT)
        program.reads(r'answer {"system": 1}\n')
        return MavsdkClient(program)

    return begin
