"""A store that agents share and that outlives them. Its first, small use: counting calls."""
