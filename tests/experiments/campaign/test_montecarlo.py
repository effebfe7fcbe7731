"""Campaigns: a fused run is the run that is flown alone, and its metrics are those of its
history.
"""

from dataclasses import replace

import numpy as np
import pytest

from experiments.campaign import lane_flight
from experiments.campaign.montecarlo import PERCENTILES, Cell, CellResult, histories, simulate
from laisn import POSITION, metrics
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.navigator import Navigator
from laisn.settings import LAISN_VARIANTS, NavigationSettings, Variant
from laisn.swarm import MESSAGE
from sim.sensing.observation import IdealMeasurements, measure
from sim.sensing.sensors import SensorErrors

DT = 0.1


QUARTER, ASTERN, ABEAM = (-15.0, -12.0), (-20.0, 0.0), (4.9, -39.7)
"""East and north [m] of a follower from its leader, which heads east, give or take 9°; abeam, the
middle transmitter is farthest.
"""


def make_truth(
    steps: int = 200,
    every: int = 10,
    *,
    offset: tuple[float, float] = QUARTER,
    attitude: bool = True,
) -> IdealMeasurements:
    """A leader on a slow weave, and a follower about 2 m deeper that circles with a radius of
    0.5 m about its place, unless it is astern.

    There is a message every `every` steps; some ranges to the front transmitter are lost.
    """
    t = DT * np.arange(steps + 1)
    leader = np.stack([t, 3.0 * np.sin(0.05 * t)], axis=1)
    heading = np.pi / 2 - np.arctan(0.15 * np.cos(0.05 * t))
    radius = 0.0 if offset == ASTERN else 0.5
    follower = (
        leader + np.array(offset) + radius * np.stack([np.cos(0.1 * t), np.sin(0.1 * t)], axis=1)
    )
    velocity = np.gradient(follower, DT, axis=0)
    depth = 10.0 + 0.3 * np.sin(0.2 * t)
    forward, port = (
        np.stack([np.sin(heading), np.cos(heading)], axis=1),
        np.stack([-np.cos(heading), np.sin(heading)], 1),
    )
    sites = [leader - forward, leader + forward, leader + 0.1 * port]
    ranges = np.stack(
        [np.sqrt(np.sum((follower - site) ** 2, axis=1) + (depth - 8.0) ** 2) for site in sites],
        axis=1,
    )
    k = np.arange(every, steps + 1, every)
    slant_range = ranges[k].copy()
    slant_range[3::7, 1] = np.nan
    not_sent = np.full(k.size, np.nan)
    return IdealMeasurements(
        dt=DT,
        start=np.concatenate([follower[0], velocity[0]]),
        speed=np.hypot(*velocity[1:].T),
        heading=np.arctan2(*velocity[1:].T),
        depth=depth[1:],
        hydrophone=follower[1:],
        leader_position=leader[1:],
        leader_heading=heading[1:],
        message_step=k,
        emission_step=k - 1,
        sent=np.rec.fromarrays(
            [
                k * DT,
                *leader[k].T,
                heading[k],
                np.hypot(1.0, 0.15 * np.cos(0.05 * t[k])),
                np.full(k.size, 8.0),
                *(0.05 * np.stack([np.sin(t[k]), np.cos(t[k])]) * (1.0 if attitude else np.nan)),
                not_sent,
                not_sent,
            ],
            dtype=MESSAGE,
        ),
        slant_range=slant_range,
    )


ALL_ERRORS = SensorErrors(
    depth_sigma=0.05,
    leader_speed_bias=0.05,
    leader_heading_bias=0.04,
    leader_heading_sigma=0.02,
    leader_depth_sigma=0.04,
    leader_position_sigma=0.3,
    leader_position_walk=0.05,
    leader_tilt_sigma=0.01,
    leader_tilt_time=4.0,
    leader_attitude_offset_sigma=0.015,
    range_tau=(0.02, 0.03, 0.04),
    range_scale_mean=0.2,
)


ECHOES = ALL_ERRORS._replace(
    surface_echo_probability=0.2, bottom_echo_probability=0.1, range_error_centred=True
)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
@pytest.mark.parametrize(
    ("errors", "offset"),
    [
        (SensorErrors(), QUARTER),
        (SensorErrors(range_tau=(0.06, 0.01, 0.01), range_error_centred=True), QUARTER),
        (ALL_ERRORS, QUARTER),
        (ECHOES, ABEAM),
        (ALL_ERRORS, ABEAM),
    ],
    ids=["paper", "centred", "everything", "echoes abeam", "abeam"],
)
def test_a_run_of_a_campaign_is_the_run_flown_alone(
    variant: Variant, errors: SensorErrors, offset: tuple[float, float]
) -> None:
    truth = make_truth(offset=offset)
    if offset == ABEAM:
        assert np.all(
            np.argmax(truth.slant_range, axis=1)[np.isfinite(truth.slant_range[:, 1])] == 2
        )
    navigation = NavigationSettings(variant=variant, use_attitude=True)
    states = histories(
        Cell(truth=truth, errors=errors, settings=navigation, seed=9, runs=range(70), follower=2)
    )
    for run in (0, 63, 69):
        measurements = measure(
            truth, errors, seed=9, run=run, follower=2, transmitters=navigation.transmitters
        )
        alone = Navigator(navigation, truth.start).run(measurements)
        assert np.abs(states[:, :, run] - alone.state).max() < 1e-9


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_metrics_are_those_of_the_histories(variant: Variant) -> None:
    # Astern of the leader with a large β: fixes of all kinds, and mirror locks on the wrong side.
    truth = make_truth(offset=ASTERN, attitude=False)
    errors = SensorErrors(range_scale_mean=0.3, range_tau=(0.2, 0.2, 0.2))
    navigation = NavigationSettings(variant=variant, gate="v-measured", position_sigma0=3.0)
    runs = range(5, 12)
    result = simulate(Cell(truth=truth, errors=errors, settings=navigation, seed=4, runs=runs))

    transmitters = navigation.transmitters
    received = [measure(truth, errors, seed=4, run=run, transmitters=transmitters) for run in runs]
    alone = [Navigator(navigation, truth.start).run(measurements) for measurements in received]
    position = np.stack(
        [
            metrics.position_errors(estimates.state[:, POSITION], truth.hydrophone)
            for estimates in alone
        ]
    )
    bearing = np.stack(
        [
            metrics.bearing_errors(
                estimates.state[:, POSITION], truth.hydrophone, truth.leader_position
            )
            for estimates in alone
        ]
    )
    row, run_arrays = result
    expected = metrics.summarise(position, bearing)
    for name, value in expected._asdict().items():
        assert row[name] == pytest.approx(value, abs=1e-8), name
    assert row["nees"] == pytest.approx(
        np.nanmean([metrics.nees(estimates, truth.hydrophone) for estimates in alone]), rel=1e-6
    )
    assert row["nis"] == pytest.approx(
        np.nanmean(np.concatenate([metrics.nis(estimates) for estimates in alone])), rel=1e-6
    )
    counts = [metrics.fix_counts(estimates) for estimates in alone]
    assert {kind: row[f"fixes_{kind}"] for kind in counts[0]} == {
        kind: sum(counts_of_run[kind] for counts_of_run in counts) for kind in counts[0]
    }
    mirror_locks = [
        metrics.mirror_locked_steps(
            estimates.state[:, POSITION],
            truth.hydrophone,
            truth.leader_position,
            truth.leader_heading,
        )
        for estimates in alone
    ]
    mirror_locked = np.array([metrics.longest_mirror_lock(steps) >= 10 for steps in mirror_locks])
    assert row["mirror_locked_runs"] == mirror_locked.sum()
    unlocked = position[~mirror_locked]
    assert row["e_p_mean_unlocked_m"] == (
        pytest.approx(unlocked.mean(), rel=1e-9) if unlocked.size else None
    )
    assert row["worst_run"] == runs[int(np.argmax(position.max(axis=1)))]

    assert run_arrays["run"].tolist() == list(runs)
    assert run_arrays["mirror_locked"].tolist() == mirror_locked.tolist()
    assert run_arrays["gated"].tolist() == [counts_of_run["gated"] for counts_of_run in counts]
    assert run_arrays["e_p_max_m"] == pytest.approx(position.max(axis=1), abs=1e-9)
    assert run_arrays["e_p_mean_m"] == pytest.approx(position.mean(axis=1), abs=1e-9)
    assert run_arrays["e_b_max_deg"] == pytest.approx(np.rad2deg(bearing.max(axis=1)), abs=1e-8)
    assert run_arrays["e_b_mean_deg"] == pytest.approx(np.rad2deg(bearing.mean(axis=1)), abs=1e-8)

    # A percentile of the histogram lies between its neighbours among the sorted errors, give or
    # take a bin, which is at most 1/128 wide.
    for step_errors, name in ((position, "e_p_p{}_m"), (np.rad2deg(bearing), "e_b_p{}_deg")):
        for percentile in PERCENTILES:
            value = row[name.format(percentile)]
            below = np.percentile(step_errors, percentile, method="lower")
            above = np.percentile(step_errors, percentile, method="higher")
            assert below * (1 - 2**-7) <= value <= above * (1 + 2**-7)


@compiled
def _bin_numbers(values: Floats, first: int) -> Ints:
    out = np.empty(values.size, dtype=np.int64)
    for i in range(values.size):
        out[i] = lane_flight._bin(values[i], first)
    return out


@pytest.mark.parametrize(
    ("lowest", "first"),
    [(lane_flight.LOWEST_P, lane_flight._FIRST_P), (lane_flight.LOWEST_B, lane_flight._FIRST_B)],
)
def test_bins_hold_what_lies_between_their_edges(lowest: float, first: int) -> None:
    edges = lane_flight.bin_edges(lowest)
    assert edges.size == lane_flight.BINS + 1
    assert (edges[0], edges[1], edges[-1]) == (0.0, lowest, np.inf)
    inner = edges[1:-1]
    # 128 bins of equal width between a power of two and the next: from 1/128 of their lower edge
    # down to 1/255 of it
    widths = np.diff(inner) / inner[:-1]
    assert widths.max() == 2**-7
    assert widths.min() == pytest.approx(1 / 255, rel=1e-12)
    values = np.concatenate(
        [[0.0, lowest / 3], lowest * np.exp(np.random.default_rng(1).uniform(0, 22, 5000)), inner]
    )
    assert _bin_numbers(values, first).tolist() == (np.digitize(values, edges) - 1).tolist()


def test_percentiles_lie_where_they_fall_within_a_bin() -> None:
    edges = lane_flight.bin_edges(lane_flight.LOWEST_P)
    histogram = np.zeros(lane_flight.BINS, dtype=np.int64)
    bin_number = np.digitize([0.5], edges)[0] - 1
    histogram[[bin_number, bin_number + 40]] = 3, 1
    # of four values, one is a third of the way through the bin that holds three
    for fraction, expected in (
        (0.25, edges[bin_number] + (edges[bin_number + 1] - edges[bin_number]) / 3),
        (0.75, edges[bin_number + 1]),
    ):
        actual = lane_flight.percentile(histogram, lane_flight.LOWEST_P, fraction, 10.0)
        assert actual == pytest.approx(expected, rel=1e-12)
    # the largest bounds what a bin may be read as
    largest = (edges[bin_number + 40] + edges[bin_number + 41]) / 2
    assert lane_flight.percentile(histogram, lane_flight.LOWEST_P, 1.0, largest) == largest


def test_figures_of_a_run_that_is_alone_are_those_of_its_history() -> None:
    """Percentiles, and the share of steps whose NEES is likely, are of all its steps."""
    truth = make_truth(400)
    cell = Cell(truth=truth, settings=NavigationSettings(dt=DT), runs=range(4, 5))
    row = simulate(cell).row
    estimate = histories(cell)[:, :2, 0]
    errors = metrics.position_errors(estimate, truth.hydrophone)
    bearings = np.rad2deg(metrics.bearing_errors(estimate, truth.hydrophone, truth.leader_position))
    for p in (50, 90, 95, 99):
        assert row[f"e_p_p{p}_m"] == pytest.approx(np.percentile(errors, p), rel=0.02)
        assert row[f"e_b_p{p}_deg"] == pytest.approx(np.percentile(bearings, p), rel=0.02)
    assert row["e_p_mean_m"] == pytest.approx(errors.mean(), rel=1e-12)
    # of two runs, of which this is one, steps are judged one after the other
    both = simulate(replace(cell, runs=range(4, 6)))
    assert row["nees"] == both.runs["nees"][0]


def test_results_depend_neither_on_threads_nor_on_blocks() -> None:
    truth = make_truth(60)
    cells = [
        Cell(truth=truth, settings=NavigationSettings(variant=variant), runs=range(3, 3 + count))
        for variant, count in (("laisn-2", 60), ("laisn-3-1", 150), ("laisn-3-2", 1))
    ]
    alone = [simulate(cell) for cell in cells]
    for threads in (1, 2, 3):
        for single_thread, several_threads in zip(
            alone, [simulate(cell, threads=threads) for cell in cells], strict=True
        ):
            assert_same(single_thread, several_threads)
    # Runs fall into other blocks if the cell begins elsewhere, and are the same to the bit.
    shifted = simulate(replace(cells[1], runs=range(50, 100)))
    for name, values in shifted.runs.items():
        assert values.tobytes() == alone[1].runs[name][47:97].tobytes()


def assert_same(actual: CellResult, expected: CellResult) -> None:
    assert actual.row == expected.row
    for name, values in actual.runs.items():
        assert values.tobytes() == expected.runs[name].tobytes()


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_a_block_of_few_runs_computes_what_a_full_one_does(variant: Variant) -> None:
    """A run that is alone, and runs that fill part of a vector, or parts of several."""
    settings = NavigationSettings(dt=DT, variant=variant)
    errors = ECHOES._replace(loss_probability=0.2)
    cell = Cell(truth=make_truth(), errors=errors, settings=settings, runs=range(64))
    full = simulate(cell).runs
    for some_runs in (range(1), range(7, 8), range(2), range(5, 14), range(20, 53)):
        arrays = simulate(replace(cell, runs=some_runs)).runs
        for name, values in arrays.items():
            np.testing.assert_array_equal(
                values, full[name][some_runs.start : some_runs.stop], err_msg=name
            )


def test_perfect_sensors_recover_the_truth() -> None:
    truth = make_truth()
    perfect = SensorErrors(
        speed_bias=0.0,
        speed_sigma=0.0,
        heading_bias=0.0,
        heading_sigma=0.0,
        range_tau=(0.0, 0.0, 0.0),
        range_scale_mean=0.0,
        range_scale_sigma=0.0,
    )
    # Without attitude the follower takes the leader as level, and these transmitters are those of
    # a level one: only the sampling of the turn is left.
    result = simulate(Cell(truth=truth, errors=perfect, runs=range(2)))
    # half of what the weave moves sideways in a step, at 0.05 m/s
    assert result.row["e_p_max_m"] < 0.5 * 0.05 * DT
    assert result.row["mirror_locked_runs"] == 0


def test_states_that_are_not_finite_are_reported() -> None:
    # Neither process noise nor speed: nothing is left to divide by.
    truth = replace(make_truth(20), speed=np.zeros(20))
    still = SensorErrors(speed_bias=0.0, speed_sigma=0.0)
    navigation = NavigationSettings(alpha=0.0, sigma_a0=0.0, sigma_speed=0.0)
    with pytest.raises(ValueError, match="run 7 left finite numbers"):
        simulate(Cell(truth=truth, errors=still, settings=navigation, runs=range(7, 9)))
