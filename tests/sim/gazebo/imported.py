"""Hulls as a user gets them: what `laisn hull --sdf FILE` prints, on a plant."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim.vehicle.mjcf import VehicleSetup, read_coefficients
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

DATA = Path(__file__).parents[2] / "data" / "gazebo"
PROBE = (DATA / "probe.sdf").read_text(encoding="utf-8")


def changed(text: str, *pairs: tuple[str, str]) -> str:
    """The text with parts of it replaced, each of which it has once."""
    for old, new in pairs:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
        text = text.replace(old, new)
    return text


@dataclass
class Imported:
    """A hull that the command printed."""

    text: str  # MJCF
    notes: list[str]  # on the standard error output
    density: float = 1000.0  # of the water in which it is tried [kg/m³]

    @cached_property
    def plant(self) -> Plant:
        """The hull alone in still water, at rest and deep, heading east."""
        setup = VehicleSetup(
            name="own", model=self.text, position_m=(0.0, 0.0, -1000.0), heading_rad=np.pi / 2
        )
        return Plant([setup], Ocean(density_kg_m3=self.density, floor_depth_m=5000.0))

    @cached_property
    def record(self) -> Any:
        """Its coefficients in the water in which it is tried."""
        (record,) = read_coefficients(self.plant.model, ["own"], self.density)
        return record

    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
        return float(self.plant.model.body("own/hull").mass[0])

    @property
    def centre(self) -> Floats:
        """Centre of gravity [m]."""
        return np.array(self.plant.model.body("own/hull").ipos)

    def matrix(self, name: str) -> Floats:
        """6×6 matrix of damping, by name "linear" or "quadratic"."""
        return np.diag(self.record[f"{name}_damping"]) + self.record[f"{name}_coupling"]

    def effector(self, name: str) -> Any:
        """An effector's record."""
        return self.plant.effectors[0][self.plant.effector_names[0].index(name)]

    def says(self, *words: str) -> bool:
        """Whether one of the notes has all these words."""
        return any(all(word in note for word in words) for note in self.notes)


def run(path: Path) -> Any:
    """Result of the command for a file."""
    return CliRunner().invoke(app, ["hull", "--sdf", str(path)])


def import_file(path: Path, density: float = 1000.0) -> Imported:
    """The hull that the command prints for a file."""
    result = run(path)
    assert result.exit_code == 0, result.output
    notes = [line.removeprefix("note: ") for line in result.stderr.splitlines()]
    return Imported(result.stdout, notes, density)


def import_text(folder: Path, text: str, density: float = 1000.0) -> Imported:
    """The hull that the command prints for the text of a file in a folder."""
    path = folder / "model.sdf"
    path.write_text(text, encoding="utf-8")
    return import_file(path, density)


def refusal(folder: Path, text: str) -> str:
    """What the command says to a file that it refuses."""
    path = folder / "model.sdf"
    path.write_text(text, encoding="utf-8")
    result = run(path)
    assert result.exit_code != 0
    assert result.stdout == ""
    return str(result.exception) + result.stderr
