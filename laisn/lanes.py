"""LAISN for a block of runs side by side, one in each lane (`lane_passes`): what `navigator` does for one follower."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from laisn import lane_passes as row
from laisn.arrays import Bools, Floats, Ints, Records
from laisn.compiled import compiled_lanes, copy_values
from laisn.failure import LaisnError
from laisn.fix import GATED
from laisn.lane_passes import LANES
from laisn.messages import LeaderMessage, Measurements
from laisn.settings import VARIANTS, NavigationSettings, Tuning
from laisn.variants import SEQUENTIAL

_SEQUENTIAL = VARIANTS.index(SEQUENTIAL)

_BROADCAST = [LeaderMessage._fields.index(n) for n in ("east", "north", "heading", "speed", "depth", "pitch", "roll")]


@compiled_lanes
def _use_pair(block: Floats, t: Tuning, k: int, fix: int) -> None:
    row.copy_fix(block, fix, row.ZX)
    row.update(block, t, k)
    row.copy_fix(block, row.ZX, fix)


@compiled_lanes
def position_update(block: Floats, t: Tuning, k: int) -> None:
    """Position from the message of step k, by the variant (paper, Sections 2.2 and 2.3)."""
    row.place_transmitters(block, t)
    row.fix_rear_front(block, t)
    if t.variant == _SEQUENTIAL:
        _use_pair(block, t, k, row.ZX12)
        row.fix_rear_middle(block, t)
        _use_pair(block, t, k, row.ZX13)
        row.fix_middle_front(block, t)
        _use_pair(block, t, k, row.ZX23)
    else:
        if t.transmitters > 2:
            row.fix_rear_middle(block, t)
            row.fix_middle_front(block, t)
        row.choose(block, t)
        row.update(block, t, k)
    row.update_gate(block, k)


@compiled_lanes
def advance(block: Floats, t: Tuning, k: int, received: bool) -> None:
    """Step k: predict, position if a message is received, speed. Rows of measurements must be filled."""
    row.own_motion(block, t)
    if received:
        row.leader_motion(block, t)
    row.predict(block, t)
    if received:
        position_update(block, t, k)
    row.speed_update(block, t)


@compiled_lanes
def fix_rows(variant: int) -> tuple[int, int, int]:
    """Rows where the fixes of a message begin; −1 for fixes that the variant does not make."""
    if variant == _SEQUENTIAL:
        return row.ZX12, row.ZX13, row.ZX23
    return row.ZX, -1, -1


class LaneEstimates(NamedTuple):
    """Estimates of R runs: n steps, m messages with f fixes each (3 with LAISN-3(1), else 1)."""

    state: Floats
    """x, y [m], vx, vy [m/s] after step k, shape (n, 4, R)."""
    fix_kind: Ints
    """`FixKind`, shape (m, f, R)."""


@compiled_lanes
def run_block(own: Floats, message_step: Ints, messages: Floats, start: Floats, t: Tuning) -> tuple[Floats, Ints]:
    """Filter the explicit measurements of a block from a known start, shape (4,).

    `own` has speed, heading and depth of each step, shape (n, 3, LANES), `messages` the rows from EAST to R3, shape (m,
    10, LANES). Returns states, shape (n, 4, LANES), and kinds of fix, shape (m, f, LANES).
    """
    n, m = own.shape[0], message_step.size
    fixes = fix_rows(t.variant)
    made = 3 if t.variant == _SEQUENTIAL else 1
    state = np.empty((n, 4 * LANES))
    kinds = np.empty((m, made, LANES), dtype=np.int64)
    own_rows, message_rows = own.reshape(n, 3 * LANES), messages.reshape(m, 10 * LANES)
    block = row.new_block(start, t)
    i = 0
    for k in range(1, n + 1):
        row.fill(block, row.SPEED, own_rows[k - 1])
        received = i < m and message_step[i] == k
        if received:
            row.fill(block, row.EAST, message_rows[i])
        advance(block, t, k, received)
        copy_values(block[row.X : row.X + 4 * LANES], state[k - 1])
        if received:
            for j in range(made):
                for lane in range(LANES):
                    kinds[i, j, lane] = int(block[fixes[j] + 3 * LANES + lane])
            i += 1
    return state.reshape(n, 4, LANES), kinds


def stacked(missions: Sequence[Measurements]) -> tuple[Floats, Floats]:
    """Own measurements and messages of up to `LANES` missions as `run_block` takes them; the last one is repeated."""
    filled = [missions[min(lane, len(missions) - 1)] for lane in range(LANES)]
    own = np.stack([np.column_stack([m.speed, m.heading, m.last_depth]) for m in filled], axis=-1)
    return own, np.stack([np.column_stack([m.message[:, _BROADCAST], m.ranges]) for m in filled], axis=-1)


def run(measurements: Sequence[Measurements], start: npt.ArrayLike, settings: NavigationSettings) -> LaneEstimates:
    """Estimate R missions that received their messages at the same steps, from a known start x, y [m], vx, vy [m/s].

    ValueError: missions differ in their steps, the settings' dt is not theirs, or an own measurement or the leader's
    pose is not finite.
    """
    first = measurements[0]
    for number, mission in enumerate(measurements):
        if abs(mission.dt - settings.dt) > 1e-9:
            raise ValueError(f"mission {number} has steps of {mission.dt:g} s, the settings {settings.dt:g} s")
        if mission.speed.size != first.speed.size or not np.array_equal(mission.message_step, first.message_step):
            raise ValueError(f"mission {number} has other steps or other message steps than mission 0")
        if mission.durations is not None or mission.transmitters is not None:
            raise ValueError(f"mission {number} has steps or transmitters of its own; lanes take equal ones only")
        sensed = (mission.speed, mission.heading, mission.message[:, :6])
        if not all(np.all(np.isfinite(values)) for values in sensed) or np.any(np.isinf(mission.depth)):
            raise ValueError(f"mission {number}: an own measurement or the leader's pose is not finite")
    begin, t = np.asarray(start, dtype=np.float64), row.tuning(settings)
    estimates = []
    for number in range(0, len(measurements), LANES):
        own, messages = stacked(measurements[number : number + LANES])
        estimates.append(run_block(own, first.message_step, messages, begin, t))
    state, kinds = (np.concatenate(parts, axis=-1)[..., : len(measurements)] for parts in zip(*estimates, strict=True))
    return LaneEstimates(state, kinds)


class LaneSwarm(NamedTuple):
    """LAISN's navigators of f followers; biases and current are no states of theirs."""

    block: Floats
    tuning: Tuning
    gated: Ints

    @compiled_lanes
    def navigate(
        self, step: int, readings: Records, received: Bools, messages: Records, ranges: Floats, estimates: Any
    ) -> int:
        """Advance by one filter step; see `laisn.swarm.Swarm.navigate`."""
        block = self.block
        last, any_received = readings.shape[0] - 1, bool(received.any())
        for lane in range(LANES):
            i = min(lane, last)
            block[row.SPEED + lane], block[row.HEADING + lane] = readings[i].speed, readings[i].heading
            block[row.DEPTH + lane] = readings[i].depth
            if any_received:
                message = messages[i]
                block[row.EAST + lane], block[row.NORTH + lane] = message.east, message.north
                block[row.LEADER_HEADING + lane], block[row.LEADER_SPEED + lane] = (
                    message.heading,
                    message.speed,
                )
                block[row.LEADER_DEPTH + lane], block[row.PITCH + lane] = message.depth, message.pitch
                block[row.ROLL + lane] = message.roll
                # a message without ranges has the same effect as none
                block[row.R1 + lane] = ranges[i, 0] if received[i] else np.nan
                block[row.R2 + lane] = ranges[i, 1] if received[i] else np.nan
                block[row.R3 + lane] = ranges[i, 2] if received[i] else np.nan
        advance(block, self.tuning, step, any_received)
        for i in range(readings.shape[0]):
            position, velocity = estimates[i].position, estimates[i].velocity
            position[0], position[1] = block[row.X + i], block[row.Y + i]
            velocity[0], velocity[1] = block[row.VX + i], block[row.VY + i]
            if received[i]:
                for first in fix_rows(self.tuning.variant):
                    self.gated[i] += first >= 0 and block[first + 3 * LANES + i] == GATED
        return 0


def new_lanes(settings: NavigationSettings, starts: Floats) -> LaneSwarm:
    """Navigators of followers at starts x, y [m], vx, vy [m/s], shape (f, 4); LaisnError for more than LANES."""
    if len(starts) > LANES:
        raise LaisnError(f"{len(starts)} followers cannot navigate together, at most {LANES}")
    tuning = row.tuning(settings)
    block = row.new_block(np.zeros(4), tuning)
    rows = row.X, row.Y, row.VX, row.VY
    for lane in range(LANES):
        start = starts[min(lane, len(starts) - 1)]
        for first, value in zip(rows, start, strict=True):
            block[first + lane] = value
        block[row.ACCEPTED_X + lane], block[row.ACCEPTED_Y + lane] = start[0], start[1]
    return LaneSwarm(block, tuning, np.zeros(len(starts), dtype=np.int64))
