"""Source of virtual robots as it travels: read from a file, named by its hash, loaded on a host."""

from robotree.vr.bundle.bundle import Bundle

__all__ = ["Bundle"]
