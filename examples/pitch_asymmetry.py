"""One message from a pitched leader: the range asymmetry, and how far it moves LAISN's fix.

Pitch φ lowers one transmitter and raises the other. A follower Δz deeper that takes the leader for
level converts the slant ranges to wrong horizontal ranges; the fix keeps its distance and moves by
Δz sin φ / |sin B| (docs/asymmetry.md). Right astern that has none: with the bow up the circles
do not meet, and the fix is on the leader's axis; with the bow down they meet aside of it.
"""

import math
from pathlib import Path

import numpy as np

from experiments.pitch import PitchGeometry, map_of_errors
from laisn.estimates import FIX_WORDS, FixKind
from laisn.fix import Fix, to_circles
from laisn.geometry import Point
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.settings import NavigationSettings, Tuning
from reports.vector import write_panel

BASELINE, DEPTH_DIFFERENCE, DISTANCE = 2.0, 10.0, 60.0  # L, Δz, horizontal distance [m]
SETTINGS = NavigationSettings(baseline=BASELINE)


def slant_ranges(pitch: float, follower: np.ndarray) -> Ranges:
    """Of a follower east, north and up [m] from a leader that heads east; pitch: bow up [rad]."""
    along = BASELINE / 2 * np.array([math.cos(pitch), 0.0, math.sin(pitch)])
    rear, front = (float(np.linalg.norm(follower + side * along)) for side in (1, -1))
    return Ranges(rear=rear, front=front, middle=math.nan)


def fix_of(ranges: Ranges, predicted: Point) -> Fix:
    """LAISN-2's fix, which takes the leader for level."""
    message = LeaderMessage(0.0, east=0.0, north=0.0, heading=math.pi / 2, speed=1.0, depth=0.0)
    circles = to_circles(Reception(message, ranges), DEPTH_DIFFERENCE, SETTINGS)
    rear_and_front = circles.pairs()[0]
    return circles.fix(rear_and_front, predicted, Tuning.of(SETTINGS))


print("bearing B   pitch φ   r_rear − r_front changes by   fix moves by   Δz sin φ / |sin B|")
for degrees, pitches in ((90, (1, 5, 10)), (60, (1, 5, 10)), (30, (1, 5, 10)), (180, (5, -5))):
    bearing = math.radians(degrees)
    east, north = DISTANCE * math.cos(bearing), -DISTANCE * math.sin(bearing)  # to starboard
    follower = np.array([east, north, -DEPTH_DIFFERENCE])
    level = slant_ranges(0.0, follower)
    for pitch_deg in pitches:
        pitch = math.radians(pitch_deg)
        ranges = slant_ranges(pitch, follower)
        fix = fix_of(ranges, Point(east, north))
        asymmetry = (ranges.rear - ranges.front) - (level.rear - level.front)
        moved = math.hypot(fix.east - east, fix.north - north)
        formula = "–"
        if degrees < 180:
            formula = f"{DEPTH_DIFFERENCE * math.sin(pitch) / math.sin(bearing):.2f} m"
        print(
            f"{degrees:6}°   {pitch_deg:6}°   {asymmetry:21.3f} m   {moved:14.2f} m   "
            f"{formula:>18}   {FIX_WORDS[FixKind(int(fix.kind))]}"
        )
# the error over bearing and pitch; the width is in inches
shown = PitchGeometry(baseline=BASELINE, pitch_deg=5.0, distance=DISTANCE, below=DEPTH_DIFFERENCE)
write_panel(map_of_errors(shown), Path("pitch.png"), width=6.0)
