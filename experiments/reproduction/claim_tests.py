"""The tests behind the claims: each takes figures of many missions and says what they come to."""

from collections.abc import Sequence

import numpy as np

from experiments.campaign.store import Steps
from experiments.reproduction.verdict import Judgement, Results, Verdict
from laisn.arrays import Floats
from laisn.geometry import signed_angle
from laisn.settings import Variant

ASTERN_DEG = 10.0
"""A follower within this angle of dead astern counts as astern."""
LATERAL_DEG = (45.0, 135.0)
"""Angle off the bow, either side, that counts as abeam."""
SECTOR_STEPS = 300
"""Steps (of 0.1 s) that a mission must spend in a sector to say something about it."""


def _judgement(parts: Sequence[bool], figures: str) -> Judgement:
    """All parts true: holds; some: depends; none: does not hold."""
    verdict: Verdict = "holds" if all(parts) else "depends" if any(parts) else "does not hold"
    return Judgement(verdict=verdict, figures=figures)


class NoDataError(LookupError):
    """Figures that a test needs are missing."""


def _require(*arrays: Floats) -> None:
    if not all(a.size and np.all(np.isfinite(a)) for a in arrays):
        raise NoDataError


def _spread(ratio: Floats, names: Sequence[str]) -> str:
    """Median and range of a ratio, with the missions at both ends."""
    low, high = int(np.argmin(ratio)), int(np.argmax(ratio))
    return f"median {np.median(ratio):.2f}, from {ratio[low]:.2f} ({names[low]}) to {ratio[high]:.2f} ({names[high]})"


def _named(missions: Sequence[str]) -> str:
    """Few missions by name, many by number."""
    return ", ".join(missions) if len(missions) <= 3 else f"{len(missions)} routes"


def _ratio(
    results: Results, over: tuple[str, Variant], under: tuple[str, Variant], metric: str = "e_p_mean_m"
) -> Floats:
    return results.values(*over, metric) / results.values(*under, metric)


def sector_errors(steps: Steps) -> tuple[float, float]:
    """Mean E_P [m] while the follower is abeam, and while it is astern; NaN where it hardly ever is."""
    off_bow = np.rad2deg(np.abs(signed_angle(np.deg2rad(steps["bearing_deg"]))))
    lateral = (off_bow >= LATERAL_DEG[0]) & (off_bow <= LATERAL_DEG[1])
    astern = off_bow >= 180.0 - ASTERN_DEG
    error = steps["e_p_mean_m"]
    abeam, behind = (float(error[s].mean()) if s.sum() >= SECTOR_STEPS else np.nan for s in (lateral, astern))
    return abeam, behind


def lateral(results: Results) -> Judgement:
    lateral, others = results.among(results.lateral), results.others(results.lateral)
    worst, best = (results.values("base", "laisn-2", "e_p_max_m", m) for m in (lateral, others))
    _require(worst, best)
    parts = [float(np.median(worst)) < float(np.median(best)), bool(worst.max() < best.min())]
    text = (
        f"E_P max of {_named(lateral)}: {worst.min():.2f} … {worst.max():.2f} m; "
        f"of the others {best.min():.2f} … {best.max():.2f} m"
    )
    sectors = [
        (m, *sector_errors(results.steps["base", m, "laisn-2"]))
        for m in results.missions
        if ("base", m, "laisn-2") in results.steps
    ]
    both = [(m, a, b) for m, a, b in sectors if np.isfinite(a) and np.isfinite(b)]
    if both:
        better = [m for m, abeam, astern in both if abeam < astern]
        parts.append(2 * len(better) > len(both))
        ratio = np.array([astern / abeam for _, abeam, astern in both])
        text += (
            f"; mean E_P astern over abeam within a mission: {_spread(ratio, [m for m, _, _ in both])}, "
            f"abeam better on {len(better)} of {len(both)}"
        )
    return _judgement(parts, text)


def interval(results: Results) -> Judgement:
    five, ten = (_ratio(results, (s, "laisn-2"), ("base", "laisn-2")) for s in ("5s", "10s"))
    _require(five, ten)
    text = f"5 s over 1 s: {_spread(five, results.missions)}; 10 s over 1 s: {_spread(ten, results.missions)}"
    return _judgement([bool(np.median(five) <= 2), bool(np.median(ten) >= 4)], text)


def baseline(results: Results) -> Judgement:
    ratio = np.concatenate([_ratio(results, ("L1", v), ("5s", v)) for v in ("laisn-2", "laisn-3-2")])
    _require(ratio)
    names = [f"{m} {v}" for v in ("LAISN-2", "LAISN-3(2)") for m in results.missions]
    parts = [bool(np.median(ratio) <= 1.25), bool(np.quantile(ratio, 0.9) <= 1.5)]
    return _judgement(parts, f"1 m over 2 m: {_spread(ratio, names)}")


def offset(results: Results) -> Judgement:
    ratio = _ratio(results, ("HT0.2", "laisn-3-2"), ("5s", "laisn-3-2"))
    _require(ratio)
    change = np.abs(np.log(ratio))
    parts = [bool(np.median(change) <= np.log(1.1)), bool(np.quantile(change, 0.9) <= np.log(1.2))]
    return _judgement(parts, f"0.2 m over 0.1 m: {_spread(ratio, results.missions)}")


def third(results: Results) -> Judgement:
    parts, texts = [], []
    for setting, title in (("base", "1 s"), ("5s", "5 s")):
        ratio = _ratio(results, (setting, "laisn-3-2"), (setting, "laisn-2"))
        _require(ratio)
        parts += [bool(np.median(ratio) >= 0.95), bool(np.mean(ratio < 0.9) <= 0.1)]
        texts.append(f"{title}: {_spread(ratio, results.missions)}")
    return _judgement(parts, "LAISN-3(2) over LAISN-2, " + "; ".join(texts))


def worse(results: Results) -> Judgement:
    mean, top = (
        _ratio(results, ("base", "laisn-3-1"), ("base", "laisn-2"), metric) for metric in ("e_p_mean_m", "e_p_max_m")
    )
    _require(mean, top)
    parts = [bool(np.median(r) > 1) for r in (mean, top)] + [bool(np.mean(r > 1) >= 0.9) for r in (mean, top)]
    return _judgement(parts, f"mean: {_spread(mean, results.missions)}; max: {_spread(top, results.missions)}")


def asymmetric(results: Results) -> Judgement:
    missions = results.among(results.astern)
    two, three = (results.values("asymmetric", v, "e_p_mean_m", missions) for v in ("laisn-2", "laisn-3-2"))
    _require(two, three)
    ratio = three / two
    text = f"LAISN-3(2) over LAISN-2, mean E_P on {_named(missions)}: {_spread(ratio, missions)}"
    return _judgement([bool(np.median(ratio) <= 0.8), bool(np.mean(ratio <= 0.8) >= 0.9)], text)


def shared(results: Results) -> Judgement:
    ratio = _ratio(results, ("muD0.3", "laisn-2"), ("5s", "laisn-2"))
    _require(ratio)
    parts = [bool(np.median(ratio) <= 1.25), bool(np.quantile(ratio, 0.9) <= 1.5)]
    return _judgement(parts, f"0.3 m over 0.1 m: {_spread(ratio, results.missions)}")


def heading(results: Results) -> Judgement:
    error = results.values("heading5", "laisn-2", "e_p_mean_m")
    growth = error / results.values("base", "laisn-2", "e_p_mean_m")
    distance = results.values("base", "laisn-2", "distance_m")
    _require(error, growth, distance)
    names = list(results.missions)
    lateral = np.isin(names, list(results.lateral))
    if lateral.all() or not lateral.any():
        raise NoDataError
    grown = [float(np.median(growth[group])) for group in (lateral, ~lateral)]
    dominates = grown[0] > grown[1] and grown[0] > 5
    slope = float(error @ distance / (distance @ distance))
    # of a line through the origin: what it leaves over the spread about the mean
    left, spread = (float(np.sum(r**2)) for r in (error - slope * distance, error - error.mean()))
    fit = 1 - left / spread if spread else 0.0
    text = (
        f"E_P grows {grown[0]:.1f} times on {_named(results.among(results.lateral))}, {grown[1]:.1f} times on the "
        f"others (medians); "
        f"E_P = {slope:.3f} × mean distance ({np.rad2deg(slope):.1f}°) explains {100 * fit:.0f} % of its variance"
    )
    return _judgement([dominates, fit >= 0.8], text)


def burst(results: Results) -> Judgement:
    top = results.values("base", "laisn-2", "e_b_max_deg")
    bursts, others = results.among(results.burst), results.others(results.burst)
    mine, theirs = (results.values("base", "laisn-2", "e_b_max_deg", m) for m in (bursts, others))
    _require(top, mine, theirs)
    largest = results.missions[int(np.argmax(top))]
    parts = [bool(np.median(mine) > np.median(theirs)), largest in bursts]
    text = (
        f"largest E_B {top.max():.1f}° on {largest}; {_named(bursts)} {np.median(mine):.1f}°, "
        f"others: {_spread(theirs, others)}"
    )
    lags = []
    for m in bursts:
        steps = results.steps.get(("base", m, "laisn-2"))
        if steps is not None:
            fastest = steps["time_s"][steps["speed_m_s"] >= 0.95 * steps["speed_m_s"].max()]
            lags.append(float(np.min(np.abs(steps["time_s"][np.argmax(steps["e_b_max_deg"])] - fastest))))
    if lags:
        parts.append(float(np.median(lags)) <= 30)
        text += f"; it peaks {np.median(lags):.0f} s from the burst"
    return _judgement(parts, text)
