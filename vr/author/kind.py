"""Kinds: what a robot of a kind promises, as an interface that editors and type checkers understand.

    class Gripper(Kind):
        "Opens and closes."

        @promised(effect="repeat")
        def grip(self, width: Annotated[float, Unit("m"), Range(0, 0.08)], *, within: Within = None) -> None:
            "Bring the fingers to a width."

`arm = Child(Gripper)` takes a robot whose class is called `Gripper`, or is derived from one, *and* that has
these commands. The kinds that come with robotree are in `robotree.kinds`; `robotree stubs NAME` writes that
of a living robot. Nothing here is ever called: a slot gives the child that is in it.

Each call may have a limit (`self.gripper.grip(0.02, within="5 s")`). `within: Within` says so to type
checkers, which cannot add a parameter to those of a method by themselves; it is no parameter of the command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

from robotree.vr.author.signature import Command, signature_of
from robotree.vr.base.description import CommandSpec, Effect

if TYPE_CHECKING:
    from robotree.vr.author.context import CallFuture
    from robotree.vr.author.readings import Readings

P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)


class Kind:
    """An interface. Its commands are marked with `@promised`, its name is that of the kind."""

    def __bool__(self) -> bool:
        """Whether there is a child in the slot."""
        raise NotImplementedError

    @property
    def readings(self) -> Readings:
        """The readings of the child, as it publishes them."""
        raise NotImplementedError


class Offered(Protocol[P, R_co]):
    """A child's command, as a page uses it."""

    def __call__(self, *values: P.args, **arguments: P.kwargs) -> R_co:
        """Have it carried out, wait for the end and return the result."""
        ...

    def start(self, *values: P.args, **arguments: P.kwargs) -> CallFuture[R_co]:
        """Have it carried out meanwhile; it ends with the running command at the latest."""
        ...

    def tell(self, *values: P.args, **arguments: P.kwargs) -> None:
        """Have it carried out, and wait only until the child has accepted it."""
        ...


class Promised(Generic[P, R]):
    """A command that all robots of a kind have."""

    def __init__(self, function: Callable[..., R], effect: Effect) -> None:
        """Made by `promised`."""
        self.function = function
        self.effect: Effect = effect

    @overload
    def __get__(self, robot: None, kind: type[Any]) -> Promised[P, R]: ...
    @overload
    def __get__(self, robot: object, kind: type[Any]) -> Offered[P, R]: ...
    def __get__(self, robot: object | None, kind: type[Any]) -> Promised[P, R] | Offered[P, R]:
        return self  # a kind has no instances: a slot gives the child in it

    def signature(self) -> Command:
        """Read it as callers see it.

        Raises:
            TypeError: an annotation is missing, or of a type that cannot travel.
        """
        return signature_of(self.function, self.effect, promised=True)


@overload
def promised(function: Callable[Concatenate[Any, P], R], /) -> Promised[P, R]: ...
@overload
def promised(*, effect: Effect) -> Callable[[Callable[Concatenate[Any, P], R]], Promised[P, R]]: ...
def promised(function: Callable[..., Any] | None = None, /, *, effect: Effect = "once") -> Any:
    """Say that all robots of a kind have this command.

    Args:
        function: its signature and documentation; its body is never run.
        effect: what a repetition does, as for `@command`.
    """

    def promise(function: Callable[..., Any]) -> Promised[..., Any]:
        return Promised(function, effect)

    return promise if function is None else promise(function)


def promises_of(kind: type[Kind]) -> tuple[CommandSpec, ...]:
    """Return the commands that a kind promises, those of its base classes first.

    Raises:
        TypeError: one is declared wrongly.
    """
    found: dict[str, Promised[..., Any]] = {
        name: value
        for base in reversed(kind.__mro__)
        for name, value in vars(base).items()
        if isinstance(value, Promised)
    }
    return tuple(one.signature().spec for one in found.values())
