"""Roles: one robot as a butler, a maid, a man, a woman or a child, without a change of any script."""

from robotree.vr.scripts.roles.player import Limit, Manner, RolePlayer, in_role
from robotree.vr.scripts.roles.profile import Profile, read_profile, resolve

__all__ = ["Limit", "Manner", "Profile", "RolePlayer", "in_role", "read_profile", "resolve"]
