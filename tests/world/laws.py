"""What holds among the processes of a machine some seconds after the last fault."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from robotree.vr.network.door import RESERVE
from robotree.vr.network.link import Topic
from robotree.vr.network.mesh import Mesh
from tests.world.machine_sockets import SimulatedSocket
from tests.world.machine_world import MachineProcess

OWN = 3
"""Sockets of a process that are no connections: the one on which it listens, and two to wake its readers."""


def network_is_whole(processes: Iterable[MachineProcess]) -> Iterator[str]:
    """Yield what is wrong: everybody hears everybody, with one picture of who is there, and nothing leaks."""
    alive = [process for process in processes if process.alive and process.joined]
    meshes = {process.transport.mesh.place.tag: process.transport.mesh for process in alive}
    held = sorted({key for mesh in meshes.values() for key in mesh._known[Topic.HOLDS]})
    for process in alive:
        mesh = process.transport.mesh
        sees = (*_sees_otherwise(mesh, set(meshes), held), *_knows_otherwise(mesh, meshes))
        for wrong in (*sees, *_leaks(process, len(alive))):
            yield f"{process.name} {wrong}"


def _sees_otherwise(mesh: Mesh, tags: set[str], held: list[str]) -> Iterator[str]:
    others = tags - {mesh.place.tag}
    awake = {tag for tag, peer in mesh._peers.items() if peer.awake}
    if awake != others or set(mesh._peers) != others:
        yield f"knows {sorted(mesh._peers)}, and there are {sorted(others)}"
    if mesh.presence.keys("**") != held:
        yield f"sees {mesh.presence.keys('**')}, and there is {held}"
    if {entry.key for entry in mesh.held("**")} != set(held):
        yield "finds other keys in the record than there are"
    if late := mesh.presence.late("**"):
        yield f"finds others late: {late}"
    if waiting := [number for peer in mesh._peers.values() for number in peer.exchanges]:
        yield f"still waits for the replies to {len(waiting)} requests"


def _knows_otherwise(mesh: Mesh, meshes: dict[str, Mesh]) -> Iterator[str]:
    """Each knows what the others serve, are present under, and want to hear."""
    for tag, peer in mesh._peers.items():
        for topic, keys in peer.known.items():
            there = set(meshes[tag]._known[topic]) if tag in meshes else set()
            if keys != there:
                yield f"knows of {tag} under {topic.name} {sorted(keys)}, and there is {sorted(there)}"
    served = {key: tag for tag, peer in mesh._peers.items() for key in peer.known[Topic.SERVES]}
    if {key: peer.tag for key, peer in mesh._where.items()} != served:
        yield "would send requests elsewhere than they are served"


def _leaks(process: MachineProcess, members: int) -> Iterator[str]:
    ends = process.system.descriptors.values()
    sockets = sum(isinstance(end, SimulatedSocket) for end in ends)
    files = len(ends) - sockets - 1  # one is what it waits with
    if sockets != OWN + 2 * (members - 1) or not 1 + RESERVE <= files <= RESERVE + members:
        yield f"has {sockets} sockets and {files} files open among {members} processes"
