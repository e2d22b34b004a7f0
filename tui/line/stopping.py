"""The verb `stop` on the command line, in one realm or in all of this user.

It enters no realm: it writes no file, so it works on a full disk. Where it has too few descriptors or threads
to see the realm it asks one process after another.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robotree.tui import exit_codes
from robotree.tui.errors import NothingToAsk, sentence
from robotree.tui.line import away
from robotree.tui.line.grammar import Line
from robotree.tui.line.shell import Console, once
from robotree.tui.line.verbs import HeldOrders, Outcome, held_away, hold, stopped
from robotree.tui.processes.ending import to_the_end
from robotree.tui.processes.realm import nothing_to_ask, visited
from robotree.tui.processes.state_files import KEYS
from robotree.tui.terminal import complain, error_data, note
from robotree.vr.base.chance import token
from robotree.vr.base.envelope import sitting_at, this_terminal
from robotree.vr.base.errors import NoSuchRobot, NotConfirmed, RealmUnusable, RobotAway, VrError
from robotree.vr.network.group_file import GroupFiles
from robotree.vr.network.policy_file import state_of
from robotree.vr.network.realms import all_realms, inhabited, realm_folder, state_home
from robotree.vr.supervision.stop import StopScope
from robotree.vr.supervision.stop_in_turn import stop_in_turn

Answer = Sequence[str] | VrError | None
"""The result of a stop in one realm: the robots that have confirmed it, or an error; None: nobody there."""


def stop(line: Line, realm: str) -> int:
    """Carry out the line.

    Args:
        line: that was understood; its order may have been sent already.
        realm: that is meant, unless all are.

    Returns:
        The exit code.
    """
    console = Console(as_json=line.flag("--json"))
    everywhere, name = line.flag("--everywhere"), line.text("NAME") or None
    if not everywhere and name in GroupFiles(state_of(realm_folder(realm).name)).names():
        return to_the_end(once(line, realm))
    folders = all_realms() if everywhere else [realm_folder(realm)]
    order, answers, held = line.order or token(), dict[Path, Answer](), dict[Path, HeldOrders]()
    work = _stop_all(folders, name, order, console, answers, held)
    try:
        if to_the_end(work) == exit_codes.INTERRUPTED:
            note("robotree: the stop has been sent; a robot that has it stays stopped")
            return exit_codes.INTERRUPTED
    except (OSError, RuntimeError, MemoryError, RealmUnusable) as error:
        work.close()
        console.warn(f"the stop asks one process after another, because {_reason(error)}")
        answers = {folder: _in_turn(folder, name, order) for folder in folders}
    if name is None:
        answers = {
            folder: _left(folder, answer, console, held.get(folder, HeldOrders()).by)
            for folder, answer in answers.items()
        }
    else:
        _leave_apart(answers, console)
    if everywhere:
        return _report_all(answers, held, console)
    given = answers[folders[0]]
    answer = nothing_to_ask(realm, stopping=True) if given is None else given
    absent = held.get(folders[0], HeldOrders())
    if isinstance(answer, NoSuchRobot):
        answer = away.explained(realm, answer)
    if isinstance(answer, NoSuchRobot) and not isinstance(answer, RobotAway) and absent.by and name:
        console.outcome(held_away(name))
        return exit_codes.DONE
    if isinstance(answer, Exception):
        console.error(answer)
        return exit_codes.code_of(answer)
    console.outcome(stopped(answer, absent.robots))
    return exit_codes.DONE


async def _stop_all(
    folders: Sequence[Path],
    name: str | None,
    order: str,
    console: Console,
    answers: dict[Path, Answer],
    held: dict[Path, HeldOrders],
) -> int:
    """Stop the robots of all these realms at once, and note the answers, and the directories that hold."""

    async def stop_one(folder: Path) -> None:
        async with visited(folder) as realm_client:
            try:
                sites = _sites(folder)
                if not (realm_client.inhabited() or (sites and name is None)):
                    answers[folder] = None
                    return
                holding = asyncio.ensure_future(hold(realm_client, name or "", console))
                try:
                    answers[folder] = await realm_client.stop(
                        name, on_late=console.warn, order=order, scope=StopScope(sites)
                    )
                finally:
                    held[folder] = await holding
            except VrError as error:
                answers[folder] = error

    await asyncio.gather(*map(stop_one, folders))
    return exit_codes.DONE


def _left(folder: Path, answer: Answer, console: Console, held: Sequence[str]) -> Answer:
    """Leave the stop for the robots whose hosts are away or hang; returns the answer, or why that failed."""
    if isinstance(answer, NotConfirmed):
        confirmed: Sequence[str] = answer.data["told"]
    else:
        confirmed = () if answer is None or isinstance(answer, VrError) else answer
    try:
        for each in away.leave_stop(folder.name, confirmed, held):
            console.warn(each)
    except NotConfirmed as error:
        return answer if isinstance(answer, VrError) else error
    return answer


def _leave_apart(answers: dict[Path, Answer], console: Console) -> None:
    """Leave the stop of one robot for its next process, if it lives apart and its process hangs."""
    for folder, answer in answers.items():
        if isinstance(answer, NotConfirmed):
            for sentence in away.leave_stop_apart(folder.name, dict(answer.data["untold"])):
                console.warn(sentence)


def _in_turn(folder: Path, name: str | None, order: str) -> Answer:
    if not inhabited(folder):
        return None
    try:
        with sitting_at(this_terminal()):
            return stop_in_turn(folder, name, order)
    except VrError as error:
        return error


def _report_all(answers: dict[Path, Answer], held: dict[Path, HeldOrders], console: Console) -> int:
    """Print what came of a stop in several realms; return the highest exit code."""
    known = {folder: answer for folder, answer in answers.items() if answer is not None}
    meant = {folder: answer for folder, answer in known.items() if not isinstance(answer, NoSuchRobot)}
    code, data, lines = exit_codes.DONE, list[dict[str, Any]](), list[str]()
    if not known:
        console.error(NothingToAsk(""))
        return exit_codes.NOBODY
    for folder, answer in (meant or known).items():
        about = {"realm": folder.name, "folder": str(folder)}
        if isinstance(answer, Exception):
            code = max(code, exit_codes.code_of(answer))
            data.append({**about, **error_data(answer)})
            complain(f"realm {folder.name}: {sentence(answer)}") if not console.as_json else None
        else:
            done = stopped(answer, held.get(folder, HeldOrders()).robots)
            data.append({**about, **done.data})
            lines.append(f"realm {folder.name}: {done.text}")
    console.outcome(Outcome({"realms": data}, "\n".join(lines)))
    return code


def _sites(folder: Path) -> Sequence[str]:
    """Return the other sites of a realm that has keys on this machine."""
    from robotree.vr.sites.known import names_of_sites

    return names_of_sites(state_home() / folder.name / KEYS)


def _reason(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()  # the file may be one of ours, which no person can do anything about
    return sentence(error) if isinstance(error, Exception) and str(error) else "there is too little memory"
