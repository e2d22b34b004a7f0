"""Asks the authority of a realm over a hub: for a certificate with a token, or for a new one. It waits."""

from __future__ import annotations

import time
from concurrent.futures import Future
from concurrent.futures import TimeoutError as OverTime
from contextlib import closing
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.base.errors import InvitationRefused, NetworkUnusable
from robotree.vr.base.requests import Raised, decode_reply
from robotree.vr.sites.certificates import Certificate
from robotree.vr.sites.invitations import Invitation, request_to_join
from robotree.vr.sites.keys import RealmKeys, expect_room, join
from robotree.vr.sites.networks import GRANTED, Pipe, Topics
from robotree.vr.sites.zenoh_pipe import ZenohPipe

WITHIN = 10.0
"""[s] to wait for the hub, and then for the authority."""

AGAIN = 0.5
"""[s] after which it asks again: the answer comes once only for each key, so nothing is done twice."""


def ask_authority(folder: Path, invitation: Invitation, *, now: float) -> RealmKeys:
    """Make a key on this machine, have it signed, and keep both.

    Args:
        folder: for the keys of the realm.
        invitation: from a token.
        now: [s since 1970].

    Raises:
        KeysExist: there are keys of the realm already.
        InvitationRefused: the authority refuses it, or does not answer.
        NetworkUnusable: no hub can be reached.
    """
    expect_room(folder, invitation.realm)
    key = Ed25519PrivateKey.generate()
    with closing(ZenohPipe(invitation.hubs)) as pipe:
        packed = request_to_join(invitation, key)
        certificate = _ask(pipe, Topics(invitation.realm), "join", invitation.number, packed)
    return join(folder, invitation, key, certificate, now=now)


def ask_to_renew(keys: RealmKeys, *, now: float) -> Certificate:
    """Ask for a new certificate of this member, for the same key.

    Raises:
        InvitationRefused: the authority refuses it, or does not answer.
        NotAMember: what came is no certificate of this member.
        NetworkUnusable: no hub can be reached.
    """
    with closing(ZenohPipe(keys.hubs)) as pipe:
        certificate = _ask(pipe, Topics(keys.realm), "renew", keys.name, keys.own.certificate)
    return keys.replace_certificate(certificate, now)


def _ask(pipe: Pipe, topics: Topics, about: str, number: str, packed: bytes) -> bytes:
    answered = Future[bytes]()

    def take(_topic: str, body: bytes) -> None:
        if not answered.done():
            answered.set_result(body)

    pipe.subscribe(topics.answer(about, number), take)
    latest = time.monotonic() + WITHIN
    while not pipe.state().up:
        if time.monotonic() > latest:
            raise NetworkUnusable(where=pipe.state().where, reason=pipe.state().reason)
        time.sleep(0.05)
    while time.monotonic() < latest:
        pipe.publish(topics.authority(about, number), packed)
        try:
            body = answered.result(AGAIN)
        except OverTime:
            continue
        if body[:1] == GRANTED:
            return body[1:]
        reply = decode_reply(body, key="the authority")
        if isinstance(reply, Raised):
            raise reply.revive()
        break
    reason = "the authority did not answer; `robotree gateway` must run where the realm was made"
    raise InvitationRefused(reason=reason)
