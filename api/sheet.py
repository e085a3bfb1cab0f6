"""The sheet of a picture: a line of text, a map drawn larger and made smaller, room beside and below."""

from __future__ import annotations

from dataclasses import dataclass

from PIL import Image, ImageDraw

from api import canvas, layers
from localization.uncertainty_field import UncertaintyField, is_off

#: Height of the line of text above the map, and width of what a colour bar needs at the right, px.
HEADER = 30
BAR = 142
_OVERSAMPLING = 2
_LEFT = 12
_LEAST_MAP = 64
_METRIC = "area95_m2"


@dataclass(frozen=True, slots=True)
class Sheet:
    """Sizes of a picture; made by :meth:`of`.

    Attributes
    ----------
    width, height
        Of the whole, px.
    view
        Of the map as it is drawn, larger than it is shown.
    small
        Width and height of the map as it is shown, px.
    """

    width: int
    height: int
    view: canvas.View
    small: tuple[int, int]

    @classmethod
    def of(cls, window: canvas.BBox, width: int, *, beside: int, below: int, least: int = 0) -> Sheet:
        """Sheet for a window of the map.

        Parameters
        ----------
        window
            x_min, y_min, x_max, y_max, W, m.
        width
            Of the whole, px; the height follows.
        beside, below
            What the map leaves free, px.
        least
            Height that the map's row has at least, px.

        Raises
        ------
        InvalidPicture
            If the width makes no sense.
        """
        map_width = max(_LEAST_MAP, width - beside) * _OVERSAMPLING
        map_height = round(map_width * (window[3] - window[1]) / (window[2] - window[0]))
        height = max(map_height // _OVERSAMPLING, least) + HEADER + below
        canvas.check_size(width * _OVERSAMPLING, height * _OVERSAMPLING)
        small = (map_width // _OVERSAMPLING, map_height // _OVERSAMPLING)
        return cls(width, height, canvas.fit_view(window, map_width, map_height), small)

    def floor(self, field: UncertaintyField, *, opacity: float | None = None) -> Image.Image:
        """The map with its obstacles, over the area of the ellipse at an opacity."""
        big = Image.new("RGB", (self.view.width, self.view.height), (255, 255, 255))
        layers.paint_floor(big, self.view, field.world)
        if opacity is not None:
            layers.paint_field(
                big,
                self.view,
                field,
                metric=_METRIC,
                colormap="viridis",
                limits=_limits(field),
                scale="log",
                opacity=opacity,
            )
        layers.paint_obstacles(big, self.view, field.world)
        return big

    def with_map(self, big: Image.Image, said: str) -> tuple[Image.Image, ImageDraw.ImageDraw]:
        """The whole with a map and the line above it, and what draws on it."""
        image = Image.new("RGB", (self.width, self.height), (255, 255, 255))
        image.paste(big.resize(self.small, Image.Resampling.LANCZOS), (_LEFT, HEADER))
        draw = ImageDraw.Draw(image)
        draw.text((_LEFT, 8), canvas.plain(said), fill=layers.INK, font=canvas.font(15))
        return image, draw

    def paint_bar(self, image: Image.Image, field: UncertaintyField) -> None:
        """The colour bar of the area at the right."""
        layers.paint_color_bar(
            image,
            self.width - 106,
            colormap="viridis",
            limits=_limits(field),
            scale="log",
            title="area95 [m²]",
            doubtful=bool(is_off(field.validity).any()),
        )


def _limits(field: UncertaintyField) -> tuple[float, float]:
    return layers.color_range(field.metric(_METRIC), None, None, "log")
