"""The world: MuJoCo behind one door, the cell that steps it, scenery, and pictures of it."""
