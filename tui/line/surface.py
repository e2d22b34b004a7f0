"""A place where lines are typed: which verbs are there, and why another one is not. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from robotree.tui.errors import BadLine, NotHere, UnknownVerb
from robotree.tui.line import checking, grammar
from robotree.tui.line.action import Action, Where, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.grammar import Line, Shape

_NAMES = {
    Where.SHELL: "in a shell",
    Where.PROMPT: "at this prompt",
    Where.SCRIPT: "in a session",
    Where.SCREEN: "on the screen",
}


class Surface(NamedTuple):
    """One place, and what may be done there."""

    where: Where
    readonly: bool = False
    """Whether everything that changes robots is absent; the protective stop stays."""
    everywhere: Mapping[str, str] = MappingProxyType({})
    """Options that every verb takes here, as in `Shape.options`."""
    internal: Mapping[str, str] = MappingProxyType({})
    """The same, for programs: they are not shown to people."""
    shell: str = "robotree"
    """How a line begins in a shell that reaches the same robots."""
    why_readonly: str = "no verb {verb!r}: this is read-only (--readonly or $ROBOTREE_READONLY)"
    absent: Mapping[str, str] = MappingProxyType({})
    """Verbs that are not here either, and why."""

    def has(self, action: Action) -> bool:
        """Whether an action can be asked for here."""
        return self.where in action.where and not self.withholds(action)

    def withholds(self, action: Action) -> bool:
        """Whether an action is absent as one may only look: the one rule for verbs, keys and pages."""
        alters = action.alters or (action.writes and self.where is not Where.SHELL)
        return action.verb in self.absent or (self.readonly and alters)

    def refusal(self, verb: str) -> str:
        """Return why one may not do here what a verb does, whatever asks for it; empty: one may."""
        why = self.absent.get(verb, self.why_readonly)
        return why.format(verb=verb) if self.withholds(BY_VERB[verb]) else ""

    @property
    def actions(self) -> tuple[Action, ...]:
        """The actions that are offered here, in the order of the registry."""
        return tuple(action for action in ACTIONS if self.has(action))

    @property
    def groups(self) -> dict[str, list[Action]]:
        """The actions by group, in the order of the registry."""
        found: dict[str, list[Action]] = {}
        for action in self.actions:
            found.setdefault(action.group, []).append(action)
        return found

    @property
    def shapes(self) -> dict[str, Shape]:
        """How the lines of each verb look."""
        return {action.verb: action.shape for action in self.actions}

    def parse(self, words: Sequence[str]) -> Line:
        """Understand a line, and refuse values that cannot be meant.

        Args:
            words: the verb and its values, as `grammar.split` or a shell gives them.

        Raises:
            NotHere: the verb exists, but not here.
            UnknownVerb: there is no such verb.
            BadLine: a value is missing or given twice, one is too many, or an option is unknown.
            ValueRefused: a value has not the form that it must have.
            BadName: a name cannot be one.
        """
        try:
            line = grammar.parse(words, self.shapes, self.everywhere, self.internal)
        except (UnknownVerb, BadLine):
            _, given = grammar.leading(words, self.everywhere)
            if elsewhere := self.elsewhere(given):
                raise elsewhere from None
            raise
        shape, only = BY_VERB[line.verb].shape, BY_VERB[line.verb].shell_options
        if self.where is not Where.SHELL and (given_here := [one for one in only if line.flag(one)]):
            raise BadLine(f"{given_here[0]} works in a shell, not {_NAMES[self.where]}", shape.usage)
        checking.check(line, {**self.everywhere, **shape.options})
        return line

    def verb_of(self, words: Sequence[str]) -> str:
        """Return the verb with which a line begins; errors as those of `parse`."""
        try:
            return grammar.verb_of(words, self.shapes)
        except (UnknownVerb, BadLine):
            if elsewhere := self.elsewhere(words):
                raise elsewhere from None
            raise

    def elsewhere(self, words: Sequence[str]) -> NotHere | None:
        """Say where the verb of a line can be used, if it exists and is not here."""
        known = [action for action in ACTIONS if _begins(words, action.verb)]
        if not known or any(self.has(one) for one in known):
            return None
        found = known[0]
        verb = found.verb if len(known) == 1 else words[0]
        if self.readonly and self.where in found.where:
            return NotHere(verb, self.refusal(found.verb) or self.why_readonly.format(verb=verb))
        if self.where is not Where.SHELL and Where.SHELL in found.where:
            import shlex

            line = f"{self.shell} {shlex.join(words)}"
            return NotHere(verb, f"no verb {verb!r} {_NAMES[self.where]}; it is for a shell: `{line}`")
        hints = [f"type `:{verb}`"] if Where.PROMPT in found.where else []
        hints += [f"press {spell(found.key)}"] if found.key else []
        how = f": {' or '.join(hints)}" if hints else ""
        return NotHere(verb, f"no verb {verb!r} {_NAMES[self.where]}; it is for the full screen{how}")


def _begins(words: Iterable[str], verb: str) -> bool:
    """Whether a line begins with a verb, or with the first word of one of two words and nothing more."""
    given, wanted = list(words), verb.split()
    return bool(given) and (given[: len(wanted)] == wanted or given == wanted[:1])
