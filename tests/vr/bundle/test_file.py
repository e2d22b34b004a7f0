"""A bundle is one plain file, and a file that could harm its reader is refused, by the name of its fault."""

from __future__ import annotations

import shutil
import stat
import subprocess
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.vr.base.errors import BadBundle, NoSuchFile
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.file import LARGEST, BundleFile
from tests.vr.bundle.signed import PAGE, archive_of, key_of, of, packed, parts_of, signer, trusting

HELPER = {"lib/grip.py": b"FORCE = 3\n", "map.json": b"{}"}


def refused(data: bytes) -> str:
    with pytest.raises(BadBundle) as error:
        BundleFile.unpack(data, "guide.bundle")
    said = str(error.value)
    assert said.startswith("the bundle guide.bundle is refused: ")
    return said.removeprefix("the bundle guide.bundle is refused: ")


def changed(change: Callable[[list[tuple[zipfile.ZipInfo, bytes]]], object]) -> bytes:
    """Return a bundle whose parts somebody has changed."""
    parts = parts_of(packed(of("anna", files=HELPER)))
    change(parts)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile warns of a name that stands twice
        return archive_of(parts)


def test_a_bundle_that_was_mailed_is_the_page_that_was_signed(tmp_path: Path) -> None:
    sent = of("anna", files=HELPER)
    file = tmp_path / "guide.bundle"
    file.write_bytes(packed(sent))
    came = Bundle.read(file)
    assert (came.source, came.files, came.signed, came.hash) == (PAGE, HELPER, sent.signed, sent.hash)
    assert came.origin == str(file)
    assert Path(came.path).name == "guide.py"
    assert packed(came) == packed(sent), "the same bundle has the same bytes"
    assert came.load().__name__ == "Guide"


def test_openssh_checks_a_bundle_without_robotree(tmp_path: Path) -> None:
    if not shutil.which("ssh-keygen"):
        pytest.skip("ssh-keygen is not installed")
    data = packed(of("anna"))
    contents = {info.filename: content for info, content in parts_of(data)}
    (tmp_path / "sig").write_bytes(contents["manifest.json.sig"])
    trust = trusting(tmp_path, signer("anna"))
    line = ["ssh-keygen", "-Y", "verify", "-f", trust, "-I", "anna", "-n", "robotree-bundle"]

    def verified(text: bytes) -> bool:
        done = subprocess.run(
            [*line, "-s", tmp_path / "sig"], input=text, capture_output=True, check=False, timeout=60
        )
        return done.returncode == 0

    assert verified(contents["manifest.json"])
    assert not verified(contents["manifest.json"] + b" ")


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("files/../guide.py", "'../guide.py' leads out of it"),
        ("files//etc/passwd", "'/etc/passwd' leads out of it"),
        ("files/~/guide.py", "'~/guide.py' leads out of it"),
        ("files/lib/./a.py", "'lib/./a.py' is not in its plain form"),
        ("files/lib//a.py", "'lib//a.py' is not in its plain form"),
        ("files/a\\b.py", "not in its plain form"),
        ("files/a\x01b.py", "not in its plain form"),
        ("files/con:a.py", "not in its plain form"),
        ("files/a.py.", "not in its plain form"),
        ("files/" + "a/" * 20 + "b.py", "is too long"),
        ("files/" + "a" * 300, "is too long"),
        ("guide.py", "'guide.py' belongs to no bundle"),
        ("files/lib/", "files/lib/ is no plain file"),
    ],
)
def test_a_path_that_leads_elsewhere_is_refused(path: str, reason: str) -> None:
    assert reason in refused(changed(lambda parts: parts.append((zipfile.ZipInfo(path), b"x = 1\n"))))


def info_of(name: str, kind: int = 0) -> zipfile.ZipInfo:
    """Return the entry of a part, of a kind of file."""
    info = zipfile.ZipInfo(name)
    info.create_system, info.external_attr = 3, (kind | 0o777) << 16 if kind else 0
    return info


@pytest.mark.parametrize(
    ("part", "content", "reason"),
    [
        (info_of("files/link.py", stat.S_IFLNK), b"/etc/passwd", "files/link.py is a link"),
        (info_of("files/null", stat.S_IFCHR), b"", "files/null is no plain file"),
        (info_of("files/guide.py"), b"x = 1\n", "a name stands twice in it"),
        (info_of("files/extra.py"), b"", "extra.py was added after it was signed"),
        (info_of("files/bomb"), bytes(LARGEST), "it is larger than 5 MB when it is unpacked"),
    ],
    ids=["a link", "a device", "a name twice", "a file more", "a bomb"],
)
def test_a_part_that_does_not_belong_there_is_refused(
    part: zipfile.ZipInfo, content: bytes, reason: str
) -> None:
    data = changed(lambda parts: parts.append((part, content)))
    assert len(data) < 100_000
    assert refused(data) == reason


def test_a_bomb_that_lies_about_its_size_is_refused() -> None:
    bomb = zipfile.ZipInfo("files/bomb")
    data = changed(lambda parts: parts.append((bomb, bytes(3_000_000))))
    lies = data.replace((3_000_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    assert lies != data
    assert "files/bomb" in refused(lies)


def test_too_many_parts_are_refused() -> None:
    many = [(zipfile.ZipInfo(f"files/{number}"), b"") for number in range(300)]
    assert "parts, and 200 files are allowed" in refused(changed(lambda parts: parts.extend(many)))


def test_a_file_that_is_too_large_is_not_even_read(tmp_path: Path) -> None:
    file = tmp_path / "guide.bundle"
    with file.open("wb") as stream:
        stream.truncate(LARGEST + 1)
    with pytest.raises(NoSuchFile, match="it is larger than"):
        Bundle.read(file)


@pytest.mark.parametrize("where", ["before", "behind", "comment"])
def test_what_is_hidden_beside_the_parts_is_refused(where: str) -> None:
    data = packed(of("anna"))
    if where == "before":
        data = b"#!/bin/sh\n" + data
    elif where == "behind":
        data = data + b"more"
    else:
        data = data[:-2] + (4).to_bytes(2, "little") + b"more"
    assert refused(data) in {
        "something is hidden before, between or behind its parts",
        "it is no bundle",
    }


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ("manifest.json", "it has no manifest.json"),
        ("manifest.json.sig", "it has no manifest.json.sig"),
        ("files/lib/grip.py", "lib/grip.py is missing"),
    ],
)
def test_a_bundle_that_lacks_a_part_is_refused(part: str, reason: str) -> None:
    def without(parts: list[tuple[zipfile.ZipInfo, bytes]]) -> None:
        parts[:] = [one for one in parts if one[0].filename != part]

    assert refused(changed(without)) == reason


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        (b'"format":1', b'"format":2', "format 2; this version of robotree reads format 1"),
        (b'"name":"guide"', b'"name":"a b"', "its name, or that of its class, cannot be one"),
        (b'"page":"guide.py"', b'"page":"other.py"', "'other.py', which is not among its files"),
        (b'{"format"', b'{ "format"', "not in the one form that is signed"),
        (b'{"format"', b'{"more":1,"format"', "its manifest cannot be read"),
        (b'"Arm.move"', b'"Arm move"', "'Arm move' is no permission"),
        (b'"files":{"guide.py"', b'"files":{"../guide.py"', "leads out of it"),
        (b'"lib/grip.py"', b'"mAp.json"', "two of its files differ only in capital letters"),
        (b"FORCE = 3", b"FORCE = 9", "lib/grip.py was changed after it was signed"),
    ],
)
def test_what_was_changed_after_it_was_signed_is_refused(before: bytes, after: bytes, reason: str) -> None:
    def change(parts: list[tuple[zipfile.ZipInfo, bytes]]) -> None:
        parts[:] = [(one, data.replace(before, after)) for one, data in parts]
        assert any(after in data for _, data in parts)

    assert reason in refused(changed(change))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_whatever_happens_to_the_bytes_of_a_bundle_it_is_refused_or_the_same(data: st.DataObject) -> None:
    good = packed(of("anna", files=HELPER))
    bytes_of = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        bytes_of[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    bytes_of = bytes_of[: data.draw(st.one_of(st.just(len(good)), st.integers(0, len(good))))]
    try:
        found = BundleFile.unpack(bytes(bytes_of), "guide.bundle")
    except BadBundle:
        return
    assert found.files == {"guide.py": PAGE.encode(), **HELPER}
    assert found.signed.manifest == BundleFile.unpack(good, "").signed.manifest
    assert key_of("anna").public in found.signed.manifest.decode()


def test_what_is_no_archive_is_no_bundle() -> None:
    for data in (b"", b"PK", b"hello" * 100):
        assert refused(data) == "it is no bundle"
