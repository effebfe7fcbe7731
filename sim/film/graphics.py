"""Which graphics libraries really render here. A probe is a child process, for a missing library
breaks the import.
"""

import json
import os
import re
import subprocess
import sys
from functools import cache
from typing import NamedTuple

import numpy as np

BACKENDS = {"linux": ("egl", "osmesa"), "darwin": ("cgl",), "win32": ("wgl",)}.get(
    sys.platform, ("egl", "osmesa")
)
"""Values of MUJOCO_GL worth trying, the best first."""

INSTALL = "on Debian and Ubuntu: apt-get install libegl1 libopengl0 libgl1-mesa-dri"
MISSING = f"no graphics library works here (laisn doctor reports why); {INSTALL}"

_PATIENCE_S = 60.0
_BALL = """
<mujoco>
  <visual><global offwidth="64" offheight="64"/><quality offsamples="0" shadowsize="0"/></visual>
  <worldbody><geom size="0.5" rgba="1 0 0 1"/><camera pos="0 0 4" fovy="30"/></worldbody>
</mujoco>
"""


class Backend(NamedTuple):
    """What a probe found."""

    name: str
    works: bool
    detail: str  # name of the renderer if it works, or why it does not


def child(program: str, backend: str, threads: int = 1) -> tuple[list[str], dict[str, str]]:
    """Command and environment of a Python process that renders with `backend`; it sees this
    process's modules.
    """
    # -P and the handed-over path: a folder `models` or `sim` in the working directory must not be
    # imported instead
    start = f"import sys\nsys.path[:] = {json.dumps(sys.path)}\n{program}"
    variables = {"MUJOCO_GL": backend, "LP_NUM_THREADS": str(threads), "OMP_NUM_THREADS": "1"}
    if sys.platform == "linux":
        # else PyOpenGL takes GLX if it is imported before MuJoCo has chosen for it
        variables["PYOPENGL_PLATFORM"] = backend
    return [sys.executable, "-P", "-c", start], os.environ | variables


def render_ball() -> str:
    """Name of the renderer that draws a red ball on black in this process; RuntimeError if the
    picture is wrong.
    """
    # a library that is missing breaks the import
    import mujoco
    from OpenGL import GL

    model = mujoco.MjModel.from_xml_string(_BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 64, 64) as renderer:
        renderer.update_scene(data, camera=0)
        pixels = renderer.render().astype(np.int64)
        name = GL.glGetString(GL.GL_RENDERER)
    middle = pixels[32, 32]
    corner = pixels[2, 2]
    if not (middle[0] > 60 > max(middle[1], middle[2]) and corner.max() < 30):
        raise RuntimeError(
            f"it draws a red ball on black as {middle.tolist()} on {corner.tolist()}"
        )
    return name.decode() if isinstance(name, bytes) else str(name)


@cache
def _examine(backend: str) -> Backend:
    command, environment = child(
        "from sim.film import graphics; print(graphics.render_ball())", backend
    )
    try:
        answer = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            timeout=_PATIENCE_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Backend(backend, False, f"gave no picture within {_PATIENCE_S:g} s")
    # PyOpenGL looks a function up in a library that it did not find
    if re.search(r"'NoneType' object has no attribute '(gl|egl)\w+'", answer.stderr):
        return Backend(backend, False, "its library is not installed")
    lines = (answer.stdout if answer.returncode == 0 else answer.stderr).strip().splitlines()
    # the exit may crash in the driver after a good picture, and the last line of a traceback is the
    # reason
    return Backend(
        backend,
        answer.returncode == 0 and bool(lines),
        lines[-1] if lines else "ended without a word",
    )


def probe() -> tuple[Backend, ...]:
    """Try every backend by rendering a picture in a child process; the answer is kept for this
    process.
    """
    return tuple(map(_examine, BACKENDS))


def working() -> Backend | None:
    """The first backend that renders, or None."""
    return next((backend for backend in map(_examine, BACKENDS) if backend.works), None)
