"""An asyncio event loop in virtual time: what it has to do is done when a `VirtualRunner` chooses it.

Several of them, one for each simulated process, run in one operating system thread. A loop has no greenlet of
its own: its callbacks run in that of the runner, and its timers are those of the runner. What a program gives
to a thread pool (`asyncio.to_thread`, `run_in_executor`) runs in a greenlet. It watches no files: sockets,
pipes and child processes of the operating system take no virtual time.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import threading
import weakref
from asyncio import base_events, events
from collections import deque
from collections.abc import Callable, Coroutine
from contextvars import Context, copy_context
from typing import Any, ParamSpec, TypeVar

from robotree.vr.base.system import System
from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner

_P = ParamSpec("_P")
_R = TypeVar("_R")


MOST_BLOCKS = 100
"""`finally` blocks of a task that are ended one after the other; a task may catch everything for ever."""
_set_running_loop = events._set_running_loop  # noqa: SLF001 # asyncio offers no other way


class _Dropped(BaseException):
    """Ends what a task of a dropped loop waits for."""


class _Handle(asyncio.Handle):
    """A callback, made in less time: it knows only what is asked for here."""

    __slots__ = ()

    def __init__(self, callback: Any, args: tuple[Any, ...], context: Context | None) -> None:
        self._callback, self._args = callback, args
        self._context = copy_context() if context is None else context
        self._cancelled = False

    def cancel(self) -> None:
        self._cancelled = True
        self._callback, self._args = None, ()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._callback!r}>"


class _Timer(asyncio.TimerHandle):
    """A timer of a loop, which is the action in the runner's agenda."""

    __slots__ = ()

    def __init__(
        self,
        when: float,
        callback: Any,
        args: tuple[Any, ...],
        loop: VirtualLoop,
        context: Context | None,
    ) -> None:
        self._when, self._callback, self._args, self._loop = when, callback, args, loop
        self._context = copy_context() if context is None else context
        self._cancelled, self._scheduled = False, True

    def __call__(self) -> None:
        """It is time."""
        self._scheduled = False
        loop: Any = self._loop
        if self._cancelled:
            loop.world.discarded -= 1
        else:
            loop.add(self)

    def cancel(self) -> None:
        if not self._cancelled:
            self._cancelled = True
            self._callback, self._args = None, ()
            if self._scheduled:
                loop: Any = self._loop
                loop.world.discard()

    __repr__ = _Handle.__repr__


class VirtualLoop(base_events.BaseEventLoop):
    """An event loop in virtual time."""

    dead = False

    def __init__(self, runner: VirtualRunner | VirtualProcess) -> None:
        """Make the loop.

        Args:
            runner: what it waits in, and whose clock it shows.
        """
        super().__init__()
        self.runner = runner
        self.time = runner.now  # type: ignore[method-assign] # [s]; asked for at every step
        self.process = runner if isinstance(runner, VirtualProcess) else None
        self.system: System | None = None
        """Of the simulated machine on which its process runs; None: on none."""
        self.world = runner.runner if isinstance(runner, VirtualProcess) else runner
        self._resume = self.world.resume
        self._of_world = None if self.process is None or self.process.exact else self.process.of_world
        self._tasks: set[weakref.ref[asyncio.Task[Any]]] = set()
        """Those that are not gone yet."""
        self._queue: deque[asyncio.Handle] = self._ready  # type: ignore[attr-defined] # where asyncio has them
        self._chosen = False
        """Whether the runner knows that there is something to do, or it is being done."""
        self._busy = False
        """Whether something is being done in its turn that was not chosen for it (`add`); it may wait."""
        self._done = runner.waiter()
        """In which `run_forever` waits for its end."""

    # -- running ----------------------------------------------------------------------------------

    def run_forever(self) -> None:
        """Run until `stop`; this greenlet waits meanwhile."""
        self._check_closed()  # type: ignore[attr-defined] # typeshed hides it
        if self.is_running():
            raise RuntimeError("This event loop is already running")
        previous = events._get_running_loop()  # noqa: SLF001 # of the greenlet that waits here
        self._thread_id = threading.get_ident()
        _set_running_loop(None)
        self.world.outside()
        try:
            if self._queue or self._stopping:  # type: ignore[has-type] # typeshed hides it
                self._be_chosen()
            self._done.wait(None)
        finally:
            self._stopping = False
            self._thread_id = None  # type: ignore[assignment] # as asyncio does
            self.world.enter(previous)

    def switch(self) -> None:
        """Do what is to be done now. Called by the runner."""
        if self._thread_id is None or self._busy:
            self._chosen = False
            return
        queue: deque[Any] = self._queue
        try:
            for _ in range(len(queue)):
                handle = queue.popleft()
                if not handle._cancelled:  # noqa: SLF001 # as asyncio does
                    self._do(handle)
        finally:
            self._chosen = False
        if self._stopping:
            self._done.wake()
        elif queue:
            self._be_chosen()

    def _do(self, handle: Any) -> None:
        world = self.world
        if world.entered is not self:  # as `enter`
            world.entered = self
            _set_running_loop(self)
        try:  # as `Handle._run`, without its call
            handle._context.run(handle._callback, *handle._args)  # noqa: SLF001 # as asyncio does
        except (SystemExit, KeyboardInterrupt):
            raise
        except BaseException as error:  # noqa: BLE001 # as asyncio does
            message = f"Exception in callback {handle!r}"
            self.call_exception_handler({"message": message, "exception": error, "handle": handle})

    def _be_chosen(self) -> None:
        if not self._chosen:
            self._chosen = True
            self._resume(self)

    # -- what is to be done -----------------------------------------------------------------------

    def add(self, handle: asyncio.Handle) -> None:
        """Do something, as the last thing of an action of the runner: now, if nothing else is to be done."""
        if self._chosen or self._busy or self._thread_id is None or not self.world.yield_to(self):
            self._queue.append(handle)
            self._be_chosen()
            return
        self._busy = True
        try:
            self._do(handle)
        finally:
            self._busy = False
        if self._stopping:
            self._done.wake()
        elif self._queue:
            self._be_chosen()

    def take(self, callback: Callable[..., object], *args: Any) -> None:
        """Do what the network brings; see `add`."""
        if not self._closed:  # type: ignore[attr-defined] # typeshed hides it
            self.add(_Handle(callback, args, None))

    def call_soon(  # type: ignore[override] # asyncio's stub ties the arguments to the callback
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        if self._closed:  # type: ignore[attr-defined] # typeshed hides it
            raise RuntimeError("Event loop is closed")
        handle = _Handle(callback, args, context)
        self._queue.append(handle)
        if not self._chosen:
            self._chosen = True
            self._resume(self)
        return handle

    call_soon_threadsafe = call_soon  # type: ignore[assignment] # as above

    def call_at(  # type: ignore[override] # typed more loosely than in asyncio
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        if self._closed:  # type: ignore[attr-defined] # typeshed hides it
            raise RuntimeError("Event loop is closed")
        timer = _Timer(when, callback, args, self, context)
        self.world.at(when if self._of_world is None else self._of_world(when), timer)
        return timer

    def call_later(  # type: ignore[override] # typed more loosely than in asyncio
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        if self._closed:  # type: ignore[attr-defined] # typeshed hides it
            raise RuntimeError("Event loop is closed")
        when = self.time() + delay
        timer = _Timer(when, callback, args, self, context)
        self.world.at(when if self._of_world is None else self._of_world(when), timer)
        return timer

    def create_task(  # type: ignore[override] # typed more loosely than in asyncio
        self, coro: Any, *, name: str | None = None, context: Context | None = None
    ) -> asyncio.Task[Any]:
        task = super().create_task(coro, name=name, context=context)
        self._tasks.add(weakref.ref(task, self._tasks.discard))
        return task

    def run_in_executor(  # type: ignore[override] # typed more loosely than in asyncio
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Run something in a greenlet of its own."""
        del executor
        future: asyncio.Future[Any] = self.create_future()

        def settle(set_it: Callable[[Any], None], value: Any) -> None:
            if not future.done():
                set_it(value)

        def work() -> None:
            try:
                result = func(*args)
            except Exception as error:  # noqa: BLE001 # for the one who waits for it
                self._from_greenlet(settle, future.set_exception, error)
            else:
                self._from_greenlet(settle, future.set_result, result)

        self.runner.spawn(work, "executor")
        return future

    def drop(self) -> None:
        """Close the loop of a process that was ended from outside; its tasks never go on.

        Each of them is ended, which runs its `finally` blocks, each up to its first `await`: what waits in an
        asynchronous generator would else go on where that is collected, in the middle of anything.
        """
        self.set_exception_handler(lambda _loop, _context: None)
        previous = events._get_running_loop()  # noqa: SLF001 # asyncio offers no other way
        _set_running_loop(self)
        try:
            while self._tasks:  # a `finally` may make more
                task = self._tasks.pop()()
                if task is not None and not task.done():
                    task._log_destroy_pending = False  # type: ignore[attr-defined] # noqa: SLF001 # asyncio offers no other way
                    coroutine: Any = task.get_coro()
                    for _ in range(MOST_BLOCKS):  # `close` would leave an asynchronous generator as it is
                        with contextlib.suppress(BaseException):
                            coroutine.throw(_Dropped())
                        # what asyncio wraps around another awaitable is a generator
                        if getattr(coroutine, "cr_frame", None) is getattr(coroutine, "gi_frame", None):
                            break
        finally:
            _set_running_loop(previous)
        self._queue.clear()
        self._thread_id = None  # type: ignore[assignment] # typeshed hides it
        self.close()

    def _from_greenlet(self, callback: Callable[..., object], *args: Any) -> None:
        if not self.is_closed():
            self.call_soon_threadsafe(callback, *args)


def run_in_virtual_time(story: Coroutine[Any, Any, _R], seed: int = 0) -> _R:
    """Run a story to its end, and what it left behind, in no time.

    Args:
        story: what to run.
        seed: of the order in which greenlets run.

    Raises:
        RuntimeError: everybody waits, and nothing will ever happen.
    """
    runner = VirtualRunner(seed)
    try:
        with asyncio.Runner(loop_factory=lambda: VirtualLoop(runner)) as tasks:
            return tasks.run(story)
    finally:
        runner.close()


def in_virtual_time(story: Callable[_P, Coroutine[Any, Any, None]]) -> Callable[_P, None]:
    """Make a plain function, for instance a test, of a story that runs in virtual time."""

    @functools.wraps(story)
    def tell(*args: _P.args, **kwargs: _P.kwargs) -> None:
        run_in_virtual_time(story(*args, **kwargs))

    return tell
