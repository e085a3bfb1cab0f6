"""Pictures of simulated fixes: circles where they belong, dots where the fixes are."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from api.canvas import InvalidPicture
from api.fix_picture import circle_through, fix_png
from localization.sensors import LASER, MAS97_CAMERA
from localization.simulation import FixCloud, simulate_fixes
from localization.triangulation import triangulate
from maps.io.site import bundled_site

WINDOW = (0.0, 0.0, 10.0, 10.0)


def distance_to_circle(line, three):
    """Distances of points from the circle through three points, by its determinant's gradient."""
    (ax, ay), (bx, by), (cx, cy) = three
    d = 2 * (ax * (by - cy) + bx * (cy - ay) + cx * (ay - by))
    a2, b2, c2 = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    ux = (a2 * (by - cy) + b2 * (cy - ay) + c2 * (ay - by)) / d
    uy = (a2 * (cx - bx) + b2 * (ax - cx) + c2 * (bx - ax)) / d
    return np.abs(np.hypot(line[:, 0] - ux, line[:, 1] - uy) - math.hypot(ax - ux, ay - uy))


def test_circles_lie_on_their_three_points(rng):
    for _ in range(50):
        three = rng.uniform(0, 10, (3, 2))
        line = circle_through(three, WINDOW)
        assert distance_to_circle(line, three).max() < 1e-6
        # It passes all three points (they are in the window), as finely as it is drawn.
        for point in three:
            assert np.hypot(*(line - point).T).min() < 1.0


@pytest.mark.parametrize("bend", [0.0, 1e-12, 1e-7])
def test_circles_of_points_in_line_are_lines(bend):
    three = np.array([[1.0, 1.0], [4.0, 4.0 + bend], [8.0, 8.0]])
    line = circle_through(three, WINDOW)
    np.testing.assert_allclose(line[:, 0], line[:, 1], atol=1e-4)
    assert line[:, 0].min() < 0.0
    assert line[:, 0].max() > 10.0


def colors_of(data):
    image = Image.open(io.BytesIO(data))
    assert image.format == "PNG"
    return image.size, np.asarray(image.convert("RGB")).astype(int)


def near(pixels, color):
    return np.count_nonzero(np.abs(pixels - color).sum(axis=2) < 90)


@pytest.mark.parametrize("sensor", [MAS97_CAMERA, LASER], ids=["camera", "laser"])
def test_picture_of_a_cloud(sensor, rng):
    world = bundled_site("mas97_room")
    cloud = simulate_fixes(world, sensor, (2.5, 3.0), n=400, rng=rng)
    size, pixels = colors_of(fix_png(world, cloud, width=900))
    assert size[0] == 900
    assert near(pixels, (0, 92, 230)) > 50
    assert near(pixels, (200, 16, 46)) > 50
    # Dots lie in the right panel, and most of its dots near its middle.
    right = pixels[:, size[0] // 2 :]
    assert near(right, (12, 24, 60)) > 100


def test_picture_without_any_fix():
    world = bundled_site("mas97_room")
    three = np.array([[3.0, 1.0], [1.0, 2.0], [1.0, 0.5]])
    fixes = triangulate([[0.0, 0.0, 0.0]], three)
    cloud = FixCloud(np.array([2.5, 3.0, 0.0]), (0, 1, 2), three, math.nan, fixes, np.eye(3) * 0.01)
    size, _ = colors_of(fix_png(world, cloud, width=700, title="nothing"))
    assert size[0] == 700


@pytest.mark.parametrize("width", [0, 10, 20_000])
def test_impossible_widths(width, rng):
    world = bundled_site("mas97_room")
    cloud = simulate_fixes(world, LASER, (2.5, 3.0), n=10, rng=rng)
    with pytest.raises(InvalidPicture):
        fix_png(world, cloud, width=width)
