"""What a command returns is what its signature promises."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest

from robotree.vr import Robot, Unit, command
from robotree.vr.base.errors import CommandFailed
from tests.vr.core.crew import Where


class Liar(Robot):
    """Declares result types, and returns the values that the test chooses."""

    truth: Any = None

    @command
    def whole(self) -> int:
        return self.truth  # type: ignore[no-any-return]

    @command
    def metres(self) -> Annotated[float, Unit("m"), "how far"]:
        return self.truth  # type: ignore[no-any-return]

    @command
    def perhaps(self) -> float | None:
        return self.truth  # type: ignore[no-any-return]

    @command
    def nothing(self) -> None:
        return self.truth  # type: ignore[no-any-return]

    @command
    def side(self) -> Literal["left", "right"]:
        return self.truth  # type: ignore[no-any-return]

    @command
    def where(self) -> Where:
        return self.truth  # type: ignore[no-any-return]

    @command
    def fails(self) -> None:
        raise self.truth

    @command
    def divides(self) -> float:
        return (1.0 + 2.0) / (3.0 * self.truth)

    @command
    def unsaid(self):  # type: ignore[no-untyped-def] # noqa: ANN201 # an author may leave it open
        return self.truth


@pytest.mark.parametrize(
    ("name", "truth", "sentence"),
    [
        ("whole", "abc", "it promises int but returned 'abc': Expected `int`, got `str`"),
        ("whole", 1.5, "it promises int but returned 1.5"),
        ("whole", True, "it promises int but returned True"),
        ("whole", None, "it promises int but returned None"),
        ("metres", "1 m", "it promises float but returned '1 m'"),
        ("perhaps", [], "it promises float | None but returned []"),
        ("nothing", 0, "it promises nothing but returned 0"),
        ("side", "up", "it promises Literal['left', 'right'] but returned 'up'"),
        ("where", {"x": "here", "moves": 1}, "Expected `float`, got `str` - at `$.x`"),
        ("where", 1, "Where but returned 1"),
    ],
)
async def test_a_result_is_what_its_signature_promises_or_a_failure(
    realm: Any, name: str, truth: Any, sentence: str
) -> None:
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = truth
    with pytest.raises(CommandFailed) as refused:
        await realm.client(liar).call(name, {})
    assert str(refused.value).startswith(f"liar.{name} failed: it promises ")
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("name", "truth", "plain"),
    [
        ("whole", 7, 7),
        ("metres", 1, 1),
        ("perhaps", None, None),
        ("side", "left", "left"),
        ("where", Where(1.0, 2), {"x": 1.0, "moves": 2}),
        ("where", {"x": 1.0, "moves": 2}, {"x": 1.0, "moves": 2}),
        ("unsaid", [1, "a"], [1, "a"]),
    ],
)
async def test_a_result_that_keeps_its_promise_travels(realm: Any, name: str, truth: Any, plain: Any) -> None:
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = truth
    assert await realm.client(liar).call(name, {}) == plain


class Unspeakable(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no words")


async def test_an_error_that_cannot_be_written_ends_its_command_all_the_same(realm: Any) -> None:
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = Unspeakable()
    with pytest.raises(CommandFailed, match=r"liar.fails failed: Unspeakable \("):
        await realm.client(liar).call("fails", {})
    assert not liar.description().busy


async def test_the_trace_of_an_error_is_written_without_parsing_python(
    realm: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Threads of commands must not disturb a parser elsewhere: CPython 3.11.7 confuses the two."""
    parsed: list[object] = []
    monkeypatch.setattr("ast.parse", lambda *given, **_: parsed.append(given))
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = 0.0
    with pytest.raises(CommandFailed, match=r"liar.divides failed: ZeroDivisionError"):
        await realm.client(liar).call("divides", {})
    assert "return (1.0 + 2.0) / (3.0 * self.truth)" in caplog.text
    assert not parsed
