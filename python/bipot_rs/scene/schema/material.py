"""Tables of materials."""

from typing import Annotated

from pydantic import Field

from bipot_rs.fem.bodies import materials
from bipot_rs.scene.schema.table import OneOrList, Table, Triple, Vector

_Modulus = Annotated[float, Field(gt=0)]
_Moduli = Annotated[list[_Modulus], Field(min_length=3, max_length=3)]
_Ratio = Annotated[float, Field(gt=-1, lt=0.5)]


class Elastic(Table):
    """An elastic material: isotropic with two numbers, or orthotropic with nine.

    For an orthotropic material ``young`` are the moduli along its axes 1, 2, 3,
    ``poisson`` the ratios ν12, ν13, ν23 and ``shear`` the moduli G12, G13, G23. The rows
    of ``axes`` are its directions, in two dimensions 1 and 2; the default is the axes of
    coordinates.
    """

    young: OneOrList[_Modulus, _Moduli]
    poisson: OneOrList[_Ratio, Triple]
    shear: _Moduli | None = None
    axes: Annotated[list[Vector], Field(min_length=2, max_length=3)] | None = None

    def make(
        self,
        *,
        plane_stress: bool = False,
        thickness: float = 1.0,
        axisymmetric: bool = False,
    ) -> materials.Elastic:
        """Make the material.

        Raises
        ------
        ValueError
            Numbers that are not those of one kind of material, or out of range.
        """
        young, poisson = self.young, self.poisson
        plane = plane_stress, thickness, axisymmetric
        if isinstance(young, list) and isinstance(poisson, list) and self.shear:
            return materials.Orthotropic(young, poisson, self.shear, self.axes, *plane)
        if isinstance(young, list) or isinstance(poisson, list) or self.shear:
            raise ValueError(
                "an orthotropic material needs three numbers each in young, poisson and "
                "shear; an isotropic one needs one number in young and poisson, no shear"
            )
        if self.axes is not None:
            raise ValueError("remove axes: this material is isotropic")
        return materials.Material(young, poisson, *plane)
