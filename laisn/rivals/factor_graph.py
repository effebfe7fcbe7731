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
from laisn.delays import NEGLIGIBLE_DELAY
from laisn.errors import LaisnError
from laisn.messages import OwnMotion, Reception
from laisn.navigators import GTSAM
from laisn.rivals.filters import STATES, DeadReckoning, slant
from laisn.rivals.leader_track import CurrentMeasurement
from laisn.settings import COMPASS_WALK, RivalSettings

RELINEARISE = 1e-3
"""A variable that moved further since its linearisation is linearised again [m], [rad], [m/s]."""
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
    lag: float  # as of `Delays` [s]
    drift_time: float  # as of `Delays` [s]
    water_velocity: Floats  # velocity through the water by log and compass, shape (2,), [m/s]
    ahead: Floats  # unit vector of the heading by the compass, shape (2,)
    # whether that velocity has a random error, a variable of the message
    has_velocity_error: bool


def _range_error(ping: _Ping, factor: Any, values: Any, jacobians: list[Floats] | None) -> Floats:
    """ρ (1 + c / max z) − z of a pose (p, b_θ), the error c of its message, the log's bias, the
    current, perhaps the random error of the velocity over the pings, along the course and to
    starboard, and perhaps the error of the leader's position, true less broadcast.
    """
    key, common, log_bias, current, *further = factor.keys()
    velocity_error = further[:1] if ping.has_velocity_error else []
    origin = further[len(velocity_error) :]
    pose = values.atPose2(key)
    rotation = pose.rotation().matrix()
    scale = 1.0 + values.atDouble(common) / ping.longest
    ahead = rotation @ ping.ahead
    # columns: unit vectors along the course and to starboard
    course = np.column_stack([ahead, -_QUARTER_TURN @ ahead])
    water_velocity = rotation @ ping.water_velocity - values.atDouble(log_bias) * ahead
    for error_key in velocity_error:
        water_velocity = water_velocity + course @ values.atPoint2(error_key)
    displacement = ping.lag * water_velocity + ping.drift_time * values.atPoint2(current)
    for error_key in origin:
        displacement = displacement + values.atPoint2(error_key)
    rho, direction = slant(pose.translation(), ping.transmitter + np.append(displacement, 0.0))
    if jacobians is not None:
        by_position = scale * direction @ rotation
        heading_derivative = -scale * ping.lag * direction @ (_QUARTER_TURN @ water_velocity)
        jacobians[0] = np.array([[*by_position, heading_derivative]])
        jacobians[1] = np.array([[rho / ping.longest]])
        jacobians[2] = np.array([[scale * ping.lag * direction @ ahead]])
        jacobians[3] = -scale * ping.drift_time * direction[None]
        for i in range(len(velocity_error)):
            jacobians[4 + i] = -scale * ping.lag * direction[None] @ course
        for i in range(len(velocity_error), len(further)):
            jacobians[4 + i] = -scale * direction[None]
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
        covariance[:2, :2] = noise
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
        keys = [self._pose, common, self._log_bias, self._current]
        has_velocity_error = bool(np.any(self._delays.lag[received] > NEGLIGIBLE_DELAY))
        if has_velocity_error:
            velocity_error = gtsam.symbol("e", self._n_messages)
            sigmas = np.sqrt(self._variances_over_pings(own))
            noise_of_velocity = gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sigmas, 1e-6))
            graph.add(gtsam.PriorFactorPoint2(velocity_error, np.zeros(2), noise_of_velocity))
            values.insert(velocity_error, np.zeros(2))
            keys.append(velocity_error)
        place_sigma = self._leader_position_variance(reception) ** 0.5
        if place_sigma > 0.0:
            origin = gtsam.symbol("o", self._n_messages)
            noise_of_place = gtsam.noiseModel.Isotropic.Sigma(2, place_sigma)
            graph.add(gtsam.PriorFactorPoint2(origin, np.zeros(2), noise_of_place))
            values.insert(origin, np.zeros(2))
            keys.append(origin)
        ahead = np.array([np.sin(own.heading), np.cos(own.heading)])
        for i in received.tolist():
            delays = float(self._delays.lag[i]), float(self._delays.drift_time[i])
            water_velocity = self._mean_speed.speed * ahead
            ping = _Ping(
                transmitters[i],
                float(ranges[i]),
                longest,
                *delays,
                water_velocity,
                ahead,
                has_velocity_error,
            )
            graph.add(gtsam.CustomFactor(range_noise, keys, partial(_range_error, ping)))
        try:
            self._smoother.update(
                graph, values, dict.fromkeys((*keys, *self._constants), self._time)
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
