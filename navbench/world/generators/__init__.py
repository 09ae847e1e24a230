"""Generators: sources that draw another layout for each episode."""

from navbench.world.generators.discs import Discs
from navbench.world.generators.polygons import Polygons
from navbench.world.generators.scattered import Scattered
from navbench.world.generators.swap import Swap
from navbench.world.generators.wander import Wander

__all__ = ["Discs", "Polygons", "Scattered", "Swap", "Wander"]
