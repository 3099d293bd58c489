"""Detection of a change in a stream of numbers: Page's cumulative sum.

Source: Page, Biometrika 41 (1954); Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 2.2.
"""


class Cusum:
    """Sums up by how much numbers exceed what is usual; a sum above a threshold is a change.

    Args:
        usual: allowance, which a number may have without being counted.
        threshold: sum from which there is a change.
        most: that one number may add, so that a single outlier is no change.
    """

    def __init__(self, usual: float, threshold: float, most: float) -> None:
        self._usual, self._threshold, self._most = usual, threshold, most
        self.sum = 0.0
        self.onset: int | None = None
        """Index given with the first number since the sum was last zero; None while it is."""

    def add(self, value: float, index: int) -> bool:
        """Take in the next number, of a sample index; tell whether there is a change."""
        self.sum = max(0.0, self.sum + min(value - self._usual, self._most))
        if self.sum == 0.0:
            self.onset = None
        elif self.onset is None:
            self.onset = index
        return self.sum > self._threshold

    def reset(self) -> None:
        """Begin anew."""
        self.sum, self.onset = 0.0, None
