"""What a command returns is what its signature promises."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest

from robotree.vr import Robot, Unit, command
from robotree.vr.author.signature import signature_of
from robotree.vr.base.errors import CommandFailed
from tests.vr.core.crew import Where

METRES, SIDE = Annotated[float, Unit("m"), "how far"], Literal["left", "right"]


class Liar(Robot):
    """Fails as the test chooses."""

    truth: Any = None

    @command
    def fails(self) -> None:
        raise self.truth

    @command
    def divides(self) -> float:
        return (1.0 + 2.0) / (3.0 * self.truth)


def given(promise: Any, truth: Any) -> Any:
    """Return what callers get of a command that promises something and returns the truth."""

    def give(self: Robot) -> Any: ...

    give.__annotations__ = {"return": promise}
    return signature_of(give, "once").plain_result(truth, robot="liar", name="give")


@pytest.mark.parametrize(
    ("promise", "truth", "sentence"),
    [
        (int, "abc", "it promises int but returned 'abc': Expected `int`, got `str`"),
        (int, 1.5, "it promises int but returned 1.5"),
        (int, True, "it promises int but returned True"),
        (int, None, "it promises int but returned None"),
        (METRES, "1 m", "it promises float but returned '1 m'"),
        (float | None, [], "it promises float | None but returned []"),
        (None, 0, "it promises nothing but returned 0"),
        (SIDE, "up", "it promises Literal['left', 'right'] but returned 'up'"),
        (Where, {"x": "here", "moves": 1}, "Expected `float`, got `str` - at `$.x`"),
        (Where, 1, "Where but returned 1"),
    ],
)
def test_a_result_is_what_its_signature_promises_or_a_failure(
    promise: Any, truth: Any, sentence: str
) -> None:
    with pytest.raises(CommandFailed) as refused:
        given(promise, truth)
    assert str(refused.value).startswith("liar.give failed: it promises ")
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("promise", "truth", "plain"),
    [
        (int, 7, 7),
        (METRES, 1, 1),
        (float | None, None, None),
        (SIDE, "left", "left"),
        (Where, Where(1.0, 2), {"x": 1.0, "moves": 2}),
        (Where, {"x": 1.0, "moves": 2}, {"x": 1.0, "moves": 2}),
        (Any, [1, "a"], [1, "a"]),  # an author may leave it open
    ],
)
def test_a_result_that_keeps_its_promise_travels(promise: Any, truth: Any, plain: Any) -> None:
    assert given(promise, truth) == plain


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
