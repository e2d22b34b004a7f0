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


def test_a_link_is_refused() -> None:
    link = zipfile.ZipInfo("files/link.py")
    link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    assert refused(changed(lambda parts: parts.append((link, b"/etc/passwd")))) == "files/link.py is a link"


def test_a_device_is_refused() -> None:
    device = zipfile.ZipInfo("files/null")
    device.create_system, device.external_attr = 3, (stat.S_IFCHR | 0o777) << 16
    assert refused(changed(lambda parts: parts.append((device, b"")))) == "files/null is no plain file"


def test_a_name_that_stands_twice_is_refused() -> None:
    again = zipfile.ZipInfo("files/guide.py")
    assert refused(changed(lambda parts: parts.append((again, b"x = 1\n")))) == "a name stands twice in it"


def test_a_bomb_is_refused_from_its_list_alone() -> None:
    bomb = zipfile.ZipInfo("files/bomb")
    data = changed(lambda parts: parts.append((bomb, bytes(LARGEST))))
    assert len(data) < 100_000
    assert "when it is unpacked" in refused(data)


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


@pytest.mark.parametrize("part", ["manifest.json", "manifest.json.sig"])
def test_a_bundle_without_its_manifest_or_signature_is_refused(part: str) -> None:
    def without(parts: list[tuple[zipfile.ZipInfo, bytes]]) -> None:
        parts[:] = [one for one in parts if one[0].filename != part]

    assert refused(changed(without)) == f"it has no {part}"


def test_a_file_that_was_changed_is_refused() -> None:
    def change(parts: list[tuple[zipfile.ZipInfo, bytes]]) -> None:
        parts[:] = [(one, b"FORCE = 9\n" if "grip" in one.filename else data) for one, data in parts]

    assert refused(changed(change)) == "lib/grip.py was changed after it was signed"


def test_a_file_that_was_added_is_refused() -> None:
    extra = zipfile.ZipInfo("files/extra.py")
    said = refused(changed(lambda parts: parts.append((extra, b""))))
    assert said == "extra.py was added after it was signed"


def test_a_file_that_was_taken_away_is_refused() -> None:
    def without(parts: list[tuple[zipfile.ZipInfo, bytes]]) -> None:
        parts[:] = [one for one in parts if "grip" not in one[0].filename]

    assert refused(changed(without)) == "lib/grip.py is missing"


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
    ],
)
def test_a_manifest_that_breaks_a_rule_is_refused(before: bytes, after: bytes, reason: str) -> None:
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
