"""The laws of the named effects, with NumPy alone: their text is the first part of every written module.

Nothing here knows the package that it comes from. Arrays are (T, n): T samples of one run, n joints, base to tip; SI
units throughout. Torques are what the motor must deliver, seen at the joint.
"""
