"""Thrust allocation: a force and a moment shared out between two thrusters of one direction, bow and stern.

The moment comes first. Steering keeps the vehicle on its way and upright; a force that is missing only lets it drift.
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021 (constrained allocation);
with two thrusters the constrained problem has this closed form.
"""

from laisn.arrays import Floats
from laisn.compiled import compiled


@compiled
def clip(value: float, low: float, high: float) -> float:
    """`value` within [low, high]."""
    return min(max(value, low), high)


@compiled
def share(force: float, moment: float, bow: float, stern: float, limits: Floats) -> tuple[float, float]:
    """Thrusts T of a pair with T_bow + T_stern = force and bow T_bow + stern T_stern = moment, within limits.

    Where limits do not allow both, the moment is limited to what the pair can do at all, and the force to what is
    left at that moment.

    Args:
        force: wanted sum [N].
        moment: wanted moment [N m].
        bow: lever of the bow thruster, positive [m].
        stern: lever of the stern thruster, negative [m].
        limits: lowest and highest thrust of bow and stern thruster, shape (2, 2), [N].

    Returns:
        Thrusts of the bow and of the stern thruster [N].
    """
    span = bow - stern
    moment = clip(moment, bow * limits[0, 0] + stern * limits[1, 1], bow * limits[0, 1] + stern * limits[1, 0])
    low = max((moment - span * limits[0, 0]) / stern, (span * limits[1, 0] + moment) / bow)
    high = min((moment - span * limits[0, 1]) / stern, (span * limits[1, 1] + moment) / bow)
    force = clip(force, low, high)
    # the second clip takes off what rounding may leave beyond a limit
    return (
        clip((moment - stern * force) / span, limits[0, 0], limits[0, 1]),
        clip((bow * force - moment) / span, limits[1, 0], limits[1, 1]),
    )
