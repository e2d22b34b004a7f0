"""What is written into a realm file is read from it as it was, whatever the texts are."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as some
from msgspec import to_builtins

from robotree.tui.realm_file.content import GroupEntry, ProcessEntry, RealmFile, RobotEntry
from robotree.tui.realm_file.reading import read_file
from robotree.tui.realm_file.writing import write_file
from robotree.vr.base.written import Mark, Word

NAMES = some.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,8}", fullmatch=True)
TEXTS = some.text(
    some.characters(min_codepoint=32, max_codepoint=0x17F, exclude_characters="\x7f"), max_size=12
)
SPECIAL = "yes|no|null|~|12:30|0123|- a|a: b|#x|{a}|a,b|'|\"|%x|@x| a "
TEXTS = TEXTS.filter(lambda text: not any("\x7f" <= one <= "\x9f" for one in text))
TEXTS |= some.sampled_from(SPECIAL.split("|"))
WORDS = TEXTS.map(lambda text: Word(text, Mark()))
KIND, ADDRESS = Word("arm", Mark()), Word("tcp:127.0.0.1:5760", Mark())


@some.composite
def files(draw: some.DrawFn) -> RealmFile:
    names = draw(some.lists(NAMES, unique=True, min_size=2, max_size=6))
    robots = [
        RobotEntry(
            name=name,
            page=Word("page.py", Mark()),
            settings=draw(some.dictionaries(some.sampled_from(["speed", "label", "on"]), WORDS)),
            slots={"arm": (Word(names[number + 1], Mark()),)},
        )
        for number, name in enumerate(names[:-1])
    ]
    last = ProcessEntry(verb="proxy", name=names[-1], facets={"kind": KIND, "connect": ADDRESS})
    hosts = [
        ProcessEntry(verb="host", name=name) for name in draw(some.lists(NAMES, unique=True, max_size=3))
    ]
    others = draw(some.sampled_from(["", "battery > 30", "kind = 'a b' or near hall"]))
    groups = (
        GroupEntry(name="all-of-them", robots=tuple(Word(name, Mark()) for name in names), where=others),
    )
    return RealmFile(path="cell.yaml", processes=(*hosts, last), robots=tuple(robots), groups=groups)


def bare(found: Any) -> Any:
    """Return a file as plain data, without its lines and quotes."""
    match found:
        case dict():
            return {key: bare(one) for key, one in found.items() if key not in {"mark", "quoted"}}
        case list() | tuple():
            return [*map(bare, found)]
        case _:
            return found


@given(files())
def test_what_is_written_is_read_as_it_was(found: RealmFile) -> None:
    again = read_file(write_file(found, comments=["by a test"]), "cell.yaml")
    assert bare(to_builtins(again)) == bare(to_builtins(found))
