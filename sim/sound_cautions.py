"""Cautions before a flight about rays that bend: shadows, several rays, and wrong ranges."""

import numpy as np

from laisn.arrays import Floats
from sim.scenario.parts import SoundSettings
from sim.water.assembly import floor_of, planned_places, sound_points
from sim.water.rays import Path as SoundPath
from sim.water.refraction import RefractedRays, traced_rays

_INSTANTS = 25  # instants at which rays are traced
_NOTICEABLE_M = 0.1  # errors of ranges below this need no caution


def _rays(sound: SoundSettings) -> RefractedRays | None:
    """Traced rays of the sea; None where sound goes straight."""
    points = sound_points(sound)
    if points is None or np.ptp(points[:, 1]) == 0.0 or sound.acoustics.rays == "straight":
        return None
    return traced_rays(points, floor_of(sound.sea))


def _direct_rays(rays: RefractedRays, leader: Floats, follower: Floats) -> tuple[int, float]:
    """How many direct rays join two places (east, north, depth) [m], and by how much the range that
    is measured by the first one is too short [m].
    """
    source, receiver = (
        (float(east), float(north), -float(depth)) for east, north, depth in (leader, follower)
    )
    rays_between = rays.rays(int(SoundPath.DIRECT), source, receiver)
    if not rays_between:
        return 0, 0.0
    slowness = rays.straight_slowness(int(SoundPath.DIRECT), source, receiver)
    # `Ray.length` is that of the straight path; the range that is measured is time / slowness
    return len(rays_between), rays_between[0].length - rays_between[0].time / slowness


def ray_cautions(sound: SoundSettings, assumed: str) -> list[str]:
    """Lines about the direct rays from the leader to its followers along their plans.

    `assumed` is the value of the key `navigation.sound_speed`: with "profile" navigators take into
    account that rays bend.
    """
    rays = _rays(sound)
    if rays is None:
        return (
            []
            if sound.acoustics.rays == "straight"
            else [
                f"without effect: acoustics.rays = {sound.acoustics.rays!r}, as the speed of sound "
                "is the same at all depths"
            ]
        )
    plan = sound.sea.plan
    leader, *followers = planned_places(plan)
    instants = np.linspace(0, len(leader) - 1, _INSTANTS).astype(int)
    shadowed = []
    multipath = []
    worst = 0.0  # largest error of a range [m]
    for follower, places in zip(plan.followers, followers, strict=True):
        counts_and_errors = [_direct_rays(rays, leader[i], places[i]) for i in instants.tolist()]
        counts = [count for count, _ in counts_and_errors]
        worst = max([worst, *(error for _, error in counts_and_errors)])
        if 0 in counts:
            shadowed.append(f"{follower.name} ({counts.count(0) / _INSTANTS:.0%} of the plan)")
        if max(counts) > 1:
            multipath.append(follower.name)
    lines = []
    if shadowed:
        lines.append(
            f"acoustics.rays: no direct ray reaches {', '.join(shadowed)}, which receives nothing "
            "there"
        )
    if multipath:
        lines.append(
            f"acoustics.rays: several direct rays reach {', '.join(multipath)}; the first to "
            "arrive is measured"
        )
    if worst > _NOTICEABLE_M and assumed != "profile":
        lines.append(
            f"acoustics.rays: rays bend, which makes ranges up to {worst:.2g} m shorter than along "
            f"the straight path; navigation.sound_speed = {assumed!r} assumes straight ones"
        )
    return lines
