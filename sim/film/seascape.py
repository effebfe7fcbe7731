"""What the film shows of the sea: a floor and a height field of the surface that travel with the camera, fog, light.

Looks alone: nothing here acts on a vehicle. The surface is the simulated one (`sim.water.elevation_at`).
"""

from typing import Any

import mujoco
import numpy as np

from laisn.arrays import Floats
from sim.assembly import models_of
from sim.flight import Flight
from sim.vehicle.mjcf import VehicleSetup, compose
from sim.water import PHASE, Ocean

WATER = (0.035, 0.26, 0.36)  # colour of the fog, and so of all that is far, so that no band remains at the horizon

_CELLS = 48  # points of a height field along each side: their number is a third of what a frame costs
_TILE_M = 40.0
_SPACINGS_M = (*(_TILE_M / k for k in range(16, 0, -1)), *(_TILE_M * k for k in (2, 3, 4, 6, 8, 12, 16, 24, 32)))
"""Spacings of a height field's points; they divide the tile, or are whole tiles."""
_CREST_M = 25.0
_TEXELS = 256


def _tile(size: int, wavelength: float, seed: int) -> Floats:
    """Periodic noise around one wavelength (a share of the tile), zero mean, unit variance, shape (size, size)."""
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((size, size)))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size, 1 / size), np.fft.rfftfreq(size, 1 / size), indexing="ij"))
    noise = np.fft.irfft2(spectrum * np.exp(-2.0 * (frequency * wavelength - 1.0) ** 2), s=(size, size))
    return np.asarray((noise - noise.mean()) / noise.std())


def _network(wavelength: float, seed: int) -> Floats:
    """Bright curved lines, as light focused by ripples draws them, in [0, 1]."""
    return np.asarray(np.exp(-4.0 * np.abs(_tile(_TEXELS, wavelength, seed))))


def build(flight: Flight, width_px: int, height_px: int) -> Any:
    """The compiled MjModel of vehicles (the leader first), sea floor and surface, for frames up to a size."""
    hulls = zip(flight.trajectory.names, models_of(flight.scenario), strict=True)
    depth = flight.scenario.ocean.floor_depth_m
    spec = compose([VehicleSetup(name=name, model=hull, position_m=(0, 0, -5)) for name, hull in hulls], depth)
    for flat in ("floor", "surface"):
        spec.delete(spec.geom(flat))
    sand = 0.5 + 0.10 * _tile(_TEXELS, 0.03, 1) + 0.10 * _tile(_TEXELS, 0.22, 2) + 0.35 * (_network(0.13, 3) - 0.3)
    sheen = 0.30 + 0.55 * _network(0.15, 4) * (0.6 + 0.4 * _network(0.35, 5)) + 0.08 * _tile(_TEXELS, 0.5, 6)
    for name, shade, dark, bright in (
        ("seabed", sand, (0.20, 0.25, 0.22), (0.70, 0.72, 0.58)),
        ("sea", sheen, (0.10, 0.42, 0.52), (0.85, 1.0, 1.0)),
    ):
        colours = np.asarray(dark) + np.clip(shade, 0.0, 1.0)[..., None] * np.subtract(bright, dark)
        texture = spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=_TEXELS, height=_TEXELS, nchannel=3
        )
        texture.data = bytes((255 * colours).round().astype(np.uint8))
        material = spec.add_material(name=f"{name}_look", specular=0.0, shininess=0.0, texuniform=True)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        # MuJoCo lays a texture twice over 1 / texrepeat
        material.texrepeat = [2 / _TILE_M, 2 / _TILE_M]
    looks_only = {"contype": 0, "conaffinity": 0}
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(
        name="seabed", type=plane, size=[200, 200, 20], pos=[0, 0, -depth], material="seabed_look", **looks_only
    )
    spec.add_hfield(
        name="sea", nrow=_CELLS, ncol=_CELLS, size=[200, 200, _CREST_M, 0.001], userdata=np.zeros(_CELLS**2)
    )
    # upside down: a height field shows only its upper face, and this one is seen from below
    spec.worldbody.add_geom(
        name="sea",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="sea",
        material="sea_look",
        pos=[0, 0, _CREST_M / 2],
        quat=(0, 1, 0, 0),
        **looks_only,
    )
    # low light from one side shows the waves' slopes; the hulls are lit by the rest
    spec.material("sea_look").rgba = [2.6, 2.6, 2.6, 1.0]
    spec.worldbody.add_light(
        name="scatter",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        dir=[0.85, 0.45, 0.25],
        diffuse=[0.22, 0.24, 0.25],
        specular=[0, 0, 0],
        castshadow=False,
    )
    visual = spec.visual
    visual.headlight.ambient = [0.20, 0.24, 0.27]
    visual.headlight.diffuse = [0.22, 0.24, 0.25]
    visual.global_.offwidth, visual.global_.offheight = width_px, height_px
    visual.rgba.fog = [*WATER, 1.0]
    return spec.compile()


class Sea:
    """Floor and moving surface, with the waves of an ocean, of a model made by `build`."""

    def __init__(self, model: Any, ocean: Ocean) -> None:
        self._model = model
        self._geom, self._floor = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, n) for n in ("sea", "seabed"))
        self._ocean = ocean
        self._waves = ocean.water[1][: PHASE + 1].T
        self._steepness = np.hypot(self._waves[:, 1], self._waves[:, 2])

    def grid(self, centre: Floats, reach: float) -> tuple[Floats, Floats]:
        """East and north of the height field's points, at least `reach` around `centre`, each of shape (_CELLS,), [m].

        The points of one spacing always lie on the same lattice, or the surface would change shape with the camera.
        """
        half = (_CELLS - 1) / 2
        cell = next((c for c in _SPACINGS_M if half * c >= reach), _SPACINGS_M[-1])
        x, y = _TILE_M * np.round(np.asarray(centre[:2]) / _TILE_M)
        offset = cell * (np.arange(_CELLS) - half)
        return x + offset, y + offset

    def elevation(self, x: Floats, y: Floats, time: float) -> Floats:
        """Height of the sea over the grid x by y without the waves too short for it, shape (len(y), len(x)), [m]."""
        cell = float(x[1] - x[0])
        long = self._steepness * cell < 2.0
        east, north = self._ocean.run(time)
        amplitude, kx, ky, omega, phase = self._waves[long][:, [0, 1, 2, 4, 5]].T
        along_x = amplitude * np.exp(1j * (np.outer(x - east, kx) + phase - omega * time))
        return np.asarray((np.exp(1j * np.outer(y - north, ky)) @ along_x.T).real)

    def show(self, centre: Floats, reach: float, time: float, context: Any) -> None:
        """Bring floor and surface to where the camera looks, the surface as it is at `time`, and upload it."""
        model = self._model
        x, y = self.grid(centre, reach)
        heights = 0.5 - self.elevation(x, y, time)[::-1] / _CREST_M
        field = int(model.geom_dataid[self._geom])
        first = model.hfield_adr[field]
        model.hfield_data[first : first + heights.size] = heights.ravel()
        # a floor beyond the fog would cost a third of a frame
        model.hfield_size[field, :2] = model.geom_size[self._floor, :2] = (x[-1] - x[0]) / 2
        model.geom_pos[[self._geom, self._floor], :2] = x.mean(), y.mean()
        mujoco.mjr_uploadHField(model, context, field)

    def show_surface(self, visible: bool) -> None:
        """Whether the surface is drawn."""
        self._model.geom_rgba[self._geom, 3] = float(visible)
