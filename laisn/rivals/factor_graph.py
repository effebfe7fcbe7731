"""Fixed-lag smoother on a factor graph, by GTSAM's incremental solver.

Variables are the pose at each message, the log's bias, the mean error of ranges and the error that the ranges of one
message share. A pose is position and compass bias: rotated by that, the odometry since the last message leads from one
to the next. A range is a `RangeFactorWithTransformBias2D` to a point at the transmitter (F. Dellaert, M. Kaess, Factor
graphs for robot perception, 2017; M. Kaess et al., iSAM2, Int. J. Robotics Research 31(2), 2012). The estimate of the
last pose is used, with the odometry since then.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.messages import OwnMotion, Reception
from laisn.rivals.odometry import COMPASS_WALK, STATES, OdometrySums
from laisn.rivals.settings import RivalSettings

KNOWN_SIGMA = 1e-4
"""Standard deviation of what is known: transmitters [m]."""
_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def _gtsam() -> Any:
    """GTSAM, which is optional and takes long to import."""
    try:
        import gtsam
    except ImportError:
        raise LaisnError(
            'navigator "factor-graph" needs GTSAM, which is not installed; install it with: pip install "gtsam>=4.3a1"'
        ) from None
    return gtsam


def _odometry_error(way: Floats, path: Floats, factor: Any, values: Any, jacobians: list[Floats] | None) -> Floats:
    """R(b_θ)ᵀ (p₂ − p₁) − (Σ s u Δt − b_v Σ u Δt), and the change of b_θ, of poses (p, b_θ) and the log's bias b_v.

    Jacobians are by the increments of GTSAM's poses, whose positions are in the frame of the pose.
    """
    first, second, log_bias = factor.keys()
    one, two = values.atPose2(first), values.atPose2(second)
    rotation = one.rotation().matrix()
    moved = rotation.T @ (two.translation() - one.translation())
    if jacobians is not None:
        jacobians[0], jacobians[1], jacobians[2] = -np.eye(3), np.eye(3), np.zeros((3, 1))
        jacobians[0][:2, 2] = -_TURN @ moved
        jacobians[1][:2, :2] = rotation.T @ two.rotation().matrix()
        jacobians[2][:2, 0] = path
    return np.array([*(moved - way + values.atDouble(log_bias) * path), two.theta() - one.theta()])


class FactorGraph(OdometrySums):
    """Smooths a window of `lag` seconds at each message."""

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """As of `DeadReckoning`; LaisnError if GTSAM is not installed."""
        super().__init__(settings, start)
        gtsam = self._gtsam = _gtsam()
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        self._smoother = gtsam.IncrementalFixedLagSmoother(settings.lag, parameters)
        self._time, self._messages, self._pose = 0.0, 0, gtsam.symbol("x", 0)
        self._log_bias, self._range_bias = gtsam.symbol("v", 0), gtsam.symbol("b", 0)
        graph, values, sigma = gtsam.NonlinearFactorGraph(), gtsam.Values(), np.sqrt(np.diag(self.P))
        prior, noise = gtsam.Pose2(*self.x[:2], 0.0), gtsam.noiseModel.Diagonal.Sigmas(sigma[[0, 1, 3]])
        graph.add(gtsam.PriorFactorPose2(self._pose, prior, noise))
        values.insert(self._pose, prior)
        for key, of in ((self._log_bias, sigma[2]), (self._range_bias, sigma[4])):
            graph.add(gtsam.PriorFactorDouble(key, 0.0, self._sigma(of)))
            values.insert(key, 0.0)
        self._smoother.update(graph, values, dict.fromkeys((self._pose, self._log_bias, self._range_bias), 0.0))

    def _sigma(self, sigma: float) -> Any:
        return self._gtsam.noiseModel.Isotropic.Sigma(1, max(float(sigma), 1e-6))

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        gtsam, settings = self._gtsam, self.settings
        way, path, noise, since = self._odometry()
        self._messages, self._time = self._messages + 1, self._time + since
        before, self._pose = self._pose, gtsam.symbol("x", self._messages)
        graph, values, common = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.symbol("c", self._messages)
        covariance = np.diag([0.0, 0.0, COMPASS_WALK**2 * since])
        covariance[:2, :2] = noise
        model, error = gtsam.noiseModel.Gaussian.Covariance(covariance), partial(_odometry_error, way, path)
        graph.add(gtsam.CustomFactor(model, [before, self._pose, self._log_bias], error))
        values.insert(self._pose, gtsam.Pose2(*self.x[:2], self.x[3]))
        graph.add(gtsam.BetweenFactorDouble(self._range_bias, common, 0.0, self._sigma(settings.range_scale_sigma)))
        values.insert(common, float(self.x[4]))
        new = [self._pose, common, self._log_bias, self._range_bias]
        for i in np.flatnonzero(np.isfinite(ranges)).tolist():
            # ranges in the plane: the depths are known
            level = math.sqrt(max(ranges[i] ** 2 - below[i, 2] ** 2, 1e-4))
            point, sigma = gtsam.symbol("l", 3 * self._messages + i), settings.range_sigma * ranges[i] / level
            graph.add(gtsam.PriorFactorPoint2(point, below[i, :2], gtsam.noiseModel.Isotropic.Sigma(2, KNOWN_SIGMA)))
            graph.add(gtsam.RangeFactorWithTransformBias2D(
                self._pose, point, common, level, self._sigma(sigma), gtsam.Pose2()
            ))  # fmt: skip
            values.insert(point, below[i, :2])
            new.append(point)
        try:
            self._smoother.update(graph, values, dict.fromkeys(new, self._time))
        except RuntimeError as error_of:
            raise ArithmeticError(f"step {self._step}: {error_of}") from None
        pose, turned = self._smoother.calculateEstimatePose2(self._pose), np.eye(3)
        turned[:2, :2] = pose.rotation().matrix()
        spread = turned @ self._smoother.marginalCovariance(self._pose) @ turned.T
        self.x = np.array([
            pose.x(), pose.y(), self._smoother.calculateEstimateDouble(self._log_bias), pose.theta(),
            self._smoother.calculateEstimateDouble(self._range_bias),
        ])  # fmt: skip
        # the solver gives marginals: the log's bias counts as independent of the pose until the next message
        self.P = np.zeros((STATES, STATES))
        self.P[np.ix_([0, 1, 3], [0, 1, 3])] = spread
        for i, key in ((2, self._log_bias), (4, self._range_bias)):
            self.P[i, i] = self._smoother.marginalCovariance(key)[0, 0]
        return True
