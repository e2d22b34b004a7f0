"""A robot as other agents see it: a name that carries out typed commands."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Protocol

from robotree.vr.author.context import CallLimit, CommandContext, StepInDoubt, running
from robotree.vr.author.together import Race, Together
from robotree.vr.base.address import check_name


class StreamOutlet(Protocol):
    """The way of a robot's streams to those who listen. Its methods may be called in any thread."""

    def wanted(self, stream: str) -> bool:
        """Whether somebody listens."""
        ...

    def send(self, stream: str, value: Any) -> None:
        """Send a value to all who listen; see `Sending.send`."""
        ...


class Robot:
    """Anything that accepts typed commands: a proxy in front of a real robot, or a virtual one.

    Subclasses mark methods with `@command`; what stands below *inside a command* works only in those.
    """

    begins: ClassVar[str] = ""
    """Command that its host calls when the robot has been made; empty: none."""
    one_at_a_time: frozenset[str] = frozenset()
    """Commands of which a second call is refused while one is under way, where others wait for their turn."""
    online: bool = True
    """False while what stands behind this robot cannot be reached: its readings are stale."""
    reading_units: ClassVar[Mapping[str, str]] = {}
    """Symbol of the unit of each reading, by its name; what is not here is a plain number.
    `count` for whole numbers."""
    isolated: bool = False
    """Whether its commands may get stuck in code that nobody can interrupt, such as a driver's: then they
    never run on the thread of the command that calls them."""
    witness: str = ""
    """The memory of its commands beyond its process, and its beginning: of a proxy its controller, in its
    present life. Then a later process that is asked for a command again finds out whether it was done, by
    the `witness` in its context. Empty: nobody does."""
    halted: str = ""
    """Why what stands behind this robot is in a stop that nobody ordered here, as a clause; empty: it is
    not. While it lasts no command begins; `resume` releases it. The code that sets it notifies the agent."""

    stream_outlet: StreamOutlet | None = None
    """Where its streams go; None: it has no agent. By our own code only."""

    def __init__(self, name: str, attributes: Mapping[str, str] | None = None) -> None:
        """Name the robot.

        Args:
            name: unique in the realm.
            attributes: free key-value pairs that lookup templates may ask for.

        Raises:
            BadName: that cannot be a name.
        """
        self.name = check_name(name)
        self.attributes = dict(attributes or {})

    @classmethod
    def kinds(cls) -> tuple[str, ...]:
        """Return the names of its classes, most special first: what a child slot is matched against."""
        return tuple(base.__name__ for base in cls.__mro__ if issubclass(base, Robot))

    # -- hooks ------------------------------------------------------------------------------------

    def readings(self) -> dict[str, float]:
        """Return what a panel draws, in SI units (`x`, `fx`, `width` …). Quick: asked ten times a second."""
        return {}

    def safe_stop(self, reason: str) -> Awaitable[None] | None:
        """Take part in a protective stop. Quick; the agent cancels commands and stops the children.

        A proxy, with hardware behind it, begins at once and returns what to wait for; a virtual robot returns
        nothing: its own hooks run in a thread, one after the other, and have confirmed it when they end.

        Returns:
            None: there is nothing to wait for. Else something new to await on the loop, that ends when the
            hardware has confirmed it, never before, and raises a `VrError` when that has refused for good.
            It is cancelled when the asker can wait no longer: that ends the waiting, not the stop.
        """

    def resume(self) -> Awaitable[None] | None:
        """Take part in the release of a stop that is in force. Quick; begins and returns as `safe_stop` does.

        Where that is not confirmed the robot stays stopped, and what has been begun is to be taken back: what
        was returned is cancelled, or a virtual robot's `safe_stop` called once more.
        """

    # -- inside a command -------------------------------------------------------------------------

    @property
    def context(self) -> CommandContext:
        """Key, epoch, caller and deadline of the running command."""
        return running().context

    @property
    def cancelled(self) -> bool:
        """Whether the running command has been asked to end."""
        return running().cancelled

    def check(self) -> None:
        """Raise if the running command has been asked to end: call it now and then in long computations.

        Raises:
            CommandCancelled: on request, by a stop, or because the bond has ended.
            DeadlineExceeded: its time is over.
        """
        running().check()

    def sleep(self, seconds: float) -> None:
        """Wait [s]; ends early, as `check` would, when the command is asked to end."""
        running().sleep(seconds)

    def wait_until(self, condition: Callable[[], object], within: float | str | None = None) -> None:
        """Wait until a condition on readings of children is true: one step, however often it is looked at.

            self.wait_until(lambda: self.arm.readings.z > 0.3, within="5 s")

        It is looked at when a child whose readings it reads publishes them: see `Readings` for the rate.

        Args:
            condition: reads readings of children, and attributes of the page; it calls no commands.
            within: [s], or text with a unit; None: until the deadline of the command.

        Raises:
            TimeoutError: it was not true in that time.
            SlotEmpty: a child was lost meanwhile.
            RuntimeError: the condition calls a command, or has read no readings of a child.
        """
        running().wait_until(condition, CallLimit.of(within))

    def now(self) -> float:
        """Return the time [s] on a monotonic clock."""
        return float(running().observe(running().now))

    def random(self) -> float:
        """Return a number from 0 up to but not including 1."""
        return float(running().observe(running().random))

    def together(self) -> Together:
        """Do several things at the same time.

            with self.together() as both:
                both.start(self.left.go_to, x=0.3)
                both.start(self.right.go_to, x=0.3)
            left, right = both.results

        What is started in the block has ended when the block has. The first failure cancels the others and
        is what the block raises. A function of the page can be started as well: it runs beside the block and
        may call children one after the other. Blocks can be nested.
        """
        group: Together = running().together(first=False)
        return group

    def first(self) -> Race:
        """Do several things at the same time until the first one succeeds; the others are then cancelled.

            with self.first() as race:
                race.start(self.left.find, what="cup")
                race.start(self.right.find, what="cup")
            where = race.result

        Raises:
            Failed: at the end of the block: all have failed; it lists them.
        """
        race: Race = running().together(first=True)
        return race

    def cleanup(self, within: float = 5.0) -> AbstractContextManager[None]:
        """Command children after a cancel, a failure or the deadline of the command.

            finally:
                with self.cleanup(within=5):
                    self.arm.grip(action="open")

        Calls that the command has started and not detached are ended first.

        Args:
            within: [s] that the block may take, at most 60; then what it waits for raises `CommandFailed`.

        Raises:
            CommandCancelled: at once, if the command was ended by a protective stop, with the robot's bond or
                lease, or by a second cancel: then nothing may move any more. The same inside the block.
        """
        return running().cleanup(within)

    def on_resume(self, gap: float) -> None:
        """Look how the world is when a command goes on after a crash of its host, before its next step.

        A page that overrides it may call children and raise: then the command ends with that error.

        Args:
            gap: [s] for which the host was away.
        """

    def thaw(self, state: dict[str, Any], from_version: str) -> dict[str, Any]:  # noqa: ARG002 # as below
        """Bring the fields of another version of this page into the form that this one declares.

        It is called when the robot goes on with this page and the form of its fields has changed, or its
        `version`. It must only compute, within 0.2 s: whatever else it does, the old page goes on.

        Args:
            state: fields of the other page by name, as plain values: settings and declared state.
            from_version: `version` of its class; empty: it had none.

        Returns:
            The fields of this page. What is missing begins with its default, as does what does not fit.
        """
        return state

    def verify(self, step: StepInDoubt) -> bool | None:  # noqa: ARG002 # for those that override it
        """Find out whether a step of a command was carried out of which nobody knows.

        It is asked about a child's command that adds up (`effect="once"`) when its result is lost, and
        neither the child nor its controller knows. A page that overrides it may call what only reads.

        Args:
            step: the call of the child.

        Returns:
            True: it was done, and the command goes on after it, with None as its result. False: it was not,
            and is done now. None: the page cannot tell.
        """
        return None

    def checkpoint(self) -> None:
        """Say that a command needs the steps of this round no more.

        Interrupted by a crash, it goes on from here, with what the robot keeps now (settings, `state`): its
        page begins at its first line, takes again the steps up to the first checkpoint at this line, and from
        there on those since the last one. Variables of the method are then as they were the first time, so
        what changes from round to round belongs into `state`. A command that goes on for ever says so in each
        round, else it cannot go on after some time.

        Raises:
            RuntimeError: a part of a command says so (`self.together()`), not the command itself.
        """
        running().checkpoint()

    def progress(self, fraction: float, text: str = "") -> None:
        """Tell the caller how far the command is.

        Args:
            fraction: 0 to 1; NaN when it cannot be said.
            text: a word about it.
        """
        running().progress(fraction, text)


HOOKS = ("readings", "safe_stop", "resume", "on_resume", "thaw", "verify")
"""Methods that the agent calls, so that an author may write them: with the parameters of `Robot`."""
OPTIONS = frozenset(
    {
        *("begins", "one_at_a_time", "reading_units", "isolated", "online", "halted", "attributes"),
        *("witness", "placement", "pinned"),
    }
)
"""Attributes that an author may set for the agent."""


def call_of(hook: str) -> str:
    """Return how the agent calls a hook: `safe_stop(reason)`."""
    _, *given = inspect.signature(getattr(Robot, hook)).parameters
    return f"{hook}({', '.join(given)})"


def expect_hooks(cls: type[Robot]) -> None:
    """Refuse hooks that the agent could not call: found now, and not in an emergency.

    Raises:
        TypeError: one is no plain method, is `async def`, yields, or takes other parameters.
    """
    for hook in HOOKS:
        written = inspect.getattr_static(cls, hook)
        name = f"{cls.__name__}.{hook}"
        if not inspect.isfunction(written):
            raise TypeError(f"{name} is called by every robot; write it as a method: def {call_of(hook)}")
        if inspect.iscoroutinefunction(written):
            raise TypeError(f"{name} runs in a thread: write it without async")
        if inspect.isgeneratorfunction(written) or inspect.isasyncgenfunction(written):
            raise TypeError(f"{name} cannot yield: it does its work and returns")
        _, *given = inspect.signature(getattr(Robot, hook)).parameters
        try:
            inspect.signature(written).bind("self", *given)
        except TypeError:
            wanted = ", ".join(["self", *given])
            raise TypeError(f"{name} must take what the robot gives it: write def {hook}({wanted})") from None


def attributes_of(cls: type[Any]) -> dict[str, Any]:
    """Return the attributes that a class and its bases declare, by name, as they are written there."""
    found: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        found.update(vars(base))
    return found
