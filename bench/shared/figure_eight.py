"""The figure of eight on which arms are compared."""

import numpy as np

ROUNDS, WIDTH = 2, 0.2  # m


def figure_eight(seconds: float) -> np.ndarray:
    """Return the way from its middle, (n, 3) m for each ms, from rest to rest."""
    r = np.arange(0, seconds, 0.001) / seconds
    angle = 2 * np.pi * ROUNDS * (10 * r**3 - 15 * r**4 + 6 * r**5)
    return WIDTH / 2 * np.stack([0.5 * np.sin(2 * angle), np.sin(angle), 0 * angle], axis=1)
