"""A store that agents share and that outlives them. Its first, small use: counting calls."""

from robotree.vr.space.contract import Space

__all__ = ["Space"]
