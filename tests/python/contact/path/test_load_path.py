"""Load paths with every method: cycles without drift, energy balance, slip history."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.contact.path.direct import DirectRecovery
from bipot_rs.contact.results.solution import recover_displacements
from support.contacts import TOL

Array = NDArray[np.float64]
SLIP = bp.Status.SLIP


def random_path(steps: int, end: float = 6.0) -> tuple[Any, Array]:
    """A smooth path of three coupled contacts that open, stick and slip."""
    rng = np.random.default_rng(20)
    root = rng.normal(size=(9, 9))
    K = root @ root.T + 4 * np.eye(9)
    waves = rng.normal(size=(3, 9))
    time = np.linspace(0, end, steps + 1)[1:]
    turns = np.column_stack([np.sin(time), 1 - np.cos(time), np.sin(2 * time)])
    path = 3 * turns @ waves
    path[:, ::3] -= 2 * np.sin(time[:, None] / 2)
    B = sparse.eye_array(9, format="csr")
    K = (K + K.T) / 2
    return bp.solve(K, B, path, gap=np.zeros(3), mu=0.4, tol=TOL), (K, path)


def test_a_path_that_closes_ends_without_forces() -> None:
    # At the end the loads are rounding errors, small against the slip in the history.
    result, (_, path) = random_path(50, 2 * math.pi)
    assert result.success
    # A load of 1e-15 of the largest; the condition of K is below 10.
    assert np.abs(result.reaction[-1]).max() <= 1e-14 * np.abs(path).max()
    assert np.abs(result.slip).max() > 1e-3


@pytest.mark.parametrize(
    ("scene", "blocks"),
    # Obstacles of the second give its steps frames, and its nodes ties.
    [("cyclic_cube", [32, 9]), ("twisted_pad", [4])],
)
def test_one_pass_over_the_factor_recovers_many_displacements(
    scene: str, blocks: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = bp.Model.from_toml(scene).with_(**{"mesh.n": 4})
    steps = list(model.assemble().solve())
    assert all(step.computed.displacement is None for step in steps)
    alone = [step.recovery.recover([step])[0] for step in steps if step.recovery]
    recover, passes = DirectRecovery.recover, []

    def count(self: DirectRecovery, some: Any) -> Any:
        passes.append(len(some))
        return recover(self, some)

    monkeypatch.setattr(DirectRecovery, "recover", count)
    recover_displacements(steps)
    assert passes == blocks
    together = [step.displacement for step in steps]
    np.testing.assert_array_equal(together, alone, strict=True)
