"""Wireshark's terminal program listens in while another tool works with the arm."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.command_line import ROBOTREE

pytestmark = pytest.mark.interop
TSHARK = shutil.which("tshark") or ""


@pytest.mark.skipif(not TSHARK, reason="tshark is not installed")
def test_it_reads_the_arms_words_off_the_loopback_device(
    start: Callable[..., Any], arm: str, mavproxy: Callable[[str], Any], tmp_path: Path
) -> None:
    port = arm.rpartition(":")[2]
    lua = tmp_path / "robotree.lua"
    subprocess.run([*ROBOTREE, "wire", "dissector", lua, "--port", port], check=True)
    fields = ("-e", "mavlink_proto.sysid", "-e", "mavlink_proto.ROBOTREE_GRIPPER_width")
    listener = start(
        *(TSHARK, "-i", "lo", "-f", f"tcp port {port}", "-X", f"lua_script:{lua}", "-l"),
        *("-Y", "mavlink_proto.ROBOTREE_GRIPPER_width", "-T", "fields", *fields),
    )
    try:
        listener.reads("Capturing on")
    except AssertionError:
        pytest.skip(f"nobody may listen to the loopback device here: {listener.printed}")
    mavproxy(arm).reads("Detected vehicle 1:1")
    assert float(listener.reads(r"(?m)^1(?:,1)*\t(0\.\d+)")[1]) == pytest.approx(0.08, abs=0.08)
