"""Contact of hulls by geometry, and missions that end with a contact, whose motion is that of
missions that continue.
"""

from typing import Any

import numpy as np
import pytest

from experiments.campaign.montecarlo import simulate_mission
from experiments.campaign.store import CampaignError
from experiments.flight.fly import MissionToFly
from experiments.study.estimate import Results
from experiments.study.measure import facts_of, records_of_run
from experiments.study.run import _row_and_lists
from sim import attitude
from sim.assembly import routes_of, setups_of
from sim.flight import Termination
from sim.scenario.file import validate
from sim.scenario.parts import MissionPlan, MotionSettings, SeaSettings
from sim.scenario.settings import Scenario
from sim.simulation import simulate
from sim.tracking import _first_contacts, contacts, first_touch, hull_gap, pair_distances
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tests import synthetic
from tests.synthetic import make_flight


@pytest.mark.parametrize(
    ("offset", "other_axis", "gap"),
    [
        ((0.0, 0.5, 0.0), (1.0, 0.0, 0.0), 0.5),  # side by side
        ((3.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.3),  # one before the other: 3 less both halves
        ((0.0, 0.4, 0.0), (0.0, 0.0, 1.0), 0.4),  # crossed at right angles
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.3),  # a T: 1 less the half of the upright one
        ((2.0, 1.0, 0.0), (1.0, 0.0, 0.0), np.hypot(1.0, 0.3)),  # offset and parallel
    ],
)
def test_the_gap_of_two_hulls_is_that_of_their_axes(
    offset: tuple[float, ...], other_axis: tuple[float, ...], gap: float
) -> None:
    axis = np.array([1.0, 0.0, 0.0])
    actual = hull_gap(np.array(offset), axis, np.array(other_axis), (1.0, 0.7))
    assert actual == pytest.approx(gap, abs=1e-9)


def test_no_two_points_of_hulls_are_nearer_than_their_gap() -> None:
    """By a search over points along both axes, 1 cm apart."""
    rng, halves = np.random.default_rng(8), (1.0, 0.7)
    positions_on_axes = np.stack(
        np.meshgrid(np.linspace(-1.0, 1.0, 201), np.linspace(-0.7, 0.7, 141)), axis=-1
    )
    for _ in range(40):
        axis, other_axis = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
        offset = rng.normal(0.0, 1.0, 3)
        offsets = (
            offset + positions_on_axes[..., 1:] * other_axis - positions_on_axes[..., :1] * axis
        )
        least_distance = np.linalg.norm(offsets, axis=-1).min()
        assert hull_gap(offset, axis, other_axis, halves) == pytest.approx(
            least_distance, abs=0.008
        )
        assert hull_gap(offset, axis, other_axis, halves) <= least_distance + 1e-12


def test_hulls_touch_where_their_skins_meet() -> None:
    """All head north, with a radius of 0.1 m. One approaches the leader from astern at 1 m/s, where
    the half lengths of hulls are 1 and 0.7 m; another one from abeam at 0.5 m/s.
    """
    flight = make_flight(10.0, 2)
    trajectory, time = flight.trajectory, flight.trajectory.time
    position = np.zeros_like(trajectory.position)
    position[:, 1, 1] = -10.05 + time
    position[:, 2, 0], position[:, 2, 1] = 5.07 - 0.5 * time, 1.65
    quaternion = np.broadcast_to(attitude.from_euler(0.0), trajectory.quaternion.shape).copy()
    approaching = synthetic.moved(trajectory, position=position, quaternion=quaternion)
    # 10.05 − t < 1.9 m, and 5.07 − t / 2 < 0.2 m
    assert contacts(approaching) == [
        (pytest.approx(8.2), ("leader", "follower1")),
        (pytest.approx(9.8), ("leader", "follower2")),
    ]
    assert first_touch(approaching.pose) == 82
    assert first_touch(approaching.pose[:82]) is None


def meeting(**changes: Any) -> Scenario:
    """Two followers that move towards each other, 60 m apart at 1 m/s each, and meet halfway."""
    head_on = [
        {"waypoints": [[0, east, 100], [60, 60 - east, 100]], "depth_m": 12.0} for east in (0, 60)
    ]
    return validate({"name": "s", "duration_s": 40.0, "followers": head_on, **changes}, "test")


EXACT_ESTIMATES = {
    "leader": {"waypoints": [[0, -50, 50], [60, 10, 50]]},
    "navigation": {"variant": "laisn-3-2"},
    # with errors of 0.3 m in each position hulls with a diameter of 0.2 m would miss each other
    "sensors": {
        "speed_bias_m_s": 0,
        "speed_sigma_m_s": 0,
        "heading_bias_deg": 0,
        "heading_sigma_deg": 0,
    },
    "acoustics": {"range_tau_m": [0, 0, 0], "range_scale_mean_m": 0, "range_scale_sigma_m": 0},
}
"""Settings with which followers have exact estimates of their positions."""


@pytest.mark.parametrize("changes", [{}, {"motion": "kinematic"}], ids=["physics", "points"])
def test_a_mission_ends_with_the_contact_that_one_that_continues_records(
    changes: dict[str, Any],
) -> None:
    whole, outcome_of_whole = MissionToFly(meeting(**changes)).simulate()
    ended, outcome = MissionToFly(meeting(contact="end", **changes)).simulate()
    assert (outcome_of_whole, outcome) == (Termination.COMPLETED, Termination.CONTACT)
    # bows meet when both have moved by 30 m, less half a hull
    assert ended.time[-1] == pytest.approx(30.0 - 0.7, abs=0.5)
    assert contacts(ended) == [(ended.time[-1], ("follower-1", "follower-2"))] == contacts(whole)
    for name in ("time", "position", "quaternion", "velocity", "effector_states"):
        np.testing.assert_array_equal(getattr(ended, name), getattr(whole, name)[: ended.time.size])


def test_a_simulation_until_contact_ends_at_the_instant_of_contact() -> None:
    """At the instant of contact, not at the end of the block of steps of compiled code."""
    scenario = meeting()
    routes = routes_of(MissionPlan.of(scenario))
    plant = Plant(setups_of(MissionPlan.of(scenario), routes), ocean_of(SeaSettings.of(scenario)))
    trajectory = simulate(plant, routes, 40.0, until_contact=True)
    assert first_touch(trajectory.pose) == trajectory.time.size - 1
    assert trajectory.time[-1] < 31.0


def test_without_contact_a_flight_reaches_its_end() -> None:
    trajectory, outcome = MissionToFly(meeting(contact="end", duration_s=10.0)).simulate()
    assert (trajectory.time[-1], outcome) == (10.0, Termination.COMPLETED)


def test_a_campaign_names_the_mission_that_contact_ends() -> None:
    with pytest.raises(
        CampaignError, match=r"'s': at 29\.\d s follower-1 and follower-2 touched, which ended"
    ):
        simulate_mission(meeting(contact="end"))


def test_facts_list_the_vehicles_in_contact() -> None:
    scenario = meeting()
    assert [
        facts["touched"]
        for facts in facts_of(MotionSettings.of(scenario), simulate_mission(scenario))
    ] == [1.0, 1.0]


def test_a_run_that_contact_ended_is_counted_and_is_in_no_mean() -> None:
    """Of three runs of a closed loop; the two that reached their end have mean errors of 1 and
    3 m.
    """
    scenario = meeting(contact="end", **EXACT_ESTIMATES)
    followers = tuple(
        follower.model_copy(update={"guidance_position": "estimate"})
        for follower in scenario.followers
    )
    ended_records = records_of_run(scenario.model_copy(update={"followers": followers}), 7)
    assert [
        (row["run"], row["ended"], row["touched"], row["e_p_mean_m"]) for row in ended_records
    ] == [(7, True, 1.0, None)] * 2

    def completed_record(run: int, error: float) -> dict[str, Any]:
        record = dict.fromkeys(ended_records[0], error)
        return record | {
            "run": run,
            "ended": False,
            "touched": 0.0,
            "mirror_locked": False,
            "gated": 2,
        }

    class Entry:
        scenario = meeting()

    row, lists = _row_and_lists(
        Entry, 0, [[completed_record(0, 1.0)], [ended_records[0]], [completed_record(2, 3.0)]]
    )  # type: ignore[arg-type]
    assert (row["e_p_mean_m"], row["e_p_max_m"], row["worst_run"]) == (2.0, 3.0, 2)
    assert (row["ended_runs"], row["mirror_locked_runs"], row["fixes_gated"]) == (1, 0, 4)
    position_in_study = {"point": 0, "arm": "", "follower": "a", "sea": 0}
    actual = Results.of([position_in_study | row], [(position_in_study, lists)])
    assert actual.estimate((0, "", "a"), "e_p_mean_m").value == 2.0
    assert actual.estimate((0, "", "a"), "ended").value == pytest.approx(1 / 3)
    # upper limit of Clopper and Pearson for one of three
    assert actual.estimate((0, "", "a"), "ended").high == pytest.approx(0.906, abs=1e-3)


def test_a_mission_in_blocks_has_the_contacts_and_distances_of_a_whole_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Vehicles whose paths cross at random, in blocks of 64 instants."""
    rng = np.random.default_rng(11)
    n = 1000
    pose = np.zeros((n, 4, 7))
    phase = rng.uniform(0.0, 6.0, (4, 3)) + np.linspace(0.0, 20.0, n)[:, None, None]
    pose[..., :3] = (4.0, 4.0, 0.4) * np.sin(phase * rng.uniform(0.7, 1.3, (4, 3)))
    pose[..., 3:] = attitude.from_euler(rng.uniform(0.0, 6.0, (n, 4)))
    expected_contacts = _first_contacts(pose)
    expected_distances = pair_distances(pose[..., :3])
    assert np.count_nonzero(expected_contacts >= 0) >= 3
    assert expected_contacts.max() > 64
    monkeypatch.setattr("sim.trajectory._BLOCK", 64)
    np.testing.assert_array_equal(_first_contacts(pose), expected_contacts)
    for actual, expected in zip(pair_distances(pose[..., :3]), expected_distances, strict=True):
        np.testing.assert_array_equal(actual, expected)
