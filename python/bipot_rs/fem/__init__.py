"""Finite elements: K, B, gap and loads of (1) and (2) from meshes."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.contact.law.frames import frames
    from bipot_rs.fem.assembly.assemble import assemble
    from bipot_rs.fem.assembly.assembly import Assembly, Support
    from bipot_rs.fem.bodies.body import Body
    from bipot_rs.fem.bodies.boundary import (
        Load,
        Spring,
        Symmetry,
        surface,
        with_surfaces,
    )
    from bipot_rs.fem.bodies.elasticity import stiffness
    from bipot_rs.fem.bodies.materials import Material, Orthotropic
    from bipot_rs.fem.bodies.stress_recovery import stress, thermal, von_mises
    from bipot_rs.fem.constraints.bolts import Bolt
    from bipot_rs.fem.constraints.references import Remote
    from bipot_rs.fem.constraints.repetition import Cyclic, Periodic
    from bipot_rs.fem.contact.contact import Contact, Floating
    from bipot_rs.fem.gradients.parameter_gradient import ParameterGradient
    from bipot_rs.mesh.boxes import FACES, box
    from bipot_rs.mesh.elements import second_order
    from bipot_rs.mesh.quality import check_mesh
    from bipot_rs.mesh.readers import read_mesh, read_meshes

__all__ = [
    "FACES",
    "Assembly",
    "Body",
    "Bolt",
    "Contact",
    "Cyclic",
    "Floating",
    "Load",
    "Material",
    "Orthotropic",
    "ParameterGradient",
    "Periodic",
    "Remote",
    "Spring",
    "Support",
    "Symmetry",
    "assemble",
    "box",
    "check_mesh",
    "frames",
    "read_mesh",
    "read_meshes",
    "second_order",
    "stiffness",
    "stress",
    "surface",
    "thermal",
    "von_mises",
    "with_surfaces",
]

__getattr__, __dir__ = lazily(__name__)
