"""How a log and a URDF may be read otherwise than they say.

Searched together and once, before any check condemns.
"""
