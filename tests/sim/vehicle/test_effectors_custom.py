"""A kind of effector by a plugin: the buoyancy engine of docs/extending.md against closed forms."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from experiments.campaign.store import key_of
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.scenario.vehicles import Vehicle
from sim.vehicle.effector_kinds import BUILT_IN, HullFlow
from sim.vehicle.effectors import Fitted, effector_wrench
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

PAGE = Path(__file__).resolve().parents[3] / "docs" / "extending.md"
VOLUME = 3e-4  # commanded to the engine [m³]
RATE = 5e-5  # largest change of its volume [m³/s]
DENSITY = 1026.0
GRAVITY = 9.81
HEAVE = (33.0, 190.0)  # drag of bluerov2_heavy [N s/m], [N s²/m²] (von Benzon et al. 2022, A1)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None) -> Path:
    """A working directory with plugin, hull and scenario of the page."""
    section = PAGE.read_text("utf-8").split("## An effector\n")[1].split("\n## ")[0]
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", section, flags=re.DOTALL | re.MULTILINE)
    for _, text in blocks:
        name = re.match(r"# (\w+\.\w+)\n", text)
        if name:
            (tmp_path / name[1]).write_text(text, encoding="utf-8")
    (hull,) = [text for language, text in blocks if language == "python" and "float.xml" in text]
    exec(compile(hull, "docs/extending.md", "exec"), {})
    laisn_sim.load_plugin("buoyancy_engine.py")
    return tmp_path


def terminal_speed(force: float) -> float:
    """Speed at which the drag d w + d₂ w² balances a force."""
    linear, quadratic = HEAVE
    return float((-linear + np.sqrt(linear**2 + 4.0 * quadratic * force)) / (2.0 * quadratic))


def plant_of(text: str) -> Plant:
    setup = VehicleSetup(
        name="float",
        model=text,
        position_m=(0.0, 0.0, -100.0),
        settings=Vehicle.model_construct(trim="neutral"),
    )
    return Plant([setup], Ocean(density_kg_m3=DENSITY))


@pytest.mark.system
@pytest.mark.usefixtures("folder")
def test_the_engine_lifts_and_sinks_the_hull_at_the_speed_of_buoyancy_against_drag() -> None:
    """Its volume changes at its rate first, and stops at its limits."""
    plant = plant_of(Path("float.xml").read_text("utf-8"))
    command = np.zeros((1, 9))
    for sign in (1.0, -1.0):
        before = plant.effector_states[0, 8]
        command[0, 8] = sign * VOLUME
        plant.step(command, 100)
        assert plant.effector_states[0, 8] == pytest.approx(before + sign * RATE * 2.0, rel=1e-9)
        # the time constant is a second at most: 32 kg, added mass included, over 33 N s/m
        plant.step(command, 1900)
        assert plant.effector_states[0, 8] == pytest.approx(sign * VOLUME, rel=1e-9)
        expected = sign * terminal_speed(DENSITY * GRAVITY * VOLUME)
        assert plant.twist[0, 2] == pytest.approx(expected, rel=1e-6)
    command[0, 8] = -1.0
    plant.step(command, 1000)
    assert plant.effector_states[0, 8] == pytest.approx(-5e-4, rel=1e-9)
    # in a hull on its side, its force is upwards in the world, and acts at its position
    text = Path("float.xml").read_text("utf-8")
    with_engine_off_centre = plant_of(
        text.replace('name="engine" pos="0 0 0"', 'name="engine" pos="0.1 0.02 0"')
    )
    states = np.zeros((1, 9))
    states[0, 8] = 1e-4
    fitted = Fitted(with_engine_off_centre.kinds, with_engine_off_centre.true_effectors, states)
    up = (0.6, 0.8, 0.0)
    water = HullFlow(DENSITY, GRAVITY, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), up)
    thrust, torque, force, moment = effector_wrench(fitted, 0, water)
    expected_force = DENSITY * GRAVITY * 1e-4 * np.array(up)
    np.testing.assert_allclose(force, expected_force, rtol=1e-12)
    np.testing.assert_allclose(moment, np.cross((0.1, 0.02, 0.0), expected_force), atol=1e-12)
    assert not any((*thrust, *torque))


@pytest.mark.long
def test_the_controller_of_the_page_takes_the_float_to_its_depth(folder: Path) -> None:
    command = "fly float.toml --plugin buoyancy_engine.py --no-video --out out"
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    flight = laisn_sim.read_log("out/flight.mcap")
    depth = -flight.trajectory.position[:, 1, 2]
    assert depth[0] == pytest.approx(14.0, abs=1e-6)
    np.testing.assert_allclose(depth[-200:], 18.0, atol=0.15)
    volume = flight.trajectory.effector_states[:, 1, 8]
    assert np.abs(volume).max() <= 5e-4
    assert not flight.trajectory.effector_states[:, 1, :8].any()


def test_unknown_kinds_and_lacking_plugins_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = Path("float.xml").read_text("utf-8")
    assert not hull_errors(text, "follower")
    (error,) = hull_errors(
        text.replace("engine.buoyancy_engine:BuoyancyEngine", "engine.fni"), "follower"
    )
    assert "unknown kind of effector 'fni'; available: curve, propeller, fin, foil" in error
    (error,) = hull_errors(
        text.replace("engine.buoyancy_engine:B", "pump.buoyancy_engine:B"), "follower"
    )
    assert "there is no actuator 'hull/pump'" in error
    (error,) = hull_errors(text.replace('data="5e-5"', 'data="0"'), "follower")
    assert "value 1, largest rate of the volume [m³/s], must be more than 0" in error
    with monkeypatch.context() as without:
        without.delenv("LAISN_PLUGINS")
        result = CliRunner().invoke(app, ["check", "float.toml"])
    assert result.exit_code == 2
    assert "add --plugin buoyancy_engine.py" in result.output


def with_kind(methods: str) -> str:
    """The MJCF of the page with an engine of another class, `Odd`, of these methods from line 8
    on.
    """
    Path("odd.py").write_text(
        "import numpy as np\nfrom laisn_sim import EffectorKind\n"
        "from sim.vehicle.effector_kinds import Bounds\n\n\n"
        "class Odd(EffectorKind):\n    parameters = {'a': Bounds(0.0, 1.0)}\n" + methods,
        encoding="utf-8",
    )
    laisn_sim.load_plugin("odd.py")
    text = Path("float.xml").read_text("utf-8")
    return text.replace(
        'engine.buoyancy_engine:BuoyancyEngine" data="5e-5"', 'engine.odd:Odd" data="5e-5"'
    )


LOAD = "    def load(self, effector, state, water):\n"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("methods", "line", "expected"),
    [
        (
            LOAD + "        return water.temperature, state\n",
            9,
            "its `load` cannot be compiled: {place}: Unknown attribute 'temperature' of type Hull",
        ),
        (
            LOAD + "        x = state\n        return (x[0], x, x), (x, x, x)\n",
            10,
            "its `load` cannot be compiled: {place}: no such operation: getitem(float64, ",
        ),
        (
            LOAD + "        return 5.0, 3.0\n",
            8,
            "its `load` ({place}) returns (5.0, 3.0); expected force [N] and moment [N m]",
        ),
        (
            "    def respond(self, effector, state, command, share, dt):\n        pass\n",
            8,
            "its `respond` ({place}) returns None; expected the state after the step",
        ),
        (
            "    def force_limits(self, effector, density, speed):\n        return 1.0\n",
            8,
            "its `force_limits` ({place}) returns 1.0; expected the least and the largest force",
        ),
    ],
)
def test_a_method_that_cannot_be_used_says_where_and_why(
    methods: str, line: int, expected: str
) -> None:
    (error,) = hull_errors(with_kind(methods), "follower")
    place = f"{Path('odd.py').resolve()}:{line}"
    assert error.startswith(f"effector odd:Odd: {expected.format(place=place)}")
    assert "\x1b" not in error


@pytest.mark.long
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("engine", ["mujoco", "direct"])
def test_a_force_that_is_no_number_names_the_effector(engine: str) -> None:
    """The root of a negative number, as soon as the state is another one than 0."""
    Path("float.xml").write_text(
        with_kind(
            LOAD + "        force = np.sqrt(-abs(state))\n"
            "        return (0.0, 0.0, force), (0.0, 0.0, 0.0)\n"
        ),
        encoding="utf-8",
    )
    with pytest.raises(
        LaisnError,
        match=r"the state of follower is lost, by effector engine of class Odd \(odd\.py\) at its "
        r"state -?\d[-.\de]*: force \[0\.0, 0\.0, nan\] N, moment \[0\.0, 0\.0, 0\.0\] N m; ",
    ):
        laisn_sim.fly("float.toml", {"timing.engine": engine, "duration_s": 20.0})


@pytest.mark.usefixtures("folder")
def test_keys_of_stored_results_depend_on_the_source_of_the_kind() -> None:
    hull = Path("float.xml").read_text("utf-8")
    before, before_of_follower = key_of(hull), key_of(laisn_sim.hull("follower"))
    source = Path("buoyancy_engine.py").read_text("utf-8")
    Path("buoyancy_engine.py").write_text(source.replace("water.up)", "water.up)  # up"), "utf-8")
    assert key_of(hull) != before
    # hulls without effectors of that kind keep their results
    assert key_of(laisn_sim.hull("follower")) == before_of_follower


def test_built_in_kinds_are_of_different_types() -> None:
    """Records have the numbers of these types; as values kinds are empty tuples and all equal."""
    assert len({type(kind) for kind in BUILT_IN}) == len(BUILT_IN) == 5
