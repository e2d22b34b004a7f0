"""What is wrong in a realm file is one sentence with its line, before anything is asked or started."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some
from msgspec import to_builtins

from robotree.tui.errors import BadRealmFile
from robotree.tui.exit_codes import USAGE, code_of
from robotree.tui.realm_file.content import GroupEntry, ProcessEntry, RealmFile, RobotEntry
from robotree.tui.realm_file.pages import pages_of
from robotree.tui.realm_file.plan import plan
from robotree.tui.realm_file.present import Present
from robotree.tui.realm_file.reading import read_file
from robotree.tui.realm_file.writing import write_file
from robotree.vr.base.written import Mark, Word
from robotree.vr.bundle import Bundle

KINDS = {"proxy": ("arm", "rover")}
EXAMPLES = Path(__file__).parents[3] / "examples"
MOVE_TO = EXAMPLES / "move_to.py"

MISTAKES = {
    "an unknown key": (
        """
        proxies:
          arm-1:
            kind: arm
            conect: tcp:127.0.0.1:5760
        """,
        5,
        "a proxy has no 'conect' (did you mean 'connect'?); it has: kind, connect",
    ),
    "an unknown section": ("\nproxes: {}", 2, "a realm has no 'proxes' (did you mean 'proxies'?)"),
    "a key of a robot": (
        "\nrobots:\n  mover:\n    page: a.py\n    slot: {arm: arm-1}",
        5,
        "a robot has no 'slot' (did you mean 'slots'?)",
    ),
    "an unknown kind": (
        "\nproxies:\n  arm-1: {kind: amr, connect: tcp:5760}",
        3,
        "there is no kind 'amr' (did you mean 'arm'?); there is: arm, rover",
    ),
    "a name that stands twice": (
        "\nhosts: [host-1,\n        host-1]",
        3,
        "'host-1' stands here twice",
    ),
    **{
        f"a name that cannot be one of {section}": (
            f"\n{section}:\n  ../x: {entry}",
            3,
            "'../x' cannot be a name",
        )
        for section, entry in (
            ("robots", "{page: a.py}"),
            ("controllers", "{kind: arm, listen: tcp:0}"),
            ("groups", "[r1]"),
        )
    },
    "a robot and a proxy of one name": (
        "\nproxies:\n  arm-1: {kind: arm, connect: tcp:5760}\nrobots:\n  arm-1: {page: a.py}",
        5,
        "'arm-1' is also a proxy in line 3: two robots have one name",
    ),
    "a child in two slots": (
        """
        robots:
          low: {page: a.py}
          one: {page: a.py, slots: {arm: low}}
          two: {page: a.py, slots: {arm: low}}
        """,
        5,
        "low stands in two.arm and in one.arm (line 4): one commands it",
    ),
    "a circle": (
        """
        robots:
          one: {page: a.py, slots: {arm: two}}
          two: {page: a.py, slots: {arm: three}}
          three: {page: a.py, slots: {arm: one}}
        """,
        5,
        "these robots would command each other in a circle: one ← three ← two ← one",
    ),
    "a robot that commands itself": (
        "\nrobots:\n  one: {page: a.py, slots: {arm: one}}",
        3,
        "these robots would command each other in a circle: one ← one",
    ),
    "no page": ("\nrobots:\n  one: {host: host-1}", 3, "the page of one is missing"),
    "no address": ("\nproxies:\n  arm-1: {kind: arm}", 3, "arm-1 lacks connect or controller"),
    "two addresses": (
        """
controllers:
  c: {kind: arm, listen: tcp:0}
proxies:
  arm-1: {kind: arm, controller: c, connect: tcp:1}""",
        5,
        "say controller or connect of arm-1, not both",
    ),
    "a controller that is nowhere": (
        "\ncontrollers:\n  table: {kind: arm, listen: tcp:0}\nviews:\n  cell: {controller: tabel}",
        5,
        "no controller is called 'tabel' (did you mean 'table'?)",
    ),
    "a host that is nowhere": (
        "\nhosts: [host-1]\nrobots:\n  one: {page: a.py, host: hots-1}",
        4,
        "no host is called 'hots-1' (did you mean 'host-1'?)",
    ),
    "a name that nobody can have": ("\nhosts: [a/b]", 2, "a/b"),
    "a hash that is none": ("\nrobots:\n  one: {page: a.py, hash: xyz}", 3, "'xyz' is no hash"),
    "a key and an open link": (
        "\nviews:\n  cell: {connect: tcp:1, key: k, open: yes}",
        3,
        "take only one of --key and --open",
    ),
    "a speed that cannot be": (
        "\ncontrollers:\n  c: {kind: arm, listen: tcp:0, speedup: 400}",
        3,
        "'400' must be a number from 0.1 to 10",
    ),
    "no YAML": ("\nhosts: [one\n", 3, "this is no YAML"),
    "no mapping": ("\n- one", 2, "a realm is written as `section: …`"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_with_its_line(mistake: str) -> None:
    text, line, said = MISTAKES[mistake]
    with pytest.raises(BadRealmFile) as refused:
        read_file(dedent(text), "cell.yaml", KINDS)
    assert refused.value.number == line
    assert said in str(refused.value)
    assert str(refused.value).startswith(f"cell.yaml, line {line}: ")
    assert "\n" not in str(refused.value)
    assert code_of(refused.value) == USAGE


def file_with(folder: Path, text: str) -> Path:
    path = folder / "cell.yaml"
    path.write_text(dedent(text))
    return path


def refused_page(path: Path) -> BadRealmFile:
    with pytest.raises(BadRealmFile) as refused:
        pages_of(read_file(path.read_text(), str(path), KINDS))
    assert "\n" not in str(refused.value)
    return refused.value


def test_a_page_that_has_changed_since_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MOVE_TO.read_text())
    before = Bundle.read(tmp_path / "mine.py").hash
    path = file_with(tmp_path, f"robots:\n  mover:\n    page: mine.py\n    hash: {before[:16]}\n")
    assert pages_of(read_file(path.read_text(), str(path)))["mover"].hash == before
    (tmp_path / "mine.py").write_text(MOVE_TO.read_text() + "\n# another one\n")
    error = refused_page(path)
    assert error.number == 4
    assert "has changed: its hash is" in str(error)
    assert before[:12] in str(error)


REMEMBERS = """\
from robotree.vr import VirtualRobot, state
class Mine(VirtualRobot):
    speed: float = 0.1
    count: int = state(0)
    _hidden: int = 1
"""
MOVES = MOVE_TO.read_text()
WRONG_PAGES = [
    ("", "page: gone.py", 3, "/gone.py: No such file or directory"),
    (MOVES, "slots: {amr: a}", 4, "MoveTo has no slot 'amr' (did you mean 'arm'?); it has: arm"),
    (MOVES, "settings: {speeed: 1}", 4, "MoveTo has no setting 'speeed'; it has: none"),
    *(
        (REMEMBERS, f"settings: {{{name}: 1}}", 4, f"Mine has no setting '{name}'; it has: speed")
        for name in ("counted", "count", "_hidden")
    ),
    ("from robotree.vr import VirtualRobot\nclass Mine(VirtualRobot)\n", "", 3, "/mine.py:2: expected ':'"),
]
"""A page, what the file says of its robot beside that, the line of the mistake, and what is said."""


@pytest.mark.parametrize(("page", "entry", "line", "expected"), WRONG_PAGES)
def test_a_page_that_is_missing_or_lacks_what_the_file_says_is_named_with_its_line(
    page: str, entry: str, line: int, expected: str, tmp_path: Path
) -> None:
    entries = f"    page: mine.py\n    {entry}" if page else f"    {entry}"
    (tmp_path / "mine.py").write_text(page)
    error = refused_page(file_with(tmp_path, f"robots:\n  one:\n{entries}\n"))
    assert error.number == line
    assert str(error).endswith(expected)


def test_a_page_that_inherits_from_elsewhere_is_not_judged_by_its_text(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from robotree.vr.scripts.roles import RolePlayer\nfrom robotree.vr import VirtualRobot\n"
        "class Mine(RolePlayer, VirtualRobot):\n    pass\n"
    )
    path = file_with(tmp_path, "robots:\n  mine:\n    page: mine.py\n    slots: {any: one}\n")
    assert pages_of(read_file(path.read_text(), str(path)))["mine"]


def test_a_child_that_is_neither_in_the_file_nor_in_the_realm_is_named(tmp_path: Path) -> None:
    path = file_with(
        tmp_path,
        f"""\
        proxies:
          arm-1: {{kind: arm, connect: "tcp:127.0.0.1:5760"}}
        robots:
          mover:
            page: {MOVE_TO}
            slots:
              arm: amr-1
        """,
    )
    wanted = read_file(path.read_text(), str(path), KINDS)
    with pytest.raises(BadRealmFile) as refused:
        plan(wanted, Present(realm="cell"), pages_of(wanted))
    assert refused.value.number == 7
    assert "no robot in the file or in realm 'cell' is called 'amr-1' (did you mean 'arm-1'?)" in str(
        refused.value
    )


def test_a_setting_is_the_text_that_would_be_typed() -> None:
    wanted = read_file(
        """
robots:
  one:
    page: a.py
    settings: {speed: 20 cm/s, points: [[1, 2], [3, 4]], on: yes, named: {a: 1}}
""",
        "cell.yaml",
    )
    robot: RobotEntry = wanted.robots[0]
    assert {name: word.text for name, word in robot.settings.items()} == {
        "speed": "20 cm/s",
        "points": "[[1, 2], [3, 4]]",
        "on": "yes",
        "named": "{a: 1}",
    }


# -- what is written into a realm file is read from it as it was, whatever the texts are -----------

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
