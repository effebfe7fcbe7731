"""Kinds of effectors: what the state of an actuator does to its hull.

A kind is a class derived from `EffectorKind`. It names its numeric in the MJCF, says what the
values mean, and has up to four methods that are compiled: `load`, `respond`, `force_limits` and
`state_for`. They take the record of EFFECTOR of one effector. The kinds of the project are those of
BUILT_IN; `sim.vehicle.effectors` finds the kind of an actuator and calls its methods.
"""

from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from laisn.arrays import Floats, RecordFields, row_dtype
from laisn.compiled import compiled, inlined, select
from laisn.errors import LaisnError
from laisn.simd import any_lane
from laisn.vector_math import arctan2, sin_cos
from sim.attitude import Vector, cross, plus, scaled

MAX_EFFECTORS = 16  # largest number of effectors of a vehicle
MAX_CURVE_POINTS = 32  # largest number of points of a thruster's curve
MAX_PARAMETERS = 8  # largest number of values of a numeric, but for a curve
# speed below which allocation leaves fins out, and hulls that need them cannot be steered [m/s]
MIN_STEERAGE_SPEED = 0.5
MIN_FLOW_SPEED = 0.01  # speed up to which gz-sim's LiftDrag gives no force [m/s]


class Effector(RecordFields):
    """One actuator or fixed fin of a vehicle, as its MJCF gives it."""

    force: Annotated[Floats, (3,)]  # force per thrust, in the body frame [-]
    torque: Annotated[Floats, (3,)]  # torque about the body's origin per thrust [m]
    lag: float  # time constant of the state [s]
    limits: Annotated[Floats, (2,)]  # lowest and highest state: thrust [N], or as of the kind
    kind: int  # number of its kind, as of `sim.vehicle.effectors.kind_of`
    fades: int  # 1: its force fades where the hull leaves the water
    # of a fin: force across the flow per incidence, over the dynamic pressure [m²/rad]
    lift_area: float
    place: Annotated[Floats, (3,)]  # of the site, in the body frame [m]
    parameters: Annotated[Floats, (MAX_PARAMETERS,)]  # values of the numeric
    points: int  # of the curve that are used
    curve: Annotated[Floats, (MAX_CURVE_POINTS, 2)]  # states and thrusts [N], by rising state


EFFECTOR = row_dtype(Effector)

Load = tuple[Vector, Vector]  # force [N], and moment about the body's origin [N m]


class HullFlow(NamedTuple):
    """The water about a hull, in the body frame."""

    density: float  # [kg/m³]
    gravity: float  # [m/s²]
    velocity: Vector  # of the hull relative to the water [m/s]
    spin: Vector  # angular velocity of the hull relative to the water [rad/s]
    up: Vector  # unit vector against gravity


class Bounds(NamedTuple):
    """Values that a number of a hull may have: between two numbers, with or without these."""

    low: float
    high: float = np.inf
    with_low: bool = False
    with_high: bool = False

    def fault(self, value: float) -> str:
        """What a value must be that is out of bounds; "" if it is not."""
        is_above = self.low < value or (self.with_low and value == self.low)
        if is_above and (value < self.high or (self.with_high and value == self.high)):
            return ""
        expected = f"{'at least' if self.with_low else 'more than'} {self.low:g}"
        if self.high < np.inf:
            expected += f" and {'at most' if self.with_high else 'below'} {self.high:g}"
        return f"must be {expected} (given: {value:g})"

    def require(self, value: float, name: str, where: str) -> None:
        """LaisnError naming the parameter if a value is out of bounds."""
        fault = self.fault(value)
        if fault:
            raise LaisnError(f"{where}, {name}, {fault}")


@inlined
def as_vector(values: Floats) -> Vector:
    """Three numbers of an array."""
    return (values[0], values[1], values[2])


@compiled
def velocity_at(place: Vector, water: HullFlow) -> Vector:
    """Velocity of a place of a hull relative to the water, in the body [m/s]."""
    return plus(water.velocity, cross(water.spin, place))


class _NoFields(NamedTuple):
    """What compiled code takes for an object without values."""


class EffectorKind(_NoFields):
    """A kind of effector; a class derived from it overrides what differs.

    Attributes:
        suffix: of the numeric of an actuator, `NAME.suffix`. A class of a plugin needs none: its
            numeric is `NAME.module:Class`.
        label: for lists.
        unit, unit_scale: of the state in lists, and what a value in SI units is multiplied by.
        parameters: names, units and bounds of the values of the numeric, up to MAX_PARAMETERS.
        fades: whether the force fades where the hull leaves the water.
        is_fin: whether it is a blade, which the flow past it lets push. A fin may be fixed to a
            site without an actuator; its geom turns by its state [rad].
        state_is_thrust: whether the state is the thrust along the axis of the actuator [N].
    """

    suffix: ClassVar[str] = ""
    label: ClassVar[str] = "effector"
    unit: ClassVar[str] = ""
    unit_scale: ClassVar[float] = 1.0
    parameters: ClassVar[dict[str, Bounds]] = {}
    fades: ClassVar[bool] = True
    is_fin: ClassVar[bool] = False
    state_is_thrust: ClassVar[bool] = False

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """Force [N] and moment about the body's origin [N m], in the body frame."""
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def respond(
        self, effector: Effector, state: float, command: float, share: float, dt: float
    ) -> float:
        """The state after a physics step of `dt` [s], by a command within the limits.

        `share` is that of the effector's first-order lag, 1 − exp(−dt/lag).
        """
        return state + share * (command - state)

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """Least and largest force along the axis at a speed along the hull [N].

        The autopilot allocates forces within these, and leaves alone what reaches none.
        """
        return 0.0, 0.0

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """State that gives a force along the axis, within `force_limits` [N], at a speed along the
        hull.
        """
        return 0.0

    def fill(self, record: Effector, values: Floats, where: str) -> None:
        """Write the values of the numeric into a record; LaisnError, with the numeric `where`, if
        they are no such values. The method is not compiled, nor is the next.
        """
        if values.size != len(self.parameters):
            names = ", ".join(self.parameters)
            raise LaisnError(
                f"{where} has {values.size} values, expected {len(self.parameters)}: {names}"
            )
        record["parameters"][: values.size] = values
        for i, (name, bounds) in enumerate(self.parameters.items()):
            bounds.require(values[i], name, f"{where}: value {i + 1}")

    def scale(self, record: Effector, thrust_ratio: float, lift_ratio: float) -> None:
        """Change a record to what it really gives, by the vehicle's true over nominal thrust and
        lift.
        """


class Thruster(EffectorKind):
    """A force along the axis; the state is the force [N], also where the hull leaves the water."""

    label = "thruster"
    unit = "N"
    fades = False
    state_is_thrust = True

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """See `EffectorKind.load`."""
        force = scaled(state, as_vector(effector.force))
        return force, scaled(state, as_vector(effector.torque))

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """See `EffectorKind.force_limits`."""
        return effector.limits[0], effector.limits[1]

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """See `EffectorKind.state_for`."""
        return force

    def scale(self, record: Effector, thrust_ratio: float, lift_ratio: float) -> None:
        """See `EffectorKind.scale`."""
        record["force"] *= thrust_ratio
        record["torque"] *= thrust_ratio


@compiled
def thrust_on_curve(record: Effector, state: float) -> float:
    """Thrust of a curve [N], linear between its points and constant beyond them."""
    curve = record.curve
    last = record.points - 1
    thrust = select(state <= curve[0, 0], curve[0, 1], curve[last, 1])
    for i in range(last):
        share = (state - curve[i, 0]) / (curve[i + 1, 0] - curve[i, 0])
        in_segment = (curve[i, 0] < state) & (state <= curve[i + 1, 0])
        thrust = select(in_segment, curve[i, 1] + share * (curve[i + 1, 1] - curve[i, 1]), thrust)
    return float(thrust)


class CurveThruster(EffectorKind):
    """A thruster with a curve of pairs of state and thrust [N], both rising; the state is any
    quantity, such as a voltage.
    """

    suffix = "curve"
    label = "thruster"

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """See `EffectorKind.load`."""
        push = thrust_on_curve(effector, state)
        force = scaled(push, as_vector(effector.force))
        return force, scaled(push, as_vector(effector.torque))

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """See `EffectorKind.force_limits`."""
        low = thrust_on_curve(effector, effector.limits[0])
        return low, thrust_on_curve(effector, effector.limits[1])

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """See `EffectorKind.state_for`."""
        curve = effector.curve
        last = effector.points - 1
        state = select(force < 0.0, curve[0, 0], curve[last, 0])
        # where two segments meet, the first one holds
        for from_end in range(last):
            i = last - 1 - from_end
            rises = curve[i, 1] < curve[i + 1, 1]
            in_segment = (curve[i, 1] <= force) & (force <= curve[i + 1, 1]) & rises
            rise = select(rises, curve[i + 1, 1] - curve[i, 1], 1.0)
            share = (force - curve[i, 1]) / rise
            on_segment = curve[i, 0] + share * (curve[i + 1, 0] - curve[i, 0])
            state = select(in_segment, on_segment, state)
        return float(select(force == 0.0, 0.0, state))

    def fill(self, record: Effector, values: Floats, where: str) -> None:
        """See `EffectorKind.fill`."""
        pairs = values.reshape(-1, 2) if values.size % 2 == 0 else np.zeros((0, 2))
        rises = (
            len(pairs) and np.all(np.diff(pairs[:, 0]) > 0) and np.all(np.diff(pairs[:, 1]) >= 0)
        )
        if not (2 <= len(pairs) <= MAX_CURVE_POINTS and rises and pairs[0, 1] < pairs[-1, 1]):
            raise LaisnError(
                f"{where} must have 2 to {MAX_CURVE_POINTS} pairs of state and thrust, rising"
            )
        record["points"] = len(pairs)
        record["curve"][: len(pairs)] = pairs

    def scale(self, record: Effector, thrust_ratio: float, lift_ratio: float) -> None:
        """See `EffectorKind.scale`."""
        record["curve"][..., 1] *= thrust_ratio


@compiled
def propeller_load(
    parameters: Floats, density: float, rate: float, inflow: float
) -> tuple[float, float]:
    """Thrust, less the thrust deduction [N], and torque on the hull [N m] (Fossen 2021, chapter 9).

    K_T and K_Q fall linearly with J = (1 − w) u / (n D), with `rate` n [1/s] and `inflow` u, the
    speed of the propeller along its axis [m/s]. A propeller that turns astern is the mirror image
    of one that turns ahead: thrust and torque change their signs with n and u. In water against
    its thrust, n u < 0, K_T and K_Q are those of J = 0. `parameters` are those of `Propeller`.
    """
    diameter = parameters[0]
    kt0 = parameters[1]
    kt_slope = parameters[2]
    kq0 = parameters[3]
    kq_slope = parameters[4]
    wake = parameters[5]
    deduction = parameters[6]
    torque_share = parameters[7]
    # thrust K_T ρ |n| n D⁴ and torque K_Q ρ |n| n D⁵, with J n D = (1 − w) u: no division by n
    ahead = select(rate > 0.0, max(inflow, 0.0), 0.0)
    with_rotation = select(rate < 0.0, min(inflow, 0.0), ahead)
    mass_rate = density * (diameter * diameter * diameter) * abs(rate)
    rotation = rate * diameter
    advance = (1.0 - wake) * with_rotation
    thrust = (1.0 - deduction) * mass_rate * (kt0 * rotation + kt_slope * advance)
    torque = torque_share * mass_rate * diameter * (kq0 * rotation + kq_slope * advance)
    return thrust, torque


class Propeller(EffectorKind):
    """A propeller; the state is its rate of rotation [1/s].

    A negative share of the torque on the hull is that of a propeller of the other hand.
    """

    suffix = "propeller"
    label = "propeller"
    unit = "rpm"
    unit_scale = 60.0
    parameters: ClassVar[dict[str, Bounds]] = {
        "diameter [m]": Bounds(0.0, 1e3),
        "K_T at J = 0": Bounds(0.0, 1e3),
        "dK_T/dJ": Bounds(-1e3, 1e-9),
        "K_Q at J = 0": Bounds(-1e3, 1e3),
        "dK_Q/dJ": Bounds(-1e3, 1e3),
        "wake fraction": Bounds(0.0, 1.0, with_low=True),
        "thrust deduction": Bounds(0.0, 1.0, with_low=True),
        "share of the torque on the hull": Bounds(-1e3, 1e3),
    }

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """See `EffectorKind.load`."""
        axis = as_vector(effector.force)
        local = velocity_at(as_vector(effector.place), water)
        inflow = local[0] * axis[0] + local[1] * axis[1] + local[2] * axis[2]
        push, twist = propeller_load(effector.parameters, water.density, state, inflow)
        moment = plus(scaled(push, as_vector(effector.torque)), scaled(twist, axis))
        return scaled(push, axis), moment

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """See `EffectorKind.force_limits`."""
        parameters = effector.parameters
        inflow = speed * effector.force[0]
        low = propeller_load(parameters, density, effector.limits[0], inflow)[0]
        return low, propeller_load(parameters, density, effector.limits[1], inflow)[0]

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """See `EffectorKind.state_for`."""
        diameter = effector.parameters[0]
        kt0 = effector.parameters[1]
        kt_slope = effector.parameters[2]
        wake = effector.parameters[5]
        deduction = effector.parameters[6]
        # moving astern along its axis it is the mirror image of one that moves ahead
        inflow = speed * effector.force[0]
        side = select(inflow < 0.0, -1.0, 1.0)
        mirrored_force = side * force
        # thrust = quadratic n² + 2 half_linear n with the flow, −quadratic n² against it
        scale = (1.0 - deduction) * density * (diameter * diameter * diameter)
        quadratic = scale * kt0 * diameter
        half_linear = 0.5 * scale * kt_slope * (1.0 - wake) * abs(inflow)
        discriminant = half_linear * half_linear + quadratic * mirrored_force
        is_with_flow = discriminant >= 0.0
        with_flow = (-half_linear + np.sqrt(select(is_with_flow, discriminant, 0.0))) / quadratic
        against = -np.sqrt(select(is_with_flow, 0.0, -mirrored_force / quadratic))
        return float(side * select(is_with_flow, with_flow, against))

    def scale(self, record: Effector, thrust_ratio: float, lift_ratio: float) -> None:
        """See `EffectorKind.scale`."""
        record["parameters"][1:3] *= thrust_ratio


@compiled
def fin_force(record: Effector, density: float, deflection: float, local: Vector) -> Vector:
    """Force of a fin by the velocity of its place relative to the water, in the body [N].

    Across the deflected chord acts ½ρ S a U² sin α |cos α|, so that its direction turns with the
    fin. α is the incidence of the flow on the chord; beyond the stall angle the force stays at its
    value there (an assumption). Along the flow acts ½ρ S C_D0 U².
    """
    e = record.force
    p = record.parameters  # those of `Fin`: S, a, stall angle, C_D0
    u = local[0]
    across = local[0] * e[0] + local[1] * e[1] + local[2] * e[2]
    in_plane_squared = u * u + across * across
    flows = in_plane_squared >= 1e-12
    # without flow there is no force, and no speed to divide by
    speed = np.sqrt(select(flows, in_plane_squared, 1.0))
    sine = 0.0
    cosine = 1.0
    sin_stall = 1.0
    # fixed fins, which are met at every step, need no sine
    if any_lane(deflection != 0.0):
        sine, cosine = sin_cos(deflection)
    if any_lane(p[2] < 0.5 * np.pi):
        sin_stall, _ = sin_cos(min(p[2], 0.5 * np.pi))
    sin_incidence = min(max((u * sine - across * cosine) / speed, -sin_stall), sin_stall)
    scale = 0.5 * density * p[0]
    cos_incidence = np.sqrt(1.0 - sin_incidence * sin_incidence)
    normal = scale * p[1] * in_plane_squared * sin_incidence * cos_incidence
    drag_per_speed = scale * p[3] * speed
    force_across = select(flows, normal * cosine - drag_per_speed * across, 0.0)
    force_forward = select(flows, -normal * sine - drag_per_speed * u, 0.0)
    return force_forward, force_across * e[1], force_across * e[2]


@compiled
def foil_force(record: Effector, density: float, deflection: float, local: Vector) -> Vector:
    """Force of a fin as gz-sim's LiftDrag has it, by the velocity of its place, in the body [N].

    Lift acts across the flow and drag along it, in the plane of the hull's axis and the fin's:
    ½ρ S C U² with C = C_Lα α and C = |C_Dα α|, of other slopes beyond the stall angle, times the
    squared cosine of the sweep. α is the incidence of the flow on the deflected chord.
    """
    e = record.force
    # those of `Foil`: S, C_Lα, stall angle, C_Lα beyond it, incidence at no deflection, C_Dα, C_Dα
    # beyond the stall angle, 1 if it acts in flow from behind
    p = record.parameters
    ahead_speed = local[0]
    across = local[0] * e[0] + local[1] * e[1] + local[2] * e[2]
    speed_squared = local[0] * local[0] + local[1] * local[1] + local[2] * local[2]
    in_plane_squared = ahead_speed * ahead_speed + across * across
    sine, cosine = sin_cos(deflection)
    chordwise_speed = ahead_speed * cosine + across * sine
    # in water at rest, and from behind, there may be no force
    flows = (speed_squared > MIN_FLOW_SPEED * MIN_FLOW_SPEED) & (in_plane_squared != 0.0)
    acts = flows & ((chordwise_speed > 0.0) | (p[7] != 0.0))
    incidence = p[4] + deflection + arctan2(-across, ahead_speed)
    while any_lane(abs(incidence) > 0.5 * np.pi):
        reversed_incidence = incidence - np.copysign(np.pi, incidence)
        incidence = select(abs(incidence) > 0.5 * np.pi, reversed_incidence, incidence)
    beyond_stall = max(abs(incidence) - p[2], 0.0)
    below_stall = min(abs(incidence), p[2])
    lift_coefficient = np.copysign(max(p[1] * below_stall + p[3] * beyond_stall, 0.0), incidence)
    drag_coefficient = abs(p[5] * below_stall + p[6] * beyond_stall)
    # dynamic pressure times area and the squared cosine of the sweep, over the speed in the plane
    cos2_sweep = in_plane_squared / select(acts, speed_squared, 1.0)
    scale = 0.5 * density * p[0] * np.sqrt(in_plane_squared) * cos2_sweep
    force_across = select(
        acts, scale * (lift_coefficient * ahead_speed - drag_coefficient * across), 0.0
    )
    force_forward = select(
        acts, -scale * (lift_coefficient * across + drag_coefficient * ahead_speed), 0.0
    )
    return force_forward, force_across * e[1], force_across * e[2]


@compiled
def fin_lift(effector: Effector, density: float, speed: float) -> float:
    """Force of a fin per deflection at a speed, `MIN_STEERAGE_SPEED` or more [N/rad]."""
    steerage_speed = max(speed, MIN_STEERAGE_SPEED)
    return float(
        0.5
        * density
        * effector.parameters[0]
        * effector.parameters[1]
        * steerage_speed
        * steerage_speed
    )


class Fin(EffectorKind):
    """A blade; the state is its deflection [rad], positive where it pushes along the axis."""

    suffix = "fin"
    label = "fin"
    unit = "°"
    unit_scale = 180.0 / np.pi
    is_fin = True
    parameters: ClassVar[dict[str, Bounds]] = {
        "area [m²]": Bounds(0.0, 1e3),
        "slope of the normal force [1/rad]": Bounds(0.0, 1e3),
        "stall angle [rad]": Bounds(0.0, 1.571),
        "drag coefficient": Bounds(0.0, 1e3, with_low=True),
    }

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """See `EffectorKind.load`."""
        position = as_vector(effector.place)
        force = fin_force(effector, water.density, state, velocity_at(position, water))
        return force, cross(position, force)

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """See `EffectorKind.force_limits`; the speed counts as `MIN_STEERAGE_SPEED` at least."""
        lift = fin_lift(effector, density, speed)
        stall = effector.parameters[2]
        return lift * max(effector.limits[0], -stall), lift * min(effector.limits[1], stall)

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """See `EffectorKind.state_for`."""
        return float(force / fin_lift(effector, density, speed))

    def fill(self, record: Effector, values: Floats, where: str) -> None:
        """See `EffectorKind.fill`."""
        super().fill(record, values, where)
        axis = record["force"]
        if abs(axis[0]) >= 1e-9 or abs(np.linalg.norm(axis) - 1.0) >= 1e-6:
            text = " ".join(f"{value:g}" for value in axis)
            raise LaisnError(
                f"{where}: the axis of a fin must be a unit vector across the hull (given: {text})"
            )
        record["lift_area"] = values[0] * values[1]

    def scale(self, record: Effector, thrust_ratio: float, lift_ratio: float) -> None:
        """See `EffectorKind.scale`."""
        record["parameters"][1] *= lift_ratio
        record["lift_area"] *= lift_ratio


class Foil(Fin):
    """A fin with the forces of gz-sim's LiftDrag, and an incidence at no deflection."""

    suffix = "foil"
    parameters: ClassVar[dict[str, Bounds]] = {
        "area [m²]": Bounds(0.0, 1e3),
        "slope of the lift [1/rad]": Bounds(0.0, 1e3),
        "stall angle [rad]": Bounds(0.0, 1.571),
        "slope of the lift beyond the stall angle [1/rad]": Bounds(-1e3, 1e3),
        "incidence at no deflection [rad]": Bounds(-1.571, 1.571),
        "drag coefficient per incidence [1/rad]": Bounds(-1e3, 1e3),
        "drag coefficient per incidence beyond the stall angle [1/rad]": Bounds(-1e3, 1e3),
        "1 if it acts in flow from behind, or 0": Bounds(0.0, 1.000001, with_low=True),
    }

    def load(self, effector: Effector, state: float, water: HullFlow) -> Load:
        """See `EffectorKind.load`."""
        position = as_vector(effector.place)
        force = foil_force(effector, water.density, state, velocity_at(position, water))
        return force, cross(position, force)

    def force_limits(self, effector: Effector, density: float, speed: float) -> tuple[float, float]:
        """See `Fin.force_limits`."""
        lift = fin_lift(effector, density, speed)
        stall = effector.parameters[2]
        incidence_undeflected = effector.parameters[4]
        low = lift * max(effector.limits[0] + incidence_undeflected, -stall)
        return low, lift * min(effector.limits[1] + incidence_undeflected, stall)

    def state_for(self, effector: Effector, density: float, force: float, speed: float) -> float:
        """See `EffectorKind.state_for`."""
        return float(force / fin_lift(effector, density, speed) - effector.parameters[4])


BUILT_IN: tuple[EffectorKind, ...] = (
    Thruster(),
    CurveThruster(),
    Propeller(),
    Fin(),
    Foil(),
)
"""Kinds of the project; the first is that of an actuator without a numeric."""
