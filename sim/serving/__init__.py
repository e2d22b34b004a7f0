"""A controller on the wire: connections, what they may bring, the way to the physics, and real time."""
