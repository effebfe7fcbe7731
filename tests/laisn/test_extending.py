"""docs/extending.md, followed to the letter in a copy of the packages: a new variant flies, replays
and runs campaigns, and a new law of drag acts.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools import import_graph

pytestmark = pytest.mark.system

ROOT = Path(__file__).resolve().parents[2]

CAMPAIGN = """
import numpy as np

from experiments.campaign.montecarlo import Cell
from experiments.campaign.montecarlo import histories
from experiments.flight.library import load_scenario
from laisn.navigator import Navigator
from sim.sensing.observation import measure

flying = ["duration_s=60", "motion=kinematic", "navigation.variant="]
cell, other = (
    Cell.of(load_scenario("T3", [*flying[:2], flying[2] + name]), runs=3)
    for name in ("laisn-closest", "laisn-best")
)
together = histories(cell)
for run in range(3):
    measured = measure(cell.truth, cell.errors, seed=cell.seed, run=run)
    alone = Navigator(cell.settings, cell.truth.start).run(measured)
    np.testing.assert_allclose(together[:, :2, run], alone.state[:, :2], rtol=0, atol=1e-9)
assert np.abs(together - histories(other)).max() > 1e-3
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages, changed as the page says."""
    root = tmp_path_factory.mktemp("copy")
    for package in import_graph.PACKAGES:
        shutil.copytree(ROOT / package, root / package)
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    blocks = dict(
        re.findall(
            r"^```python\n# ((?:laisn|sim)/\S+)\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE
        )
    )
    assert set(blocks) == {"laisn/fix.py", "laisn/settings.py", "sim/vehicle/hydrodynamics.py"}
    drag = root / "sim" / "vehicle" / "hydrodynamics.py"
    text, n_replaced = re.subn(
        r"^@compiled\ndef damping\(.*?\n\n\n",
        lambda _: f"{blocks['sim/vehicle/hydrodynamics.py']}\n\n",
        drag.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    assert n_replaced == 1
    drag.write_text(text, encoding="utf-8")
    variants, settings = root / "laisn" / "fix.py", root / "laisn" / "settings.py"
    text, table_head, entry = (
        variants.read_text(encoding="utf-8"),
        "CHOOSE_PAIR: dict[",
        '"laisn-closest": laisn_closest,',
    )
    assert text.count(table_head) == 1
    assert f"`{entry}`" in page
    head, tail = text.split(table_head)
    tail = tail.replace("= {\n", f"= {{\n    {entry}\n", 1)
    variants.write_text(f"{head}{blocks['laisn/fix.py']}\n\n{table_head}{tail}", encoding="utf-8")
    text, line = settings.read_text(encoding="utf-8"), blocks["laisn/settings.py"].strip()
    assert line.count("\n") == 0
    variant_lines = re.findall(r"^Variant = .*$", text, flags=re.MULTILINE)
    assert len(variant_lines) == 1
    # the page's line is the one that stands there, with one more name
    assert line.replace(', "laisn-closest"', "") == variant_lines[0]
    settings.write_text(text.replace(variant_lines[0], line), encoding="utf-8")
    return root


DRAG = """
import numpy as np
from sim.vehicle import mjcf, hydrodynamics
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

setup = VehicleSetup(name="a", model="follower", position_m=(0.0, 0.0, -10.0), speed_m_s=1.0)
plant = Plant([setup], Ocean())
c = mjcf.read_coefficients(plant.model, plant.names, 1026.0).view(np.recarray)[0]
force, moment = hydrodynamics.viscous(c, (0.0, 0.0, 0.0), (0.3, 0.0, 0.4))[0]
# roll damps by 0.034 N m s² times the resultant of 0.5 rad/s, where the file's law takes the
# roll's own 0.3 rad/s
assert abs(moment[0] + (0.58853 + 0.034 * 0.5) * 0.3) < 1e-12, moment
plant.step(np.zeros_like(plant.effector_states), 10)
assert 0.9 < plant.twist[0, :2].max() < 1.0, plant.twist
"""

COMMANDS = """
import sys
from typer.testing import CliRunner
from laisn_sim.cli.main import app

for line in sys.argv[1:]:
    result = CliRunner().invoke(app, line.split())
    print(result.output)
    assert result.exit_code == 0, line
"""


def run(copy: Path, *words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(copy), "COLUMNS": "200"}
    result = subprocess.run(
        [sys.executable, *words],
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_a_new_variant_flies_and_replays(copy: Path) -> None:
    fly = (
        "fly T3 --no-video --set motion=kinematic --set duration_s=20 --out out/{0} --set "
        "navigation.variant=laisn-{0}"
    )
    replay = "replay out/best/flight.mcap --variant laisn-closest"
    output = run(copy, "-c", COMMANDS, fly.format("best"), replay, fly.format("closest"))
    assert "replayed, laisn-closest" in output
    best, closest = (
        json.loads((copy / "out" / name / "summary.json").read_text())
        for name in ("best", "closest")
    )
    assert (best["variant"], closest["variant"]) == ("laisn-best", "laisn-closest")
    assert best["e_p_mean_m"] != closest["e_p_mean_m"]


@pytest.mark.long
def test_a_new_variant_is_the_same_in_a_campaign(copy: Path) -> None:
    run(copy, "-c", CAMPAIGN)


@pytest.mark.long
def test_another_law_of_drag_is_one_function(copy: Path) -> None:
    run(copy, "-c", DRAG)
