"""Poses from three bearings: a million fixes on one core, against numpy and against published figures."""

from __future__ import annotations

import math
import time

import numpy as np

from localization.camera import Camera
from localization.triangulation import triangulate, triangulate_columns

TITLE = "Triangulation: a batch of fixes on one core (processor time of one thread)"
SIDE_M = 15.0


def numpy_total(bearings, landmarks):
    """Poses (N, 3) by the published formulas of ToTal, as array operations."""
    x2, y2 = landmarks[:, 1, 0], landmarks[:, 1, 1]
    x1, y1 = landmarks[:, 0, 0] - x2, landmarks[:, 0, 1] - y2
    x3, y3 = landmarks[:, 2, 0] - x2, landmarks[:, 2, 1] - y2
    t12 = 1 / np.tan(bearings[:, 1] - bearings[:, 0])
    t23 = 1 / np.tan(bearings[:, 2] - bearings[:, 1])
    t31 = (1 - t12 * t23) / (t12 + t23)
    x12, y12 = x1 + t12 * y1, y1 - t12 * x1
    x23, y23 = x3 - t23 * y3, y3 + t23 * x3
    x31, y31 = (x3 + x1) + t31 * (y3 - y1), (y3 + y1) - t31 * (x3 - x1)
    k31 = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1)
    d = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31)
    x, y = x2 + k31 * (y12 - y23) / d, y2 + k31 * (x23 - x12) / d
    heading = np.arctan2(y2 - y, x2 - x) - bearings[:, 1]
    return np.column_stack([x, y, heading - 2 * math.pi * np.floor(heading / (2 * math.pi) + 0.5)])


def numpy_with_covariance(bearings, landmarks, sigma):
    """Poses and covariances (N, 3, 3): inverse of the information of each fix."""
    pose = numpy_total(bearings, landmarks)
    d = landmarks - pose[:, None, :2]
    r2 = (d**2).sum(axis=2)
    h = np.stack([d[..., 1] / r2, -d[..., 0] / r2, np.full_like(r2, -1.0)], axis=-1)
    return pose, np.linalg.inv(np.einsum("nki,nkj->nij", h, h) / sigma**2)


def microseconds(call, n, repeats):
    call()
    best = math.inf
    for _ in range(repeats):
        began = time.thread_time()
        call()
        best = min(best, time.thread_time() - began)
    return 1e6 * best / n


def run(n=1_000_000, repeats=7):
    rng = np.random.default_rng(11)
    pose = np.column_stack([rng.uniform(0, SIDE_M, (n, 2)), rng.uniform(-math.pi, math.pi, n)])
    landmarks = rng.uniform(0, SIDE_M, (n, 3, 2))
    d = landmarks - pose[:, None, :2]
    bearings = np.arctan2(d[..., 1], d[..., 0]) - pose[:, 2:]
    shared = landmarks[0].copy()
    to_shared = shared - pose[:, None, :2]
    seen = np.arctan2(to_shared[..., 1], to_shared[..., 0]) - pose[:, 2:]
    camera = Camera(512.0, 256.0)
    columns = rng.uniform(0, 512, (n, 3))
    sigmas = np.full((n, 3), 0.01)
    few = min(n, 100_000)
    calls = {
        "pose": (lambda: triangulate(bearings, landmarks), n),
        "pose, landmarks shared": (lambda: triangulate(seen, shared), n),
        "pose from columns": (lambda: triangulate_columns(columns, shared, camera), n),
        "pose + 3×3 covariance": (lambda: triangulate(bearings, landmarks, sigma=0.01), n),
        "pose + covariance, sigma per bearing": (lambda: triangulate(bearings, landmarks, sigma=sigmas), n),
        "numpy, pose": (lambda: numpy_total(bearings[:few], landmarks[:few]), few),
        "numpy, pose + 3×3 covariance": (
            lambda: numpy_with_covariance(bearings[:few], landmarks[:few], 0.01),
            few,
        ),
    }
    took = {name: microseconds(call, size, repeats) for name, (call, size) in calls.items()}
    fixes = triangulate(bearings, landmarks)
    error = np.hypot(*(fixes.pose - pose)[fixes.ok, :2].T)
    accuracy = {
        "pose": f"{np.median(error):.1e} / {np.quantile(error, 0.999):.1e}",
        "numpy, pose": _accuracy(numpy_total(bearings, landmarks), pose),
    }
    published = {"pose": "0.163 (ToTal in C, i7-920); 0.051 (same, AMD EPYC)"}
    rows = []
    for name, value in took.items():
        reference = "numpy, pose" if "covariance" not in name else "numpy, pose + 3×3 covariance"
        rows.append(
            {
                "batch": name,
                "µs per fix": f"{value:.3f}",
                "times numpy's speed": f"{took[reference] / value:.1f}",
                "error median / 99.9 % [m]": accuracy.get(name, ""),
                "published, other machines [µs]": published.get(name, ""),
            }
        )
    return rows


def _accuracy(found, pose):
    error = np.hypot(*(found - pose)[:, :2].T)
    return f"{np.nanmedian(error):.1e} / {np.nanquantile(error, 0.999):.1e}"
