"""Finite elements: K, B, gap and loads of (1) and (2) from meshes."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.contact.law.frames import frames as frames
    from bipot_rs.fem.assembly.assemble import assemble as assemble
    from bipot_rs.fem.assembly.assembly import Assembly as Assembly
    from bipot_rs.fem.assembly.assembly import Support as Support
    from bipot_rs.fem.bodies.body import Body as Body
    from bipot_rs.fem.bodies.boundary import Load as Load
    from bipot_rs.fem.bodies.boundary import Spring as Spring
    from bipot_rs.fem.bodies.boundary import Symmetry as Symmetry
    from bipot_rs.fem.bodies.boundary import surface as surface
    from bipot_rs.fem.bodies.boundary import with_surfaces as with_surfaces
    from bipot_rs.fem.bodies.elasticity import stiffness as stiffness
    from bipot_rs.fem.bodies.materials import Material as Material
    from bipot_rs.fem.bodies.materials import Orthotropic as Orthotropic
    from bipot_rs.fem.bodies.stress_recovery import stress as stress
    from bipot_rs.fem.bodies.stress_recovery import thermal as thermal
    from bipot_rs.fem.bodies.stress_recovery import von_mises as von_mises
    from bipot_rs.fem.constraints.bolts import Bolt as Bolt
    from bipot_rs.fem.constraints.references import Remote as Remote
    from bipot_rs.fem.constraints.repetition import Cyclic as Cyclic
    from bipot_rs.fem.constraints.repetition import Periodic as Periodic
    from bipot_rs.fem.contact.contact import Contact as Contact
    from bipot_rs.fem.contact.contact import Floating as Floating
    from bipot_rs.fem.gradients.parameter_gradient import (
        ParameterGradient as ParameterGradient,
    )
    from bipot_rs.mesh.boxes import FACES as FACES
    from bipot_rs.mesh.boxes import box as box
    from bipot_rs.mesh.elements import second_order as second_order
    from bipot_rs.mesh.quality import check_mesh as check_mesh
    from bipot_rs.mesh.readers import read_mesh as read_mesh
    from bipot_rs.mesh.readers import read_meshes as read_meshes

__getattr__, __dir__ = lazily(__name__)
__all__ = __dir__()
