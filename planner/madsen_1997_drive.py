"""Fig. 7 of MAS97, driven: best triplets with free pan against a camera that is forced to look ahead.

The paper compares predicted ellipses along the diagonal of its room (:mod:`localization.madsen_1997_path`);
here the robot drives it, with odometry, a filter and a follower, and what counts is what it touches and how
far it is from where it believes to be.
"""

from __future__ import annotations

import math

import numpy as np

from localization.madsen_1997_path import PATH
from localization.motion import OdometryModel
from localization.sensors import MAS97_CAMERA
from maps.world import World
from planner.choices import Policy
from planner.simulation import SimulatedRobot, simulate
from planner.simulation_report import SimulationReport
from planner.timing import time_polyline

#: The ways to look that are compared: the paper's best, the best ahead, and the paper's arbitrary ahead.
WAYS_TO_LOOK: tuple[Policy, ...] = ("best_triplet", "forced_forward", "arbitrary_forward")
#: A wide robot on simple wheels, in a room that leaves it 0.27 m beside the path at the narrowest place.
ODOMETRY = OdometryModel(distance_sigma=0.03, turn_sigma=0.05, drift_sigma=0.02)
RADIUS = 0.6
START_SIGMAS = (0.05, 0.05, 0.02)
MAX_SPEED, MAX_ACCEL = 1.0, 0.5
FIX_RATE = 2.0
#: Triplets keep this far from the edges of the view: the camera is turned by what the robot believes.
VIEW_MARGIN = math.radians(2.0)


def drive_diagonal(
    room: World,
    *,
    runs: int = 1000,
    rng: np.random.Generator,
    view_margin: float = VIEW_MARGIN,
    threads: int | None = None,
) -> dict[Policy, SimulationReport]:
    """Runs along the diagonal of the room for each of :data:`WAYS_TO_LOOK`, all with the same noise.

    Parameters
    ----------
    room
        The paper's room, ``mas97_room``.
    runs
        Per way to look.
    rng
        Source of the noise.
    view_margin
        How far triplets keep from the edges of the view, rad.
    threads
        Default: one per core.
    """
    trajectory = time_polyline(PATH, max_speed=MAX_SPEED, max_accel=MAX_ACCEL)
    seed = int(rng.integers(0, 2**63))
    out: dict[Policy, SimulationReport] = {}
    for policy in WAYS_TO_LOOK:
        robot = SimulatedRobot(
            radius=RADIUS,
            odometry=ODOMETRY,
            fix_rate=FIX_RATE,
            policy=policy,
            view_margin=view_margin,
            start_covariance=np.diag(START_SIGMAS) ** 2,
        )
        out[policy] = simulate(
            room,
            MAS97_CAMERA,
            trajectory,
            robot=robot,
            runs=runs,
            rng=np.random.default_rng(seed),
            threads=threads,
        )
    return out
