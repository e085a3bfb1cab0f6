"""What the colours of a field mean: as values, and as a picture."""

from __future__ import annotations

from typing import Any

from PIL import Image

from api import layers
from api.canvas import encode_png
from api.colormaps import COLORMAPS
from api.render import BAR_WIDTH
from localization.uncertainty_field import METRICS


def legend_to_json(metric: str, colormap: str, limits: tuple[float, float], scale: str) -> dict[str, Any]:
    """Ends, ticks and the 256 colours of a scale; values beyond the ends have the colour of the end."""
    unit, meaning = METRICS[metric]
    return {
        "metric": metric,
        "unit": unit,
        "meaning": meaning,
        "colormap_name": colormap,
        "scale": scale,
        "rescale": list(limits),
        "ticks": [
            {"value": value, "position": layers.position(value, limits, scale)}
            for value in layers.ticks(*limits, scale)
        ],
        "colors": ["#" + bytes(color).hex() for color in COLORMAPS[colormap]],
    }


def legend_png(
    metric: str,
    colormap: str,
    limits: tuple[float, float],
    scale: str,
    *,
    height: int,
    doubtful: bool,
) -> bytes:
    """The colour bar as it stands beside a heatmap; ``doubtful``: stripes are explained too."""
    unit = METRICS[metric][0]
    title = metric.rsplit("_", 1)[0] if unit else metric
    image = Image.new("RGB", (BAR_WIDTH, height), (255, 255, 255))
    layers.paint_color_bar(
        image,
        12,
        colormap=colormap,
        limits=limits,
        scale=scale,
        title=f"{title} [{unit}]" if unit else title,
        doubtful=doubtful,
    )
    return encode_png(image)
