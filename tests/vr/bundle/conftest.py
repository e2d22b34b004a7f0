"""Hosts in a network in memory."""

from __future__ import annotations

from tests.vr.scripts.conftest import names_are_sure_at_once

__all__ = ["names_are_sure_at_once"]
