"""Information of one fix in every cell of a field, for the filter's searches."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Ellipses smaller than the triplet's own by no more than this share are the triplet's.
_SAME = 1e-6


@njit(cache=True, nogil=True)
def fix_information(
    triplet, covariance, sigma_theta, pan, transform, positions, survey, sensor, padded, widening, stop
):
    """Fill ``padded`` ((ny + 2)(nx + 2), 6): xx, xy, yy, xθ, yθ, θθ; and ``widening`` (ny, nx).

    ``Σ hᵀ h / v`` over the bearings of each cell's ``triplet`` (ny, nx, 3), ``h`` their gradients in x, y and
    heading, divided by ``widening`` where the ellipse of ``covariance`` (ny, nx, 3), NaN without a fix, is
    larger than the triplet's; where it is smaller or there is no triplet: of ``covariance`` and
    ``sigma_theta`` (ny, nx) apart, and NaN in ``widening``. ``pan`` (ny, nx), rad; ``transform`` (5,): as of
    ``line_cost``; ``positions`` (N, 2) and ``survey`` (N,) of the landmarks, m, m²; ``sensor`` (6,): x and y
    from the robot to the sensor, m, azimuth of its axis in W, variance on the axis and its floor, rad², and
    0 where that variance counts all around. Returns whether it came to its end before ``stop`` (1,) was set.
    """
    ny, nx = widening.shape
    # Row by row: the first touch of so much memory takes time that a stop must be able to cut short.
    padded[: nx + 2] = 0.0
    padded[(ny + 1) * (nx + 2) :] = 0.0
    for row in range(ny):
        if stop[0] != 0:
            return False
        padded[(row + 1) * (nx + 2) : (row + 2) * (nx + 2)] = 0.0
        for col in range(nx):
            widening[row, col] = np.nan
            P = covariance[row, col]
            if math.isnan(P[0]):
                continue
            at = (row + 1) * (nx + 2) + col + 1
            own = P[0] * P[2] - P[1] * P[1]
            known = True
            for i in range(3):
                known = known and 0 <= triplet[row, col, i] < positions.shape[0]
            if known:
                u = (col + 0.5) * transform[4]
                v = (row + 0.5) * transform[4]
                x = transform[0] + transform[2] * u - transform[3] * v + sensor[0]
                y = transform[1] + transform[3] * u + transform[2] * v + sensor[1]
                look = sensor[2] + (0.0 if math.isnan(pan[row, col]) else pan[row, col])
                for i in range(3):
                    j = triplet[row, col, i]
                    dx = positions[j, 0] - x
                    dy = positions[j, 1] - y
                    r2 = dx * dx + dy * dy
                    hx = dy / r2
                    hy = -dx / r2
                    ht = hy * sensor[0] - hx * sensor[1] - 1.0
                    variance = survey[j] / r2 + sensor[4]
                    if sensor[5] == 0.0:
                        variance += sensor[3]
                    else:
                        variance += sensor[3] * math.cos(math.atan2(dy, dx) - look) ** 4
                    padded[at, 0] += hx * hx / variance
                    padded[at, 1] += hx * hy / variance
                    padded[at, 2] += hy * hy / variance
                    padded[at, 3] += hx * ht / variance
                    padded[at, 4] += hy * ht / variance
                    padded[at, 5] += ht * ht / variance
                J = padded[at]
                # Of the position: the Schur complement of the heading.
                xx = J[0] - J[3] * J[3] / J[5]
                xy = J[1] - J[3] * J[4] / J[5]
                yy = J[2] - J[4] * J[4] / J[5]
                det = (xx * yy - xy * xy) * own
                wider = math.sqrt(det) if det > 0.0 else np.nan
                if wider > 1.0 - _SAME:
                    widening[row, col] = max(wider, 1.0)
                    for i in range(6):
                        J[i] /= widening[row, col]
                    continue
            padded[at, 0] = P[2] / own
            padded[at, 1] = -P[1] / own
            padded[at, 2] = P[0] / own
            padded[at, 3] = 0.0
            padded[at, 4] = 0.0
            padded[at, 5] = 1.0 / sigma_theta[row, col] ** 2
    return True
