"""Stages on drawn routes: groups, means and verdicts of missions made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.reproduction import routes_page, routes_study
from experiments.reproduction.claims import Claim
from experiments.reproduction.routes_study import distributions, geometry, judge, results_of
from experiments.reproduction.stages import METRICS, SETTINGS, Key
from experiments.reproduction.verdict import Criterion, Evaluated, Results
from sim.geometry import attitude
from sim.trajectory import Trajectory
from tests import straight

CLASSES = {f"{name}-{i}": name for name in routes_study.CLASSES for i in range(2)}


def flown(astern: float, speed: float = 1.0, distance: float = 20.0) -> Trajectory:
    """A follower that is 9.9° off dead astern for a share of the time, and then 10.1° off; it swims eastwards."""
    whole = straight.make_trajectory((0.0, 0.0, -8.0), follower_velocity=(speed, 0.0, 0.0))
    off = np.deg2rad(np.where(np.arange(whole.time.size) < astern * whole.time.size, 9.9, -10.1))
    position, quaternion = whole.position.copy(), whole.quaternion.copy()
    # both head 30° east of north
    quaternion[:] = attitude.from_euler(np.pi / 6)
    course = np.pi / 6 + np.pi + off
    position[:, 1, :2] = position[:, 0, :2] + distance * np.column_stack([np.sin(course), np.cos(course)])
    velocity = np.array([np.sin(np.pi / 6), np.cos(np.pi / 6), 0.0]) * speed * np.ones_like(whole.velocity)
    return replace(whole, position=position, quaternion=quaternion, velocity=velocity)


def test_geometry_is_time_astern_and_top_speed() -> None:
    assert geometry(flown(0.25, 1.7)) == pytest.approx((51 / 201, 1.7))


def test_routes_are_grouped_by_where_the_follower_swims() -> None:
    """Shares astern 0, 1/8 … 1: of nine the three least and the three most, with the ties of quantiles."""
    flights = {f"m{i}": flown(i / 8, 1.0 + 0.1 * (i == 4), 10.0 + i) for i in range(9)}
    rows: dict[Key, dict[str, float]] = {("base", name, "laisn-2"): {"e_p_mean_m": 1.0} for name in flights}
    found = results_of(rows, flights)
    assert list(found.lateral) == ["m0", "m1", "m2"]
    assert list(found.astern) == ["m6", "m7", "m8"]
    assert list(found.burst) == ["m4"]
    assert found.values("base", "laisn-2", "distance_m") == pytest.approx(np.arange(10.0, 19.0))


def test_a_class_has_the_mean_of_its_routes_and_all_have_that_of_all() -> None:
    setting = replace(SETTINGS[0], variants=("laisn-2",))
    values = dict(zip(CLASSES, 2.0 ** np.arange(len(CLASSES)), strict=True))
    rows: dict[Key, dict[str, float]] = {
        (setting.name, m, "laisn-2"): {x: value * (i + 1) for i, x in enumerate(METRICS)} | {"captured_runs": i0}
        for i0, (m, value) in enumerate(values.items())
    }
    table = distributions([setting], rows, CLASSES, 1)
    assert [row["class"] for row in table] == [*routes_study.CLASSES, "all"]
    for k, row in enumerate(table[:-1]):
        pair = list(values.values())[2 * k : 2 * k + 2]
        for i, metric in enumerate(METRICS):
            assert row[metric] == pytest.approx((i + 1) * sum(pair) / 2)
            # of two routes a resample has both or one of them twice
            assert (row[f"{metric}_low"], row[f"{metric}_high"]) == pytest.approx(
                ((i + 1) * pair[0], (i + 1) * pair[1])
            )
        assert (row["routes"], row["captured_runs"]) == (2, 4 * k + 1)
    last, n = table[-1], len(CLASSES)
    assert last["e_p_max_m"] == pytest.approx((2.0**n - 1) / n)
    assert (last["routes"], last["captured_runs"]) == (n, n * (n - 1) // 2)


def test_verdicts_are_counted_over_resampled_routes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim that holds if a class's first route was drawn: of two, with a chance of 3/4."""
    first = next(iter(CLASSES))

    def drawn(results: Results) -> Evaluated:
        names = list(results.missions)
        for name in routes_study.CLASSES:
            assert sum(CLASSES[m] == name for m in names) == 2
        held = Criterion("first drawn", np.asarray(1.0 * (first in names)), ">", 0.5, "share")
        return Evaluated([held], lambda: "")

    monkeypatch.setattr(routes_study, "CLAIMS", (Claim(number=1, text="", criterion="", test=drawn),))
    results = Results(rows={}, missions=list(CLASSES))
    ((_, whole, shares),) = judge(results, CLASSES, 1)
    assert whole.verdict == "holds"
    assert shares["holds"] + shares["does not hold"] == pytest.approx(1.0)
    # 200 resamples: four standard deviations
    assert shares["holds"] == pytest.approx(0.75, abs=4 * np.sqrt(0.75 * 0.25 / routes_study.CLAIM_RESAMPLES))


def test_the_page_shows_means_with_their_intervals_class_by_class() -> None:
    table = [
        {"setting": "base", "variant": "laisn-2", "class": name}
        | {f"{m}{end}": 10.0 * k + i + part for i, m in enumerate(METRICS) for end, part in
           (("", 0.5), ("_low", 0.25), ("_high", 0.75))}
        for k, name in enumerate([*routes_study.CLASSES, "all"])
    ]  # fmt: skip
    n = 10.0 * len(routes_study.CLASSES)
    (row,) = routes_page._overall(table, {"base": "often"}).rows
    assert [cell.text for cell in row] == [
        "often", "LAISN-2", *(f"{n + i + 0.5:.2f} ({n + i + 0.25:.2f} … {n + i + 0.75:.2f})" for i in range(6)),
    ]  # fmt: skip
    (row,) = routes_page._by_class(table, {"base": "often"}).rows
    assert [cell.text for cell in row][2:] == [
        f"{10 * k + 2.5:.2f} ({10 * k + 2.25:.2f} … {10 * k + 2.75:.2f})" for k in range(len(routes_study.CLASSES))
    ]
