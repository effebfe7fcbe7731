"""The study of real ranges: `python -m tools.documents.studies real-ranges`.

Plaza 1 and 2 are navigated on with two beacons at a time and with all four, from a known start and
from none: by dead reckoning, LAISN-2, the tightly coupled navigator that is made for transmitters
on a leader's hull, and that among beacons, which also has to do without some of its states, or
with a scale that is known better.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.beacon_replay import (
    BeaconReplaySettings,
    Score,
    dead_reckoning,
    navigate_among_beacons,
    navigate_by_laisn,
    score,
)
from laisn.estimates import Estimates
from laisn.settings import NavigationSettings, TightSettings
from laisn.tight.navigator import TightNavigator
from reports.findings import RESULTS_FILE, Finding, plain_finding, record
from reports.version import ROOT
from sim.datasets.log import Replayable, read_data_set, read_data_set_log, write_data_set

COMMAND = "python -m tools.documents.studies real-ranges"
MODULES = ("tools.documents.real_ranges",)
DATA = ROOT / "tests" / "data" / "plaza"
SETS = ("Plaza1", "Plaza2")
SETTLED_S = 60.0
"""With an unknown start errors count from here on: two beacons leave a mirror image open until
the vehicle turns.
"""

BEACON_SETTINGS = {
    "tight": BeaconReplaySettings(),
    "unknown-start": BeaconReplaySettings(known_start=False),
    "steady-gyro": BeaconReplaySettings(medium="air", gyro_bias_sigma_deg_s=0.0),
    "known-scale": BeaconReplaySettings(medium="air", range_scale_sigma=0.003),
    "exact-speed": BeaconReplaySettings(medium="air", speed_scale_sigma=0.0),
    "exact-beacons": BeaconReplaySettings(
        medium="air", survey_sigma_m=0.0, range_offset_sigma_m=0.0
    ),
}
"""The navigator among beacons as it is, from an unknown start, without some of its states, and
with a scale of ranges that is known better.

In the medium "air" defaults are those for radio ranges on land; where no medium is given, the
navigator also tries those for sound under water, and takes what makes the ranges likelier.
"""


HULL_SETTINGS = TightSettings(
    transmitters=2,
    start_sigma=1.0,
    speed_sigma=0.01,
    speed_bias_sigma=0.05,
    heading_sigma=float(np.deg2rad(0.1)),
    heading_bias_sigma=float(np.deg2rad(5.0)),
    range_sigma=0.5,
    range_scale_bias_sigma=3.0,  # of the scale error, at the longest range of a message [m]
    outlier_span=20.0,  # how much longer than the distance a wrong range may be [m]
    slip=0.05,  # random walk that odometry does not see [m/√s]
)
"""Settings of the tightly coupled navigator that is made for transmitters on a leader's hull, for
the quality of these sensors.
"""


def _among(settings: BeaconReplaySettings) -> Callable[[Replayable], Estimates]:
    """What makes estimates of a recording by the navigator among beacons."""
    return lambda recorded: navigate_among_beacons(recorded, settings)[0]


NAVIGATORS: dict[str, Callable[[Replayable], Estimates]] = {
    "dead-reckoning": dead_reckoning,
    "laisn-2": lambda recorded: navigate_by_laisn(
        recorded, NavigationSettings(use_single_range=True)
    ),
    "hull": lambda recorded: TightNavigator(
        replace(HULL_SETTINGS, dt=recorded.measurements.dt), recorded.start
    ).run(recorded.measurements),
    **{name: _among(settings) for name, settings in BEACON_SETTINGS.items()},
}
"""What makes estimates of a recording, by its name in the record."""


def recordings(name: str) -> Iterator[tuple[tuple[str, ...], Replayable]]:
    """A data set with each pair of its beacons, and then with all, read back from its log."""
    data = read_data_set(DATA / f"{name}.mat")
    with TemporaryDirectory() as folder:
        for beacons in (*combinations(data.beacons, 2), data.beacons):
            log = Path(folder) / f"{'-'.join(beacons)}.mcap"
            write_data_set(data.with_beacons(beacons), log)
            yield beacons, read_data_set_log(log)


def scores(
    name: str, navigators: tuple[str, ...] = tuple(NAVIGATORS)
) -> dict[str, dict[tuple[str, ...], Score]]:
    """Scores by navigator and beacons."""
    scores_of: dict[str, dict[tuple[str, ...], Score]] = {navigator: {} for navigator in navigators}
    for beacons, recorded in recordings(name):
        for navigator in navigators:
            start_s = SETTLED_S if navigator == "unknown-start" else 0.0
            estimates = NAVIGATORS[navigator](recorded)
            scores_of[navigator][beacons] = score(
                estimates, recorded.measurements, recorded.truth, start_s
            )
    return scores_of


def findings_of(name: str, scores: dict[str, dict[tuple[str, ...], Score]]) -> dict[str, Finding]:
    """Findings on a data set."""
    result: dict[str, Finding] = {}
    for navigator, errors_by_beacons in scores.items():
        pairs = np.array(
            [errors for beacons, errors in errors_by_beacons.items() if len(beacons) == 2]
        )
        all_errors = next(
            errors for beacons, errors in errors_by_beacons.items() if len(beacons) > 2
        )
        mean, _, high, nees = pairs.T  # the fields of `Score`
        values = {
            "pairs": (
                float(np.median(mean)),
                "median over pairs of beacons of the mean error",
                "m",
            ),
            "worst-pair": (float(mean.max()), "largest mean error of a pair of beacons", "m"),
            "high": (float(high.max()), "95 % of errors are smaller, with the worst pair", "m"),
            "nees-least": (float(nees.min()), "of all pairs", ""),
            "nees-most": (float(nees.max()), "of all pairs", ""),
            "all": (all_errors.mean, "mean error with all beacons", "m"),
            "all-high": (all_errors.high, "95 % of errors are smaller, with all beacons", "m"),
            "all-nees": (all_errors.nees, "with all beacons", ""),
        }
        for key, (value, meaning, unit) in values.items():
            result[f"{key} {navigator} {name}"] = plain_finding(value, meaning, unit)
    return result


def ranges_of(name: str) -> dict[str, Finding]:
    """Findings on the ranges: their scale and their random error, by the surveyed path."""
    data = read_data_set(DATA / f"{name}.mat")
    # columns of the truth: time [s], east and north [m]
    positions = np.column_stack(
        [np.interp(data.range_time, data.truth[:, 0], data.truth[:, k]) for k in (1, 2)]
    )
    true = np.hypot(*(positions - data.places[data.range_beacon]).T)
    scale = float(data.ranges @ true / (true @ true))
    return {
        f"ranges {name}": plain_finding(data.ranges.size, "ranges to all beacons"),
        f"scale {name}": plain_finding(scale - 1.0, "common scale error of all ranges"),
        f"sigma {name}": plain_finding(
            float(np.std(data.ranges - scale * true)), "of what that leaves of the ranges", "m"
        ),
    }


def run(folder: Path) -> None:
    """Navigate on everything and write the record into a folder."""
    findings: dict[str, Finding] = {}
    for name in SETS:
        findings |= ranges_of(name) | findings_of(name, scores(name))
    record("real-ranges", COMMAND, MODULES, findings).write(folder / RESULTS_FILE)
