"""Modules and data beside a page: imported in every usual way, never stale, never mixed up."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

import pytest

from robotree.vr.base.errors import BrokenSource
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import close_all

PYTHON = f"{sys.version_info[0]}.{sys.version_info[1]}"
PAGE = '''
import json
from pathlib import Path

import helper
import lib.grip
from robotree.vr import VirtualRobot, command
from . import helper as same
from .lib.grip import WIDTH, close

MAP = json.loads(Path(__file__).with_name("map.json").read_text())


class Page(VirtualRobot):
    """Uses all that lies beside it."""

    def told(self):
        """Return what all of it says."""
        from lib import late

        return [helper.NAME, same is helper, lib.grip.WIDTH == WIDTH, close(), MAP["door"], late.SAID]
'''


GRIP = """
from helper import NAME
from . import late

WIDTH = 0.04

def close():
    return NAME + late.SAID
"""


def write(folder: Path, **changes: str) -> Path:
    files = {
        "page.py": PAGE,
        "helper.py": "NAME = 'first'\n",
        "lib/grip.py": GRIP,
        "lib/late.py": "SAID = '!'\n",
        "map.json": '{"door": 1}',
        "unused.py": "raise SystemExit\n",
        **{name.replace("__", "/").replace("_py", ".py"): text for name, text in changes.items()},
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "page.py"


def told(bundle: Bundle) -> list[object]:
    robot = bundle.create("robot")
    found: list[object] = robot.told()  # type: ignore[attr-defined]
    return found


def test_a_page_imports_what_lies_beside_it_in_every_usual_way(tmp_path: Path) -> None:
    bundle = Bundle.read(write(tmp_path))
    assert set(bundle.files) == {"helper.py", "lib/grip.py", "lib/late.py", "map.json"}
    assert told(bundle) == ["first", True, True, "first!", 1, "!"]
    assert "helper" not in sys.modules
    assert "lib" not in sys.modules


def test_it_works_on_another_machine_and_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    write(tmp_path / "mine")
    monkeypatch.chdir(tmp_path / "mine")
    bundle = Bundle.read("page.py")
    monkeypatch.chdir("/")
    for file in (tmp_path / "mine").rglob("*.*"):
        file.unlink()
    assert told(bundle)[0] == "first"


def test_an_edited_helper_is_never_stale(tmp_path: Path) -> None:
    page = write(tmp_path)
    first = Bundle.read(page)
    old = first.create("old")
    (tmp_path / "helper.py").write_text("NAME = 'other'\n")
    (tmp_path / "map.json").write_text('{"door": 2}')
    second = Bundle.read(page)
    assert first.hash != second.hash
    assert told(second) == ["other", True, True, "other!", 2, "!"]
    assert second.again(old).told()[0] == "other"  # type: ignore[attr-defined]
    assert old.told() == ["first", True, True, "first!", 1, "!"]  # type: ignore[attr-defined]


def test_two_folders_with_equal_names_do_not_mix(tmp_path: Path) -> None:
    bundles = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        bundles.append(Bundle.read(write(tmp_path / name, helper_py=f"NAME = {name!r}\n")))
    robots = [bundle.create("robot") for bundle in bundles]
    assert [robot.told()[3] for robot in robots] == ["one!", "two!"]  # type: ignore[attr-defined]


def test_robots_that_go_take_their_modules_and_files_along(tmp_path: Path) -> None:
    robot = Bundle.read(write(tmp_path)).create("robot")
    robot.told()  # type: ignore[attr-defined]
    name = type(robot).__module__
    folder = Path(str(sys.modules[name].__file__)).parent
    assert folder.is_dir()
    assert folder != tmp_path
    del robot
    gc.collect()
    assert not folder.exists()
    assert not [module for module in sys.modules if module.startswith(name)]


def test_a_process_that_ends_leaves_no_files_behind(tmp_path: Path) -> None:
    module = sys.modules[Bundle.read(write(tmp_path)).load().__module__]  # no robot is made of it
    folder = Path(str(module.__file__)).parent
    assert folder.is_dir()
    close_all()
    assert not folder.exists()


@pytest.mark.parametrize(
    ("helper", "reason"),
    [
        ("NAME = 'a'\n1 / 0\n", "helper.py, line 2: ZeroDivisionError: division by zero"),
        ("NAME = 'a'\ndef broken(:\n", f"helper.py, line 2: invalid syntax (this host runs Python {PYTHON})"),
        (
            "from nowhere_at_all import x\n",
            "helper.py, line 1: ModuleNotFoundError: No module named 'nowhere_at_all'",
        ),
    ],
)
def test_a_mistake_in_a_helper_names_its_file_and_line(tmp_path: Path, helper: str, reason: str) -> None:
    with pytest.raises(BrokenSource) as refused:
        Bundle.read(write(tmp_path, helper_py=helper)).load()
    assert str(refused.value) == f"{tmp_path}/page.py cannot be loaded: {reason}"


def test_what_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BrokenSource, match="line 1: an import leads above the folder of the page"):
        Bundle.read(write(tmp_path, page_py="from ..above import x\n"))
    evil = Bundle("import helper\n", "page.py", "", {"../helper.py": b"x = 1", "helper.py": b""})
    with pytest.raises(BrokenSource, match=r"the file '\.\./helper\.py' does not lie beside it"):
        evil.load()
    (tmp_path / "big.json").write_bytes(bytes(4_000_001))
    with pytest.raises(BrokenSource, match=r"big\.json, which belongs to it, cannot be read"):
        Bundle.read(write(tmp_path, page_py="D = __file__ + 'x'\nE = 'big.json'\n"))


def test_errors_call_modules_and_data_by_the_names_that_an_author_knows(tmp_path: Path) -> None:
    page = write(tmp_path, helper_py="import lib.grip\nNAME = 'first'\n")
    with pytest.raises(BrokenSource) as refused:
        Bundle.read(page).create("robot")
    told = str(refused.value)
    assert "grip.py, line 2: ImportError: cannot import name 'NAME' from partially initialized" in told
    assert "module 'helper' (most likely due to a circular import) (helper.py)" in told
    write(tmp_path).with_name("map.json").unlink()
    with pytest.raises(BrokenSource, match=r"FileNotFoundError: .*: 'map\.json'$"):
        Bundle.read(page).create("robot")
