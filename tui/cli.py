"""The command `robotree`: reads one line, and starts what it asks for.

This is the composition root: the only place, with `demo.py`, that may start the other rooms. Everything
heavy is imported where it is needed, so that help comes at once.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING, Any, NoReturn

from robotree.tui import exit_codes
from robotree.tui.errors import Interrupted, NeedsTerminal
from robotree.tui.line import grammar, manual
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Line
from robotree.tui.line.surface import Surface
from robotree.tui.processes.realm import only_looking
from robotree.tui.terminal import (
    answer,
    answering,
    complain,
    forget_the_reader,
    no_screen,
    note,
    put,
    until_the_reader_leaves,
)

if TYPE_CHECKING:
    from robotree.vr.agents.run import Ready


START = 0.5
"""[s] that Python takes at most to start."""


def program(order: str = "") -> NoReturn:
    """Run the command line of this process and end the process.

    Args:
        order: id of the order to stop that has been sent already for this line; empty: none has.

    Where nothing else runs in it, Python does not take apart what it has loaded: that takes as long as a list
    of robots. All that was written has been flushed (`terminal.put`).
    """
    code = main(order=order)
    threads = sys.modules.get("threading")  # not loaded: there is only this one
    if threads is None or threads.active_count() == 1:
        os._exit(code)
    sys.exit(code)


def main(words: Sequence[str] | None = None, *, order: str = "") -> int:
    """Run one command line.

    Args:
        words: without the program's name; None: those of this process.
        order: see `program`.

    Returns:
        The exit code; see `exit_codes`.
    """
    # what this process has computed so far is the start of Python: the line was given before that
    began = time.monotonic() - (min(time.process_time(), START) if words is None else 0.0)
    given = list(sys.argv[1:] if words is None else words)
    with answering(as_json="--json" in takewhile(lambda word: word != "--", given)) as got:
        code = _answered(given, began, order)
        if got.as_json and not got.given and code == exit_codes.DONE:
            put("null")
        return code


def _answered(given: list[str], began: float, order: str) -> int:
    try:
        return _obey(given, began, order)
    except KeyboardInterrupt:
        complain(Interrupted())
        return exit_codes.INTERRUPTED
    except BrokenPipeError:
        # The reader of our output left (`robotree ls | head -1`): nothing to say, nobody to say it to.
        forget_the_reader()
        return exit_codes.DONE
    except Exception as error:
        if not exit_codes.ours(error):
            raise  # a mistake of ours: its traceback is wanted
        complain(error)
        return exit_codes.code_of(error)


def _obey(given: list[str], began: float, order: str) -> int:
    before, rest = grammar.leading(given, manual.EVERYWHERE)
    surface = manual.shell(readonly=only_looking(given="--readonly" in given))
    plain = [word for word in rest if not word.startswith("-")]
    if "--version" in before or rest[:1] == ["-V"]:
        return _version()
    if rest[:1] == ["help"]:
        return _help(plain[1:], surface)
    if {"--help", "-h"} & {*before, *rest}:
        return _help(plain, surface)
    words = [*before, *rest] if rest else ["supervise", *before]
    line = surface.parse(words)._replace(given=began, order=order)
    if needs := BY_VERB[line.verb].needs:
        from robotree.tui.line.installed import require

        require(line.verb, *needs)
    try:
        return _start(line, readonly=surface.readonly)
    except ImportError as error:  # what only some lines of a verb need
        from robotree.tui.line.installed import lacking

        raise lacking(line.verb, error) or error from None


def _help(words: Sequence[str], surface: Surface) -> int:
    """Print the help of all verbs, of those with this first word, or of one."""
    family = manual.family(words[0], surface) if len(words) == 1 else ""
    if words and not family:
        verb = surface.verb_of(words)
        answer(manual.page(verb), lambda: manual.structure(BY_VERB[verb]))
    else:
        begins = f"{words[0]} " if words else ""
        found = [action for action in surface.actions if action.verb.startswith(begins)]
        answer(family or manual.overview(surface), lambda: [manual.structure(one) for one in found])
    return exit_codes.DONE


def _version() -> int:
    from importlib.metadata import PackageNotFoundError, version

    with suppress(PackageNotFoundError):
        found = version("robotree")
        answer(f"robotree {found}", lambda: {"robotree": found})
    return exit_codes.DONE


def _start(line: Line, *, readonly: bool) -> int:
    """Start what the line asks for, in this process, and return its exit code."""
    from robotree.tui.processes.realm import chosen

    realm = chosen(line.text("--realm"))
    tether = line.flag("--tether")
    match line.verb:
        case "supervise" | "user":
            return _screen(line, realm, readonly=readonly)
        case "demo":
            return _demo(line, readonly=readonly)
        case "run" | "test":
            return _play(line, realm, readonly=readonly)
        case verb if verb in AGENTS and not line.flag("--print-config"):
            import asyncio

            return asyncio.run(_agent(line, realm, tether=tether))
        case verb if verb.startswith("wire ") or (verb.startswith("rules ") and _offline(line)):
            from importlib import import_module

            return int(import_module(f"robotree.tui.{verb.partition(' ')[0]}").start(line))
        case verb:
            apart = {
                "check": _author, "new": _author, "compose": _compose, "info": _look, "doctor": _look,
                "completion": _complete, "man": _man, "stop": _stop, "save": _save, "apply": _apply,
                "hub": _realm, "mcp": _mcp, "assistants": _assistant, "web": _web,
            }  # fmt: skip
            families: dict[str, Callable[[Line, str, bool], int]] = {
                "realm": _realm, "bundle": _bundle, "policy": _policy, "assistant": _assistant,
                "fault": _fault, "recording": _recorded, "export": _recorded, "replay": _recorded,
            }  # fmt: skip
            family = families.get(verb.partition(" ")[0], _ask)
            return apart.get(verb, family)(line, realm, readonly)


def _play(line: Line, realm: str, *, readonly: bool) -> int:
    """Play a session script, or a suite of them."""
    if line.verb == "test":
        from robotree.tui.session import suite

        return suite.run(line, realm, _run, readonly=readonly)
    from robotree.tui.session.playing import play_file

    return _run(play_file(line, realm, readonly=readonly))


def _screen(line: Line, realm: str, *, readonly: bool) -> int:
    """Show what is in a realm: drawn, or in lines."""
    if line.flag("--plain") or os.environ.get("ROBOTREE_PLAIN", "") not in {"", "0"}:
        from robotree.tui.plain import supervise_in_lines

        return _run(supervise_in_lines(realm, readonly=readonly), on_screen=True)
    from robotree.tui.line.installed import require

    require(line.verb, "tui")
    _take_calm(line)
    return _run(_supervise(realm, readonly=readonly, user=line.verb == "user"), on_screen=True)


def _realm(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Make, join or change a realm of several machines, or print how a hub is configured."""
    from robotree.tui.sites import sharing

    if line.verb == "realm create" and line.text("--group"):
        return sharing.create(line.text("NAME"), line.text("--group"))
    if line.verb == "realm join" and "@" in line.text("TOKEN"):
        return sharing.join(line.text("TOKEN"))
    from robotree.tui.sites import realms, running

    return running.print_config(line) if line.verb == "hub" else realms.start(line, realm)


def _bundle(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Make, check or trust a bundle."""
    from robotree.tui import bundles

    return bundles.start(line, realm)


def _recorded(line: Line, _realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Show a recording of a realm, or write it in another format."""
    if line.verb == "replay":
        from robotree.tui.recording.replaying import replay

        return _run(replay(line), on_screen=True)
    from robotree.tui.recording import exports

    return exports.start(line)


def _policy(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Show, check or set the policy of a realm."""
    from robotree.tui.sites import policies

    return policies.start(line, realm)


def _mcp(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Serve assistants."""
    from robotree.tui import assisting

    return _run(assisting.serve(line, realm))


def _web(line: Line, realm: str, readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Serve the full screen to browsers."""
    from robotree.tui.web.serving import web

    return _run(web(line, realm, readonly=readonly))


def _assistant(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """List assistants, or make or take back their keys."""
    from robotree.tui import assisting

    return assisting.start(line, realm)


def _offline(line: Line) -> bool:
    """Whether a verb about rules is about a file, and not about a script that runs."""
    what = line.text("WHAT")
    return not what or bool(line.text("--after")) or what.lower().endswith((".yaml", ".yml", ".clp"))


def _author(line: Line, _realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Write or check a page."""
    from robotree.tui import authoring
    from robotree.tui.line.known_kinds import known_kinds

    return (authoring.check if line.verb == "check" else authoring.new)(line, known_kinds())


def _compose(line: Line, realm: str, readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Make a page of a file, also where no realm is; or open the composer."""
    if not line.text("--from"):
        from robotree.tui.line.installed import require

        require("compose", "tui")
        return _run(_supervise(realm, readonly=readonly, composing=True), on_screen=True)
    from robotree.tui.line.shell import apart

    return _run(apart(line, realm))


def _ask(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Carry out a verb over the robots of a realm."""
    from robotree.tui.line.shell import once

    listening = line.verb == "watch" or line.flag("--follow") or line.flag("--watch")
    return _run(once(line, realm), listening=listening)


def _fault(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Begin a fault, and keep it up until its time is over or Ctrl-C."""
    from robotree.tui.line.shell import once
    from robotree.tui.session.faults import hold

    return _run(once(line, realm, hold))


def _stop(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Stop robots, in one realm or in all of this user."""
    from robotree.tui.line.stopping import stop

    return stop(line, realm, _run)


def _save(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Write a realm into a file."""
    from robotree.tui.realm_file import verbs

    return _run(verbs.save(line, realm))


def _apply(line: Line, realm: str, _readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Bring about the realm of a file."""
    from robotree.proxy.kinds import KINDS
    from robotree.tui.realm_file import verbs

    return _run(verbs.apply(line, realm, {"proxy": KINDS}))


def _look(line: Line, realm: str, readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Look at this machine, not at robots alone."""
    from robotree.tui.diagnosis import doctor, info

    return info.run(realm, readonly=readonly) if line.verb == "info" else doctor.run(line, realm)


def _complete(line: Line, realm: str, readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Print the script of a shell, or what a half-typed line may become."""
    from robotree.tui.line import shells

    words, script = line.many("WORD"), shells.script(line.text("SHELL"))
    if not words:
        answer(script.rstrip("\n"), lambda: {"script": script})
        return exit_codes.DONE
    offered = shells.offered(words, manual.shell(readonly=readonly), realm)
    plain = line.text("SHELL") == "bash"
    rows = [word if plain or not about else f"{word}\t{about}" for word, about in offered]
    if rows or line.flag("--json"):
        answer("\n".join(rows), lambda: [word for word, _ in offered])
    return exit_codes.DONE


def _man(_line: Line, _realm: str, readonly: bool) -> int:  # noqa: FBT001 # one of several that are alike
    """Print the manual page."""
    found = manual.man_page(manual.shell(readonly=readonly))
    answer(found.rstrip("\n"), lambda: {"man": found})
    return exit_codes.DONE


def _take_calm(line: Line) -> None:
    """Hand `--calm` over to the screen, and to whatever it starts."""
    if line.flag("--calm"):
        os.environ["ROBOTREE_CALM"] = "1"


def _demo(line: Line, *, readonly: bool) -> int:
    """Play the demo: on the full screen where there is a terminal for it, else as its script."""
    from robotree.tui import demo, demo_companion, demo_crash
    from robotree.tui.errors import ValueRefused
    from robotree.tui.line.installed import require
    from robotree.tui.wire import security

    _take_calm(line)
    headless, without = line.flag("--headless"), no_screen()
    if without and not headless:
        note(
            f"the full screen needs a terminal, and {without}; the demo plays its script (`demo --headless`)"
        )
    companion, crash = demo_companion.wanted(line.text("STORY")), line.flag("--crash")
    if companion and crash:
        raise ValueRefused("--crash", "the host of the cell is killed, not that of the companion's flat")
    sites = line.text("STORY") in {demo_companion.SITES, demo_companion.TRAVEL}
    if line.text("--delay") and not sites:
        raise ValueRefused("--delay", "only `demo sites` and `demo travel` have a line between sites")
    assisted = line.text("STORY") == demo_companion.MCP
    extras = ["scripts"] * companion + ["machines"] * sites + ["mcp"] * assisted
    require("demo", *extras, *([] if headless or without else ["tui"]))
    if not (headless or without):
        from robotree.tui.screen import keymap

        keymap.load()  # one that is wrong is told before anything begins
    if sites:
        return _run(
            _demo_sites(line, headless=headless or bool(without), readonly=readonly), on_screen=not headless
        )
    if line.text("STORY") == demo_companion.AWAY:
        from robotree.tui.demo_away import away

        apart = headless or bool(without)
        key = security.wanted(line, security.REALM)
        work = away(headless=apart, realm=line.text("--realm"), readonly=readonly, key=key)
        return _run(work, on_screen=not headless)
    if assisted:
        from robotree.tui import demo_mcp

        apart, key = headless or bool(without), security.wanted(line, security.REALM)
        work = demo_mcp.demo(headless=apart, realm=line.text("--realm"), readonly=readonly, key=key)
        return _run(work, on_screen=not headless)
    over = demo.Wire.of(can=line.flag("--can"), classic=line.flag("--classic"))
    story: demo.Story = demo_companion.STORY if companion else demo_crash.Crash() if crash else demo.CELL
    if line.text("STORY") == demo_companion.COMPOSE:
        from robotree.tui import demo_compose

        story = demo_compose.Compose()
    work = demo.demo(
        story,
        headless=headless or bool(without),
        realm=line.text("--realm"),
        pictures=line.text("--pictures"),
        wire=over,
        speedup=line.text("--speedup", "1"),
        readonly=readonly,
        key=security.wanted(line, security.REALM),
    )
    return _run(work, on_screen=not headless)


def _demo_sites(line: Line, *, headless: bool, readonly: bool) -> Coroutine[Any, Any, int]:
    """Return the demo of several machines.

    Raises:
        ValueRefused: it has no such option.
    """
    from robotree.tui import demo_companion, demo_sites, demo_travel
    from robotree.tui.errors import ValueRefused
    from robotree.tui.wire import security

    story = line.text("STORY")
    travel = story == demo_companion.TRAVEL
    for option in ("--crash", "--can", "--classic", "--pictures"):
        if line.flag(option) or line.text(option):
            raise ValueRefused(
                option, f"`demo {story}` has a course of its own; it takes --headless, --delay and --speedup"
            )
    return demo_sites.demo(
        headless=headless,
        delay=demo_sites.delay_of(line.text("--delay", f"{demo_sites.DELAY}")),
        realm=line.text("--realm"),
        speedup=line.text("--speedup", demo_travel.SPEEDUP if travel else "1"),
        readonly=readonly,
        key=security.wanted(line, security.REALM),
        make=demo_travel.Travel if travel else None,
    )


def _run(work: Coroutine[Any, Any, int], *, listening: bool = False, on_screen: bool = False) -> int:
    """Run to the end. SIGTERM and SIGHUP end it as Ctrl-C does: what it began on robots ends too.

    Args:
        work: what is done.
        listening: it does nothing but tell, and so ends when nobody reads it any more.
        on_screen: it is for the person at the terminal, and so ends when the terminal closes.
    """
    import asyncio
    import signal

    from robotree.tui.processes.ending import CREW_LAST_WORDS, Ending

    async def obeying() -> int:
        loop, task = asyncio.get_running_loop(), asyncio.ensure_future(work)

        def end() -> None:
            if not task.cancelling():  # Ctrl-C may have come first
                task.cancel()

        unread = until_the_reader_leaves(loop, task.cancel) if listening else None
        with Ending(end, CREW_LAST_WORDS) as ending:
            ending.at(signal.SIGTERM, signal.SIGHUP)
            if on_screen:
                ending.with_terminal()
            try:
                return await task
            except asyncio.CancelledError:
                if unread is not None and unread():
                    forget_the_reader()
                    return exit_codes.DONE
                complain(Interrupted())
                return exit_codes.INTERRUPTED

    _find_room_for_a_loop()
    with asyncio.Runner() as runner:
        runner.get_loop()  # first: where it fails, nothing has begun
        return runner.run(obeying())


def _find_room_for_a_loop() -> None:
    """Try whether the descriptors of an event loop are free: asyncio prints a traceback of its own if not.

    Raises:
        OSError: they are not.
    """
    import select
    import socket

    with select.epoll():
        for end in socket.socketpair():
            end.close()


async def _supervise(realm: str, *, readonly: bool, user: bool = False, composing: bool = False) -> int:
    """Join the realm and show the full screen, its composer, or the page for who does not operate robots."""
    if without := no_screen():
        raise NeedsTerminal(without)
    from robotree.client.joining import joined
    from robotree.tui.screen import keymap
    from robotree.tui.screen.app import Composer, Supervisor
    from robotree.tui.screen.supervise import supervise
    from robotree.tui.screen.user_app import UserApp

    keymap.load()  # one that is wrong is told before anything begins
    from robotree.tui.line import taken
    from robotree.tui.line.carrying import Silent

    async with joined(realm) as realm_client:
        await taken.merge(realm_client, Silent())
        app = UserApp if user else Composer if composing else Supervisor
        return await supervise(realm_client, realm, readonly=readonly, screen=app)


async def _agent(line: Line, realm: str, *, tether: bool) -> int:
    """Run one agent until the process is ended."""
    from robotree.tui.processes.serving import serve

    foreign = line.verb in {"host", "proxy"}  # the code of authors: pages and proxies
    await serve(partial(AGENTS[line.verb], line, realm), tether=tether, foreign=foreign)
    return exit_codes.DONE


async def _sim(line: Line, _realm: str, ready: Ready) -> None:
    from robotree.sim.controller.fence_file import FenceFile
    from robotree.sim.serving.server import serve
    from robotree.tui.line import values
    from robotree.tui.processes.state_files import fence_file, kept_by_one
    from robotree.tui.wire.security import openness, securing

    url = line.text("--listen")
    file = fence_file(line.text("--state"), url)
    with kept_by_one(file):
        async with securing(line) as security:
            memory = FenceFile(file, reset=line.flag("--reset-epoch"))
            if memory.trouble:
                note(memory.trouble)

            def listens(address: str) -> None:
                if not security.signed:
                    note(openness(address))
                ready(address)

            if line.text("--log"):
                _log_goals(line.text("--log"))
            speedup = values.factor(line.text("--speedup", "1"))
            kind = line.text("KIND")
            await serve(kind, url, ready=listens, speedup=speedup, security=security, memory=memory)


def _log_goals(given: str) -> None:
    """Write each goal that the simulated controller begins and ends into a file, behind what is there.

    Raises:
        ValueRefused: the file cannot be opened.
    """
    import logging
    from pathlib import Path

    from robotree.files import opened
    from robotree.sim.firmware import goals
    from robotree.tui.errors import ValueRefused

    try:
        descriptor = opened(Path(given).expanduser(), os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW)
    except OSError as error:
        raise ValueRefused("--log", f"{given} cannot be written: {error.strerror}") from None
    handler = logging.StreamHandler(os.fdopen(descriptor, "w", buffering=1))
    handler.setFormatter(logging.Formatter("%(created).3f %(message)s"))
    log = logging.getLogger(goals.__name__)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    log.propagate = False


async def _proxy(line: Line, realm: str, ready: Ready) -> None:
    from robotree.proxy.agent import run_proxy
    from robotree.tui.processes.state_files import history_folder
    from robotree.tui.wire.security import securing

    kind, name, url = line.text("KIND"), line.text("NAME"), line.text("--connect")
    take_over = line.flag("--take-over")
    component = _component(line.text("--component", "1"))
    async with securing(line) as security:
        await run_proxy(
            kind,
            name,
            url,
            realm=realm,
            security=security,
            take_over=take_over,
            component=component,
            keep=history_folder(realm, name),
            ready=ready,
        )


def _component(text: str) -> int:
    """A MAVLink component id, 1 to 255."""
    from robotree.tui.errors import ValueRefused

    if not text.isdecimal() or not 1 <= int(text) <= 255:
        raise ValueRefused("N", f"{text!r} is no component; write a number from 1 to 255")
    return int(text)


def _cameras(text: str) -> dict[str, int]:
    """Components by the names of cameras, from `left=101,right=102`."""
    from robotree.tui.errors import ValueRefused

    found: dict[str, int] = {}
    for each in text.split(","):
        name, _, component = each.partition("=")
        if not name.strip():
            raise ValueRefused("LIST", f"{each!r} names no camera; write NAME=COMPONENT, such as left=101")
        found[name.strip()] = _component(component)
    return found


async def _view(line: Line, realm: str, ready: Ready) -> None:
    from robotree.proxy.agent import run_view
    from robotree.tui.wire.security import securing

    async with securing(line) as security:
        await run_view(
            line.text("NAME"),
            line.text("--connect"),
            realm=realm,
            security=security,
            cameras=_cameras(line.text("--cameras", "cell=100,wrist=101")),
            ready=ready,
        )


async def _host(line: Line, realm: str, ready: Ready) -> None:
    from robotree.tui.bundles import gate_of
    from robotree.tui.line import values
    from robotree.tui.processes.state_files import history_folder, journal_folder
    from robotree.vr.agents.run import Keeping, place_of, run_host
    from robotree.vr.agents.standby import AFTER

    name, only, of = line.text("NAME"), line.text("--only"), line.text("--standby-for")
    after = values.duration(line.text("--after")) if line.text("--after") else AFTER
    _check_standing_by(line, after)
    folder = None if only else journal_folder(realm, of or name)
    if folder is not None and line.flag("--forget"):
        shutil.rmtree(folder, ignore_errors=True)
        folder = None
    place = place_of(folder, line.text("--journal"), f"{realm}/{of or name}")
    await run_host(
        name,
        realm=realm,
        only=only,
        keep=None if place is None else Keeping(place, of, after),
        past=history_folder(realm, only) if only else folder,
        gate=gate_of(line, realm),
        isolate=values.isolation(line.text("--isolate")) or "none",
        most=values.number_of("--most", line.text("--most")),
        ready=ready,
    )


def _check_standing_by(line: Line, after: float) -> None:
    """Refuse what a stand-by host, or one with a journal elsewhere, cannot be told."""
    from robotree.tui.errors import ValueRefused
    from robotree.vr.agents.standby import SHORTEST_AFTER
    from robotree.vr.space.run import POSTGRES

    name, of, url = line.text("NAME"), line.text("--standby-for"), line.text("--journal")
    if after < SHORTEST_AFTER:
        raise ValueRefused(
            "TIME", f"{after:g} s is too short to know that a host is away; write 2.5s or more"
        )
    if of == name:
        raise ValueRefused("HOST", f"{name} cannot stand by for itself; write the name of another host")
    if url and not url.startswith(POSTGRES):
        raise ValueRefused("URL", f"{url!r} is no database; write postgresql://HOST/DATABASE")
    if url and (line.text("--only") or line.flag("--forget")):
        raise ValueRefused("URL", "a host with --only or --forget keeps nothing; leave --journal out")


async def _lookup(line: Line, realm: str, ready: Ready) -> None:
    from robotree.vr.agents.run import run_lookup

    await run_lookup(line.text("NAME"), realm=realm, ready=ready)


async def _directory(line: Line, realm: str, ready: Ready) -> None:
    from robotree.tui.errors import NoPlaceForState, ValueRefused
    from robotree.tui.processes.state_files import directory_folder, site_of
    from robotree.vr.orders.run import run_directory
    from robotree.vr.space.run import POSTGRES

    name = line.text("NAME")
    folder = directory_folder(realm, name)
    if folder is None:
        raise NoPlaceForState
    url = line.text("--store")
    if url and not url.startswith(POSTGRES):
        raise ValueRefused("URL", f"{url!r} is no database; write postgresql://HOST/DATABASE")
    await run_directory(name, folder, realm=realm, site=site_of(realm), database=url, ready=ready)


async def _space(line: Line, realm: str, ready: Ready) -> None:
    from robotree.tui.errors import NoPlaceForState, ValueRefused
    from robotree.tui.processes.state_files import state_file
    from robotree.vr.space.run import run_space

    name, durability = line.text("NAME"), line.text("--durability", "process")
    if durability not in {"process", "power"}:
        raise ValueRefused("CLASS", f"{durability!r} is none; write process or power")
    store = line.text("--store") or state_file(realm, f"{name}.space.db")
    if store is None:
        raise NoPlaceForState
    await run_space(name, str(store), durability=durability, realm=realm, ready=ready)


async def _hub(line: Line, realm: str, ready: Ready) -> None:
    from robotree.tui.sites.running import run_hub

    await run_hub(line, realm, ready)


async def _gateway(line: Line, realm: str, ready: Ready) -> None:
    from robotree.tui.sites.running import run_gateway

    await run_gateway(line, realm, ready)


AGENTS: dict[str, Callable[[Line, str, Ready], Coroutine[Any, Any, None]]] = {
    "sim": _sim,
    "proxy": _proxy,
    "view": _view,
    "host": _host,
    "lookup": _lookup,
    "directory": _directory,
    "space serve": _space,
    "hub": _hub,
    "gateway": _gateway,
}
"""The process verbs: each is its agent until it is cancelled."""
