"""Pose from any number of bearings: weighted least squares by damped Gauss-Newton steps.

The bearing of landmark i at d from the robot is ``atan2(d_y, d_x) - θ``; its gradient by (x, y, θ) is
``(d_y/r², -d_x/r², -1)``. Weights are inverse variances, so a step is measured in standard deviations.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import wrapped

CONVERGED = 0
SINGULAR = 1
NO_CONVERGENCE = 2

#: Pivot of the information with unit diagonal below which rounding would decide the covariance.
SINGULAR_PIVOT = 1e-12
# Squared lengths of steps, in standard deviations: done, and small enough when nothing improves any more.
_DONE = 1e-18
_STUCK = 1e-8
_DAMPING_MAX = 1e8


@njit(cache=True, nogil=True)
def chi_square(bearings, landmarks, weights, x, y, heading):
    """Weighted sum of squared residuals of bearings (M,) to landmarks (M, 2) from a pose."""
    total = 0.0
    for i in range(bearings.shape[0]):
        azimuth = math.atan2(landmarks[i, 1] - y, landmarks[i, 0] - x)
        residual = wrapped(bearings[i] + heading - azimuth)
        total += weights[i] * residual * residual
    return total


@njit(cache=True, nogil=True)
def linearised(bearings, landmarks, weights, pose, information, gradient):
    """Information (3, 3) and weighted residuals (3,) at a pose (3,); False on top of a landmark."""
    information[:] = 0.0
    gradient[:] = 0.0
    for i in range(bearings.shape[0]):
        dx = landmarks[i, 0] - pose[0]
        dy = landmarks[i, 1] - pose[1]
        r2 = dx * dx + dy * dy
        if r2 < 1e-300:
            return False
        hx = dy / r2
        hy = -dx / r2
        w = weights[i]
        e = w * wrapped(bearings[i] + pose[2] - math.atan2(dy, dx))
        information[0, 0] += w * hx * hx
        information[0, 1] += w * hx * hy
        information[0, 2] -= w * hx
        information[1, 1] += w * hy * hy
        information[1, 2] -= w * hy
        information[2, 2] += w
        gradient[0] += e * hx
        gradient[1] += e * hy
        gradient[2] -= e
    information[1, 0] = information[0, 1]
    information[2, 0] = information[0, 2]
    information[2, 1] = information[1, 2]
    return True


@njit(cache=True, nogil=True)
def cholesky(matrix, damping, lower, scale):
    """Lower factor (3, 3) of ``S (matrix + damping · diagonal) S``, S (3,) making the diagonal 1 + damping.

    Returns the smallest squared pivot, 0 when the matrix is not positive definite.
    """
    for i in range(3):
        if not matrix[i, i] > 0.0:
            return 0.0
        scale[i] = 1.0 / math.sqrt(matrix[i, i])
    least = np.inf
    for i in range(3):
        for j in range(i + 1):
            value = matrix[i, j] * scale[i] * scale[j]
            if i == j:
                value += damping
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                if not value > 0.0:
                    return 0.0
                least = min(least, value)
                lower[i, i] = math.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    return least


@njit(cache=True, nogil=True)
def solve(lower, scale, right, solution):
    """Solution (3,) of the system that :func:`cholesky` has factored."""
    for i in range(3):
        value = right[i] * scale[i]
        for k in range(i):
            value -= lower[i, k] * solution[k]
        solution[i] = value / lower[i, i]
    for i in range(2, -1, -1):
        value = solution[i]
        for k in range(i + 1, 3):
            value -= lower[k, i] * solution[k]
        solution[i] = value / lower[i, i]
    for i in range(3):
        solution[i] *= scale[i]


@njit(cache=True, nogil=True)
def refine(bearings, landmarks, weights, steps, pose, covariance):
    """Least-squares pose from the start in ``pose`` (3,), and its covariance (3, 3), both written.

    ``bearings`` (M,) rad, ``landmarks`` (M, 2) m, ``weights`` (M,) rad⁻². Returns the outcome, the number of
    steps tried and the weighted sum of squared residuals.
    """
    information = np.zeros((3, 3))
    lower = np.zeros((3, 3))
    gradient = np.zeros(3)
    scale = np.zeros(3)
    step = np.zeros(3)
    best = chi_square(bearings, landmarks, weights, pose[0], pose[1], pose[2])
    damping = 0.0
    outcome = NO_CONVERGENCE
    tried = 0
    while tried < steps and outcome == NO_CONVERGENCE:
        if not linearised(bearings, landmarks, weights, pose, information, gradient):
            return SINGULAR, tried, best
        while tried < steps:
            tried += 1
            if cholesky(information, damping, lower, scale) <= 0.0:
                damping = max(1e-6, 10.0 * damping)
                if damping > _DAMPING_MAX:
                    return SINGULAR, tried, best
                continue
            solve(lower, scale, gradient, step)
            length = step[0] * gradient[0] + step[1] * gradient[1] + step[2] * gradient[2]
            value = chi_square(
                bearings, landmarks, weights, pose[0] + step[0], pose[1] + step[1], pose[2] + step[2]
            )
            if value <= best:
                pose[0] += step[0]
                pose[1] += step[1]
                pose[2] = wrapped(pose[2] + step[2])
                best = value
                if length <= _DONE * (1.0 + best):
                    outcome = CONVERGED
                damping = 0.0 if damping < 1e-5 else 0.1 * damping
                break
            if length <= _STUCK * (1.0 + best) and damping == 0.0:
                outcome = CONVERGED
                break
            damping = max(1e-6, 10.0 * damping)
            if damping > _DAMPING_MAX:
                return NO_CONVERGENCE, tried, best
    if outcome != CONVERGED:
        return outcome, tried, best
    if not linearised(bearings, landmarks, weights, pose, information, gradient):
        return SINGULAR, tried, best
    if cholesky(information, 0.0, lower, scale) <= SINGULAR_PIVOT:
        return SINGULAR, tried, best
    for j in range(3):
        gradient[:] = 0.0
        gradient[j] = 1.0
        solve(lower, scale, gradient, step)
        for i in range(3):
            covariance[i, j] = step[i]
    for i in range(3):
        for j in range(i):
            mean = 0.5 * (covariance[i, j] + covariance[j, i])
            covariance[i, j] = mean
            covariance[j, i] = mean
    return CONVERGED, tried, best


@njit(cache=True, nogil=True)
def refine_many(bearings, landmarks, weights, steps, started, poses, outcome, cost):
    """Least-squares poses (n, 3) of bearings (n, M) to the same landmarks (M, 2) with weights (M,).

    Where ``started`` (n,) ``poses`` holds the start and gets the result; ``outcome`` and ``cost`` (n,) are as
    of ``refine``, ``SINGULAR`` and inf where there is no start.
    """
    covariance = np.empty((3, 3))
    for i in range(bearings.shape[0]):
        outcome[i] = SINGULAR
        cost[i] = np.inf
        if started[i]:
            result, _, value = refine(bearings[i], landmarks, weights, steps, poses[i], covariance)
            outcome[i] = result
            cost[i] = value
