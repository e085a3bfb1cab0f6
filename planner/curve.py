"""A C² curve through given points: densely sampled, timed, and checked against the cost space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from maps.arrays import FloatArray, frozen
from planner.cost_space import CostSpace
from planner.kernels.corridor import chord_costs
from planner.kernels.timing import motion_at, speed_profile, station_times
from planner.result import Trajectory
from planner.timing import sample_spacing

#: Distance between the dense stations of a curve, m.
DENSE_M = 0.02
_MAX_DENSE = 40_000
#: By this much a curve may miss the clearance that is asked for, m.
CLEARANCE_TOLERANCE_M = 1e-6
# Limits are planned this share below what is allowed: between stations the acceleration bulges a little.
_MARGIN = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Natural cubic spline by chord length, and its dense stations.

    Attributes
    ----------
    spline
        Position (x, y), m, over the parameter u (chord length through the points given, m).
    u, s
        Shape (K,): parameter and arc length of the dense stations, m.
    points
        Shape (K, 2): places of the dense stations in W, m.
    kappa
        Shape (K,): signed curvature there, 1/m, positive to the left.
    """

    spline: CubicSpline
    u: FloatArray
    s: FloatArray
    points: FloatArray
    kappa: FloatArray

    def __post_init__(self) -> None:
        for name in ("u", "s", "points", "kappa"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def length(self) -> float:
        """Arc length, m."""
        return float(self.s[-1])


@dataclass(frozen=True, slots=True, eq=False)
class CurveCheck:
    """What a curve keeps, judged on its dense chords.

    Attributes
    ----------
    cost
        ``∫ rate ds`` along the chords; inf where one enters a forbidden cell.
    deficit
        Shape (K - 1,), m: by how much each chord's exact clearance misses the radius plus the bound of the
        curve's distance from the chord; positive where it does.
    forbidden
        Shape (K - 1,), bool: chords that enter a forbidden cell.
    """

    cost: float
    deficit: FloatArray
    forbidden: FloatArray

    @property
    def worst(self) -> float:
        """Largest deficit, m; 0 where there is none."""
        return float(self.deficit.max(initial=0.0))

    @property
    def is_valid(self) -> bool:
        """Whether clearance and cells are as they must be, everywhere."""
        return math.isfinite(self.cost) and self.worst <= CLEARANCE_TOLERANCE_M

    def complaint(self) -> str:
        """What is wrong with the curve, in words."""
        if self.forbidden.any():
            return "the smooth path enters a forbidden cell"
        return f"the smooth path misses its clearance by {self.worst:.6f} m"


def curve_through(points: FloatArray) -> Curve:
    """Natural cubic spline, parameterised by chord length, through points (N, 2), N ≥ 2, all distinct."""
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    spline = CubicSpline(chord, points, bc_type="natural")
    n = int(np.clip(math.ceil(chord[-1] / DENSE_M), 8, _MAX_DENSE))
    # Closer at the ends, which may lie just as near to a wall as allowed: chords there miss the curve least.
    even = np.linspace(0.0, 1.0, n + 1)
    near = np.array([0.125, 0.25, 0.5]) / n
    u = chord[-1] * np.concatenate([even[:1], near, even[1:-1], 1.0 - near[::-1], even[-1:]])
    slope = spline(u, 1)
    bend = spline(u, 2)
    speed = np.hypot(slope[:, 0], slope[:, 1])
    middle = np.hypot(*spline(0.5 * (u[:-1] + u[1:]), 1).T)
    # Simpson: exact to 1e-9 of the length at this density.
    steps = np.diff(u) * (speed[:-1] + 4.0 * middle + speed[1:]) / 6.0
    cross = slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]
    kappa = cross / np.maximum(speed, 1e-9) ** 3
    dense = spline(u)
    dense[0], dense[-1] = points[0], points[-1]
    return Curve(spline, u, np.concatenate([[0.0], np.cumsum(steps)]), dense, kappa)


def check_curve(curve: Curve, space: CostSpace) -> CurveCheck:
    """Exact cost and clearance of the dense chords of a curve.

    A curve of curvature at most κ is nowhere further than ``κ l² / 8`` from a chord of length l; every
    chord has to keep that much more than the radius, so that the curve itself keeps the radius.
    """
    k = len(curve.points) - 1
    bound = np.maximum(np.abs(curve.kappa[:-1]), np.abs(curve.kappa[1:]))
    sag = 0.125 * bound * np.diff(curve.s) ** 2
    cost, deficit = np.empty(k), np.empty(k)
    chord_costs(curve.points, sag, cost, deficit, *space.kernel_args)
    return CurveCheck(float(cost.sum()), deficit, ~np.isfinite(cost))


def time_curve(curve: Curve, *, max_speed: float, max_accel: float) -> Trajectory:
    """Fastest motion along a curve from rest to rest.

    Largest ``v²`` at every dense station (backward, then forward) such that ``a² + (κ v²)² ≤ max_accel²``
    with the tangential acceleration ``a`` constant between stations. The limits hold for the samples and for
    the mean acceleration between them; what rounding leaves over is taken up by stretching time.

    Parameters
    ----------
    curve
        The way.
    max_speed, max_accel
        Limits, m/s and m/s².
    """
    steps = np.diff(curve.s)
    b = np.empty(len(curve.s))
    speed_profile(np.abs(curve.kappa), steps, max_speed, max_accel * (1.0 - _MARGIN), b)
    times = np.empty(len(b))
    station_times(b, steps, times)
    total = float(times[-1])
    t = np.linspace(0.0, total, math.ceil(total / sample_spacing(total)) + 1)
    s, v, a = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    motion_at(t, times, b, steps, curve.s, s, v, a)
    v[-1] = 0.0
    s[-1] = curve.s[-1]
    points, velocity, acceleration = _motion(curve, s, v, a)
    stretch = _stretch(t, points, velocity, acceleration, max_speed, max_accel)
    return Trajectory(t * stretch, points, velocity / stretch, acceleration / stretch**2)


def motion_on_curve(curve: Curve, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Places (K, 2), headings, curvature and its change per metre at arc lengths (K,)."""
    u = _parameter(curve, s)
    first, second = curve.spline(u, 1), curve.spline(u, 2)
    speed = np.hypot(first[:, 0], first[:, 1])
    kappa = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    points = curve.spline(u)
    points[0], points[-1] = curve.points[0], curve.points[-1]
    which = np.clip(np.searchsorted(curve.s, s, side="right") - 1, 0, len(curve.s) - 2)
    twist = np.diff(curve.kappa)[which] / np.diff(curve.s)[which]
    return points, np.arctan2(first[:, 1], first[:, 0]), kappa, twist


def _parameter(curve: Curve, s: FloatArray) -> FloatArray:
    rate = np.hypot(*curve.spline(curve.u, 1).T)
    return np.asarray(np.clip(CubicHermiteSpline(curve.s, curve.u, 1.0 / rate)(s), 0.0, curve.u[-1]))


def _motion(
    curve: Curve, s: FloatArray, v: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    # Places, velocities and accelerations at arc lengths s with speeds v and tangential accelerations a.
    u = _parameter(curve, s)
    first, second = curve.spline(u, 1), curve.spline(u, 2)
    speed = np.hypot(first[:, 0], first[:, 1])[:, None]
    tangent = first / speed
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    kappa = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[:, None] / speed**3
    points = curve.spline(u)
    points[0], points[-1] = curve.points[0], curve.points[-1]
    acceleration = a[:, None] * tangent + (v**2)[:, None] * kappa * normal
    return points, v[:, None] * tangent, acceleration


def _stretch(
    t: FloatArray,
    points: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    max_speed: float,
    max_accel: float,
) -> float:
    # Factor ≥ 1 on time after which both limits hold, for the samples and for differences between them.
    dt = np.diff(t)[:, None]
    speeds = [np.hypot(*velocity.T), np.hypot(*(np.diff(points, axis=0) / dt).T)]
    accels = [np.hypot(*acceleration.T), np.hypot(*(np.diff(velocity, axis=0) / dt).T)]
    over_speed = float(max(x.max() for x in speeds)) / max_speed
    over_accel = float(max(x.max() for x in accels)) / max_accel
    return max(1.0, over_speed, math.sqrt(over_accel)) * (1.0 + 1e-12)
