"""The three-dimensional part of a frame: sea, hulls with smoothed edges, and ghosts of estimates."""

from typing import Any

import mujoco
import numpy as np

from laisn.arrays import Bytes, Floats
from sim.assembly import ocean_of
from sim.film import seascape
from sim.film.antialiasing import smooth
from sim.film.cameras import Shot, View
from sim.film.film_data import ESTIMATE, FrameState
from sim.flight import Flight
from sim.scenario.settings import Video
from sim.vehicle.effectors import MovingFins
from sim.vehicle.mjcf import resolve

Box = tuple[int, int, int, int]

_GHOST_ALPHA = 0.30
_GHOST_FULL_M = 1.5
_GHOST_LEAST = 0.05
_INSIDE = ("nozzle", "band")  # parts that shine through a translucent hull and make blotches of it
_MAX_GEOMS = 6000
_INSET_FOG = (3.0, 110.0)
_HULL_REACH_M = 1.5  # reach from a vehicle's middle to beyond its ends, propeller included


class GlScene:
    """Owns the model, the graphics context and the frame buffer, until it is closed.

    Raises RuntimeError if no graphics context can be made here.
    """

    def __init__(self, flight: Flight, video: Video) -> None:
        self.width, self.height = size = video.width_px, video.height_px
        self._model = seascape.build(flight, *size)
        self._data = mujoco.MjData(self._model)
        self._vehicles = [resolve(self._model, name) for name in flight.trajectory.names]
        self._fins = MovingFins(self._model)
        parts = [self._model.geom(g).name.split("/")[-1] for g in range(self._model.ngeom)]
        self._inside = {g for g, part in enumerate(parts) if part.startswith(_INSIDE)}
        self._gl = mujoco.GLContext(*size)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._read_one_mipmap()
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False  # see `_add_backdrop`
        self._sight = 0.0
        self._options = mujoco.MjvOption()
        self._sea = seascape.Sea(self._model, ocean_of(flight.scenario))
        self._pixels = np.zeros((self.height, self.width, 3), np.uint8)
        self._smooth = np.zeros_like(self._pixels)

    def close(self) -> None:
        """Free the graphics context."""
        self._context.free()
        self._gl.free()

    def picture(self, state: FrameState, shot: Shot, insets: tuple[Box, ...]) -> Bytes:
        """Render a state; insets lie in boxes (left, top, width, height) [px].

        Returns:
            Pixels, bottom row first, shape (height, width, 3); the same array at every call.
        """
        for vehicle, position, quaternion in zip(self._vehicles, state.position, state.quaternion, strict=True):
            self._data.qpos[vehicle.qpos : vehicle.qpos + 3] = position
            self._data.qpos[vehicle.qpos + 3 : vehicle.qpos + 7] = quaternion
        if state.effectors.size == self._model.nu:  # the paper's point motion has no effectors
            self._fins.turn(state.effectors.ravel())
        self._sea.show_surface(shot.surface)
        self._fog(*shot.fog)
        # what a wide lens sees before the fog closes lies within this square
        looked_at = shot.view.position + 0.4 * shot.fog[1] * shot.view.axes[2]
        self._sea.show(looked_at, 0.9 * shot.fog[1], state.time, self._context)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        whole: Box = (0, 0, self.width, self.height)
        self._render(state, shot.view, whole)
        self._fog(*_INSET_FOG)
        # insets look at a hull from above, or from close by
        self._sea.show_surface(False)
        for (view, _), box in zip(shot.insets, insets, strict=True):
            self._sea.show(view.target, _INSET_FOG[1], state.time, self._context)
            mujoco.mj_kinematics(self._model, self._data)  # the sea has moved
            self._render(state, view, box)
        mujoco.mjr_readPixels(self._pixels, None, mujoco.MjrRect(*whole), self._context)
        self._smooth[:] = self._pixels
        for view, box in zip((shot.view, *(view for view, _ in shot.insets)), (whole, *insets), strict=True):
            self._smooth_hulls(state, view, box)
        return self._smooth

    def _smooth_hulls(self, state: FrameState, view: View, box: Box) -> None:
        """Smooth the edges of what is seen near a vehicle; all else is water, without edges."""
        left, top, width, height = box
        pixels, ahead = view.project(state.position, width, height)
        for (x, y), distance in zip(pixels, ahead, strict=True):
            if distance < -_HULL_REACH_M:
                continue
            # a hull about the lens may be anywhere in the frame
            near = distance < 1.2 * _HULL_REACH_M
            reach = np.inf if near else view.focal(height) * _HULL_REACH_M / (distance - _HULL_REACH_M)
            x0, x1 = (int(np.clip(v, 0, width)) for v in (x - reach, x + reach))
            y0, y1 = (int(np.clip(v, 0, height)) for v in (y - reach, y + reach))
            # rows of a picture that was read from OpenGL count from below
            first = self.height - (top + y1)
            smooth(self._pixels, self._smooth, left + x0, first, x1 - x0, y1 - y0)

    def _fog(self, start: float, end: float) -> None:
        # loads the graphics library, which a process that only imports this file may not have
        from OpenGL import GL

        # MuJoCo hands its fog to OpenGL once, when the context is made
        GL.glFogf(GL.GL_FOG_START, start)
        GL.glFogf(GL.GL_FOG_END, end)
        self._sight = end

    def _read_one_mipmap(self) -> None:
        """Take a pixel of a texture from the nearest of its sizes alone: on a processor, two cost as much again."""
        # as in `_fog`
        from OpenGL import GL

        flat = mujoco.mjtTexture.mjTEXTURE_2D.value
        for texture, kind in zip(self._context.texture, self._model.tex_type, strict=False):
            if kind == flat:
                GL.glBindTexture(GL.GL_TEXTURE_2D, int(texture))
                GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR_MIPMAP_NEAREST)

    def _render(self, state: FrameState, view: View, box: Box) -> None:
        left, top, width, height = box
        scene, model = self._scene, self._model
        model.vis.global_.fovy = view.fovy_deg
        camera = mujoco.MjvCamera()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, self._data, self._options, None, camera, everything, scene)
        # a free camera cannot roll, and rounds its place: put it where the overlay has it
        _, up, forward = view.axes
        for eye in scene.camera:
            eye.pos[:], eye.up[:], eye.forward[:] = view.position, up, forward
        self._add_backdrop(view)
        self._add_ghosts(state)
        mujoco.mjr_render(mujoco.MjrRect(left, self.height - top - height, width, height), scene, self._context)

    def _add(self, shape: int, size: Floats, at: Floats, turn: Floats, rgba: tuple[float, ...]) -> Any:
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, shape, size, at, turn.ravel(), np.array(rgba, dtype=np.float32))
        # MuJoCo leaves these as the memory had them: taken for part of a hull, the backdrop would get a ghost
        geom.objtype, geom.objid, geom.segid = mujoco.mjtObj.mjOBJ_UNKNOWN.value, -1, -1
        geom.camdist, geom.transparent, geom.category = 0.0, 0, mujoco.mjtCatBit.mjCAT_DECOR.value
        scene.ngeom += 1
        return geom

    def _add_backdrop(self, view: View) -> None:
        """A wall beyond the fog, which colours it; drawn last and mostly hidden, it costs a quarter of a sky."""
        distance = 1.5 * self._sight
        right, up, forward = view.axes
        size = np.array([4.0 * distance, 3.0 * distance, 1.0])
        turn = np.column_stack([right, up, -forward])
        self._add(mujoco.mjtGeom.mjGEOM_BOX.value, size, view.position + distance * forward, turn, (0, 0, 0, 1))

    def _add_ghosts(self, state: FrameState) -> None:
        """A ghost hull at each follower's estimate."""
        scene, drawn = self._scene, self._scene.ngeom
        shift = state.estimate - state.hydrophone
        # hull and ghost in one place would hide each other
        alpha = _GHOST_ALPHA * np.minimum(1.0, np.linalg.norm(shift, axis=1) / _GHOST_FULL_M)
        seen = {vehicle.body: f for f, vehicle in enumerate(self._vehicles[1:]) if alpha[f] > _GHOST_LEAST}
        for i in range(drawn):
            original = scene.geoms[i]
            if original.objtype != mujoco.mjtObj.mjOBJ_GEOM.value or original.objid < 0:
                continue
            f = seen.get(int(self._model.geom_bodyid[original.objid]))
            if f is None or original.objid in self._inside:
                continue
            size, turn = np.array(original.size, np.float64), np.array(original.mat, np.float64)
            ghost = self._add(original.type, size, original.pos + shift[f], turn, (*ESTIMATE, float(alpha[f])))
            if ghost is not None:
                # a cylinder's and a capsule's sizes would be turned about once more
                ghost.size[:] = size
                ghost.dataid, ghost.emission = original.dataid, 0.5
