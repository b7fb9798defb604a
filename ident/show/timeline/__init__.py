"""The Rerun timeline: measured torque against every rung, what is left, and the moving arm."""
