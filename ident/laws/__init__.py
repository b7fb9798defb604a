"""What is known of effects, written once: their laws in NumPy (all else stands in
`ident/effects/effects.toml`).

A law of one joint's speed, load and angle is one function of the states and its shape, named as its
effect: the diagnosis, the fit, the planners' slopes and symbols and the written module all evaluate
it. The text of `motion`, `friction_laws`, `elastic` and `acting` is the first part of every written
module: they know NumPy and each other alone. Arrays are (T, n): T samples of one run, n joints,
base to tip; SI units. Torques are the motor's, seen at the joint.
"""
