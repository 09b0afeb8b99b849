"""Rigid obstacles, at rest or moving along the load path."""

from bipot_rs.obstacle.motion import Approach, Motion, approach
from bipot_rs.obstacle.protocol import Closest, Obstacle
from bipot_rs.obstacle.shapes import (
    Cylinder,
    Distance,
    Plane,
    Sphere,
    Torus,
    Union,
    ask,
)
from bipot_rs.obstacle.triangulated import Surface

__all__ = [
    "Approach",
    "Closest",
    "Cylinder",
    "Distance",
    "Motion",
    "Obstacle",
    "Plane",
    "Sphere",
    "Surface",
    "Torus",
    "Union",
    "approach",
    "ask",
]
