"""Models of one body, held and loaded in different ways, that every engine can solve."""

from typing import Any

import numpy as np

import bipot_rs as bp
from support.pressed_in_space import pressed
from support.rollers import block


def order_two() -> bp.Model:
    m = pressed(2)
    return m.with_(**{"body.block.order": 2})


def on_a_ball() -> bp.Model:
    m = block(6, 3)
    m.obstacle("ball", sphere={"centre": [0.1, 0.0, 2.0], "radius": 2.0})
    m.contact("block.top", against="ball", mu=0.4)
    m = m.with_(support=[])
    m.support("block.bottom", x=m.times(0.02, "shear"), y=0.0, z=m.times(0.03, "press"))
    m.path(press=[1.0, 1.0, 0.5], shear=[0.0, 1.0, -1.0])
    return m


def _under_a_table(mu: float, height: float = 0.0, *, held: bool = False) -> bp.Model:
    """A block whose top may touch a rigid plane."""
    m = block(4, 3)
    m = m if held else m.with_(support=[])
    normal = [0.0, 0.0, -1.0]
    m.obstacle("table", plane={"point": [0.0, 0.0, height], "normal": normal})
    m.contact("block.top", against="table", mu=mu)
    return m


def floating() -> bp.Model:
    """A block that nothing but contact and symmetry holds."""
    m = _under_a_table(0.5)
    m.pressure("block.bottom", m.times(3.0, "press"))
    m.traction("block.bottom", x=m.times(0.4, "shear"))
    m.path(press=[1.0, 1.0], shear=[0.3, 1.0])
    return m


def on_springs() -> bp.Model:
    m = pressed()
    m.spring("block.right", stiffness=[300.0, 200.0, 100.0])
    return m


def warmed() -> bp.Model:
    """An initial strain presses the block onto the plane."""
    m = _under_a_table(0.3, 0.001, held=True)
    m.strain("block", expansion=1e-4, temperature=m.times(100.0, "warm"))
    m.path(warm=[0.5, 1.0])
    return m


def sliding_freely() -> bp.Model:
    """A block that is pressed onto a plane without friction, free to slide along x."""
    m = _under_a_table(0.0)
    m.support("block.bottom", y=0.0, z=m.times(0.02, "press"))
    m.path(press=[0.5, 1.0])
    return m


def blocks(n: int = 3, **path: Any) -> bp.Model:
    """A stiff block on a soft one, with every type of value that Python allows."""
    m = bp.Model("Round on flat", units=("mm", "N", "MPa"), n=n)
    m.material("steel", young=210e3, poisson=np.float64(0.3))
    m.material("polymer", young=2100, poisson=0.4)
    x = np.linspace(-2.0, 2.0, 2 * n + 1)
    down = {"from": 0.0, "to": -2.0, "cells": "n"}
    m.body("upper", material="steel", cell="quadrilateral", x=x, y=(0, 0.5, 2))
    m.body("lower", material="polymer", cell="quadrilateral", x=x.tolist(), y=down)
    m.support("lower.bottom", x=0, y=0)
    m.support("upper.top", x=m.times(0.004, "shear"), y=-0.02)
    m.pressure("upper.right", m.times(5.0, "shear"))
    m.body_force("lower", y=-0.1)
    m.contact(
        "upper.bottom",
        against="lower.top",
        mu=0.3,
        clearance={"radius": 100},
        within={"x": (-2, 1.5)},
    )
    m.path(parameter="shear", **({"shear": [0.0, 1.0]} | path))
    return m
