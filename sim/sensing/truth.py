"""What one follower's sensors see of a mission, before errors: the seam between motion and measurement."""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.records import own_arrays, require_shapes


@dataclass(frozen=True, kw_only=True)
class MissionTruth:
    """What one follower's sensors see of a mission, without errors: n filter steps (k = 1 … n) and m messages.

    Raises ValueError if shapes disagree or `message_step` is not increasing within 1 … n.
    """

    dt: float
    """Filter step Δt [s]."""
    start: Floats
    """State of the hydrophone at step 0: x, y [m] and velocity through the water [m/s], shape (4,)."""
    speed: Floats
    """Speed of the follower through the water, along its hull, shape (n,), [m/s]."""
    heading: Floats
    """Heading of the follower, shape (n,), [rad]."""
    depth: Floats
    """Depth of the follower's depth sensor, shape (n,), [m]."""
    hydrophone: Floats
    """Horizontal position that is estimated, shape (n, 2), [m]."""
    leader_position: Floats
    """Horizontal position of the leader's body origin, shape (n, 2), [m]."""
    leader_heading: Floats
    """Heading of the leader, shape (n,), [rad]."""
    message_step: Ints
    """Step k at which a message is available, shape (m,), increasing."""
    emission_step: Ints
    """Step at which the leader sent it, shape (m,): address of the leader's noise, which all followers share."""
    timestamp: Floats
    """Emission on the leader's clock, shape (m,), [s]."""
    sent_position: Floats
    """Leader's body origin at emission: east, north and depth, shape (m, 3), [m]."""
    sent_heading: Floats
    """Leader's heading at emission, shape (m,), [rad]."""
    sent_speed: Floats
    """Leader's speed at emission, shape (m,), [m/s]."""
    sent_attitude: Floats
    """Leader's pitch and roll at emission as measured, but for random errors, shape (m, 2), [rad]; NaN if they are not
    broadcast."""
    slant_range: Floats
    """Slant range to the rear, front and middle transmitter, shape (m, 3), [m]; NaN where nothing is received."""
    echo_range: Floats | None = None
    """Slant range by way of the surface and of the bottom, shape (2, m, 3), [m]; None if echoes are not modelled."""

    def __post_init__(self) -> None:
        n, m = self.speed.size, self.message_step.size
        expected = {"start": (4,), "hydrophone": (n, 2), "leader_position": (n, 2), "slant_range": (m, 3)}
        expected |= dict.fromkeys(("speed", "heading", "depth", "leader_heading"), (n,))
        expected |= dict.fromkeys(("message_step", "emission_step", "timestamp", "sent_heading", "sent_speed"), (m,))
        expected |= {"sent_position": (m, 3), "sent_attitude": (m, 2)}
        if self.echo_range is not None:
            expected["echo_range"] = (2, m, 3)
        require_shapes(self, expected)
        own_arrays(self)
        if m and (self.message_step[0] < 1 or self.message_step[-1] > n or np.any(np.diff(self.message_step) < 1)):
            raise ValueError(f"MissionTruth.message_step must increase within 1 … {n}")
