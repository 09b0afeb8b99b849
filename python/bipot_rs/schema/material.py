"""What bodies are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bipot_rs.schema.table import Table


class Elastic(Table):
    """Isotropic elasticity."""

    young: Annotated[float, Field(gt=0)]
    poisson: Annotated[float, Field(gt=-1, lt=0.5)]
