"""Return mapping of a soil, after a textbook and without the package."""

import math

import numpy as np
from numpy.typing import NDArray

from bipot_rs.theory.soils import DruckerPrager

Array = NDArray[np.float64]


def return_stress(
    soil: DruckerPrager, K: float, G: float, start: Array, strain: Array
) -> Array:
    """Return mapping in ``p`` and ``√J₂``: de Souza Neto, Perić, Owen, 2008, chapter 8.

    ``Φ = √J₂ + η p - ξ c``, flow ``s/(2 √J₂) + η̄ I/3``.
    """
    eta, bar = soil.friction / math.sqrt(2), soil.dilatancy / math.sqrt(2)
    strength = eta * soil.apex
    volume = np.trace(strain)
    trial = start + K * volume * np.eye(3)
    trial = trial + 2 * G * (strain - volume / 3 * np.eye(3))
    p = np.trace(trial) / 3
    s = trial - p * np.eye(3)
    root = math.sqrt(0.5 * np.sum(s * s))
    over = root + eta * p - strength
    if over <= 0 and p <= soil.apex:
        return trial
    gamma = over / (G + K * eta * bar)
    if over > 0 and root - G * gamma >= 0:
        return (1 - G * gamma / root) * s + (p - K * bar * gamma) * np.eye(3)
    return soil.apex * np.eye(3)
