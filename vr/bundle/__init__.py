"""Source of virtual robots as it travels: read from a file, named by its hash, loaded on a host."""

from robotree.vr.bundle.bundle import LARGEST, Bundle

__all__ = ["LARGEST", "Bundle"]
