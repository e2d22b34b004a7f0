"""Completion in a shell: the scripts for bash, zsh and fish, and the words that they offer.

    source <(robotree completion bash)                    in ~/.bashrc
    source <(robotree completion zsh)                     in ~/.zshrc, behind compinit
    robotree completion fish | source                     in ~/.config/fish/config.fish

A script asks robotree again at each Tab: `robotree completion SHELL -- WORD …` prints what the last of these
words may become. Verbs and options come from the registry, names from the living realm. Where nothing fits,
the shell offers files.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import completion, grammar, manual
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.completion import Words
from robotree.tui.line.grammar import Blank, Line
from robotree.tui.line.surface import Surface
from robotree.tui.processes.realm import only_looking
from robotree.tui.terminal import answer

GLANCE = 1.0
"""[s] that the robots of the realm may take to say what they are called: a person waits at the keyboard."""

BASH = """\
_robotree() {
    # `=` and `:` part words for bash, not for robotree: the line is read as it stands
    local line="${COMP_LINE:0:COMP_POINT}" word
    local -a typed
    read -ra typed <<<"$line"
    [[ "$line" == *[[:space:]] ]] && typed+=("")
    COMPREPLY=()
    while IFS= read -r word; do
        COMPREPLY+=("$word")
        [[ "$word" == *= ]] && compopt -o nospace 2>/dev/null
    done < <("${typed[0]}" completion bash -- "${typed[@]:1}" 2>/dev/null)
}
complete -o default -F _robotree robotree
"""

ZSH = """\
#compdef robotree
_robotree() {
    local line word about
    local -a plain plain_about open
    for line in "${(@f)$("${words[1]}" completion zsh -- "${(@)words[2,CURRENT]}" 2>/dev/null)}"; do
        word="${line%%$'\\t'*}"
        about="${line#*$'\\t'}"
        if [[ -z "$word" ]]; then continue
        elif [[ "$word" == *= ]]; then open+=("$word")
        elif [[ "$about" == "$line" ]]; then plain+=("$word"); plain_about+=("$word")
        else plain+=("$word"); plain_about+=("$word  -- $about")
        fi
    done
    (( ${#open} )) && compadd -S '' -a open
    (( ${#plain} )) && compadd -l -d plain_about -a plain
    (( ${#open} + ${#plain} )) || _files
}
compdef _robotree robotree
"""

FISH = """\
function __robotree_complete
    set -l given (commandline -opc)
    set -l found ($given[1] completion fish -- $given[2..-1] (commandline -ct) 2>/dev/null)
    if test (count $found) -gt 0
        printf '%s\\n' $found
    else
        __fish_complete_path (commandline -ct)
    end
end
complete -c robotree -f -a '(__robotree_complete)'
"""

SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}
"""By the name of the shell."""


def script(shell: str) -> str:
    """Return the script that makes a shell complete lines of robotree.

    Raises:
        ValueRefused: the shell is unknown.
    """
    if shell not in SCRIPTS:
        raise ValueRefused("SHELL", f"{shell!r} is no shell that is known: {', '.join(SCRIPTS)}")
    return SCRIPTS[shell]


def complete(line: Line, realm: str) -> int:
    """Print the script of a shell, or what a half-typed line may become."""
    words, text = line.many("WORD"), script(line.text("SHELL"))
    if not words:
        answer(text.rstrip("\n"), lambda: {"script": text})
        return exit_codes.DONE
    here = manual.shell(readonly=only_looking(given=line.flag("--readonly")))
    found = offered(words, here, realm)
    plain = line.text("SHELL") == "bash"
    rows = [word if plain or not about else f"{word}\t{about}" for word, about in found]
    if rows or line.flag("--json"):
        answer("\n".join(rows), lambda: [word for word, _ in found])
    return exit_codes.DONE


def man(line: Line, _realm: str) -> int:
    """Print the manual page."""
    found = manual.man_page(manual.shell(readonly=only_looking(given=line.flag("--readonly"))))
    answer(found.rstrip("\n"), lambda: {"man": found})
    return exit_codes.DONE


def offered(words: Sequence[str], surface: Surface, realm: str) -> list[tuple[str, str]]:
    """Return what the last word may become.

    Args:
        words: behind the program's name; the last one is half typed.
        surface: which verbs and options there are.
        realm: whose robots can be named; it is asked only where a name may come next.

    Returns:
        Each word, and for a verb what it does, in one sentence.
    """
    *typed, last = list(words) or [""]
    _, given = grammar.leading(typed, surface.everywhere)
    known = Words(verbs=surface.shapes, everywhere=surface.everywhere)
    blanks = {part.name for part in completion.expected(given, known) if isinstance(part, Blank)}
    if blanks & completion.OF_THE_REALM:
        known = asyncio.run(_named(known, _realm_in(typed) or realm))
    found = completion.following(given, last, known)
    if not last and "FILE" in blanks:  # else no file would be offered beside the second words of verbs
        found = ()
    if not last.startswith("-"):  # options come when they are asked for, so that files are offered otherwise
        found = tuple(word for word in found if not word.startswith("-"))
    return [(word, _about(" ".join([*given, word]))) for word in found]


def _realm_in(given: Sequence[str]) -> str:
    """Return the realm that a half-typed line names; empty: it names none that can be one."""
    from robotree.tui.processes.realm import chosen
    from robotree.vr.base.errors import BadName

    for word, value in zip(given, [*given[1:], ""], strict=True):
        name = value if word == "--realm" else word.removeprefix("--realm=")
        if word.startswith("--realm") and name:
            try:
                return chosen(name)
            except BadName:
                return ""
    return ""


def _about(typed: str) -> str:
    action = BY_VERB.get(typed)
    return action.help.partition(". ")[0].rstrip(".") if action else ""


async def _named(known: Words, realm: str) -> Words:
    """Add the names of the living realm; none where nobody answers in time."""
    from robotree.client.joining import joined
    from robotree.tui.processes.realm import anybody_met
    from robotree.vr.base.errors import VrError

    if not anybody_met(realm):
        return known
    try:
        async with asyncio.timeout(GLANCE), joined(realm) as realm_client:
            robots, hosts = await asyncio.gather(realm_client.tree(), realm_client.hosts())
            return completion.words_of(
                robots,
                free=[robot.name for robot in realm_client.robots()],
                views=[view.name for view in realm_client.views()],
                hosts=[host.address.name for host in hosts],
                verbs=known.verbs,
                everywhere=known.everywhere,
                groups=realm_client.groups.names(),
            )
    except (VrError, TimeoutError):
        return known
