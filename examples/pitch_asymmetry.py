"""One message from a pitched leader: the range asymmetry, and how far it moves the position fix.

Pitch φ lowers one transmitter and raises the other. A follower Δz deeper that takes the leader for
level converts the slant ranges to wrong horizontal ranges; the fix keeps its distance and moves by
Δz sin φ / |sin B| (docs/asymmetry.md).
"""

import numpy as np

BASELINE, DEPTH_DIFFERENCE, DISTANCE = 2.0, 10.0, 60.0  # L, Δz, horizontal distance [m]


def fix_error(pitch: float, bearing: float) -> tuple[float, float]:
    """Range asymmetry that pitch adds [m], and distance of the fix from the follower [m].

    The leader heads along x at the origin; angles in radians, the bearing B from the bow.
    """
    follower = np.array([DISTANCE * np.cos(bearing), DISTANCE * np.sin(bearing), -DEPTH_DIFFERENCE])
    along = BASELINE / 2 * np.array([np.cos(pitch), 0.0, np.sin(pitch)])
    # rear, front
    slant = np.array([np.linalg.norm(follower + along), np.linalg.norm(follower - along)])
    level = BASELINE / 2 * np.array([1.0, 0.0, 0.0])
    expected = np.array([np.linalg.norm(follower + level), np.linalg.norm(follower - level)])
    # two circles about the transmitters of a level leader
    rear, front = np.sqrt(slant**2 - DEPTH_DIFFERENCE**2)
    x = (rear**2 - front**2) / (2 * BASELINE)
    y = np.sqrt(max(rear**2 - (x + BASELINE / 2) ** 2, 0.0))
    asymmetry = (slant - expected) @ np.array([1.0, -1.0])
    return float(asymmetry), float(np.hypot(x - follower[0], y - abs(follower[1])))


print("bearing B   pitch φ   r_rear − r_front changes by   fix moves by   Δz sin φ / |sin B|")
for degrees in (90, 60, 30):
    for pitch_deg in (1, 5, 10):
        bearing, pitch = np.radians([degrees, pitch_deg])
        asymmetry, moved = fix_error(pitch, bearing)
        formula = DEPTH_DIFFERENCE * np.sin(pitch) / np.sin(bearing)
        print(
            f"{degrees:6}°   {pitch_deg:6}°   {asymmetry:21.3f} m   {moved:14.2f} m   "
            f"{formula:14.2f} m"
        )
