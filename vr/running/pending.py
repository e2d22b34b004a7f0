"""A call under way, as those who wait for its end see it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

from robotree.vr.child import readable
from robotree.vr.errors import ChildCancelled, CommandCancelled, CommandFailed, NoAnswer, Unreachable, VrError
from robotree.vr.requests import PATIENCE, Accepted, Progress, Raised, Returned, decode_reply
from robotree.vr.running.process import Frame, Worker
from robotree.vr.running.together import Part


class Listener(Protocol):
    """Who wants to know how a call fares. Called in any thread; must not block."""

    def note(self, fraction: float, text: str) -> None:
        """Take how far it is: 0 to 1, NaN when it cannot be said."""
        ...

    def settle(self, reply: Returned | Raised) -> None:
        """Take how it ended."""
        ...


class PendingCall(Part):
    """A child's command under way: the `CallFuture` that the author's code gets."""

    reply: Returned | Raised | None = None
    accepted: bool = False
    accept_by: float = math.inf
    """[s] when the child must have accepted it."""
    oneway: bool = False
    """Whether nobody waits for its end."""
    run_here: Callable[[Worker], None] | None = None
    """Carries the command out on the worker that waits for it: set when it is its turn."""
    ended: Callable[[], None] | None = None
    """Called once it has ended."""
    at_rest = True
    """See `Started.at_rest`."""
    key_of_child: str = ""
    """Under which a child in another process answers."""
    _fraction: float = math.nan
    _awaited: bool = False
    """Whether the caller waits until the child has accepted it."""
    _dropped: bool = False
    """Whether nobody waits for it any more."""
    _error: VrError | None = None

    def __init__(
        self, frame: Frame, slot: str, key: str, child: str, command: str, *, passes_on: bool = False
    ) -> None:
        """Made by the robot that calls.

        Args:
            frame: of the command that calls.
            slot: of the child.
            key: of the call.
            child: name of the child.
            command: of the child.
            passes_on: its progress is that of the command that calls.
        """
        self.slot, self.key, self.child, self.command = slot, key, child, command
        self.let_go: Callable[[], None] = _no_more
        """Has the child go on when the command that called it has ended."""
        self.withdraw: Callable[[str], None] = _nothing
        """Tells the child that nobody wants the call any more, and why."""
        self.frame = frame
        self._passes_on = passes_on
        self._tell = []
        self._may_be_given = [True]
        """Emptied by who decides whether the caller's worker carries the command out: caller or child."""

    # -- a Listener -------------------------------------------------------------------------------

    def note(self, fraction: float, text: str) -> None:
        """See `Listener.note`."""
        self._fraction, frame = fraction, self.frame
        if self._passes_on:
            frame.live.note(frame.call_key, fraction, text)
        elif text:
            frame.live.note_child(frame.call_key, self.child, text)

    def settle(self, reply: Returned | Raised) -> None:
        """See `Listener.settle`."""
        if self.reply is None:
            self.reply = reply
            if self.ended is not None:
                self.ended()
            if self._tell:
                self.tell_all()
            self.frame.wake()

    def fail(self, error: VrError) -> None:
        """End it with an error of our own."""
        self.settle(Raised.of(error))

    def take_reply(self, body: bytes | None) -> None:
        """Take one reply from another process; None: there are no more."""
        if body is None:
            if self.reply is not None or (self._awaited and self.accepted):
                return
            if self.accepted:
                detail = "it ended in the middle; look where the robot stands before you go on"
                self.fail(CommandFailed(robot=self.child, command=self.command, detail=detail))
            else:
                self.fail(Unreachable(key=self.key_of_child))
            return
        try:
            reply = decode_reply(body, key=self.child)
        except VrError as error:
            self.fail(error)
            return
        if isinstance(reply, (Returned, Raised)):
            self.settle(reply)
        elif isinstance(reply, Progress):
            self.note(reply.fraction, reply.text)
        elif isinstance(reply, Accepted):
            self.accepted, self.accept_by = True, math.inf
            if self.oneway and self.ended is not None:
                self.ended()
            if self._awaited:
                self.frame.wake()

    # -- a CallFuture -----------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        return self.reply is not None

    @property
    def progress(self) -> float:
        """See `CallFuture.progress`."""
        return self._fraction

    def result(self, timeout: float | None = None) -> Any:
        """See `CallFuture.result`."""
        return self.frame.in_this_thread().result_of(self, math.inf if timeout is None else timeout)

    def detach(self) -> PendingCall:
        """See `CallFuture.detach`."""
        self.frame.in_this_thread().detach(self)
        return self

    def cancel(self) -> None:
        """See `CallFuture.cancel`."""
        if self.reply is None:
            self.called_off = True
            self.withdraw("its caller has cancelled it")
            self.fail(
                CommandCancelled(robot=self.child, command=self.command, reason="its caller has cancelled it")
            )

    # -- for the frame ----------------------------------------------------------------------------

    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker, or carry the command out there; return the result.

        Raises:
            VrError: what the child raised, or what has ended the waiting command.
            TimeoutError: it is still under way.
        """
        frame = self.frame
        worker = frame.worker
        try:
            while self.reply is None:
                if self.run_here is not None:
                    run, self.run_here = self.run_here, None
                    run(worker)
                else:
                    self._wait(timeout)
        except TimeoutError:
            raise
        except BaseException:
            self.drop("its caller was ended")
            raise
        return self._value()

    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it.

        Raises:
            VrError: it has refused.
        """
        self._awaited = True
        while not self.accepted and self.reply is None:
            self._wait(math.inf)
        if self.reply is not None:
            self._value()

    def give_turn(self, run: Callable[[Worker], None]) -> bool:
        """Have the caller's worker carry the command out; False: it waits no longer."""
        try:
            self._may_be_given.pop()
        except IndexError:
            return False
        self.run_here = run
        self.frame.wake()
        return True

    def drop(self, reason: str) -> None:
        """Nobody waits for it any more."""
        if self.reply is not None or self._dropped:
            return
        self._dropped = True
        self.withdraw(reason)
        try:
            self._may_be_given.pop()
        except IndexError:  # it is given to us at this moment: somebody else has to take it
            worker = self.frame.worker
            while self.run_here is None and self.reply is None:
                worker.waiter.wait(None)
            if self.run_here is not None:
                run, self.run_here = self.run_here, None
                worker.process.work(run)

    def _wait(self, timeout: float) -> None:
        frame, worker = self.frame, self.frame.worker
        patience = self.accept_by - worker.process.runner.now()
        if not worker.wait(frame, self._is_news, min(timeout, patience)):
            if patience > timeout:
                raise TimeoutError
            if not self.accepted:
                self.withdraw("the caller gave up")
                self.fail(NoAnswer(key=self.key_of_child, seconds=PATIENCE))

    def _is_news(self) -> bool:
        # that it was accepted is looked at when the time for that is over: it wakes nobody
        return self.reply is not None or self.run_here is not None or (self._awaited and self.accepted)

    def _value(self) -> Any:
        reply = self.reply
        if isinstance(reply, Returned):
            value = reply.value
            return readable(value) if isinstance(value, (dict, list)) else value
        assert reply is not None  # noqa: S101 # it is done
        self.frame.worker.check(self.frame)  # if the caller itself was asked to end, that is what it is told
        error = self.error()
        assert error is not None  # noqa: S101 # it has failed
        raise error

    def error(self) -> VrError | None:
        """See `Started.error`."""
        if not isinstance(self.reply, Raised):
            return None
        if self._error is None:
            meant = self.frame.live.meant(self.slot, self.reply.revive())
            self._error = meant
            if isinstance(meant, CommandCancelled):
                self._error = ChildCancelled(**meant.data)
                self._error.trace = meant.trace
        return self._error

    def end_with(self, cause: VrError, *, final: bool) -> None:
        """See `Started.end_with`: it ends when the command does, or when its clean-up begins."""


def _nothing(_: str) -> None:
    """Tell nobody."""


def _no_more() -> None:
    """Do nothing."""
