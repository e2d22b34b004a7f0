"""`robotree rules …`: scripts checked, tested and explained without any robot.

robotree rules check guide.yaml --listing
robotree rules test guide.test.yaml
robotree rules dry-run guide.yaml          (one happening a line on standard input)
robotree rules explain guide.yaml greet --after guide.test.yaml
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.line.known_kinds import check_script, known_kinds
from robotree.tui.line.shell import ask
from robotree.tui.line.sources import shipped
from robotree.tui.terminal import answer, put

if TYPE_CHECKING:  # help must not wait for the rules
    from robotree.vr.scripts.program import Program
    from robotree.vr.scripts.trial import Played, Rehearsal, Trial


def _source(path: Path) -> str:
    from robotree.vr.bundle import Bundle

    return Bundle.read(path).source


def _program(given: str) -> Program:
    from robotree.vr.scripts.script import read_program

    path = shipped(given)
    program = read_program(_source(path), str(given))
    check_script(program)
    return program


def known_choices() -> dict[str, list[tuple[str, str]]]:
    """Return arguments and the values that they take, by name of the kind."""
    from robotree.vr.scripts.run import choices_of

    return {kind: choices_of(commands.values()) for kind, commands in known_kinds().items()}


def check(line: Line, _realm: str) -> int:
    """Check a script."""
    from robotree.vr.scripts.engine import Engine
    from robotree.vr.scripts.joins import loose
    from robotree.vr.scripts.known import mistyped

    program = _program(line.text("FILE"))
    Engine(program)  # CLIPS takes each rule
    rules, kinds = len(program.rules), len(program.templates)
    counted = f"{rules} rule{'s' * (rules != 1)}, {kinds} kind{'s' * (kinds != 1)} of facts"
    advice = [
        f"{line.text('FILE')}: {partner.name} is of kind {partner.kind}, which does not come with"
        f" robotree{near}"
        for partner, near in mistyped(program, known_kinds())
    ]
    advice += [
        f"{line.text('FILE')}:{one.mark.line}: rule {one.rule} joins {' with '.join(one.kinds)} without a "
        "shared variable: the numbers of these facts are multiplied"
        for one in map(loose, program.rules)
        if one is not None
    ]
    text = "\n".join([f"{line.text('FILE')} is good: {counted}", *advice])
    if line.flag("--listing"):
        text = program.listing
    data = {
        "script": program.name,
        "hash": program.hash,
        "partners": [partner.name for partner in program.partners],
        "hears": [hears.name for hears in program.hears],
        "advice": advice,
        "rules": [{"name": rule.name, "line": rule.mark.line, "clips": rule.clips} for rule in program.rules],
    }
    answer(text, lambda: data)
    return exit_codes.DONE


def _table(given: str, script: str = "") -> tuple[Program, tuple[Trial, ...]]:
    from robotree.vr.scripts.known import check_trials
    from robotree.vr.scripts.trial import read_table

    path = shipped(given)
    named, tests = read_table(_source(path), given)
    program = _program(script or str(path.parent / named))
    check_trials(program, tests, known_kinds())
    return program, tests


def test(line: Line, _realm: str) -> int:
    """Play a table against a script; refused where a test fails."""
    from robotree.vr.scripts.trial import run

    program, tests = _table(line.text("TABLE"))
    results: list[dict[str, Any]] = []
    choices = known_choices()
    for trial in tests:
        steps = list(run(program, trial, choices))
        last = steps[-1] if steps else None
        fault = last.fault if last else ""
        where = f"{line.text('TABLE')}:{last.mark.line}" if last and fault else ""
        results.append({"test": trial.name, "passed": not fault, "where": where, "fault": fault})
    rows: list[str] = []
    for result in results:
        rows.append(f"{'✓' if result['passed'] else '✗'} {result['test']}")
        if not result["passed"]:
            rows.append(f"    {result['where']}: {result['fault']}")
    failed = sum(not result["passed"] for result in results)
    rows.append(f"{len(results) - failed} of {len(results)} passed")
    answer("\n".join(rows), lambda: results)
    return exit_codes.REFUSED if failed else exit_codes.DONE


def dry_run(line: Line, _realm: str) -> int:
    """Show what a script would do."""
    program, as_json = _program(line.text("FILE")), line.flag("--json")
    if not line.text("TABLE"):
        rehearsal = _rehearsal(program)
        _show(rehearsal.opening, as_json=as_json)
        for text in sys.stdin:
            if text.strip() and not text.startswith("#"):
                _show([_tried(rehearsal, text.strip())], as_json=as_json)
        return exit_codes.DONE
    for trial in _table(line.text("TABLE"), line.text("FILE"))[1]:
        if not as_json:
            put(f"# {trial.name}")
        rehearsal = _rehearsal(program, trial)
        _show(rehearsal.opening, as_json=as_json)
        _show((rehearsal.play(step.when, step.mark) for step in trial.steps), as_json=as_json)
    return exit_codes.DONE


def _tried(rehearsal: Rehearsal, text: str) -> Played:
    """Play a line as it was typed; one that cannot be played is reported, and the next line is read."""
    from robotree.vr.base.errors import BrokenScript
    from robotree.vr.scripts.trial import Played

    try:
        return rehearsal.play(text)
    except BrokenScript as error:
        return Played(when=text, orders=(), fired=(), fault=str(error.data["reason"]))


def _show(steps: Iterable[Played], *, as_json: bool) -> None:
    for played in steps:
        if as_json:
            put(msgspec.json.encode(played).decode())
            continue
        if played.fired or played.fault or not played.opening:
            put(f"> {played.when}")
        for text in (*(f"{rule} fires" for rule in played.fired), *(f"→ {order}" for order in played.orders)):
            put(f"  {text}")
        if played.fault:
            put(f"  ✗ {played.fault}")


def _rehearsal(program: Program, trial: Trial | None = None) -> Rehearsal:
    from robotree.vr.scripts.trial import Rehearsal

    choices = known_choices()
    if trial is None:
        return Rehearsal(program, choices=choices)
    return Rehearsal(program, trial.parameters, trial.missing, trial.roles, choices)


def explain(line: Line, realm: str) -> int:
    """Explain a rule of a script that runs; or of a file, at the beginning or after its first test."""
    if not line.text("--after") and not line.text("WHAT").lower().endswith((".yaml", ".yml", ".clp")):
        return ask(line, realm)
    from robotree.vr.scripts.explain import state, unknown_rule, why

    program, rule = _program(line.text("WHAT")), line.text("RULE")
    if rule and program.rule(rule) is None:
        raise ValueRefused("RULE", unknown_rule(program, rule))
    if line.text("--after"):
        trial = _table(line.text("--after"), line.text("WHAT"))[1][0]
        rehearsal = _rehearsal(program, trial)
        for step in trial.steps:
            rehearsal.play(step.when, step.mark)
    else:
        rehearsal = _rehearsal(program)
    text = why(rehearsal.engine, rule) if rule else state(rehearsal.engine)
    answer(text, lambda: {"explanation": text.splitlines()})
    return exit_codes.DONE
