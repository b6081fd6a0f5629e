"""This module draws the colours of random quadrotors: greys more often than any hue, as on real ones."""

import numpy as np

# As in `shapes`, which needs a graphics library; whoever only reads data sets has none.
RGB = tuple[int, int, int]


def _saturated(rng: np.random.Generator) -> RGB:
    """Return a strong colour of any hue."""
    hue = rng.uniform(0, 6)
    saturation, value = rng.uniform(0.55, 1.0), rng.uniform(0.45, 1.0)
    ramp = np.clip(np.abs(np.remainder(hue + np.array([0.0, 4.0, 2.0]), 6) - 3) - 1, 0, 1)
    red, green, blue = np.rint(255 * value * (1 - saturation * (1 - ramp))).astype(int).tolist()
    return red, green, blue


def _grey(low: int, high: int, rng: np.random.Generator) -> RGB:
    """Return a grey between two values, a little warm or cool."""
    value = rng.integers(low, high)
    red, green, blue = np.clip(value + rng.integers(-3, 4, 3), 0, 255).tolist()
    return red, green, blue


def accent(rng: np.random.Generator) -> RGB:
    """Return a colour that stands out: of stripes, stickers, blade tips."""
    return _saturated(rng) if rng.random() < 0.8 else _grey(200, 250, rng)


def colours(family: str, rng: np.random.Generator) -> dict[str, RGB | None]:
    """Return the colours of hull, trim, propellers and tips."""
    playful = family in ("racer", "ducted", "toy")  # these are sold in more colours than the others
    kind = rng.random() * (1.3 if playful else 0.95)
    if kind < 0.2:
        hull = _grey(222, 250, rng)
    elif kind < 0.41:
        hull = _grey(120, 215, rng)
    elif kind < 0.6:
        hull = _grey(22, 110, rng)
    else:
        hull = _saturated(rng)
    if rng.random() < 0.7:
        trim = _grey(24, 80, rng)
    elif rng.random() < 0.5:
        trim = _saturated(rng)
    else:
        trim = _grey(150, 240, rng)

    plain = rng.random() < (0.4 if playful else 0.78)
    if plain and rng.random() < 0.75:
        propeller = _grey(22, 100, rng)
    elif plain:
        propeller = _grey(150, 245, rng)
    else:
        propeller = _saturated(rng)
    tip = accent(rng) if rng.random() < 0.3 else propeller
    rear = None
    if rng.random() < (0.25 if playful else 0.08):
        rear = _saturated(rng) if rng.random() < 0.6 else _grey(22, 245, rng)
    return {
        "hull_rgb": hull,
        "trim_rgb": trim,
        "propeller_rgb": propeller,
        "tip_rgb": tip,
        "rear_propeller_rgb": rear,
    }
