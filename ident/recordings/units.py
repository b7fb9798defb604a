"""Units of time and angle that files may be in, in s and rad: session.toml names them."""

import math

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE_UNITS = {"rad": 1.0, "deg": math.radians(1.0)}
