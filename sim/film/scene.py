"""The three-dimensional part of a frame: sea, hulls with smoothed edges, and ghosts of estimates.

The sea is a floor, level or a height field as it was read, and a height field of the surface; both
travel with the camera, in fog and light.
Nothing here acts on a vehicle. The surface is the simulated one (`elevation_at` in
`sim.water.environment`).
"""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from laisn.arrays import Bytes, Floats
from sim.film.antialiasing import smooth
from sim.film.cameras import Shot, View
from sim.film.film_data import ESTIMATE, FilmFrame
from sim.flight import FlightRecord
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.settings import Video
from sim.vehicle.effectors import MovingFins
from sim.vehicle.mjcf import VehicleSetup, compose, resolve
from sim.water.assembly import floor_of, sea_of_keys
from sim.water.floors import LevelFloor
from sim.water.grids import GriddedFloor
from sim.water.ocean import Ocean
from sim.water.waves import AMPLITUDE, CARRIER_EAST, CARRIER_NORTH, KX, KY, OMEGA, PHASE

Box = tuple[int, int, int, int]  # left, top, width, height [px]

_GHOST_ALPHA = 0.30  # largest opacity of a ghost
_GHOST_FULL_M = 1.5  # position error from which a ghost has it; below, in proportion
_MIN_GHOST = 0.05  # ghosts of less opacity are not drawn
_INSIDE = ("nozzle", "band")  # parts that shine through a translucent hull and make blotches of it
_MAX_GEOMS = 6000
_UNSEEN = mujoco.mjNGROUP - 1  # group of geoms that are not drawn
_INSET_FOG = (3.0, 110.0)  # where the fog of insets begins, and where it hides all [m]
_HULL_REACH_M = 1.5  # reach from a vehicle's middle to beyond its ends, propeller included
# colour of the fog, and so of all that is far, so that no band remains at the horizon
WATER = (0.035, 0.26, 0.36)

# points of a height field along each side: their number is a third of what a frame costs
_POINTS = 48
_TILE_M = 40.0
_SPACINGS_M = (
    *(_TILE_M / k for k in range(16, 0, -1)),
    *(_TILE_M * k for k in (2, 3, 4, 6, 8, 12, 16, 24, 32)),
)
"""Spacings of a height field's points; they divide the tile, or are whole tiles."""
_CREST_M = 25.0  # from the lowest to the highest surface that the height field can show
_TEXELS = 256  # of a texture along each side


def _noise(wavelength: float, seed: int) -> Floats:
    """Periodic noise around one wavelength (a share of the tile), zero mean, unit variance,
    shape (size, size).
    """
    size = _TEXELS
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((size, size)))
    frequency = np.hypot(
        *np.meshgrid(np.fft.fftfreq(size, 1 / size), np.fft.rfftfreq(size, 1 / size), indexing="ij")
    )
    noise = np.fft.irfft2(
        spectrum * np.exp(-2.0 * (frequency * wavelength - 1.0) ** 2), s=(size, size)
    )
    return np.asarray((noise - noise.mean()) / noise.std())


def _caustics(wavelength: float, seed: int) -> Floats:
    """Bright curved lines, as light focused by ripples draws them, in [0, 1]."""
    return np.asarray(np.exp(-4.0 * np.abs(_noise(wavelength, seed))))


def relief_of(floor: GriddedFloor) -> float:
    """Height of the highest place of a floor above the deepest [m]."""
    return max(float(np.ptp(floor.depth)), 0.01)


def build(flight: FlightRecord, width_px: int, height_px: int) -> Any:
    """The compiled MjModel of vehicles (the leader first), sea floor and surface, for frames up
    to a size.
    """
    hulls = zip(flight.trajectory.names, MissionPlan.of(flight.scenario).models, strict=True)
    floor = floor_of(SeaSettings.of(flight.scenario))
    depth = floor.deepest
    spec = compose(
        [VehicleSetup(name=name, model=hull, position_m=(0, 0, -5)) for name, hull in hulls], depth
    )
    for flat in ("floor", "surface"):
        spec.delete(spec.geom(flat))
    sand = 0.5 + 0.10 * _noise(0.03, 1) + 0.10 * _noise(0.22, 2) + 0.35 * (_caustics(0.13, 3) - 0.3)
    sheen = (
        0.30 + 0.55 * _caustics(0.15, 4) * (0.6 + 0.4 * _caustics(0.35, 5)) + 0.08 * _noise(0.5, 6)
    )
    for name, shade, dark, bright in (
        ("seabed", sand, (0.20, 0.25, 0.22), (0.70, 0.72, 0.58)),
        ("sea", sheen, (0.10, 0.42, 0.52), (0.85, 1.0, 1.0)),
    ):
        colours = np.asarray(dark) + np.clip(shade, 0.0, 1.0)[..., None] * np.subtract(bright, dark)
        kind = mujoco.mjtTexture.mjTEXTURE_2D
        texture = spec.add_texture(name=name, type=kind, width=_TEXELS, height=_TEXELS, nchannel=3)
        texture.data = bytes((255 * colours).round().astype(np.uint8))
        material = spec.add_material(
            name=f"{name}_look", specular=0.0, shininess=0.0, texuniform=True
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        # MuJoCo lays a texture twice over 1 / texrepeat
        material.texrepeat = [2 / _TILE_M, 2 / _TILE_M]
    looks_only = {"contype": 0, "conaffinity": 0}
    seabed: dict[str, Any] = {
        "name": "seabed",
        "type": mujoco.mjtGeom.mjGEOM_PLANE,
        "material": "seabed_look",
    }
    heights = np.zeros(_POINTS**2)
    if isinstance(floor, GriddedFloor):
        size = [200, 200, relief_of(floor), 0.001]
        spec.add_hfield(name="seabed", nrow=_POINTS, ncol=_POINTS, size=size, userdata=heights)
        seabed |= {"type": mujoco.mjtGeom.mjGEOM_HFIELD, "hfieldname": "seabed"}
    else:
        seabed["size"] = [200, 200, 20]
    spec.worldbody.add_geom(**seabed, pos=[0, 0, -depth], **looks_only)
    spec.add_hfield(
        name="sea", nrow=_POINTS, ncol=_POINTS, size=[200, 200, _CREST_M, 0.001], userdata=heights
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
    visual.global_.offwidth = width_px
    visual.global_.offheight = height_px
    visual.rgba.fog = [*WATER, 1.0]
    return spec.compile()


class Sea:
    """Floor and moving surface, with the waves of an ocean, of a model made by `build`."""

    def __init__(
        self, model: mujoco.MjModel, ocean: Ocean, floor: LevelFloor | GriddedFloor
    ) -> None:
        self._model = model
        # ids of their geoms
        self._surface_geom, self._floor_geom = (
            mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, n) for n in ("sea", "seabed")
        )
        self._gridded_floor = floor if isinstance(floor, GriddedFloor) else None
        # west, east and south edge of the floor's grid in the graphics context
        self._shown: tuple[float, ...] = ()
        self._ocean = ocean
        self._wavenumber = np.hypot(*ocean.waves.wavenumber_1_m.T)  # [rad/m]

    def grid(self, centre: Floats, reach: float) -> tuple[Floats, Floats]:
        """East and north of the height field's points, at least `reach` about `centre`, shape
        (_POINTS,) each, [m].
        """
        half_count = (_POINTS - 1) / 2
        spacing = next((c for c in _SPACINGS_M if half_count * c >= reach), _SPACINGS_M[-1])
        # points of one spacing always lie on the same lattice, or the surface would change shape
        # with the camera
        x, y = _TILE_M * np.round(np.asarray(centre[:2]) / _TILE_M)
        offset = spacing * (np.arange(_POINTS) - half_count)
        return x + offset, y + offset

    def elevation(self, x: Floats, y: Floats, time: float) -> Floats:
        """Height of the sea over the grid x by y without the waves too short for it, shape
        (len(y), len(x)), [m].
        """
        spacing = float(x[1] - x[0])
        is_resolved = self._wavenumber * spacing < 2.0
        environment = self._ocean.environment
        east, north = environment.current.at_time(time).drift.displacement
        waves = environment.waves.components[:, is_resolved]
        kx, ky = waves[[KX, KY]]
        # at a fixed place [rad/s]
        omega = waves[OMEGA] + kx * waves[CARRIER_EAST] + ky * waves[CARRIER_NORTH]
        phase = 0.5 * np.pi * waves[PHASE] - omega * time
        along_x = waves[AMPLITUDE] * np.exp(1j * (np.outer(x - east, kx) + phase))
        return np.asarray((np.exp(1j * np.outer(y - north, ky)) @ along_x.T).real)

    def show(
        self,
        centre: Floats,
        reach: float,
        time: float,
        context: mujoco.MjrContext,
        *,
        surface: bool,
    ) -> None:
        """Bring floor and surface to where the camera looks, the surface, if it is drawn, as it
        is at `time`.
        """
        model = self._model
        model.geom_rgba[self._surface_geom, 3] = float(surface)
        x, y = self.grid(centre, reach)
        # a floor beyond the fog would cost a third of a frame
        half_width = (x[-1] - x[0]) / 2
        model.geom_size[self._floor_geom, :2] = half_width
        model.geom_pos[[self._surface_geom, self._floor_geom], :2] = x.mean(), y.mean()
        if not surface:
            return
        heights = 0.5 - self.elevation(x, y, time)[::-1] / _CREST_M
        field = int(model.geom_dataid[self._surface_geom])
        first = model.hfield_adr[field]
        model.hfield_data[first : first + heights.size] = heights.ravel()
        model.hfield_size[field, :2] = half_width
        mujoco.mjr_uploadHField(model, context, field)
        if self._gridded_floor is not None:
            self._show_floor(self._gridded_floor, x, y, context)

    def _show_floor(self, floor: GriddedFloor, x: Floats, y: Floats, context: Any) -> None:
        """Bring the relief of the floor to a grid."""
        grid = (float(x[0]), float(x[-1]), float(y[0]))
        if grid != self._shown:
            self._shown = grid
            mujoco.mjr_uploadHField(self._model, context, self.place_floor(floor, x, y))

    def place_floor(self, floor: GriddedFloor, x: Floats, y: Floats) -> int:
        """Give the model the relief of the floor over the grid x by y; returns the id of its height
        field.
        """
        model = self._model
        field = int(model.geom_dataid[self._floor_geom])
        model.hfield_size[field, :2] = (x[-1] - x[0]) / 2
        heights = (floor.deepest - floor.depths_at(*np.meshgrid(x, y))) / relief_of(floor)
        first = model.hfield_adr[field]
        model.hfield_data[first : first + heights.size] = heights.ravel()
        return field


class GlScene:
    """Model, graphics context and frame buffer, until it is closed; RuntimeError: no graphics
    context is to be had.
    """

    def __init__(self, flight: FlightRecord, video: Video) -> None:
        self.width = video.width_px
        self.height = video.height_px
        self._model = build(flight, self.width, self.height)
        self._data = mujoco.MjData(self._model)
        self._vehicles = resolve(self._model, flight.trajectory.names)
        self._fins = [MovingFins(self._model, f"{name}/") for name in flight.trajectory.names]
        parts = [self._model.geom(g).name.split("/")[-1] for g in range(self._model.ngeom)]
        # geoms that ghosts do not have
        self._inside = {g for g, part_name in enumerate(parts) if part_name.startswith(_INSIDE)}
        self._gl = mujoco.GLContext(self.width, self.height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._read_one_mipmap()
        self._leave_stencil_out()
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False  # see `_add_backdrop`
        self._fog_end = 0.0  # distance from which nothing is seen [m]
        self._background_grey: float | None = None  # from 0 to 1; None: the sea
        self._floor_geom = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_GEOM, "seabed")
        self._options = mujoco.MjvOption()
        self._options.geomgroup[_UNSEEN] = 0
        roots = self._model.body_rootid[self._model.geom_bodyid]
        bodies = np.array([vehicle.body for vehicle in self._vehicles])
        self._hulls = np.flatnonzero(np.isin(roots, bodies))  # geoms of vehicles
        self._vehicle_of_hulls = np.argmax(roots[self._hulls, None] == bodies, axis=1)
        self._groups = self._model.geom_group[self._hulls]
        bounds = self._model.geom_rbound[self._hulls]
        self._reaches = np.where(bounds > 0, bounds, np.inf)  # MuJoCo gives planes none
        sea = SeaSettings.of(flight.scenario)
        self._sea = Sea(self._model, sea_of_keys(sea.ocean, sea.seed), floor_of(sea))
        self._pixels = np.zeros((self.height, self.width, 4), np.uint8)
        self._smooth = np.zeros_like(self._pixels)

    def close(self) -> None:
        """Free the graphics context."""
        self._context.free()
        self._gl.free()

    def picture(
        self,
        state: FilmFrame,
        shot: Shot,
        insets: tuple[Box, ...],
        background_grey: float | None = None,
    ) -> Bytes:
        """Pixels of a state, bottom row first, shape (height, width, 4), the same array at every
        call; the fourth channel is without meaning.

        Insets lie in boxes (left, top, width, height) [px]. With a grey background, from 0 to 1,
        there is no sea.
        """
        self._background_grey = background_grey
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = background_grey is None
        self._model.geom_rgba[self._floor_geom, 3] = float(background_grey is None)
        for vehicle, position, quaternion in zip(
            self._vehicles, state.position, state.quaternion, strict=True
        ):
            self._data.qpos[vehicle.qpos : vehicle.qpos + 3] = position
            self._data.qpos[vehicle.qpos + 3 : vehicle.qpos + 7] = quaternion
        if state.effectors.size:  # the paper's point motion has no effectors
            for fins, states in zip(self._fins, state.effectors, strict=True):
                fins.turn(states)
        self._fog(*shot.fog)
        # what a wide lens sees before the fog closes lies within this square
        looked_at = shot.view.position + 0.4 * shot.fog[1] * shot.view.axes[2]
        self._sea.show(
            looked_at,
            0.9 * shot.fog[1],
            state.time,
            self._context,
            surface=shot.surface and background_grey is None,
        )
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        full_box: Box = (0, 0, self.width, self.height)
        self._render(state, shot.view, full_box)
        self._fog(*_INSET_FOG)
        for (view, _), box in zip(shot.insets, insets, strict=True):
            # insets look at a hull from above, or from close by
            self._sea.show(view.target, _INSET_FOG[1], state.time, self._context, surface=False)
            mujoco.mj_kinematics(self._model, self._data)  # the sea has moved
            self._render(state, view, box)
        self._read()
        self._smooth[:] = self._pixels
        views = (shot.view, *(view for view, _ in shot.insets))
        areas = [
            area
            for view, box in zip(views, (full_box, *insets), strict=True)
            for area in self._areas_of_hulls(state, view, box)
        ]
        smooth(self._pixels, self._smooth, np.array(areas, np.int64).reshape(-1, 4))
        return self._smooth

    def _read(self) -> None:
        """Read the pixels with their opacity: of a format of three channels, OpenGL converts each
        pixel.
        """
        # as in `_fog`
        from OpenGL import GL

        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._context.offFBO)
        GL.glReadPixels(
            0, 0, self.width, self.height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, self._pixels
        )

    def _areas_of_hulls(self, state: FilmFrame, view: View, box: Box) -> Iterator[Box]:
        """Where a vehicle is near, rows from below: left, first row, width, height [px]; all else
        is water, without edges to smooth.
        """
        left, top, width, height = box
        pixels, ahead = view.project(state.position, width, height)
        for (x, y), distance in zip(pixels, ahead, strict=True):
            if distance < -_HULL_REACH_M:
                continue
            # a hull about the lens may be anywhere in the frame
            is_near = distance < 1.2 * _HULL_REACH_M
            reach = (
                np.inf
                if is_near
                else view.focal(height) * _HULL_REACH_M / (distance - _HULL_REACH_M)
            )
            x0, x1 = (int(np.clip(v, 0, width)) for v in (x - reach, x + reach))
            y0, y1 = (int(np.clip(v, 0, height)) for v in (y - reach, y + reach))
            # rows of a picture that was read from OpenGL count from below
            yield left + x0, self.height - (top + y1), x1 - x0, y1 - y0

    def _fog(self, start: float, end: float) -> None:
        """Let fog begin at a distance, and hide all at another [m]."""
        # loads the graphics library, which a process that only imports this file may not have
        from OpenGL import GL

        # MuJoCo hands its fog to OpenGL once, when the context is made
        GL.glFogf(GL.GL_FOG_START, start)
        GL.glFogf(GL.GL_FOG_END, end)
        self._fog_end = end

    def _read_one_mipmap(self) -> None:
        """Take a pixel of a texture from the nearest of its sizes alone: on a processor, two
        cost as much again.
        """
        # as in `_fog`
        from OpenGL import GL

        flat = mujoco.mjtTexture.mjTEXTURE_2D.value
        for texture, kind in zip(self._context.texture, self._model.tex_type, strict=False):
            if kind == flat:
                GL.glBindTexture(GL.GL_TEXTURE_2D, int(texture))
                GL.glTexParameteri(
                    GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR_MIPMAP_NEAREST
                )

    def _leave_stencil_out(self) -> None:
        """Take a buffer of depths of the same precision without the stencil that MuJoCo gives it
        for mirrors: half the bytes.
        """
        # as in `_fog`
        from OpenGL import GL

        frame, buffer = GL.GL_FRAMEBUFFER, GL.GL_RENDERBUFFER
        depth = self._context.offDepthStencil
        GL.glBindFramebuffer(frame, self._context.offFBO)
        GL.glFramebufferRenderbuffer(frame, GL.GL_DEPTH_STENCIL_ATTACHMENT, buffer, 0)
        GL.glBindRenderbuffer(buffer, depth)
        GL.glRenderbufferStorage(buffer, GL.GL_DEPTH_COMPONENT32F, self.width, self.height)
        GL.glFramebufferRenderbuffer(frame, GL.GL_DEPTH_ATTACHMENT, buffer, depth)

    def _render(self, state: FilmFrame, view: View, box: Box) -> None:
        left, top, width, height = box
        scene = self._scene
        model = self._model
        model.vis.global_.fovy = view.fovy_deg
        self._show_what_is_seen(state, view, width / height)
        camera = mujoco.MjvCamera()
        categories = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, self._data, self._options, None, camera, categories, scene)
        # a free camera cannot roll, and rounds its place: put it where the overlay has it
        _, up, forward = view.axes
        for eye in scene.camera:
            eye.pos[:] = view.position
            eye.up[:] = up
            eye.forward[:] = forward
        self._add_backdrop(view)
        self._add_ghosts(state)
        mujoco.mjr_render(
            mujoco.MjrRect(left, self.height - top - height, width, height), scene, self._context
        )

    def _show_what_is_seen(self, state: FilmFrame, view: View, aspect: float) -> None:
        """Leave out parts of hulls that lie outside the picture with their ghosts: OpenGL would
        compute all their corners.
        """
        places = self._data.geom_xpos[self._hulls]
        shift = np.concatenate([np.zeros((1, 3)), state.estimate - state.hydrophone])
        ghosts = places + shift[self._vehicle_of_hulls]
        visible = view.sees(places, self._reaches, aspect)
        visible |= view.sees(ghosts, self._reaches, aspect)
        self._model.geom_group[self._hulls] = np.where(visible, self._groups, _UNSEEN)

    def _add(
        self, shape: int, size: Floats, position: Floats, rotation: Floats, rgba: tuple[float, ...]
    ) -> Any:
        """Add a geom of a type of MuJoCo to the scene, with the matrix `rotation`; returns it, or
        None if there is no room.
        """
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom, shape, size, position, rotation.ravel(), np.array(rgba, dtype=np.float32)
        )
        # MuJoCo leaves these as the memory had them: taken for part of a hull, the backdrop would
        # get a ghost
        geom.objtype = mujoco.mjtObj.mjOBJ_UNKNOWN.value
        geom.objid = -1
        geom.segid = -1
        geom.camdist = 0.0
        geom.transparent = 0
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
        scene.ngeom += 1
        return geom

    def _add_backdrop(self, view: View) -> None:
        """A wall beyond the fog, which colours it; drawn last and mostly hidden, it costs a
        quarter of a sky.
        """
        distance = 1.5 * self._fog_end
        grey = 0.0 if self._background_grey is None else self._background_grey
        right, up, forward = view.axes
        size = np.array([4.0 * distance, 3.0 * distance, 1.0])
        rotation = np.column_stack([right, up, -forward])
        wall = self._add(
            mujoco.mjtGeom.mjGEOM_BOX.value,
            size,
            view.position + distance * forward,
            rotation,
            (grey, grey, grey, 1),
        )
        if wall is not None and self._background_grey is not None:
            wall.emission = 1.0
            wall.specular = 0.0  # no light but its own

    def _add_ghosts(self, state: FilmFrame) -> None:
        """A ghost hull at each follower's estimate."""
        scene = self._scene
        geom_count = self._scene.ngeom
        shift = state.estimate - state.hydrophone
        # hull and ghost in one place would hide each other
        alpha = _GHOST_ALPHA * np.minimum(1.0, np.linalg.norm(shift, axis=1) / _GHOST_FULL_M)
        visible = {
            vehicle.body: f for f, vehicle in enumerate(self._vehicles[1:]) if alpha[f] > _MIN_GHOST
        }
        for i in range(geom_count):
            original = scene.geoms[i]
            if original.objtype != mujoco.mjtObj.mjOBJ_GEOM.value or original.objid < 0:
                continue
            f = visible.get(int(self._model.geom_bodyid[original.objid]))
            if f is None or original.objid in self._inside:
                continue
            size = np.array(original.size, np.float64)
            rotation = np.array(original.mat, np.float64)
            ghost = self._add(
                original.type, size, original.pos + shift[f], rotation, (*ESTIMATE, float(alpha[f]))
            )
            if ghost is not None:
                # a cylinder's and a capsule's sizes would be turned about once more
                ghost.size[:] = size
                ghost.dataid = original.dataid
                ghost.emission = 0.5
