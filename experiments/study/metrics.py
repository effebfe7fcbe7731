"""What a study can be judged by: the columns of its tables, what each is, and its unit."""

from typing import NamedTuple

from experiments.campaign.montecarlo import PERCENTILES
from laisn.estimates import FixKind

UNITS = {
    "deg_sqrt_h": "°/√h", "m_s2": "m/s²", "m_s": "m/s", "kg_m3": "kg/m³", "deg_s": "°/s", "deg_h": "°/h",
    "per_s": "1/s", "ppm": "ppm", "deg": "°", "kg": "kg", "m2": "m²", "m": "m", "s": "s", "n": "N", "j": "J", "w": "W",
}  # fmt: skip
"""Units by the ends of keys and columns, the longer ones first."""


def without_unit(name: str) -> tuple[str, str]:
    """A key or column without the unit at its end, and that unit; empty where it has none."""
    suffix = next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
    return name.removesuffix(f"_{suffix}") if suffix else name, UNITS.get(suffix, "")


class Metric(NamedTuple):
    """A column of results.parquet or runs.parquet."""

    label: str
    what: str
    unit: str = ""


_ERRORS = {
    "e_p_mean_m": ("mean E_P", "mean position error of the estimate"),
    "e_p_max_m": ("largest E_P", "largest position error; of a cell, over all its runs"),
    "e_p_rms_m": ("RMS E_P", "RMS position error of a run"),
    "e_p_std_m": ("σ of E_P", "standard deviation of the position error over steps and runs"),
    "e_b_mean_deg": ("mean E_B", "mean bearing error of the estimate, seen from the leader"),
    "e_b_max_deg": ("largest E_B", "largest bearing error; of a cell, over all its runs"),
    "e_b_std_deg": ("σ of E_B", "standard deviation of the bearing error over steps and runs"),
    "e_p_mean_unlocked_m": ("mean E_P without mirror lock", "mean position error of runs without mirror lock"),
    "mirror_locked": (
        "share of runs locked on the mirror image",
        "runs held at the mirror image for a message interval, E_P > 5 m",
    ),
    "mirror_locked_runs": ("runs locked on the mirror image", "number of such runs"),
    "gated": ("gated fixes of a run", "fixes that the gate rejected"),
    "nees": ("NEES", "mean normalised squared position error; 2 if the covariance is right"),
    "nees_inside": ("share of steps with NEES in χ²", "steps at which the NEES over runs is in its 95 % interval"),
    "bound_rms_m": ("Cramér–Rao bound", "least RMS position error of dead reckoning with ranges; tight only"),
    "bound_smoothed_rms_m": ("bound of smoothing", "the same with messages up to bound_lag_s later"),
    "rms_over_bound": ("RMS E_P over the bound", "RMS position error over that of the Cramér–Rao bound"),
    "nis": ("NIS", "mean normalised squared innovation; 2 if its covariance is right"),
}
_PERCENTILES = {
    f"e_{kind}_p{p}_{unit}": (f"{p}th percentile of E_{kind.upper()}", "over steps and runs")
    for kind, unit in (("p", "m"), ("b", "deg"))
    for p in PERCENTILES
}
_FIXES = {
    f"fixes_{kind.name.lower()}": (f"fixes: {kind.name.lower().replace('_', ' ')}", "number over all runs")
    for kind in FixKind
}
MISSION = {
    "track_error_rms_m": (
        "RMS distance from its place",
        "RMS distance from where the route or station has the follower",
    ),
    "track_error_max_m": ("largest distance from its place", "largest distance from there"),
    "track_error_end_m": ("distance from its place at the end", "distance from there when the mission ends"),
    "cross_track_rms_m": ("RMS cross-track error", "RMS distance from the legs of the route; followers on routes"),
    "cross_track_max_m": ("largest cross-track error", "largest distance from the legs of the route"),
    "station_rms_m": ("RMS distance from the station", "RMS distance of the hydrophone from the station once joined"),
    "station_p95_m": ("95th percentile of the distance from the station", "exceeded for 5 % of the time once joined"),
    "station_max_m": ("largest distance from the station", "largest distance from the station once joined"),
    "station_turn_max_m": ("largest distance from the station in turns", "largest while the formation turns; 0: never"),
    "station_leg_rms_m": ("RMS distance from the station on legs", "RMS distance while the formation goes straight on"),
    "lost": ("share of runs lost", "follower more than 10 m off its station once joined, or never joined: share"),
    "depth_error_rms_m": ("RMS error of depth", "RMS error of the follower's depth against the depth it was to hold"),
    "depth_error_max_m": ("largest error of depth", "largest error of depth"),
    "closest_approach_m": ("smallest distance from another vehicle", "of origins, in space"),
    "closest_horizontal_m": ("smallest horizontal distance from another vehicle", "whatever their depths"),
    "closest_in_layer_m": ("smallest horizontal distance in a layer", "of vehicles less than 1 m above or below"),
    "range_mean_m": ("mean horizontal distance from the leader", "mean horizontal distance from the leader"),
    "depth_offset_rms_m": ("RMS depth below the leader", "RMS depth of the follower below, or above, the leader"),
    "pitch_fix_error_m": (
        "error of a fix from the leader's pitch",
        "what the leader's pitch moves a noiseless LAISN-2 fix by, mean of a fix each second",
    ),
    "pitch_rms_deg": ("RMS pitch", "RMS pitch of the follower"),
    "pitch_max_deg": ("largest pitch", "largest pitch of the follower, up or down"),
    "power_mean_w": ("mean power of the thrusters", "mean power of the follower's thrusters"),
    "energy_j": ("energy of the thrusters", "energy of the follower's thrusters over the mission"),
    "leader_pitch_rms_deg": ("RMS pitch of the leader", "RMS pitch of the leader"),
    "leader_pitch_max_deg": ("largest pitch of the leader", "largest pitch of the leader, up or down"),
    "leader_depth_error_rms_m": ("RMS error of the leader's depth", "RMS error of the leader's depth"),
    "leader_power_mean_w": ("mean power of the leader's thrusters", "mean power of the leader's thrusters"),
    "leader_energy_j": ("energy of the leader's thrusters", "energy of the leader's thrusters over the mission"),
    "touched": ("share of runs with contact", "whether the follower's hull touched another: share of runs"),
    "ended": ("share of runs ended by contact", "whether contact ended the mission: share of runs"),
}

METRICS: dict[str, Metric] = {
    name: Metric(f"{label} [{unit}]" if unit else label, what, unit)
    for name, (label, what) in (_ERRORS | _PERCENTILES | _FIXES | MISSION).items()
    for _, unit in [without_unit(name)]
}
SHARES = frozenset({"mirror_locked", "lost", "touched", "ended"})
"""Metrics that a run either has or has not: 1 or 0."""
