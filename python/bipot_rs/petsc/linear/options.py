"""Options of PETSc: ours, unless the user has set others with the prefix ``bipot_``."""

from __future__ import annotations

from types import ModuleType

PREFIX = "bipot_"

KSP = {
    "ksp_type": "fgmres",
    "ksp_gmres_restart": 80,
    "ksp_gmres_cgs_refinement_type": "refine_ifneeded",
}
PC = {"pc_type": "gamg"}
# SOR fails on coarse levels, where an aggregate may have fewer motions than columns, and on
# eliminated rows. New aggregates for each set of statuses save iterations, but take longer
# than these.
GAMG = {
    "pc_gamg_type": "agg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.01,
    "pc_gamg_reuse_interpolation": True,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
}
# Options that we have set, which stay in the database of PETSc: a user may change them later.
_OURS: dict[str, str] = {}


def smoother_is_ours(PETSc: ModuleType) -> bool:
    """Whether the user has not chosen the smoother of multigrid."""
    names = ("mg_levels_ksp_type", "mg_levels_pc_type")
    return not any(is_of_the_user(PETSc, name) for name in names)


def is_of_the_user(PETSc: ModuleType, name: str) -> bool:
    """Whether the user has set this option."""
    database = PETSc.Options(PREFIX)
    if not database.hasName(name):
        return False
    return bool(database.getString(name, "") != _OURS.get(name))


def set_defaults(PETSc: ModuleType) -> dict[str, str]:
    """Set our options where the user has none; the type of the preconditioner is in them."""
    database = PETSc.Options(PREFIX)
    settings: dict[str, str] = {}
    for defaults in (KSP, PC, GAMG):
        if defaults is GAMG and settings["pc_type"] != "gamg":
            break
        for name, value in defaults.items():
            if not database.hasName(name):
                database.setValue(name, value)
                _OURS[name] = database.getString(name, str(value))
            settings[name] = database.getString(name, str(value))
    return settings
