"""The registry of navigators, what each of them is to its users, and what those that run online
have in common.

A navigator is one entry of `NAVIGATORS`, or a class of a plugin that a scenario names as
"module:Class". Nothing else decides by the kind of a navigator. Code is named by strings, so that
scenarios can be read without it.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.errors import LaisnError
from laisn.estimates import Estimates, FixKind, FixRecord, TightEstimates
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.plugins import calling, class_and_file, find_class, is_loaded, is_plugin_name
from laisn.settings import (
    LAISN_VARIANTS,
    NavigationSettings,
    RivalSettings,
    Settings,
    TightSettings,
    WaterBeaconSettings,
)

NavigatorFactory = Callable[[Any, Floats], Any]
"""Makes a navigator of settings and start; its `run` converts the measurements of a mission into
`Estimates`.
"""


class MissionResult(NamedTuple):
    """What a campaign uses of one run: n steps, f fixes."""

    state: Floats  # x, y [m], vx, vy [m/s] after each step, shape (n, 4)
    covariance: Floats  # of the position: xx, xy, yy, shape (n, 3), [m²]
    kinds: Sequence[int]  # `FixKind` of each fix, f of them
    nis_sum: float  # squared innovations of all updates, in units of S
    nis_dof: float  # its degrees of freedom, and its mean if S is right


class Extra(NamedTuple):
    """A package that few need, so that it is not installed with this project."""

    module: str
    title: str
    install: str  # the command

    @property
    def missing(self) -> str:
        """What to do if it is not installed; else empty."""
        if find_spec(self.module) is not None:
            return ""
        return f"needs {self.title}, which is not installed; install it with: {self.install}"


GTSAM = Extra("gtsam", "GTSAM", 'pip install "gtsam>=4.3a1"')


@dataclass(frozen=True, kw_only=True)
class NavigatorSpec:
    """One navigator: its settings and, as "module:name", its code. What is left empty is done in
    Python: campaigns call `run` once for each run, and a swarm that steers by its estimates calls
    `step` of each navigator.
    """

    factory: str | NavigatorFactory  # the class, made of settings and start; of a plugin itself
    settings: type[Settings] = NavigationSettings
    # tables of `navigation` that hold the settings; none: `navigation` itself
    sections: tuple[str, ...] = ()
    title: str = ""  # what reports call it; empty: its name in capitals
    estimates: type[Estimates] = Estimates
    lanes: bool = False  # campaigns run it as lanes of `laisn.lanes`, 64 runs side by side
    # campaign kernel: function of settings, measurements and start that returns a `MissionResult`
    mission: str = ""
    # function of settings and starts, shape (f, 4), that returns a compiled `laisn.swarm.Swarm`
    swarm: str = ""
    smoother: str = ""  # a class like `factory` with the lag [s] as third argument
    beacons: str = ""  # the class that stands for it in data sets, among beacons at rest
    # that it needs beside log, compass, depth and ranges, as `sensors.custom` names it
    sensor: str = ""
    needs: tuple[str, ...] = ()  # names of readings that a user's navigator cannot do without
    # its errors come near the Cramér–Rao bound, so that campaigns compute that too
    compare_with_crlb: bool = False
    takes_links: bool = False  # it uses the messages of several links, `navigation.further_links`
    extra: Extra | None = None  # without which it cannot be made

    @property
    def reads_assumptions(self) -> bool:
        """Whether it reads all of `navigation.assume`, as the tightly coupled navigator does;
        settings of rivals have this table too, of which they read `current` alone.
        """
        return self.settings is TightSettings

    @property
    def missing(self) -> str:
        """What it needs that is not installed, and what to do; empty if nothing is missing."""
        return self.extra.missing if self.extra else ""

    @property
    def _class(self) -> Any:
        return resolve_name(self.factory) if isinstance(self.factory, str) else self.factory

    def make(self, settings: Settings, start: Floats) -> Any:
        """The navigator of one follower at its start [x, y, vx, vy]; LaisnError if that is not
        four finite numbers.
        """
        if isinstance(self.factory, str):
            return self._class(settings, start)
        with calling(f"navigator {self.title}"):
            navigator = self._class(settings, start)
        if hasattr(navigator, "run"):
            return CustomNavigator(navigator, settings)
        return SteppedNavigator(navigator, settings)

    def new_swarm(self, settings: Settings, starts: Floats, *, several_links: bool = False) -> Any:
        """A `laisn.swarm.Swarm` of navigators at their starts, shape (f, 4), which may take the
        messages of `several_links`; LaisnError if that cannot be.
        """
        if self.swarm and not several_links:
            return resolve_name(self.swarm)(settings, starts)
        if isinstance(self._class, type) and not hasattr(self._class, "step"):
            raise LaisnError(
                f"navigator {self.title or self.factory!r} has no `step`, which followers need "
                "that steer by it"
            )
        return resolve_name("laisn.swarm:SeparateNavigators")(self.make, settings, starts)

    def fly(self, settings: Settings, measurements: Measurements, start: Floats) -> MissionResult:
        """One run of a campaign."""
        if self.mission and not measurements.links:
            result: MissionResult = resolve_name(self.mission)(settings, measurements, start)
            return result
        estimates = self.make(settings, start).run(measurements)
        used = np.isfinite(estimates.innovation_covariance).all(axis=(1, 2)) & np.isfinite(
            estimates.innovation
        ).all(axis=1)
        # an innovation of a navigator that takes it to be exact has no squared size in units of S
        pxx, pxy, pyy = estimates.innovation_covariance[:, (0, 0, 1), (0, 1, 1)].T
        used &= resolve_name("laisn.metrics:is_invertible")(pxx, pxy, pyy)
        e = estimates.innovation[used]
        S = estimates.innovation_covariance[used]
        nis_sum = float(np.sum(e * np.linalg.solve(S, e[..., None])[..., 0])) if len(e) else 0.0
        covariance = estimates.covariance[:, (0, 0, 1), (0, 1, 1)]
        return MissionResult(
            estimates.state, covariance, estimates.fix_kind.tolist(), nis_sum, 2.0 * len(e)
        )


BEACON_VARIANT = "beacons"
"""The navigator for a link of beacons at rest."""
_LAISN = NavigatorSpec(
    factory="laisn.navigator:Navigator", lanes=True, swarm="laisn.lanes:new_lanes"
)
_TIGHT = NavigatorSpec(
    factory="laisn.tight.navigator:TightNavigator",
    settings=TightSettings,
    sections=("assume",),
    title="the tightly coupled navigator",
    estimates=TightEstimates,
    mission="laisn.tight.navigator:fly",
    swarm="laisn.tight.navigator:new_tight_swarm",
    smoother="laisn.tight.navigator:SmoothingNavigator",
    beacons="laisn.beacons:BeaconNavigator",
    compare_with_crlb=True,
    takes_links=True,
)


def _rival(
    factory: str,
    title: str,
    sensor: str = "",
    extra: Extra | None = None,
    *,
    takes_links: bool = False,
) -> NavigatorSpec:
    return NavigatorSpec(
        factory=f"laisn.rivals.{factory}",
        settings=RivalSettings,
        sections=("assume", "rival"),
        title=title,
        sensor=sensor,
        extra=extra,
        takes_links=takes_links,
    )


NAVIGATORS: dict[str, NavigatorSpec] = {
    **dict.fromkeys(LAISN_VARIANTS, _LAISN),
    "tight": _TIGHT,
    "dead-reckoning": _rival("filters:DeadReckoning", "dead reckoning"),
    "ekf": _rival("filters:RangeFilter", "the extended Kalman filter on ranges", takes_links=True),
    "imm": _rival("speed_modes:SpeedModes", "the extended Kalman filter with two modes of speed"),
    "owtt": _rival(
        "filters:OneWayTravelTime", "the filter on one-way travel times of one transmitter"
    ),
    "particle": _rival("particles:ParticleFilter", "the particle filter"),
    "factor-graph": _rival(
        "factor_graph:FactorGraph", "the fixed-lag smoother on a factor graph", extra=GTSAM
    ),
    "inverted-usbl": _rival("filters:InvertedUsbl", "the inverted USBL", sensor="inverted-usbl"),
    "geodetic": _rival("filters:GeodeticAdjustment", "the geodetic adjustment of dead reckoning"),
    BEACON_VARIANT: NavigatorSpec(
        factory="laisn.beacons:BeaconNavigator",
        settings=WaterBeaconSettings,
        sections=("beacons",),
        title="the navigator among beacons",
    ),
}


def code_of_navigators() -> list[str]:
    """Modules of all code that the registry names."""
    specs = NAVIGATORS.values()
    code = {name for s in specs for name in (s.factory, s.mission, s.swarm, s.smoother, s.beacons)}
    return sorted({str(name).partition(":")[0] for name in code if name} | {"laisn.swarm"})


CUSTOM_SECTION = "custom"
"""Table of `navigation` that holds the settings of a user's own navigator."""


def _custom_spec(name: str) -> NavigatorSpec:
    factory = find_class("navigator", name, "step")
    settings = getattr(factory, "Settings", NavigationSettings)
    usable = not isinstance(factory, type) or hasattr(factory, "run") or hasattr(factory, "step")
    if not usable or not issubclass(settings, Settings):
        raise LaisnError(
            f"navigator {name!r}: expected a class with `step(own, reception, dt)`, `state` and "
            "`covariance`, or with `run(measurements) -> Estimates`; its own settings are a class "
            "`Settings` in it that derives from laisn.settings.Settings"
        )
    sections = (CUSTOM_SECTION,) if settings is not NavigationSettings else ()
    return NavigatorSpec(
        factory=factory,
        settings=settings,
        sections=sections,
        title=getattr(factory, "__name__", type(factory).__name__),
        needs=tuple(getattr(factory, "needs", ())),
    )


def find(name: str) -> NavigatorSpec:
    """The navigator of this name, which may be in a plugin; LaisnError if there is none."""
    if name in NAVIGATORS:
        return NAVIGATORS[name]
    if not is_plugin_name(name):
        raise LaisnError(
            f"navigator {name!r}; available: {', '.join(NAVIGATORS)}, or MODULE:CLASS of a plugin "
            "that --plugin FILE.py loads"
        )
    return _custom_spec(name)


def is_known(name: str) -> bool:
    """Whether `find` has the code of a navigator: it is one of this project, or its plugin is
    loaded.
    """
    return name in NAVIGATORS or is_loaded(name)


def title_of(name: str) -> str:
    """What reports call a navigator. The class of a plugin is called by its name, so that the
    plugin need not be loaded: "Class" of "module:Class", or "module" alone.
    """
    if is_known(name):
        return find(name).title or name.upper()
    return name.rpartition(":")[2]


def spec_of(settings: Settings) -> NavigatorSpec:
    """The navigator of this project that takes these settings."""
    return next(spec for spec in NAVIGATORS.values() if type(settings) is spec.settings)


MAX_SPEED = 50.0  # a measured speed beyond this is broken [m/s]
MAX_RANGE = 1e5  # a range beyond this is broken [m]
_MAX_COORDINATE = 1e3 * MAX_RANGE  # a position of a leader or transmitter beyond this is broken [m]


def require_valid(
    step: int,
    own: OwnMotion,
    reception: Reception | None,
    duration: float | None,
    *,
    whole_messages: bool = True,
) -> None:
    """LaisnError naming what of the input of a step is not finite or beyond its bounds.

    With `whole_messages` position, heading, speed and depth of messages may not be missing (NaN).
    """
    if not (math.isfinite(own.speed) and math.isfinite(own.heading)) or math.isinf(own.depth):
        raise LaisnError(f"step {step}: own motion {own} is not finite")
    if abs(own.speed) > MAX_SPEED:
        raise LaisnError(
            f"step {step}: the speed is {own.speed:g} m/s, "
            f"expected −{MAX_SPEED:g} … {MAX_SPEED:g} m/s"
        )
    if duration is not None and not 0.0 < duration < math.inf:
        raise LaisnError(f"step {step}: it takes {duration} s, expected a positive time")
    for received in (reception, *own.receptions.values()):
        if received is not None:
            _require_valid_reception(step, received, whole_messages)


def _require_valid_reception(step: int, reception: Reception, whole_messages: bool) -> None:
    message, ranges, places = reception[:3]
    numbers = np.array(message[:6])
    if not whole_messages:
        numbers[np.isnan(numbers)] = 0.0
    if not np.isfinite(numbers).all() or np.abs(numbers[[1, 2, 5]]).max() > _MAX_COORDINATE:
        raise LaisnError(
            f"step {step}: leader message {message} is not finite, or farther than "
            f"{_MAX_COORDINATE:g} m"
        )
    if any(value < 0.0 or value > MAX_RANGE for value in ranges):
        raise LaisnError(
            f"step {step}: ranges {ranges}, expected 0 … {MAX_RANGE:g} m, NaN for a missing one"
        )
    if places is not None and not np.nanmax(np.abs(places), initial=0.0) <= _MAX_COORDINATE:
        raise LaisnError(
            f"step {step}: a transmitter is farther than {_MAX_COORDINATE:g} m; NaN stands for none"
        )


def _as_numbers(values: object) -> Floats:
    """A copy as an array of numbers; of anything else an empty one."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)


Result = TypeVar("Result", bound=Estimates)


class OnlineNavigator(ABC, Generic[Result]):
    """A navigator under way: at a step, with a state and its covariance, which a subclass
    advances in `_navigate`.
    """

    ESTIMATES: type[Any] = Estimates
    """The record of a mission, of type Result."""
    WHOLE_MESSAGES: ClassVar[bool] = True
    """Whether it needs position, heading, speed and depth of every message."""

    def __init__(self, settings: Any, start: Floats | None, start_sigma: float) -> None:
        """Begin at x, y [m], vx, vy [m/s], of finite numbers, or anywhere; `start_sigma` is σ of
        the place [m].
        """
        self.settings = settings
        self._step = 0
        self._depth = math.nan
        self._state = np.full(4, np.nan)
        self._covariance = np.full((4, 4), np.nan)
        self._start: tuple[float, float] | None = None
        if start is not None:
            self._state = _as_numbers(start)
            if self._state.shape != (4,) or not np.all(np.isfinite(self._state)):
                raise LaisnError(f"start is {start}, expected four finite numbers x, y, vx, vy")
            self._covariance = np.diag(np.repeat([start_sigma**2, 0.0], 2))
            self._start = float(start[0]), float(start[1])

    @property
    def state(self) -> Floats:
        """x, y, vx, vy after the last step, shape (4,): mean over the mixture."""
        return self._state.copy()

    @property
    def covariance(self) -> Floats:
        """Covariance of `state` over the mixture, shape (4, 4)."""
        return self._covariance.copy()

    def _fix_at_estimate(self, kind: FixKind, **details: Any) -> FixRecord:
        """The record of a message whose ranges are used themselves."""
        sigma = math.sqrt(0.5 * max(float(np.trace(self._covariance[:2, :2])), 0.0))
        return FixRecord(
            step=self._step,
            position=self._state[:2].copy(),
            sigma=sigma,
            kind=kind,
            details=details,
        )

    @abstractmethod
    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        """Advance by the checked input of a step that took `dt` [s]; the fixes of its message,
        if there was one.
        """

    def step(
        self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None
    ) -> list[FixRecord]:
        """Advance by one filter step; the fixes of its message, if there was one.

        Args:
            own: measured in the step; of a missing depth (NaN) the last one is used.
            reception: message and ranges, if one arrived in the step; NaN for a missing range.
            duration: time that this step took, if it is another one than the settings' Δt [s].

        Raises:
            LaisnError: a reading is not finite or out of its range, or a duration not positive.
            ArithmeticError: the covariance is not positive definite any more; the navigator cannot
                be used further.
        """
        self._step += 1
        whole = self.WHOLE_MESSAGES
        require_valid(self._step, own, reception, duration, whole_messages=whole)
        if not math.isnan(own.depth):
            self._depth = own.depth
        own = own._replace(depth=self._depth)
        return self._navigate(own, reception, self.settings.dt if duration is None else duration)

    @property
    def runs_by_steps(self) -> bool:
        """Whether `run` gives what `step` gives in a loop, so that a mission can be navigated while
        it goes on.
        """
        return type(self).run is OnlineNavigator.run

    def run(self, measurements: Measurements) -> Result:
        """Estimates of a whole mission from the start; the same to the bit as `step` in a loop,
        with its errors. ValueError: the measurements have another filter step than the settings, or
        the navigator is under way.
        """
        measurements.require_fresh(self._step, self.settings.dt)
        n = measurements.speed.size
        state = np.empty((n, 4))
        covariance = np.empty((n, 4, 4))
        fixes: list[FixRecord] = []
        durations = (
            [None] * n if measurements.durations is None else measurements.durations.tolist()
        )
        for i, (own, reception) in enumerate(measurements.steps()):
            fixes += self.step(own, reception, durations[i])
            state[i] = self.state
            covariance[i] = self.covariance
        # so that the record of estimates need not copy them
        state.flags.writeable = covariance.flags.writeable = False
        result: Result = self.ESTIMATES.of(state, covariance, fixes)
        return result


def _require_finite(navigator: object, state: Floats, known_start: bool, times: Floats) -> None:
    """LaisnError naming the class of a navigator and the first time at which its estimate is not
    finite.

    `state` are its estimates at `times`, shape (n, 4). Without a known start there may be none at
    first.
    """
    finite: Bools = np.asarray(np.isfinite(state).all(axis=1))
    first = 0
    if not known_start:
        first = int(np.argmax(finite)) if finite.any() else finite.size
    lost = first + np.flatnonzero(~finite[first:])
    if lost.size:
        raise LaisnError(
            f"navigator {class_and_file(navigator)}: its estimate at {times[lost[0]]:g} s is "
            f"{state[lost[0]].tolist()}; expected finite x, y, vx, vy"
        )


class _CustomSteps:
    """Calls `step` of a navigator of the user's own, and checks the state that it leaves."""

    def __init__(self, navigator: Any, settings: Settings) -> None:
        self._navigator = navigator
        self._has_estimate = settings.known_start
        self._time = 0.0
        self.returned: Any = None
        """By the last step of the navigator: its fixes, if it is derived from this project's."""

    def step(self, own: OwnMotion, reception: Reception | None, dt: float) -> Floats:
        """Advance by a step of `dt` [s]; the state after it, shape (4,). LaisnError if the
        navigator has none, or it is not finite once there was an estimate.
        """
        self._time += dt
        with calling(f"navigator {class_and_file(self._navigator)}: step"):
            self.returned = self._navigator.step(own, reception, dt)
        state = _numbers_in(self._navigator, "state", (4,))
        self._has_estimate = self._has_estimate or bool(np.isfinite(state).all())
        _require_finite(self._navigator, state[None], self._has_estimate, np.array([self._time]))
        self._require_biases()
        return state

    def _require_biases(self) -> None:
        """LaisnError if the navigator has an attribute `biases` that is not two finite numbers."""
        if not hasattr(self._navigator, "biases"):
            return
        biases = _numbers_in(self._navigator, "biases", (2,))
        if not np.isfinite(biases).all():
            raise LaisnError(
                f"navigator {class_and_file(self._navigator)}: its `biases` at {self._time:g} s "
                f"are {biases.tolist()}; expected finite numbers, of log [m/s] and compass [rad]"
            )


_MEANINGS = {
    "state": "x, y [m], vx, vy [m/s]",
    "covariance": "that of the state x, y, vx, vy",
    "biases": "of log [m/s] and compass [rad]",
}
"""Attributes of navigators of the user's own."""


def _numbers_in(navigator: object, name: str, shape: tuple[int, ...]) -> Floats:
    """An attribute of a navigator of the user's own; LaisnError if it has not this shape."""
    value = getattr(navigator, name, None)
    numbers = _as_numbers(value)
    if numbers.shape != shape:
        raise LaisnError(
            f"navigator {class_and_file(navigator)}: its `{name}` is {value!r:.60}; expected "
            f"numbers of shape {shape}: {_MEANINGS[name]}"
        )
    return numbers


class CustomNavigator:
    """A navigator of the user's own with `run`: what it returns is checked. All else of it is as
    it is.
    """

    def __init__(self, navigator: Any, settings: Settings) -> None:
        self._navigator = navigator
        self._settings = settings
        self._steps = _CustomSteps(navigator, settings)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._navigator, name)

    def step(
        self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None
    ) -> list[FixRecord]:
        """Advance by one filter step; see `OnlineNavigator.step`. LaisnError if a class that is
        derived from that returns no list of fixes.
        """
        self._steps.step(own, reception, self._settings.dt if duration is None else duration)
        fixes = self._steps.returned
        if isinstance(fixes, list):
            return fixes
        if getattr(self._navigator, "runs_by_steps", False):
            raise LaisnError(
                f"navigator {class_and_file(self._navigator)} returned {type(fixes).__name__} from "
                "`step`; expected a list of laisn.estimates.FixRecord"
            )
        return []

    def run(self, measurements: Measurements) -> Estimates:
        """Its estimates of a mission; LaisnError if they are of another kind, of another number
        of steps, or not finite.
        """
        kind = class_and_file(self._navigator)
        with calling(f"navigator {kind}: run"):
            estimates = self._navigator.run(measurements)
        if not isinstance(estimates, Estimates):
            raise LaisnError(
                f"navigator {kind} returned {type(estimates).__name__} from `run`; expected "
                "laisn.estimates.Estimates"
            )
        steps = measurements.speed.size
        if np.shape(estimates.state) != (steps, 4):
            raise LaisnError(
                f"navigator {kind}: its states have the shape {np.shape(estimates.state)}; "
                f"expected ({steps}, 4) for x, y, vx, vy after each of {steps} steps"
            )
        times: Floats = self._settings.dt * np.arange(1, steps + 1, dtype=np.float64)
        _require_finite(self._navigator, estimates.state, self._settings.known_start, times)
        return estimates


class SteppedNavigator(OnlineNavigator[Estimates]):
    """A plugin's class with `step(own, reception, dt)`, `state` and `covariance`, run over
    missions.

    A message gives a fix at the estimate. LaisnError if state or covariance have another shape, or
    a state is not finite once there was an estimate.
    """

    WHOLE_MESSAGES = False

    def __init__(self, navigator: Any, settings: Settings) -> None:
        super().__init__(settings, None, 0.0)
        self._navigator = navigator
        self._steps = _CustomSteps(navigator, settings)

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        self._state = self._steps.step(own, reception, dt)
        self._covariance = _numbers_in(self._navigator, "covariance", (4, 4))
        if reception is None:
            return []
        received = not all(map(math.isnan, reception.ranges))
        return [self._fix_at_estimate(FixKind.RANGES if received else FixKind.LOST)]

    @property
    def biases(self) -> tuple[float, float]:
        """Estimated biases of log [m/s] and compass [rad], 0 unless the class has an attribute
        of this name.
        """
        log, compass = getattr(self._navigator, "biases", (0.0, 0.0))
        return float(log), float(compass)
