"""The companion: a wheeled base, a waist, two arms and a head, in a flat with visitors.

Its controller has four MAVLink components.

companion.xml     the robot; flat.py puts it into the flat with table, cups and visitors
figure.py         its kinematics, dynamics and geometry, by Pinocchio
guard.py          what may not be done: self-collision, tip-over, too near to a person
limb.py base.py head.py   the devices: two arms, the base with the waist, the head
body.py           the whole body: one control law for all, in every step of the world
visitors.py       people who walk about, hold out a hand, speak and listen
world.py          all of it, compiled and put in its first place; what each component reports
"""
