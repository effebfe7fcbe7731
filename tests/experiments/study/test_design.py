"""Designs and draws of studies: values where they belong, draws that no other key changes."""

import math

import numpy as np
import pytest
from scipy import stats

from experiments.study.design import Draw, Factor, points_of, value_at
from experiments.study.file import StudyError, study_from_table
from experiments.study.plan import plan_of
from sim.scenario.point_motion import CLASSES


def test_a_range_is_a_grid_with_both_ends():
    linear = Factor.of("x", {"from": 0, "to": 12, "steps": 4})
    assert linear.values == (0, 4, 8, 12)
    log = Factor.of("x", {"from": 0.01, "to": 10, "steps": 4, "scale": "log"})
    assert log.values == (0.01, 0.1, 1, 10)


def test_a_factorial_design_has_every_combination():
    factors = [Factor.of("a", [1, 2, 3]), Factor.of("b", ["x", "y"])]
    points = points_of(factors, "factorial", None, 1, 6)
    assert len(points) == 6
    assert {(point["a"], point["b"]) for point in points} == {
        (a, b) for a in (1, 2, 3) for b in "xy"
    }


def test_points_are_counted_before_they_are_made():
    """Three factors of 10,000 steps are 10¹² points, which no machine holds."""
    factors = [Factor.of(key, {"from": 0, "to": 1, "steps": 10_000}) for key in "abc"]
    with pytest.raises(ValueError, match=r"1,000,000,000,000 points, at most 200,000"):
        points_of(factors, "factorial", None, 1, 200_000)


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol"])
def test_a_sampled_design_has_one_point_in_every_stratum_of_every_factor(design):
    """Both designs put one of n points into each nth of every range."""
    factors = (
        Factor.of("a", {"from": 2, "to": 4}, sampled=True),
        Factor.of("b", {"from": 1, "to": 100, "scale": "log"}, sampled=True),
    )
    points = points_of(factors, design, 16, 1, 99)
    fractions = np.array(
        [[(point["a"] - 2) / 2, math.log(point["b"]) / math.log(100)] for point in points]
    )
    assert np.array_equal(
        np.sort(np.floor(16 * fractions).astype(int), axis=0),
        np.arange(16)[:, None].repeat(2, axis=1),
    )
    assert points == points_of(factors, design, 16, 1, 99)
    assert points != points_of(factors, design, 16, 2, 99)


@pytest.mark.parametrize(
    ("specification", "expected"),
    [
        ([], "empty"),
        ([1, 1], "twice"),
        ({"from": 0}, "from, to and steps"),
        ({"from": 0, "to": 1}, "steps"),
        ({"from": 0, "to": 1, "steps": 2, "scale": "log"}, "positive"),
        ({"from": 0, "to": 0, "steps": 2}, "different"),
        ({"from": 0, "to": 1, "steps": 2, "step": 1}, "unknown step"),
    ],
)
def test_an_invalid_factor_is_reported_with_the_expectation(specification, expected):
    with pytest.raises(ValueError, match=expected):
        Factor.of("x", specification)


def test_a_sobol_design_needs_a_power_of_two():
    with pytest.raises(ValueError, match="such as 32"):
        points_of([Factor.of("a", {"from": 0, "to": 1}, sampled=True)], "sobol", 30, 1, 99)


@pytest.mark.parametrize(
    ("specification", "law"),
    [
        ({"uniform": [0.2, 0.8]}, stats.uniform(0.2, 0.6)),
        ({"normal": [1.0, 0.1]}, stats.norm(1.0, 0.1)),
        ({"truncnorm": [1.0, 0.5, 0.9, 2.0]}, stats.truncnorm(-0.2, 2.0, 1.0, 0.5)),
        ({"gamma": {"a": 2.0, "scale": 3.0}}, stats.gamma(2.0, scale=3.0)),
    ],
)
def test_draws_follow_their_law(specification, law):
    """By the Kolmogorov-Smirnov test of 1000 draws with fixed seeds, which the right law fails once
    in a thousand.
    """
    draw = Draw.of("leader.mass", specification)
    assert (
        stats.kstest([draw.value(1, realization) for realization in range(1000)], law.cdf).pvalue
        > 1e-3
    )


@pytest.mark.parametrize(
    ("specification", "law"),
    [
        ({"uniform": [0.2, 0.7]}, stats.uniform(0.2, 0.7 - 0.2)),
        ({"normal": [1.1, 0.13]}, stats.norm(1.1, 0.13)),
    ],
)
def test_draws_without_scipy_stats_are_those_with_it_to_the_bit(specification, law):
    quantile = Draw.of("leader.mass", specification).quantile
    probabilities = np.random.default_rng(1).random(1000)
    assert [quantile(probability, []) for probability in probabilities.tolist()] == law.ppf(
        probabilities
    ).tolist()


def test_choices_come_equally_often():
    draw = Draw.of("navigation.variant", {"choice": ["a", "b", "c"]})
    actual = [draw.value(1, realization) for realization in range(1000)]
    assert stats.chisquare([actual.count(choice) for choice in "abc"]).pvalue > 1e-3


def test_draws_of_keys_realizations_and_seeds_are_independent():
    draw, draw_of_other_key = (Draw.of(key, {"uniform": [0, 1]}) for key in ("a", "b"))
    values = [draw.value(1, realization) for realization in range(1000)]
    for other_values in (
        [draw_of_other_key.value(1, realization) for realization in range(1000)],
        [draw.value(2, realization) for realization in range(1000)],
        [draw.value(1, realization + 1) for realization in range(1000)],
    ):
        assert abs(np.corrcoef(values, other_values)[0, 1]) < 4 / math.sqrt(1000)


@pytest.mark.parametrize(
    ("specification", "expected"),
    [
        (0.3, "one distribution"),
        ({"uniforn": [0, 1]}, "unknown distribution"),
        ({"uniform": [1, 0]}, r"\[low, high\]"),
        ({"uniform": [1]}, r"\[low, high\]"),
        ({"uniform": [1, 1]}, "no values"),
        ({"normal": [1, 0]}, "no values"),
        ({"gamma": [2]}, "table of its parameters"),
        ({"gamma": {"b": 2}}, "gamma"),
        ({"normal": {"scale": -1}}, "no values"),
        ({"choice": 3}, "list"),
    ],
)
def test_an_invalid_draw_is_reported_with_the_expectation(specification, expected):
    with pytest.raises(ValueError, match=expected):
        Draw.of("x", specification)


def test_a_route_is_drawn_for_each_realization_from_its_class(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Waypoints depend on seed, realization and key alone; with `any`, all classes come up."""
    key = "followers.0.waypoints"
    near_class = Draw.of(key, {"route_class": "50-near-alike"})
    assert near_class.value(3, 0) == near_class.value(3, 0) != near_class.value(3, 1)
    legs = np.diff([time for time, _, _ in near_class.value(3, 0)])
    assert np.all(legs[:-1] <= 80.0), "a class of near waypoints"
    any_class = Draw.of(key, {"route_class": "any"})
    is_far = [
        np.diff([time for time, _, _ in any_class.value(3, realization)]).min() >= 100.0
        for realization in range(24)
    ]
    assert 4 <= sum(is_far) <= 20, "half of the classes have waypoints far apart"
    with pytest.raises(
        ValueError, match=r"route_class expects any, 50-near-alike, .*\(given: 'near'\)"
    ):
        Draw.of(key, {"route_class": "near"})
    monkeypatch.setattr("experiments.study.design.random_waypoints", lambda name, _: name)
    assert {any_class.value(3, realization) for realization in range(200)} == set(CLASSES)


def test_a_formation_is_drawn_for_each_realization_and_keeps_its_distances() -> None:
    area = {
        "count": 8,
        "spacing_m": 7.0,
        "behind_m": 12.0,
        "length_m": 30.0,
        "width_m": 50.0,
        "layer_m": 0.5,
    }
    draw = Draw.of("followers", {"formation": area})
    formations = [draw.value(1, realization) for realization in range(40)]
    assert formations[3] == Draw.of("followers", {"formation": area}).value(1, 3)
    positions_of_draws = []
    for followers in formations:
        stations = [follower["station"] for follower in followers]
        positions = np.array([(station["behind_m"], station["port_m"]) for station in stations])
        distances = np.hypot(
            *(positions[:, None] - positions[None]).transpose(2, 0, 1)
        ) + 100.0 * np.eye(8)
        assert distances.min() >= 7.0
        assert [station["depth_m"] for station in stations] == [10.0 + 0.5 * i for i in range(8)]
        positions_of_draws.append(positions)
    # drawn evenly: means are at the middle of the area, to within three standard errors of 320
    # stations
    behind, port = np.concatenate(positions_of_draws).T
    assert (behind.min() >= 12.0, behind.max() <= 42.0, np.abs(port).max() <= 25.0) == (
        True,
        True,
        True,
    )
    assert behind.mean() == pytest.approx(27.0, abs=3 * 30.0 / np.sqrt(12 * 320))
    assert port.mean() == pytest.approx(0.0, abs=3 * 50.0 / np.sqrt(12 * 320))


@pytest.mark.parametrize(
    ("specification", "expected"),
    [
        (
            {"count": 0},
            "formation expects a table with count, spacing_m, .*; count: Input should be greater",
        ),
        ({"cuont": 3}, "count: Field required"),
        ("any", "formation expects a table"),
        (
            {"count": 50, "length_m": 10.0, "width_m": 10.0},
            "50 stations 6 m apart do not fit into the area",
        ),
    ],
)
def test_a_formation_that_cannot_be_drawn_is_refused(specification: object, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Draw.of("followers", {"formation": specification})


def test_a_value_may_differ_from_run_to_run():
    assert [value_at({"cycle": ["a", "b", "c"]}, run) for run in range(5)] == [
        "a",
        "b",
        "c",
        "a",
        "b",
    ]
    assert [value_at({"rotate": 100}, run) for run in range(5)] == [0, 100, 200, 300, 40]
    assert [value_at(specification, 3) for specification in (2.5, [1, 2], {"kind": "jonswap"})] == [
        2.5,
        [1, 2],
        {"kind": "jonswap"},
    ]


def test_a_study_gives_each_run_its_values_and_every_follower_the_same():
    arm = {"name": "a", "title": "any direction", "every": 2, "followers": {"*": {"depth_m": 9.0}}}
    table = {
        "scenario": "swarm",
        "runs": 5,
        "set": {"ocean.current_direction_deg": {"rotate": 90}},
        "arm": [arm],
    }
    plan = plan_of(study_from_table(table, "s", "s"))
    (entry,) = plan.entries
    assert list(plan.runs_of(entry)) == [0, 2, 4]
    assert plan.flights == 3
    assert plan.study.title("arm", "a") == "any direction"
    scenarios = [entry.scenario_at(run) for run in range(5)]
    assert [scenario.run for scenario in scenarios] == [0, 1, 2, 3, 4]
    assert [scenario.ocean.current_direction_deg for scenario in scenarios] == [0, 90, 180, 270, 0]
    assert {follower.depth_m for scenario in scenarios for follower in scenario.followers} == {9.0}
    assert scenarios[0] == entry.scenario


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"set": {"ocean.current_speed_m_s": {"cycle": []}}},
            r"expected \{ cycle = \[value, …\] \} or \{ rotate = ",
        ),
        ({"set": {"ocean.current_speed_m_s": {"rotate": "x"}}}, r"expected \{ cycle"),
        (
            {"set": {"ocean.current_speed_m_s": {"cycle": [-1.0]}}},
            r"ocean.current_speed_m_s: .*greater than or equal",
        ),
        (
            {"arm": [{"name": "a", "every": 0}]},
            r"arm\[0\].every: Input should be greater .*1 \(given: 0\)",
        ),
        (
            {"scenario": "T5", "arm": [{"name": "a", "every": 2}]},
            r"arm a: every applies to closed loops",
        ),
        ({"set": {"followers.*.no_key": 1}}, r"followers\[0\].no_key: unknown key"),
        (
            {
                "scenario": "T5",
                "arm": [
                    {"name": "a"},
                    {
                        "name": "b",
                        "navigation.variant": "tight",
                        "navigation.assume.known_start": False,
                    },
                ],
            },
            r"arm b: navigation.assume.known_start = false is for closed loops",
        ),
    ],
)
def test_invalid_values_of_runs_are_refused(keys, message):
    with pytest.raises(StudyError, match=message):
        plan_of(study_from_table({"scenario": "swarm"} | keys, "s", "s"))
