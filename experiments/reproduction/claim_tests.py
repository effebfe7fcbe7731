"""The tests behind the claims: each turns figures of many missions into criteria with their bounds.

Figures are arrays over missions, shape (m,), or over resamples and missions, shape (B, m).
"""

from collections.abc import Sequence

import numpy as np

from experiments.reproduction.replications import NEAR_BURST_S
from experiments.reproduction.verdict import Criterion, Evaluated, Results
from laisn.arrays import Bools, Floats
from laisn.settings import Variant


class NoDataError(LookupError):
    """Figures that a test needs are missing."""


def _require(*arrays: Floats) -> None:
    if not all(a.size and np.all(np.isfinite(a)) for a in arrays):
        raise NoDataError


def _median(values: Floats) -> Floats:
    return np.asarray(np.median(values, axis=-1))


def _nine_tenths(values: Floats) -> Floats:
    return np.asarray(np.quantile(values, 0.9, axis=-1))


def _share(which: Bools | Floats) -> Floats:
    return np.asarray(np.mean(which, axis=-1))


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


def lateral(results: Results) -> Evaluated:
    lateral, others = results.among(results.lateral), results.others(results.lateral)
    worst, best = (results.values("base", "laisn-2", "e_p_max_m", m) for m in (lateral, others))
    _require(worst, best)
    top, least = (results.in_replications("base", "laisn-2", "e_p_max_m", m) for m in (lateral, others))
    below = _share(top.max(axis=-1) < least.min(axis=-1))
    abeam, astern = (results.values("base", "laisn-2", f"e_p_{where}_m") for where in ("abeam", "astern"))
    both: Bools = np.asarray(np.isfinite(abeam + astern).reshape(-1, abeam.shape[-1]).all(axis=0))
    abeam, astern = abeam[..., both], astern[..., both]
    criteria = [
        Criterion("median E_P max, abeam over the others", _median(worst) / _median(best), "<", 1.0),
        Criterion("share of replications with E_P max abeam below each other", below, ">", 0.5, "replications"),
    ]
    if both.any():
        criteria.append(
            Criterion("share of missions better abeam than astern", _share(abeam < astern), ">", 0.5, kind="share")
        )

    def figures() -> str:
        text = (
            f"E_P max of {_named(lateral)}: {worst.min():.2f} … {worst.max():.2f} m; "
            f"of the others {best.min():.2f} … {best.max():.2f} m"
        )
        if not both.any():
            return text
        names = [m for m, known in zip(results.missions, both, strict=True) if known]
        return (
            f"{text}; mean E_P astern over abeam within a mission: {_spread(astern / abeam, names)}, "
            f"abeam better on {np.count_nonzero(abeam < astern)} of {len(names)}"
        )

    return Evaluated(criteria, figures)


def interval(results: Results) -> Evaluated:
    five, ten = (_ratio(results, (s, "laisn-2"), ("base", "laisn-2")) for s in ("5s", "10s"))
    _require(five, ten)
    criteria = [
        Criterion("median of 5 s over 1 s", _median(five), "≤", 2.0),
        Criterion("median of 10 s over 1 s", _median(ten), "≥", 4.0),
    ]
    names = results.missions
    return Evaluated(criteria, lambda: f"5 s over 1 s: {_spread(five, names)}; 10 s over 1 s: {_spread(ten, names)}")


def baseline(results: Results) -> Evaluated:
    ratio = np.concatenate([_ratio(results, ("L1", v), ("5s", v)) for v in ("laisn-2", "laisn-3-2")], axis=-1)
    _require(ratio)
    names = [f"{m} {v}" for v in ("LAISN-2", "LAISN-3(2)") for m in results.missions]
    criteria = [
        Criterion("median of 1 m over 2 m", _median(ratio), "≤", 1.25),
        Criterion("nine tenths of 1 m over 2 m", _nine_tenths(ratio), "≤", 1.5),
    ]
    return Evaluated(criteria, lambda: f"1 m over 2 m: {_spread(ratio, names)}")


def offset(results: Results) -> Evaluated:
    ratio = _ratio(results, ("HT0.2", "laisn-3-2"), ("5s", "laisn-3-2"))
    _require(ratio)
    change = np.abs(np.log(ratio))
    criteria = [
        Criterion("median change by 0.2 m, as a factor", np.exp(_median(change)), "≤", 1.1),
        Criterion("nine tenths of the changes", np.exp(_nine_tenths(change)), "≤", 1.2),
    ]
    return Evaluated(criteria, lambda: f"0.2 m over 0.1 m: {_spread(ratio, results.missions)}")


def third(results: Results) -> Evaluated:
    ratios = {
        title: _ratio(results, (setting, "laisn-3-2"), (setting, "laisn-2"))
        for setting, title in (("base", "1 s"), ("5s", "5 s"))
    }
    _require(*ratios.values())
    criteria = []
    for title, ratio in ratios.items():
        criteria.append(Criterion(f"median at {title}", _median(ratio), "≥", 0.95))
        criteria.append(
            Criterion(f"share of missions below 0.9 at {title}", _share(ratio < 0.9), "≤", 0.1, kind="share")
        )

    def figures() -> str:
        told = "; ".join(f"{title}: {_spread(ratio, results.missions)}" for title, ratio in ratios.items())
        return f"LAISN-3(2) over LAISN-2, {told}"

    return Evaluated(criteria, figures)


def worse(results: Results) -> Evaluated:
    ratios = {
        name: _ratio(results, ("base", "laisn-3-1"), ("base", "laisn-2"), metric)
        for name, metric in (("mean", "e_p_mean_m"), ("max", "e_p_max_m"))
    }
    _require(*ratios.values())
    criteria = [Criterion(f"median of the {name}", _median(r), ">", 1.0) for name, r in ratios.items()]
    criteria += [
        Criterion(f"share of missions with a larger {name}", _share(r > 1), "≥", 0.9, kind="share")
        for name, r in ratios.items()
    ]
    return Evaluated(
        criteria, lambda: "; ".join(f"{name}: {_spread(r, results.missions)}" for name, r in ratios.items())
    )


def asymmetric(results: Results) -> Evaluated:
    missions = results.among(results.astern)
    two, three = (results.values("asymmetric", v, "e_p_mean_m", missions) for v in ("laisn-2", "laisn-3-2"))
    _require(two, three)
    ratio = three / two
    criteria = [
        Criterion("median of LAISN-3(2) over LAISN-2", _median(ratio), "≤", 0.8),
        Criterion("share of missions at 0.8 or less", _share(ratio <= 0.8), "≥", 0.9, kind="share"),
    ]
    return Evaluated(
        criteria, lambda: f"LAISN-3(2) over LAISN-2, mean E_P on {_named(missions)}: {_spread(ratio, missions)}"
    )


def shared(results: Results) -> Evaluated:
    ratio = _ratio(results, ("muD0.3", "laisn-2"), ("5s", "laisn-2"))
    _require(ratio)
    criteria = [
        Criterion("median of 0.3 m over 0.1 m", _median(ratio), "≤", 1.25),
        Criterion("nine tenths of 0.3 m over 0.1 m", _nine_tenths(ratio), "≤", 1.5),
    ]
    return Evaluated(criteria, lambda: f"0.3 m over 0.1 m: {_spread(ratio, results.missions)}")


def heading(results: Results) -> Evaluated:
    error = results.values("heading5", "laisn-2", "e_p_mean_m")
    growth = error / results.values("base", "laisn-2", "e_p_mean_m")
    distance = results.values("base", "laisn-2", "distance_m")
    _require(error, growth, distance)
    lateral = np.isin(list(results.missions), list(results.lateral))
    if lateral.all() or not lateral.any():
        raise NoDataError
    grown, elsewhere = (_median(growth[..., group]) for group in (lateral, ~lateral))
    slope = np.sum(error * distance, axis=-1) / np.sum(distance**2, axis=-1)
    # of a line through the origin: what it leaves over the spread about the mean
    left = np.sum((error - slope[..., None] * distance) ** 2, axis=-1)
    spread = np.sum((error - error.mean(axis=-1, keepdims=True)) ** 2, axis=-1)
    fit = 1.0 - np.divide(left, spread, out=np.ones_like(left), where=spread > 0.0)
    criteria = [
        Criterion("growth abeam, over that elsewhere and over 5", np.minimum(grown / elsewhere, grown / 5.0), ">", 1.0),
        Criterion("variance that the line explains", fit, "≥", 0.8, kind="share"),
    ]
    return Evaluated(
        criteria,
        lambda: (
            f"E_P grows {grown:.1f} times on {_named(results.among(results.lateral))}, {elsewhere:.1f} times on the "
            f"others (medians); E_P = {slope:.3f} × mean distance ({np.rad2deg(slope):.1f}°) explains "
            f"{100 * fit:.0f} % of its variance"
        ),
    )


def burst(results: Results) -> Evaluated:
    bursts, others = results.among(results.burst), results.others(results.burst)
    mine, theirs = (results.values("base", "laisn-2", "e_b_max_deg", m) for m in (bursts, others))
    _require(mine, theirs)
    top, least = (results.in_replications("base", "laisn-2", "e_b_max_deg", m) for m in (bursts, others))
    largest = _share(top.max(axis=-1) > least.max(axis=-1))
    criteria = [
        Criterion("largest E_B, median of the bursts over the others'", _median(mine) / _median(theirs), ">", 1.0),
        Criterion("share of replications with the largest E_B in a burst", largest, ">", 0.5, "replications"),
    ]
    near = results.values("base", "laisn-2", "e_b_peaks_at_burst", bursts)
    timed = bool(np.all(np.isfinite(near)))
    if timed:
        what = f"share of replications with the peak within {NEAR_BURST_S:.0f} s of the burst"
        criteria.append(Criterion(what, _share(near), ">", 0.5, "replications"))

    def figures() -> str:
        where = (bursts if mine.max() > theirs.max() else others)[int(np.argmax(max(mine, theirs, key=np.max)))]
        return (
            f"largest E_B {max(mine.max(), theirs.max()):.1f}° on {where}; {_named(bursts)} {np.median(mine):.1f}°, "
            f"others: {_spread(theirs, others)}"
        )

    return Evaluated(criteria, figures)
