"""Hulls of users: what a file lacks is named at once, what flies is the file, and the scenario
holds it whole.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import laisn_sim
import models
from experiments.study.file import study_from_table
from experiments.study.plan import plan_of
from laisn.errors import LaisnError
from laisn.metrics import position_errors
from sim.feasibility import cautions, infeasibilities
from sim.flight import FlightRecord, Termination, navigation_settings
from sim.log.scene import hull
from sim.scenario.file import scenario_or_errors
from sim.scenario.settings import Scenario
from sim.vehicle.mjcf import NUMERICS, spec_of
from sim.vehicle.own_hull import hull_errors

FOLLOWER, LEADER = (
    models.path(name).read_text(encoding="utf-8") for name in ("follower", "leader")
)
COMMON_SITES = ("depth_sensor", "cg")


def without_element(element: str, name: str, mjcf_text: str = FOLLOWER) -> str:
    """A hull without one of its sites, actuators or numerics."""
    changed = re.sub(rf'<{element} name="{name}"[^>]*/>', "", mjcf_text)
    assert changed != mjcf_text
    return changed


def test_the_projects_own_hulls_lack_nothing() -> None:
    assert hull_errors(FOLLOWER, "follower") == []
    assert hull_errors(LEADER, "leader") == []


@pytest.mark.parametrize("name", NUMERICS)
def test_a_missing_coefficient_is_named_with_its_unit(name: str) -> None:
    (error,) = hull_errors(without_element("numeric", name), "follower")
    assert error.startswith(f"lacks <numeric name='{name}'>, ")
    assert error.endswith(f"[{NUMERICS[name][1]}]")


@pytest.mark.parametrize(
    ("role", "text", "name"),
    [
        *(("follower", FOLLOWER, name) for name in (*COMMON_SITES, "hydrophone")),
        *(("leader", LEADER, name) for name in ("tx_rear", "tx_front", "tx_middle")),
    ],
)
def test_a_missing_site_is_named(role: str, text: str, name: str) -> None:
    (error,) = hull_errors(without_element("site", name, text), role)
    assert error.startswith(f"lacks <site name='{name}'>, ")


def test_an_actuator_whose_site_is_missing_is_named() -> None:
    (error,) = hull_errors(without_element("site", "thruster_lateral_bow"), "follower")
    assert (
        error
        == "<general name='thruster_lateral_bow'>: there is no <site name='thruster_lateral_bow'>"
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<mujoco><worldbody/></mujoco>", "has no body 'hull'"),
        ("<mujoco><body></mujoco>", "not valid MJCF: "),
        (
            FOLLOWER.replace('data="3 3 3 0 0 0"', 'data="3 3"'),
            "name='linear_damping_fade'> has 2 values, expected 6",
        ),
        (
            FOLLOWER.replace('simple="false"', "").replace(
                'pos="0 0 -0.02" mass', 'pos="0 0 0" mass'
            ),
            'simple="false"',
        ),
        (
            FOLLOWER.replace('<freejoint name="free"/>', '<joint name="a"/>'),
            "must have one <freejoint>",
        ),
        (re.sub(r"<inertial[^>]*>", "", FOLLOWER), "lacks <inertial"),
        (
            FOLLOWER.replace("<asset>", '<asset><texture name="t" type="2d" file="/etc/passwd"/>'),
            "names other files",
        ),
        (FOLLOWER.replace("<asset>", '<include file="other.xml"/><asset>'), "names other files"),
        (FOLLOWER.replace('dyntype="filterexact" dynprm="0.3"', ""), "a state of its own"),
        (re.sub(r"<general name[^>]*>", "", FOLLOWER), "has 0 actuators, expected 1 to 16"),
        (
            FOLLOWER.replace("0 29.43764 0 0 0 0", "0.1 29.43764 0 0 0 0"),
            "added_mass must be symmetric",
        ),
        (
            FOLLOWER.replace("0 29.43764 0 0 0 0", "0 -0.5 0 0 0 0"),
            "hull: added_mass must be symmetric and positive semi",
        ),
        (
            FOLLOWER.replace('<camera name="chase"', '<body name="arm"/><camera name="chase"'),
            "no body beside 'hull'",
        ),
        (
            FOLLOWER.replace(
                "<asset>", '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/>'
            ),
            "<hfield>",
        ),
        (
            FOLLOWER.replace("<asset>", '<asset><mesh name="m" builtin="cone" params="1e6 0.3"/>'),
            "within ±64",
        ),
        (
            FOLLOWER.replace("</custom>", '<numeric name="a" size="1000000000"/></custom>'),
            "within ±1000",
        ),
        (
            FOLLOWER.replace(
                "<worldbody>", '<worldbody><replicate count="1000000"><site/></replicate>'
            ),
            "<replicate>",
        ),
        (FOLLOWER.replace('mass="31.0294"', 'mass="NaN"'), "<inertial mass='NaN'> must be finite"),
        (
            FOLLOWER.replace('mass="31.0294"', 'mass="nan(1)"'),
            "<inertial mass='nan(1)'> must be finite",
        ),
        (
            FOLLOWER.replace('pos="0 0 0.1"/>', 'pos="0 0 1e300"/>'),
            "<site pos='0 0 1e300'> must be finite and within ±1e",
        ),
        (
            FOLLOWER.replace("</body>", '<geom class="fin" size="1 1 1"/>' * 200 + "</body>"),
            "elements <geom>, at most 200",
        ),
        (
            FOLLOWER.replace("<asset>", "<asset>" + '<mesh builtin="sphere" params="4"/>' * 20),
            "has 21 elements <mesh>",
        ),
        (
            without_element("site", "fins_level"),
            "there is no actuator 'hull/fins_level', nor a site of the body 'hull/hull'",
        ),
        (
            FOLLOWER.replace('pos="-0.72 0 0" zaxis="0 1 0"', 'pos="-0.72 0 0" zaxis="1 0 0"'),
            "unit vector across the hull",
        ),
        (
            FOLLOWER.replace('density="0"', 'density="1026"'),
            "<option density='1026'> is a property of the sea: 0",
        ),
        (
            FOLLOWER.replace("</custom>", '<numeric name="fin_x" data="-0.72"/></custom>'),
            "'fin_x'> has no meaning",
        ),
        (
            FOLLOWER.replace('ctrlrange="-40', 'forcerange="-1 1" ctrlrange="-40'),
            "no actuator may have a forcerange",
        ),
        (
            FOLLOWER.replace('density="0"', 'wind="9 0 0"'),
            "<option wind='9 0 0'> is a property of the sea: leave it out",
        ),
    ],
)
def test_an_unusable_hull_is_refused_with_the_reason(
    text: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And MuJoCo has written no file of warnings into the working folder."""
    monkeypatch.chdir(tmp_path)
    assert text != FOLLOWER
    errors = hull_errors(text, "follower")
    assert any(expected in error for error in errors), errors
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["<robot name='arm'><link name='a'/></robot>", "<sdf/>"])
def test_other_formats_are_named_with_the_command_that_converts_them(text: str) -> None:
    (line,) = hull_errors(text, "follower")
    assert "laisn hull --sdf" in line


def test_an_error_that_several_checks_find_is_listed_once() -> None:
    table = {"navigation": {"variant": "missing_plugin:Class"}, "followers": [{"route": "T5"}]}
    _, errors = scenario_or_errors(table, infeasibilities)
    assert len([error for error in errors if "missing_plugin:Class" in error]) == 1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a scenario and its hull, the follower with twice the axial drag coefficient."""
    folder = tmp_path_factory.mktemp("own")
    mjcf_text = FOLLOWER.replace('data="0.2128 0.05596 0.266"', 'data="0.2128 0.11192 0.266"')
    assert mjcf_text != FOLLOWER
    (folder / "mine.xml").write_text(mjcf_text, encoding="utf-8")
    (folder / "mine.toml").write_text(
        'duration_s = 60\n[[followers]]\nroute = "T2"\nmodel = "mine.xml"\n'
    )
    return folder


def test_the_hull_of_the_file_is_flown(folder: Path) -> None:
    """At steady speed through still water the thrust equals the drag: it is larger by the drag of
    the added coefficient.
    """
    own, shipped = (
        laisn_sim.fly(scenario, {"duration_s": 60}) for scenario in (folder / "mine.toml", "T2")
    )
    thrusts = [flight.trajectory.effector_states[-200:, 1, 0].mean() for flight in (own, shipped)]
    speed = shipped.trajectory.forward_speed[-200:, 1]
    added_drag = 0.5 * 1026 * 0.2128 * 0.05596 * np.mean(speed**2)
    assert thrusts[0] - thrusts[1] == pytest.approx(added_drag, rel=0.02)
    np.testing.assert_array_equal(own.trajectory.position[:, 0], shipped.trajectory.position[:, 0])


def test_a_scenario_is_whole_without_the_file(folder: Path, tmp_path: Path) -> None:
    flight = laisn_sim.fly(folder / "mine.toml", {"duration_s": 10})
    flight.scenario.save(tmp_path / "again.toml")
    assert laisn_sim.load(tmp_path / "again.toml") == flight.scenario
    again = laisn_sim.read_log(laisn_sim.write_log(flight, tmp_path / "a.mcap"))
    assert again.scenario == flight.scenario
    assert (
        laisn_sim.fly(again.scenario).trajectory.position.tobytes()
        == flight.trajectory.position.tobytes()
    )


def test_errors_of_a_hull_are_reported_together_with_others(folder: Path) -> None:
    """Keys are validated one by one first and together second; each of these rounds reports all of
    its errors.
    """
    (folder / "bad.xml").write_text(without_element("site", "hydrophone"), encoding="utf-8")
    changes = {"followers.0.model": str(folder / "bad.xml"), "ocean.floor_depth_m": 4.0}
    with pytest.raises(laisn_sim.LaisnError) as caught:
        laisn_sim.load(folder / "mine.toml", changes)
    assert "followers[0].model: lacks <site name='hydrophone'>, the hydrophone" in str(caught.value)
    assert "floor_depth_m" in str(caught.value)


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("absent.xml", "No such file"),
        ("/dev/zero", "it is no plain file"),
        ("/", "it is a folder"),
    ],
)
def test_a_hull_that_is_no_readable_file_is_refused(path: str, reason: str) -> None:
    with pytest.raises(laisn_sim.LaisnError, match=rf"leader\.model: cannot be read: {reason}"):
        laisn_sim.load("T5", {"leader.model": path})


def test_a_study_finds_hulls_beside_its_file(folder: Path) -> None:
    table = {
        "scenario": "T2",
        "set": {"duration_s": 60.0},
        "vary": {"followers.0.model": ["mine.xml"]},
    }
    (entry,) = plan_of(study_from_table(table, "s.toml", "s", folder)).entries
    assert entry.scenario.followers[0].model == (folder / "mine.xml").read_text(encoding="utf-8")
    arms = [{"name": "usual"}, {"name": "mine", "followers": {"0": {"model": "mine.xml"}}}]
    plan = plan_of(study_from_table({"scenario": "T2", "arm": arms}, "s.toml", "s", folder))
    assert [e.scenario.followers[0].model is None for e in plan.entries] == [True, False]


def test_logs_draw_the_hull_of_the_file() -> None:
    def drawn_shapes(model: str) -> dict[str, list[Any]]:
        return hull(spec_of(model).compile())

    without_geoms = re.sub(r"<geom [^>]*/>", "", FOLLOWER)
    assert len(drawn_shapes("follower")["cylinders"]) > 3
    assert not any(drawn_shapes(without_geoms).values())
    # the keyframe of the file is of five thrusters
    without_lateral_thrusters = re.sub(
        r'<(site|general) name="thruster_lateral_[^>]*/>', "", FOLLOWER
    )
    assert repr(drawn_shapes(without_lateral_thrusters)) == repr(drawn_shapes(FOLLOWER))


WITHOUT_VERTICAL_LIFT = {
    'data="0.2128 0.05596 0.266"': 'data="0.2128 0.05596 0"',
    '<numeric name="fins_level.fin" data="0.027 3.09 1.5708 0"/>': "",
}
"""Replacements in the MJCF of the follower that leave it the lift of its upright fins alone."""


def test_what_an_autopilot_cannot_control_is_refused_by_name(tmp_path: Path) -> None:
    text = FOLLOWER
    for old, new in WITHOUT_VERTICAL_LIFT.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "flat.xml").write_text(text, encoding="utf-8")
    changes = {"followers.0.model": str(tmp_path / "flat.xml"), "duration_s": 20}
    with pytest.raises(
        laisn_sim.LaisnError,
        match=r"followers\[0\].model: .*'pitch' needs vertical lift of the hull",
    ):
        laisn_sim.load("T3", changes | {"followers.0.depth_control": "pitch"})
    # thrusters alone hold it, unless they follow too slowly; what passes flies
    by_thrust = laisn_sim.fly(
        "T3", changes | {"followers.0.depth_control": "thrust", "duration_s": 5}
    )
    assert by_thrust.outcome is Termination.COMPLETED
    assert (
        np.abs(by_thrust.trajectory.depth[:, 1] - by_thrust.scenario.followers[0].depth_m).max()
        < 1.0
    )
    (tmp_path / "flat.xml").write_text(text.replace('dynprm="0.3"', 'dynprm="2"'), encoding="utf-8")
    with pytest.raises(laisn_sim.LaisnError, match=r"cannot stabilise heave and pitch at 1 m/s"):
        laisn_sim.load("T3", changes)
    lateral = re.compile(r'<general name="thruster_lateral_(bow|stern)"[^>]*/>')
    (tmp_path / "straight.xml").write_text(lateral.sub("", FOLLOWER), encoding="utf-8")
    with pytest.raises(laisn_sim.LaisnError, match=r"the effectors cannot give yaw independently"):
        laisn_sim.load("T3", {"followers.0.model": str(tmp_path / "straight.xml")})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("10.78728 7.45398", "1e5 7.45398", "too fast for physics steps of 0.02 s"),
        ("0.56 0.72", "0.56 100", "too fast for physics steps of 0.02 s"),
        (
            'data="1.1 1.1"',
            'data="1.1 -1.1"',
            r"cross_flow_drag must be at least 0 \(given: -1.1\)",
        ),
        *(
            (old, new, rf"hull: {name} must be {bound} \(given: ")
            for name, old, new, bound in (
                ("munk_factor", 'data="1"', 'data="2"', "at least 0 and at most 1"),
                ("munk_factor", 'data="1"', 'data="-0.1"', "at least 0 and at most 1"),
                (
                    "hull_lift_planes",
                    'planes" data="1 1"',
                    'planes" data="1 1.5"',
                    "at least 0 and at most 1",
                ),
                ("hull_radius", 'radius" data="0.095"', 'radius" data="0"', "more than 0"),
                ("displaced_inertia", 'inertia" data="', 'inertia" data="-', "at least 0"),
                ("buoyancy", 'buoyancy" data="', 'buoyancy" data="-', "at least 0"),
            )
        ),
        (
            'dynprm="0.3"',
            'dynprm="-1"',
            r"dynprm, its lag \[s\], must be at least 0 \(given: -1\)",
        ),
        ('ctrlrange="-40 100"', 'ctrlrange="5 40"', r"must hold 0, .* \(given: 5 40\)"),
        ('ctrlrange="-40 100"', 'ctrlrange="-40 -5"', r"must hold 0, .* \(given: -40 -5\)"),
        (
            'pos="0 0 0.1"',
            'pos="1e8 0 0.1"',
            "<site name='hydrophone'>: pos must be within ±1000 m",
        ),
        (
            'size="0.008 0.03"',
            'size="0 0.03"',
            "size 0 must be positive in geom, Element name 'hull/mast'",
        ),
    ],
)
def test_a_hull_that_cannot_be_simulated_is_refused_by_name(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in FOLLOWER
    (tmp_path / "odd.xml").write_text(FOLLOWER.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(laisn_sim.LaisnError, match=rf"followers\[0\]\.model: .*{message}"):
        laisn_sim.load("T3", {"followers.0.model": str(tmp_path / "odd.xml"), "duration_s": 20})


def moved_leader(**positions: str) -> str:
    """The project's leader with transmitters elsewhere."""
    text = LEADER
    for name, position in positions.items():
        text, count = re.subn(rf'(<site name="{name}" [^>]*pos=)"[^"]*"', rf'\1"{position}"', text)
        assert count == 1, name
    return text


SHORT_BASELINE = {"tx_rear": "-0.7 0 0", "tx_front": "0.7 0 0", "tx_middle": "0 0.2 0"}
TOWED_BEAM = {"tx_rear": "-12 0.5 -2", "tx_front": "-9 -0.5 -2.5", "tx_middle": "-10 1 -2"}


def point_motion_flight(
    leader_hull: str, leader_keys: dict[str, float], **other_keys: Any
) -> FlightRecord:
    """A short flight with point motion behind a leader."""
    return laisn_sim.fly(
        {
            "followers": [{"route": "T5"}],
            "leader": {"model": leader_hull, **leader_keys},
            "motion": "kinematic",
            "duration_s": 20.0,
            **other_keys,
        }
    )


def test_transmitters_are_where_the_own_hull_has_them() -> None:
    flight = point_motion_flight(moved_leader(**SHORT_BASELINE), {})
    trajectory = flight.trajectory
    assert [
        trajectory.site_offset[trajectory.site(f"leader/tx_{name}")].tolist()
        for name in ("rear", "front", "middle")
    ] == [[-0.7, 0, 0], [0.7, 0, 0], [0, 0.2, 0]]
    settings = navigation_settings(flight.scenario, trajectory.sites, 0)
    assert (settings.baseline, settings.middle_offset, settings.transmitter_offsets) == (
        1.4,
        0.2,
        (),
    )
    assert cautions(flight.scenario) == []
    # loading sets no baseline, and saving keeps the hull
    assert laisn_sim.load(flight.scenario).leader.baseline_m is None
    again = Scenario.model_validate(tomllib.loads(flight.scenario.toml()))
    assert again == flight.scenario


def test_a_key_moves_the_transmitters_of_an_own_hull() -> None:
    flight = point_motion_flight(moved_leader(**SHORT_BASELINE), {"baseline_m": 1.0})
    trajectory = flight.trajectory
    assert trajectory.site_offset[trajectory.site("leader/tx_front"), 0] == 0.5
    assert trajectory.site_offset[trajectory.site("leader/tx_middle"), 1] == 0.2


@pytest.mark.parametrize("variant", ["tight", "laisn-2"])
def test_transmitters_on_a_towed_beam_are_navigated_by(variant: str) -> None:
    """9 to 12 m behind the leader and below it: with the transmitters of the shipped hull, the
    position would be some 10 m off.
    """
    flight = point_motion_flight(
        moved_leader(**TOWED_BEAM), {}, navigation={"variant": variant}, duration_s=100.0
    )
    settings = navigation_settings(flight.scenario, flight.trajectory.sites, 0)
    assert settings.transmitter_offsets == (
        (-12.0, 0.5, -2.0),
        (-9.0, -0.5, -2.5),
        (-10.0, 1.0, -2.0),
    )
    errors = position_errors(flight.estimates[0].state[:, :2], flight.hydrophone(0)[:, :2])
    assert np.median(errors) < 2.0


def test_followers_on_stations_need_transmitters_on_the_axis() -> None:
    with pytest.raises(LaisnError, match=r"leader\.model: where followers are on stations"):
        laisn_sim.load(
            {
                "followers": [{"station": {"behind_m": 20, "depth_m": 10}}],
                "leader": {"model": moved_leader(**TOWED_BEAM)},
            }
        )
