"""The compose file starts what robotree understands, and the processes of a site see each other."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotree.tui.line import manual

COMPOSE = Path(__file__).parents[2] / "deploy" / "compose.yaml"
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load(COMPOSE.read_text())["services"]
VERBS = {"hub": "hub", "gateway": "gateway", "lookup": "lookup", "host": "host", "robot": "proxy"}
BESIDE = sorted(set(VERBS) - {"hub", "gateway"})


def test_each_service_starts_a_line_that_robotree_understands() -> None:
    lines = {name: re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", SERVICES[name]["command"]) for name in SERVICES}
    assert {name: manual.shell().parse(shlex.split(line)).verb for name, line in lines.items()} == VERBS


@pytest.mark.parametrize("name", BESIDE)
def test_a_process_of_a_site_shares_sockets_and_process_numbers_with_its_gateway(name: str) -> None:
    service = SERVICES[name]
    assert service["network_mode"] == service["pid"] == "service:gateway"
    assert service["volumes"] == SERVICES["gateway"]["volumes"]


def test_a_site_opens_no_port_and_the_hub_has_no_key_of_the_realm() -> None:
    assert [name for name, service in SERVICES.items() if "ports" in service] == ["hub"]
    assert not set(SERVICES["hub"]["volumes"]) & set(SERVICES["gateway"]["volumes"])
