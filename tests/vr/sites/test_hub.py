"""A hub's own certificate and its configuration."""

from __future__ import annotations

import datetime as dt
import ssl
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from robotree.vr.sites.hub import certificate_in

NOW = dt.datetime(2026, 11, 1, tzinfo=dt.UTC)


def test_hubs_that_start_at_once_have_one_certificate_with_the_key_that_belongs_to_it(tmp_path: Path) -> None:
    for number in range(8):
        folder = tmp_path / f"{number}"
        with ThreadPoolExecutor(4) as pool:
            made = list(pool.map(lambda _, at=folder: certificate_in(at, NOW), range(4)))
        assert len({one.fingerprint for one in made}) == 1
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(made[0].certificate, made[0].key)  # refuses a key that does not belong to it
