"""The first screen of a flight's report: two sentences, and key figures against what is expected of
them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from laisn.navigators import title_of
from reports.flight_figures import ON_AXIS_DEG
from reports.page import Tile
from reports.verdict import Verdict
from sim.flight import FlightRecord, Termination
from sim.scenario.links import LEADER_LINK

Accuracies = Mapping[str, Mapping[str, float]]
"""What `accuracy` of the report tells of each follower, by its name."""
Tone = Literal["good", "bad", ""]

EXPECTED_NEES = 2.0
"""Of a consistent filter, on average."""
# intervals for `tone_of`
_GOOD_NEES = (1.0, 4.0)
_TOLERABLE_NEES = (0.25, 8.0)
CONSISTENT_OUTSIDE_SHARE = math.exp(-2.0)
"""Share of errors outside the 2σ ellipse of a consistent filter (Rayleigh distribution)."""
_GOOD_OUTSIDE = (0.0, 0.25)
_TOLERABLE_OUTSIDE = (0.0, 0.40)
_GOOD_BOUND = (0.0, 1.5)  # of the RMS error over the bound's
_TOLERABLE_BOUND = (0.0, 3.0)
_NEAR_SHARE = 0.3  # least share of the time near the leader's axis that is a cause
_NEAR_RATIO = 1.5  # least ratio of the mean error there to that elsewhere
_WRONG_SIDE_SHARE = 0.01  # least share of the time on the wrong side that is a cause
_TWO_TRANSMITTERS = 2


def tone_of(value: float | None, good: tuple[float, float], tolerable: tuple[float, float]) -> Tone:
    """Good within the first interval, bad outside the second, wider one, neither between them."""
    if value is None or not math.isfinite(value):
        return ""
    if good[0] <= value <= good[1]:
        return "good"
    return "" if tolerable[0] <= value <= tolerable[1] else "bad"


def figure_text(value: float, unit: str = "") -> str:
    """A number with about three digits: 0.05 m, 12.3 m, 61 thousand, 20.4 million."""
    if value >= 1e9:
        return f"{value:.2g}{unit}"
    if value >= 1e6:
        return f"{value / 1e6:.3g} million{unit}"
    if value >= 1e4:
        return f"{value / 1e3:,.0f} thousand{unit}"
    if value >= 100:
        return f"{value:.0f}{unit}"
    return f"{value:.1f}{unit}" if value >= 10 else f"{value:.2f}{unit}"


def navigators(flight: FlightRecord) -> str:
    """The navigators of a flight's followers, each once, in words."""
    scenario = flight.scenario
    words = []
    for i in range(len(scenario.followers)):
        navigation = scenario.navigation_of(i)
        title = title_of(navigation.variant)
        words.append(f"{title} on {navigation.transmitters} transmitters")
    distinct = list(dict.fromkeys(words))
    return " and ".join(filter(None, [", ".join(distinct[:-1]), distinct[-1]]))


def subject(flight: FlightRecord) -> str:
    """Who did what, for how long, and by which navigator."""
    followers = flight.scenario.followers
    subject = "One follower" if len(followers) == 1 else f"{len(followers)} followers"
    is_single = len(followers) == 1
    if all(follower.station for follower in followers):
        does = f"{'holds its station' if is_single else 'hold their stations'} on a leader"
    else:
        does = f"{'swims' if is_single else 'swim'} with a leader"
    duration = f"{float(flight.trajectory.time[-1]):,.0f} s"
    return f"{subject} {does} for {duration}, navigating by {navigators(flight)}."


def cause(transmitters: int, errors: Mapping[str, float], nees: float | None) -> str:
    """Why the estimate of a follower that uses so many transmitters is as far off as it is, with
    its errors as of `accuracy` of the report; empty: nothing stands out.
    """
    near_axis = errors["near_axis"]
    off_axis = errors["mean_elsewhere"]
    if near_axis >= _NEAR_SHARE and not errors["mean_near"] < _NEAR_RATIO * off_axis:
        is_two = transmitters <= _TWO_TRANSMITTERS
        reason = (
            "two transmitters cannot tell the side"
            if is_two
            else "ranges hardly tell the direction"
        )
        return (
            f"{100 * near_axis:.0f} % of the time it is within {ON_AXIS_DEG:g}° of the leader's "
            f"axis, where {reason}"
        )
    if errors["wrong_side"] >= _WRONG_SIDE_SHARE:
        return f"{100 * errors['wrong_side']:.0f} % of the time it is on the wrong side of the axis"
    return overconfidence(nees)


def overconfidence(nees: float | None) -> str:
    """What a filter's mean NEES says of it; empty: nothing stands out."""
    if nees is None or nees <= _TOLERABLE_NEES[1]:
        return ""
    return (
        f"the filter is surer than right (mean NEES {figure_text(nees)}, {EXPECTED_NEES:g} "
        "expected)"
    )


def _stations(summary: Mapping[str, Any]) -> str:
    """How well stations were held, of a flight in which no follower was lost."""
    rows = {n: row for n, row in summary["followers"].items() if "station_rms_m" in row}
    rms = [row["station_rms_m"] for row in rows.values()]
    worst = max(rows, key=lambda name: rows[name]["station_max_m"])
    largest = rows[worst]["station_max_m"]
    others = len(summary["followers"]) - len(rows)
    if len(rows) == 1:
        subject = worst if others else "It"
        return (
            f"{subject} keeps station: {figure_text(rms[0], ' m')} off it (RMS), "
            f"{figure_text(largest, ' m')} at most."
        )
    subject = f"The {len(rows)} on stations" if others else "All"
    return (
        f"{subject} keep station: {figure_text(min(rms))} to {figure_text(max(rms), ' m')} off it "
        f"(RMS), {figure_text(largest, ' m')} at most ({worst})."
    )


def on_stations(summary: Mapping[str, Any]) -> bool:
    """Whether any follower has a station."""
    return any("station_rms_m" in row for row in summary["followers"].values())


def headline(
    flight: FlightRecord, verdict: Verdict, summary: Mapping[str, Any], accuracies: Accuracies
) -> str:
    """Who did what, and how it went and why."""
    sentence = verdict.sentence
    is_uneventful = (
        flight.outcome is Termination.COMPLETED
        and not verdict.lost
        and not flight.without_estimate
        and "touched" not in sentence
    )
    if is_uneventful and on_stations(summary):
        sentence = _stations(summary)
    elif is_uneventful and accuracies:
        worst = max(accuracies, key=lambda name: accuracies[name]["mean"])
        nees = summary["followers"].get(worst, {}).get("nees")
        follower = flight.trajectory.names.index(worst) - 1
        navigation = flight.scenario.navigation_of(follower)
        # the leader's axis is nothing to those that navigate on another link
        reason = (
            cause(navigation.transmitters, accuracies[worst], nees)
            if navigation.link == LEADER_LINK
            else overconfidence(nees)
        )
        if reason:
            owner = "" if len(accuracies) == 1 else f"of {worst}, "
            sentence = f"{sentence.removesuffix('.')}: {owner}{reason}."
    # no number is parted from its unit
    return f"{subject(flight)} {sentence}".replace(" %", "\u00a0%")


def _largest(values: Sequence[float | None]) -> float | None:
    """The largest of the values that are known; None without any."""
    finite = [value for value in values if value is not None and math.isfinite(value)]
    return max(finite, default=None)


def _consistency(rows: Mapping[str, Any], accuracies: Accuracies) -> list[Tile]:
    """NEES, share outside 2σ and ratio to the bound, of all followers."""
    prefix = "all, " if len(accuracies) > 1 else ""
    nees = [row["nees"] for row in rows.values() if row.get("nees") is not None]
    tiles = []
    if nees:
        mean = float(np.mean(nees))
        tone = tone_of(mean, _GOOD_NEES, _TOLERABLE_NEES)
        expected = f"{prefix}{EXPECTED_NEES:g} expected"
        tiles.append(Tile(name="NEES", value=figure_text(mean), remark=expected, tone=tone))
    outside = float(np.mean([errors["outside"] for errors in accuracies.values()]))
    tone = tone_of(outside, _GOOD_OUTSIDE, _TOLERABLE_OUTSIDE)
    remark = f"{prefix}{100 * CONSISTENT_OUTSIDE_SHARE:.0f} % expected"
    tiles.append(
        Tile(name="outside its 2σ", value=f"{100 * outside:.0f} %", remark=remark, tone=tone)
    )
    ratio = _largest([row.get("rms_over_bound") for row in rows.values()])
    if ratio is not None:
        tone = tone_of(ratio, _GOOD_BOUND, _TOLERABLE_BOUND)
        # a single flight may be luckier than the least error on average
        remark = "1 at best on average" + (", the worst" if prefix else "")
        tiles.append(Tile(name="× bound", value=figure_text(ratio), remark=remark, tone=tone))
    return tiles


def _station_tiles(rows: Mapping[str, Any]) -> list[Tile]:
    """Whether stations are held: the first question to a formation."""
    on_station = [
        name
        for name, row in rows.items()
        if not row.get("lost") and row.get("joined_s") is not None
    ]
    worst = max(rows, key=lambda name: rows[name]["station_max_m"])
    rms = math.sqrt(float(np.mean([row["station_rms_m"] ** 2 for row in rows.values()])))
    all_held = len(on_station) == len(rows)
    return [
        Tile(
            name="keep station",
            value=f"{len(on_station)} of {len(rows)}",
            remark="none lost"
            if all_held
            else f"{len(rows) - len(on_station)} lost or never joined",
            tone="good" if all_held else "bad",
        ),
        Tile(name="off station", value=figure_text(rms, " m"), remark="RMS of all"),
        Tile(
            name="farthest off station",
            value=figure_text(rows[worst]["station_max_m"], " m"),
            remark=worst,
        ),
    ]


def tiles(summary: Mapping[str, Any], accuracies: Accuracies) -> list[Tile]:
    """Key figures: stations of a formation, errors, and the filter's consistency."""
    rows = summary["followers"]
    on_station = {name: row for name, row in rows.items() if "station_rms_m" in row}
    shown_tiles = _station_tiles(on_station) if on_station else []
    if not accuracies:
        return shown_tiles
    worst = max(accuracies, key=lambda name: accuracies[name]["largest"])
    has_several = len(accuracies) > 1
    mean = float(np.mean([errors["mean"] for errors in accuracies.values()]))
    high = max(errors["high"] for errors in accuracies.values())
    time = f"at {accuracies[worst]['largest_s']:.0f} s"
    shown_tiles.append(
        Tile(
            name="mean error",
            value=figure_text(mean, " m"),
            remark=f"95 % below {figure_text(high, ' m')}"
            + (", worst follower" if has_several else ""),
        )
    )
    largest = figure_text(accuracies[worst]["largest"], " m")
    remark = f"{worst}, {time}" if has_several else time
    shown_tiles.append(Tile(name="largest error", value=largest, remark=remark))
    return [*shown_tiles, *_consistency(rows, accuracies)]
