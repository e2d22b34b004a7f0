"""sim: the robots that nobody has to buy.

A simulated *controller*, as the far end of the wire would be with a real robot: MuJoCo moves the world,
Pinocchio gives the arm's kinematics and dynamics, ruckig the jerk-limited paths, and a natural-admittance law
at 1 kHz keeps every contact force bounded whatever the network does. `sim` knows the wire
(`robotree.protocol`) and nothing else of robotree; to a proxy it is a robot.

    kinds.KINDS          what can be simulated: arm, rover
    server.serve(...)    one controller listening on a link until it is cancelled
    cell.Cell            one world, stepped by hand (virtual time) or in real time by `realtime.RealTime`

Importing this package loads no physics; only the modules that need an engine import it.
"""
