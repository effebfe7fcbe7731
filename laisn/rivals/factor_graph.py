"""Fixed-lag smoother on a factor graph, by GTSAM's incremental solver.

Variables are the pose at each message, the log's bias, the current, the mean error of ranges and
the error that the ranges of one message share. A pose is position and compass bias: rotated by
that, the odometry since the last message leads from one to the next (F. Dellaert, M. Kaess, Factor
graphs for robot perception, 2017; M. Kaess et al., iSAM2, Int. J. Robotics Research 31(2), 2012).
The estimate of the last pose is used, with the odometry since then. The shared error is
proportional to the range; GTSAM's `RangeFactorWithTransformBias2D` adds one bias to all ranges
alike.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import OwnMotion, Reception
from laisn.navigators import GTSAM
from laisn.rivals.filters import STATES, DeadReckoning, slant
from laisn.rivals.leader_track import CurrentMeasurement
from laisn.settings import COMPASS_WALK, RivalSettings

RELINEARISE = 1e-3
"""A variable that moved further since its linearisation is linearised again [m], [rad], [m/s]."""
# of a way [m²]; smaller ones are too near to a constraint for the solver
_NEGLIGIBLE_VARIANCE = 1e-8
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def _odometry_error(
    displacement: Floats,
    path: Floats,
    time: float,
    factor: Any,
    values: Any,
    jacobians: list[Floats] | None,
) -> Floats:
    """R(b_θ)ᵀ (p₂ − p₁ − c t) − (Σ s u Δt − b_v Σ u Δt), and the change of b_θ.

    Of poses (p, b_θ), the log's bias b_v and the current c; `displacement` is Σ s u Δt [m], `path`
    Σ u Δt [s], `time` t [s]. `jacobians`, unless None, gets the derivatives by the increments of
    GTSAM's poses, whose positions are in the frame of the pose, and by the others.
    """
    first, second, log_bias, current = factor.keys()
    pose = values.atPose2(first)
    next_pose = values.atPose2(second)
    rotation = pose.rotation().matrix()
    moved_in_pose = rotation.T @ (
        next_pose.translation() - pose.translation() - values.atPoint2(current) * time
    )
    if jacobians is not None:
        jacobians[0] = np.diag([-1.0, -1.0, -1.0])
        jacobians[1] = np.eye(3)
        jacobians[2] = np.zeros((3, 1))
        jacobians[3] = np.zeros((3, 2))
        jacobians[0][:2, 2] = -_QUARTER_TURN @ moved_in_pose
        jacobians[1][:2, :2] = rotation.T @ next_pose.rotation().matrix()
        jacobians[2][:2, 0] = path
        jacobians[3][:2] = -time * rotation.T
    return np.array(
        [
            *(moved_in_pose - displacement + values.atDouble(log_bias) * path),
            next_pose.theta() - pose.theta(),
        ]
    )


class _Ping(NamedTuple):
    """A range, and what happened since its ping left and arrived."""

    transmitter: Floats  # as of `DeadReckoning._update`, shape (3,), [m]
    range: float  # slant range [m]
    longest: float  # longest range of the message [m]
    # way through the water since then by log and compass, and what it gains for 1 m/s more, shape
    # (2,), [m], [s]
    logged: Floats
    per_speed: Floats
    # indices of the error of this way, east and north, in those of the message; none: it has none
    error: slice
    drift_time: float  # as of `Delays` [s]


def _range_error(ping: _Ping, factor: Any, values: Any, jacobians: list[Floats] | None) -> Floats:
    """ρ (1 + c / max z) − z of a pose (p, b_θ), the error c of its message, the log's bias, the
    current, perhaps the error of the leader's position, true less broadcast, and perhaps errors of
    the ways until the last ping.
    """
    key, common, log_bias, current, *further = factor.keys()
    # the last of all, if there is one
    ways = further[-1:] if ping.error.stop else []
    origin = further[: len(further) - len(ways)]
    pose = values.atPose2(key)
    rotation = pose.rotation().matrix()
    scale = 1.0 + values.atDouble(common) / ping.longest
    per_speed = rotation @ ping.per_speed
    way = rotation @ ping.logged - values.atDouble(log_bias) * per_speed
    displacement = way + ping.drift_time * values.atPoint2(current)
    for error_key in origin:
        displacement = displacement + values.atPoint2(error_key)
    for error_key in ways:
        displacement = displacement + values.atVector(error_key)[ping.error]
    rho, direction = slant(pose.translation(), ping.transmitter + np.append(displacement, 0.0))
    if jacobians is not None:
        by_position = scale * direction @ rotation
        heading_derivative = -scale * direction @ (_QUARTER_TURN @ way)
        jacobians[0] = np.array([[*by_position, heading_derivative]])
        jacobians[1] = np.array([[rho / ping.longest]])
        jacobians[2] = np.array([[scale * direction @ per_speed]])
        jacobians[3] = -scale * ping.drift_time * direction[None]
        for i in range(len(origin)):
            jacobians[4 + i] = -scale * direction[None]
        for error_key in ways:
            by_error = np.zeros((1, values.atVector(error_key).size))
            by_error[0, ping.error] = -scale * direction
            jacobians[4 + len(origin)] = by_error
    return np.array([scale * rho - ping.range])


class FactorGraph(DeadReckoning):
    """Smooths a window of `lag` seconds at each message."""

    KEEPS_READINGS = True  # those of log and compass, for `_odometry`
    MOVES_TRANSMITTERS = False

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """As of `DeadReckoning`; LaisnError if GTSAM is not installed."""
        super().__init__(settings, start)
        try:
            import gtsam
        except ImportError:
            raise LaisnError(f"navigator 'factor-graph' {GTSAM.missing}") from None
        self._gtsam = gtsam
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        parameters.setRelinearizeThreshold(RELINEARISE)
        self._smoother = gtsam.IncrementalFixedLagSmoother(settings.lag, parameters)
        self._time = 0.0
        self._n_messages = 0
        # covariance of what dead reckoning erred from the last ping to its message, which the
        # next odometry holds: poses have the errors of pings [m²]
        self._since_ping = np.zeros((2, 2))
        self._pose = gtsam.symbol("x", 0)
        self._log_bias, self._range_bias, self._current = (gtsam.symbol(name, 0) for name in "vbw")
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        sigma = np.sqrt(np.diag(self.P))
        prior = gtsam.Pose2(self.x[0], self.x[1], 0.0)
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigma[[0, 1, 3]])
        graph.add(gtsam.PriorFactorPose2(self._pose, prior, noise))
        values.insert(self._pose, prior)
        for key, sigma_of_key in ((self._log_bias, sigma[2]), (self._range_bias, sigma[4])):
            graph.add(gtsam.PriorFactorDouble(key, 0.0, self._sigma(sigma_of_key)))
            values.insert(key, 0.0)
        prior_noise = gtsam.noiseModel.Isotropic.Sigma(2, max(float(sigma[5]), 1e-6))
        graph.add(gtsam.PriorFactorPoint2(self._current, np.zeros(2), prior_noise))
        values.insert(self._current, np.zeros(2))
        self._constants = self._log_bias, self._range_bias, self._current
        self._smoother.update(graph, values, dict.fromkeys((self._pose, *self._constants), 0.0))

    def _sigma(self, sigma: float) -> Any:
        return self._gtsam.noiseModel.Isotropic.Sigma(1, max(float(sigma), 1e-6))

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        gtsam = self._gtsam
        settings = self.settings
        displacement, path, noise, elapsed = self._odometry()
        self._n_messages += 1
        self._time += elapsed
        last_pose = self._pose
        self._pose = gtsam.symbol("x", self._n_messages)
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        common = gtsam.symbol("c", self._n_messages)
        covariance = np.diag([0.0, 0.0, COMPASS_WALK**2 * elapsed])
        covariance[:2, :2] = noise + self._since_ping
        model = gtsam.noiseModel.Gaussian.Covariance(covariance)
        odometry_error = partial(_odometry_error, displacement, path, elapsed)
        graph.add(
            gtsam.CustomFactor(
                model, [last_pose, self._pose, self._log_bias, self._current], odometry_error
            )
        )
        values.insert(self._pose, gtsam.Pose2(*self.x[:2], self.x[3]))
        graph.add(
            gtsam.BetweenFactorDouble(
                self._range_bias, common, 0.0, self._sigma(settings.range_scale_sigma)
            )
        )
        values.insert(common, float(self.x[4]))
        received = np.flatnonzero(np.isfinite(ranges))
        range_noise = self._sigma(settings.range_sigma)
        longest = float(ranges[received].max())
        keys_of_all = [self._pose, common, self._log_bias, self._current]
        place_sigma = self._leader_position_variance(reception) ** 0.5
        if place_sigma > 0.0:
            origin = gtsam.symbol("o", self._n_messages)
            noise_of_place = gtsam.noiseModel.Isotropic.Sigma(2, place_sigma)
            graph.add(gtsam.PriorFactorPoint2(origin, np.zeros(2), noise_of_place))
            values.insert(origin, np.zeros(2))
            keys_of_all.append(origin)
        self._since_ping = self._ways.covariance_since_last(received)
        before_last = self._ways.covariance_before_last(received)
        # places of pings in `received` whose ways err
        erring = np.flatnonzero(np.einsum("iikk->i", before_last) > _NEGLIGIBLE_VARIANCE).tolist()
        if erring:
            way_errors = gtsam.symbol("e", self._n_messages)
            size = 2 * len(erring)
            stacked = before_last[np.ix_(erring, erring)].transpose(0, 2, 1, 3).reshape(size, size)
            noise_of_ways = gtsam.noiseModel.Gaussian.Covariance(
                stacked + _NEGLIGIBLE_VARIANCE * np.eye(size)
            )
            graph.add(gtsam.PriorFactorVector(way_errors, np.zeros(size), noise_of_ways))
            values.insert(way_errors, np.zeros(size))
        for place, i in enumerate(received.tolist()):
            errs = place in erring
            ping = _Ping(
                transmitters[i],
                float(ranges[i]),
                longest,
                self._ways.logged[i],
                self._ways.per_speed[i],
                slice(2 * erring.index(place), 2 * erring.index(place) + 2) if errs else slice(0),
                float(self._delays.drift_time[i]),
            )
            keys = [*keys_of_all, way_errors] if errs else keys_of_all
            graph.add(gtsam.CustomFactor(range_noise, keys, partial(_range_error, ping)))
        try:
            self._smoother.update(
                graph, values, dict.fromkeys((*values.keys(), *self._constants), self._time)
            )
        except RuntimeError as failure:
            raise ArithmeticError(f"step {self._step}: {failure}") from None
        pose = self._smoother.calculateEstimatePose2(self._pose)
        rotation = np.eye(3)
        rotation[:2, :2] = pose.rotation().matrix()
        spread = rotation @ self._smoother.marginalCovariance(self._pose) @ rotation.T
        self.x = np.array(
            [
                pose.x(),
                pose.y(),
                self._smoother.calculateEstimateDouble(self._log_bias),
                pose.theta(),
                self._smoother.calculateEstimateDouble(self._range_bias),
                *self._smoother.calculateEstimatePoint2(self._current),
            ]
        )
        # the solver gives marginals: constants count as independent of the pose until the next
        # message
        self.P = np.zeros((STATES, STATES))
        self.P[np.ix_([0, 1, 3], [0, 1, 3])] = spread
        for i, key in ((2, self._log_bias), (4, self._range_bias)):
            self.P[i, i] = self._smoother.marginalCovariance(key)[0, 0]
        self.P[5:, 5:] = self._smoother.marginalCovariance(self._current)
        return True

    def _update_current(self, measurement: CurrentMeasurement) -> None:
        """Add what the leader's way shows of the current to the graph, and to the estimate until
        the next message.
        """
        gtsam = self._gtsam
        graph = gtsam.NonlinearFactorGraph()
        noise = gtsam.noiseModel.Isotropic.Sigma(2, math.sqrt(measurement.variance))
        graph.add(gtsam.PriorFactorPoint2(self._current, measurement.current, noise))
        self._smoother.update(graph, gtsam.Values(), {self._current: self._time})
        super()._update_current(measurement)
