"""Known effects planted onto recordings of real arms, which have all that a simulation lacks.

None of the catalogue's columns is used: rigid bodies go through Pinocchio, friction through
bristles, soft and loose gears through an equation of motion of their own.
"""
