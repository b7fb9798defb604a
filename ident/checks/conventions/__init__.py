"""How a log and a URDF may be read otherwise than they say, searched together and once, before any check condemns."""
