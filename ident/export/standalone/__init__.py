"""The laws of the identified effects, with NumPy alone: their text is the first part of every written module.

Of the package it knows the friction laws of `ident.model.friction_laws` alone, whose text goes along. Arrays are
(T, n): T samples of one run, n joints, base to tip; SI units throughout. Torques are what the motor must deliver, seen
at the joint.
"""
