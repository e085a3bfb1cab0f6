"""Fields and worlds as pictures. Top row is the highest y; every length in a picture is stated."""

from __future__ import annotations

from PIL import Image

from api import layers
from api.canvas import BBox, InvalidPicture, check_bbox, encode_png, fit_view, picture_size
from api.colormaps import COLORMAPS, DEFAULT_COLORMAP
from localization.uncertainty_field import METRICS, UncertaintyField
from maps.world import World

_MARGIN = 12
BAR_WIDTH = 118
#: The least picture that holds a colour bar, px.
LEAST_WIDTH, LEAST_HEIGHT = 200, 130


def default_scale(metric: str) -> str:
    """Scale of the colours that suits a metric: linear for counts and shares, log for lengths and areas."""
    return "linear" if metric in {"n_visible", "validity"} else "log"


def room_for_bar(width: int, height: int, asked: tuple[int | None, int | None]) -> tuple[int, int]:
    """Size of a picture with a colour bar, px: sides that nobody asked for grow to what it takes.

    Raises
    ------
    InvalidPicture
        If a side that was asked for is too small.
    """
    if (asked[0] or LEAST_WIDTH) < LEAST_WIDTH or (asked[1] or LEAST_HEIGHT) < LEAST_HEIGHT:
        raise InvalidPicture(
            f"A picture with a colour bar starts at {LEAST_WIDTH} × {LEAST_HEIGHT} px; "
            "ask for a larger one or for one without the bar (legend false)."
        )
    return max(width, LEAST_WIDTH), max(height, LEAST_HEIGHT)


def heatmap_png(
    field: UncertaintyField,
    *,
    metric: str = "area95_m2",
    width: int | None = None,
    height: int | None = None,
    max_size: int = 1200,
    bbox: BBox | None = None,
    colormap: str = DEFAULT_COLORMAP,
    vmin: float | None = None,
    vmax: float | None = None,
    scale: str | None = None,
    legend: bool = True,
    landmarks: bool = True,
) -> bytes:
    """Heatmap of one metric over the floor, as PNG.

    Parameters
    ----------
    field
        What to draw.
    metric
        Key of :data:`localization.uncertainty_field.METRICS`.
    width, height
        Size of the picture, px, colour bar included; one or both may be missing, then the longer side
        follows ``max_size`` and the shape of the window.
    bbox
        Window ``(x_min, y_min, x_max, y_max)`` in W, m; None: the whole map.
    colormap
        Key of :data:`api.colormaps.COLORMAPS`.
    vmin, vmax
        Ends of the colours; default the 1st and 99th percentile of the window.
    scale
        ``log`` or ``linear``; default :func:`default_scale`.
    legend
        Whether a colour bar stands at the right.
    landmarks
        Whether landmarks are drawn.

    Raises
    ------
    InvalidPicture
        If size, window, range, scale or colour map make no sense, or the metric is not known for the field's
        estimator.
    """
    if metric not in METRICS:
        raise InvalidPicture(f"Unknown metric '{metric}'; use one of {', '.join(METRICS)}.")
    if colormap not in COLORMAPS:
        raise InvalidPicture(f"Unknown colour map '{colormap}'; use one of {', '.join(COLORMAPS)}.")
    if metric == "validity" and field.method.estimator == "all_visible":
        raise InvalidPicture("Validity is not known for fixes of all landmarks in view; draw another metric.")
    scale = default_scale(metric) if scale is None else scale
    window = check_bbox(bbox, field.frame.bounds())
    extra = BAR_WIDTH if legend else 0
    asked = (width, height)
    width, height = picture_size(window, width, height, extra, max_size)
    if legend:
        width, height = room_for_bar(width, height, asked)
    image = Image.new("RGB", (width, height), (255, 255, 255))
    margin = _MARGIN if legend else 0
    view = fit_view(
        window, max(8, width - extra - 2 * margin), max(8, height - 2 * margin), left=margin, top=margin
    )
    sample = view.pixel_centres()[:: max(1, view.height // 256), :: max(1, view.width // 256)]
    rows, cols, on = layers.cells_on(field.frame.cell_at(sample), field.frame.shape)
    limits = layers.color_range(field.metric(metric, (rows, cols))[on], vmin, vmax, scale)
    layers.paint_floor(image, view, field.world)
    layers.paint_field(image, view, field, metric=metric, colormap=colormap, limits=limits, scale=scale)
    layers.paint_obstacles(image, view, field.world)
    if landmarks:
        layers.paint_landmarks(image, view, field.world, radius=max(1.5, min(4.0, view.scale * 0.15)))
    if legend:
        unit = METRICS[metric][0]
        title = metric.rsplit("_", 1)[0] if unit else metric
        layers.paint_color_bar(
            image,
            width - extra + 12,
            colormap=colormap,
            limits=limits,
            scale=scale,
            title=f"{title} [{unit}]" if unit else title,
            doubtful=bool(layers.is_doubtful(field, (rows, cols))[on].any()),
        )
    return encode_png(image)


def map_png(world: World, *, max_size: int = 1200) -> bytes:
    """Floor and landmarks as PNG."""
    width, height = picture_size(world.bounds, None, None, 0, max_size)
    image = Image.new("RGB", (width, height), layers.OUTSIDE)
    view = fit_view(world.bounds, width, height)
    layers.paint_floor(image, view, world)
    layers.paint_landmarks(image, view, world, radius=max(1.5, min(4.0, view.scale * 0.15)))
    return encode_png(image)
