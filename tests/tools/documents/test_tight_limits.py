"""The record of the limits of the tightly coupled navigator: its findings follow from its cells."""

import numpy as np
import pytest

from laisn.arrays import Floats
from reports.findings import read_findings
from tools.documents.markers import RECORDS
from tools.documents.tight_limits import RIVALS, case_findings, measured_beside, normalised_errors


class RunsOfTwoRoutes:
    """Errors and NEES of runs, as `Cells` gives them, shape (runs, routes)."""

    def __init__(self, errors: Floats, nees: float) -> None:
        self.errors = errors
        self.nees = nees

    def values_by_run(self, metric: str) -> Floats:
        return self.errors if metric == "e_p_mean_m" else np.full(self.errors.shape, self.nees)


def test_a_rival_counts_as_better_on_a_route_where_the_whole_interval_is() -> None:
    """On the first of two routes the filter is better by 0.1 m in each run, on the second worse."""
    rng = np.random.default_rng(1)
    ours = 1.0 + 0.01 * rng.standard_normal((20, 2))
    rival = ours + np.array([-0.1, 0.3]) + 0.01 * rng.standard_normal((20, 2))
    arms = {
        name: RunsOfTwoRoutes(errors, nees)
        for name, errors, nees in (
            ("tight", ours, 2.0),
            ("ekf", rival, 3.0),
            ("laisn-3-2", 3.0 * ours, 100.0),
            ("tight-2", ours, 2.0),
            ("ekf-2", ours + 0.1, 5.0),
            ("laisn-2", 3.0 * ours, 100.0),
        )
    }
    findings = dict(case_findings("case", arms))  # type: ignore[arg-type]
    assert findings["better-than tight case"].number == 1
    assert findings["better-than tight-2 case"].number == 0
    assert findings["least ekf case"].number == pytest.approx(-0.1, abs=0.01)
    assert findings["less ekf case"].number == pytest.approx(0.1, abs=0.01)
    assert findings["worst ekf case"].number == pytest.approx(1.3, abs=0.01)
    assert findings["nees-most ekf-2 case"].number == 5.0


def test_the_follower_of_the_map_is_where_it_says() -> None:
    """2 m abeam to starboard: both ranges of the leader's ends are √5 m, but for a common error."""
    measured = measured_beside(90.0, 2.0, 0.0, run=3)
    rear, front, _ = measured.ranges.T
    np.testing.assert_allclose(rear, front, atol=0.011)
    assert np.mean(rear) == pytest.approx(np.sqrt(5.0), abs=0.02)
    assert np.std(rear) == pytest.approx(0.05, rel=0.2)
    deeper = measured_beside(90.0, 2.0, 1.0, run=3)
    assert np.mean(deeper.ranges[:, 0]) == pytest.approx(np.sqrt(6.0), abs=0.02)


@pytest.mark.system
def test_the_covariance_holds_over_bearing_and_distance() -> None:
    """A part of the map, flown: the median NEES of nine runs, of which 2 is right off the axis. On
    the axis the mean of both sides has no lateral error, so that 1 less is right.
    """
    for bearing in (0.0, 45.0, 90.0, 170.0, 180.0):
        for distance in (1.0, 4.0, 30.0, 250.0, 500.0):
            for interval in (1.0, 5.0):
                nees = np.median(normalised_errors(bearing, distance, 0.0, interval, 9))
                on_axis = bearing in (0.0, 180.0)
                assert (0.6 if on_axis else 0.75) < nees < 4.0, (bearing, distance, interval)


def test_the_record_keeps_what_the_documents_say() -> None:
    """No rival is better with two transmitters, NEES is 1 to 3 on each route, and 4 at most on the
    map.
    """
    record = read_findings(RECORDS / "tight-limits.json")
    assert record["better-than tight-2"].number == 0
    for case in ("exact", "0.1", "0.5", "2", "slot 0.1", "slot 0.2"):
        for ours, (_, laisn) in RIVALS.items():
            assert record[f"nees-least {ours} {case}"].number > 1.0
            assert record[f"nees-most {ours} {case}"].number < 3.0
            finding = record[f"less {laisn} {case}"]
            assert finding.low is not None
            assert finding.low > 0.0
    for interval in ("1", "5"):
        assert record[f"nees-most {interval}"].number < 4.0
