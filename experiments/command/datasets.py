"""Data sets of real ranges: import as logs, and navigation on these."""

from collections.abc import Iterable, Sequence
from math import isnan
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from experiments.campaign.progress import literal, tell
from experiments.command.replaying import require_own_file, write_states
from laisn.failure import LaisnError

_TIGHT = "tight"
_LARGE = 1e5
"""Errors beyond this are printed by their order of magnitude [m]."""


def import_data_set(source: Path, out: Path, beacons: str | None) -> None:
    """Write a data set as a log.

    Args:
        source: factor graph or data set of ranging radios.
        out: the log.
        beacons: names of those whose ranges are kept, with commas between; None: all.

    Raises:
        LaisnError: the file cannot be read or lacks a beacon, or the log's name is invalid.
    """
    from sim.datasets.log import VEHICLE, read_data_set, write_data_set

    require_own_file(out, ".mcap", source)
    data = read_data_set(source)
    if beacons is not None:
        data = data.among([name.strip() for name in beacons.split(",") if name.strip()])
    write_data_set(data, out)
    console = Console()
    tell(console, f"{VEHICLE}: {len(data.odometry)} steps of odometry in {data.time[-1] - data.time[0]:.1f} s")
    for i, (name, (east, north)) in enumerate(zip(data.beacons, data.places[:, :2], strict=True)):
        ranges = (data.range_beacon == i).sum()
        tell(console, f"beacon {name} at {east:.2f} m east, {north:.2f} m north: {ranges} ranges")
    tell(console, f"path to compare with: {len(data.truth)} places")
    for remark in data.remarks:
        tell(console, remark, "note:")
    tell(console, f"log in {out}")


def _split(assignments: Iterable[str]) -> tuple[list[str], dict[str, object]]:
    """Assignments `navigation.…`, and values of `beacons.…` by key; LaisnError naming any other key."""
    from sim.scenario.file import values_of

    navigation: list[str] = []
    beacons: dict[str, object] = {}
    for assignment in assignments:
        ((key, value),) = values_of([assignment]).items()
        section, _, name = key.partition(".")
        if section == "beacons":
            beacons[name] = value
        elif section == "navigation":
            navigation.append(assignment)
        else:
            raise LaisnError(f"--set {key}: a replay of a data set takes navigation.… (LAISN) and beacons.… (tight)")
    return navigation, beacons


def replay_data_set(
    path: Path, variant: str, assignments: Sequence[str], out: Path | None, longest_gap_s: float
) -> None:
    """Navigate on the log of a data set, and print errors beside those of dead reckoning.

    Args:
        path: log that `import_data_set` wrote.
        variant: name of a LAISN variant, or "tight".
        assignments: overrides, `navigation.key=value` of LAISN or `beacons.key=value` of the navigator among beacons.
        out: CSV file for the estimates; None: none.
        longest_gap_s: longest gap between own measurements that is bridged [s].

    Raises:
        LaisnError: the log cannot be read, or an argument is invalid.
    """
    from experiments.flight.library import load_flyable
    from experiments.real_ranges.navigating import among_beacons, by_laisn, dead_reckoning, score
    from experiments.real_ranges.settings import beacons_of
    from laisn.settings import NavigationSettings
    from sim.datasets.log import VEHICLE, read_data_set_log
    from sim.flight import navigation_settings
    from sim.motion import simulate_motion

    require_own_file(out, ".csv", path)
    navigation, beacons = _split(assignments)
    settings_of_beacons = beacons_of(beacons)
    recorded = read_data_set_log(path, longest_gap_s)
    if variant == _TIGHT:
        if navigation:
            raise LaisnError(f"--set {navigation[0]}: the variant {_TIGHT} takes beacons.… in a data set")
        estimates, medium = among_beacons(recorded, settings_of_beacons)
        title = f"{variant}, in {medium}"
    else:
        if beacons:
            raise LaisnError(f"--set beacons.{next(iter(beacons))}: is for the variant {_TIGHT}")
        # of this scenario only the settings of navigation are used
        changes = [f"navigation.variant={variant}", "navigation.use_single_range=true", *navigation]
        scenario = load_flyable("T5", [*changes, "motion=kinematic", "duration_s=2"])
        settings = navigation_settings(scenario, simulate_motion(scenario), 0)
        assert isinstance(settings, NavigationSettings)
        estimates, title = by_laisn(recorded, settings), variant
    console, measured = Console(), recorded.measurements
    heads = ("", "mean error [m]", "RMS [m]", "95 % [m]", "NEES", "ends at x, y [m]")
    table = Table(*(Column(literal(head)) for head in heads), box=None, pad_edge=False)
    for name, found in (("dead reckoning", dead_reckoning(recorded)), (title, estimates)):
        errors = score(found, measured, recorded.truth)
        figures = ["–" if isnan(value) else f"{value:.2f}" if value < _LARGE else f"{value:.0e}" for value in errors]
        x, y = found.state[-1, :2]
        table.add_row(literal(name), *figures, f"{x:.2f}, {y:.2f}")
    console.print(table)
    for remark in recorded.remarks:
        tell(console, remark, "note:")
    if out is not None:
        write_states(out, [(VEHICLE, measured.time, estimates.state)])
        tell(console, out)
