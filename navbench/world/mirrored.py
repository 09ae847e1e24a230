"""The mirror image of a layout, left for right: what lies at y lies at -y."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

from navbench.world.grid import Grid
from navbench.world.layout import Layout
from navbench.world.shapes import Bounds

TURNED = ("y_m", "y1_m", "y2_m", "heading_rad")


def mirrored(layout: Layout) -> Layout:
    """Return a layout with everything in it on the other side of the x axis."""
    image: Layout = _image(layout)
    return image


def _image(thing: Any) -> Any:
    if isinstance(thing, tuple):
        return tuple(map(_image, thing))
    if isinstance(thing, Bounds):
        return replace(thing, y_min_m=-thing.y_max_m, y_max_m=-thing.y_min_m)
    if isinstance(thing, Grid):
        top_m = thing.y_min_m + thing.height * thing.resolution_m
        return Grid.of(thing.occupied()[::-1], thing.resolution_m, thing.x_min_m, -top_m)
    if not is_dataclass(thing):
        return thing
    values = {item.name: getattr(thing, item.name) for item in fields(thing)}
    turned = {name: -values[name] for name in TURNED if values.get(name) is not None}
    return replace(thing, **({name: _image(value) for name, value in values.items()} | turned))  # type: ignore[type-var]
