"""What no image may hold."""

import numpy as np


def refuse_nan(image: np.ndarray) -> None:
    """Refuse an image [...] that holds what is not a number: a ValueError names the first place."""
    if np.isnan(image).any():
        first = ", ".join(map(str, np.argwhere(np.isnan(image))[0]))
        raise ValueError(f"the image has {np.isnan(image).sum()} NaN values, the first at [{first}]")
