"""sim: the robots that nobody has to buy.

A simulated *controller*, as the far end of the wire would be with a real robot: MuJoCo moves the world,
Pinocchio gives the arm's kinematics and dynamics, ruckig the jerk-limited paths, and a natural-admittance law
at 1 kHz keeps every contact force bounded whatever the network does. `sim` knows the wire
(`robotree.protocol`) and nothing else of robotree; to a proxy it is a robot.

    kinds       what can be simulated, one line a robot: arm/, rover/
    arm/ rover/ a folder a robot: model, world, control law, verbs, telemetry
    motion/     where something should be next: paths, pursuits, the leash
    physics/    the one door to MuJoCo, the cell that steps it, scenery, pictures
    firmware/   the controller's program: pure, one service a file
    serving/    the controller on the wire and in real time; `serving.server.serve(...)` runs one
    testing     somebody who commands a controller in virtual time

Importing this package loads no physics; only the modules that need an engine import it.
"""
