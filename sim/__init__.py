"""sim: simulated robots.

A simulated *controller*, which looks on the wire like that of a real robot: MuJoCo moves the world, Pinocchio
gives the arm's kinematics and dynamics, ruckig the jerk-limited paths, and a natural-admittance law at 1 kHz
keeps every contact force bounded whatever the network does. `sim` knows the wire (`robotree.protocol`) and
nothing else of robotree; to a proxy it is a robot.

    kinds       what can be simulated, one line for each robot
    arm/ rover/ one folder for each robot: model, control law, verbs, world, telemetry
    motion/     reference motion: paths, pursuits, and the follower that waits when blocked
    physics/    MuJoCo, the cell that steps it, scenery, pictures
    firmware/   the controller's program: pure, one file for each service
    controller/ one cell with its firmware, the inbox of frames, and what is kept over a restart
    serving/    controllers on the wire and in real time; `serving.server.serve(...)` runs one
    testing     an operator that commands a controller in virtual time

Importing this package loads no physics; only the modules that need an engine import it.
"""
