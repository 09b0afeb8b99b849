"""What bodies are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag

from bipot_rs.fem import materials
from bipot_rs.scene.schema.table import KIND, Table, Vector

_Modulus = Annotated[float, Field(gt=0)]
_Ratio = Annotated[float, Field(gt=-1, lt=0.5)]


_ONE_OR_THREE = Discriminator(
    lambda v: KIND + ("three" if isinstance(v, list) else "one")
)


class Elastic(Table):
    """Elasticity: isotropic by two numbers, orthotropic by three times three.

    Of an orthotropic one ``young`` are the moduli along its axes 1, 2, 3, ``poisson`` the
    ratios ν12, ν13, ν23 and ``shear`` G12, G13, G23; ``axes`` are its directions as rows,
    in the plane 1 and 2, without them those of coordinates.
    """

    young: Annotated[
        Annotated[_Modulus, Tag(f"{KIND}one")]
        | Annotated[
            Annotated[list[_Modulus], Field(min_length=3, max_length=3)],
            Tag(f"{KIND}three"),
        ],
        _ONE_OR_THREE,
    ]
    poisson: Annotated[
        Annotated[_Ratio, Tag(f"{KIND}one")]
        | Annotated[
            Annotated[list[float], Field(min_length=3, max_length=3)],
            Tag(f"{KIND}three"),
        ],
        _ONE_OR_THREE,
    ]
    shear: Annotated[list[_Modulus], Field(min_length=3, max_length=3)] | None = None
    axes: Annotated[list[Vector], Field(min_length=2, max_length=3)] | None = None

    def made(
        self, *, plane_stress: bool = False, thickness: float = 1.0
    ) -> materials.Elastic:
        """The material, in a plane as its body has it.

        Raises
        ------
        ValueError
            Numbers of both kinds, or of none that exists.
        """
        young, poisson = self.young, self.poisson
        if isinstance(young, list) and isinstance(poisson, list) and self.shear:
            return materials.Orthotropic(
                young, poisson, self.shear, self.axes, plane_stress, thickness
            )
        if isinstance(young, list) or isinstance(poisson, list) or self.shear:
            raise ValueError(
                "an orthotropic material needs young, poisson and shear of three numbers "
                "each, an isotropic one young and poisson of one"
            )
        if self.axes is not None:
            raise ValueError(
                "axes are of an orthotropic material, this one is isotropic"
            )
        return materials.Material(young, poisson, plane_stress, thickness)
