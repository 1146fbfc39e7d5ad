"""The columns of the state of a body in the plane, a row (x, y, vx, vy, yaw, spin)."""

X, Y, VX, VY, YAW, SPIN = range(6)
"""Columns of a state: position (world units), velocity (world units/s), yaw (radians) and spin (radians/s)."""
POSITION, VELOCITY = slice(X, VX), slice(VX, YAW)
"""Columns of the position and of the velocity."""
STATE_SIZE = SPIN + 1
"""Number of columns of a state."""
