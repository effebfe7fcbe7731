"""Keeping to a route by readings and estimates, in place of the truth."""

from laisn.arrays import Record
from laisn.compiled import compiled
from sim.control import follower as steering
from sim.control.autopilot import control
from sim.control.guidance import integrate_offset, start_guidance, steer, track_current
from sim.simulation import TICK, RouteControl


@compiled
def follow_route(
    k: int,
    i: int,
    senses: steering.Senses,
    memory: Record,
    routes: RouteControl,
    stride: int,
    estimates_current: bool,
) -> None:
    """Find the command of vehicle i that keeps it to its route by its readings and estimates.

    Args:
        k: instant from which on the command holds.
        i: index of the vehicle.
        senses: what the vehicle knows of itself.
        memory: its memory, of `sim.control.follower.FOLLOWER_MEMORY`.
        routes: control of all vehicles, which holds the command.
        stride: instants from one filter step to the next.
        estimates_current: whether its navigator estimates a current.
    """
    estimate = senses.estimate
    reference = routes.reference[k, i]
    guidance = routes.guidance[i]
    motion = steering.measured_motion(senses.reading, estimate, TICK, memory)
    if k == 0:
        start_guidance(reference, motion.heading, motion.surge, (0.0, 0.0), guidance)
    position = estimate.position[0], estimate.position[1]
    if k < stride or position[0] != position[0]:
        # as long as there is no estimate, the reference itself
        position = reference.east, reference.north
    if estimates_current:
        track_current((estimate.current[0], estimate.current[1]), TICK, guidance)
    else:
        integrate_offset(reference, position, TICK, guidance)
    steering_command = steer(reference, position, TICK, guidance)
    control(
        routes.kinds,
        routes.autopilot_designs[i],
        steering_command,
        reference,
        motion,
        TICK,
        routes.autopilot_memories[i],
        routes.command[i],
    )
