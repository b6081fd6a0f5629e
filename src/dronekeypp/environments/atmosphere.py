"""Clear sky: sunlight scattered by air, haze and ozone (Nishita et al. 1993; Bruneton and Neyret 2008)."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.noise import smooth

# Scattering and absorption at sea level, 1/m, for red, green and blue.
_RAYLEIGH = np.array([5.8e-6, 13.5e-6, 33.1e-6])
_OZONE = np.array([0.65e-6, 1.88e-6, 0.085e-6])
_MIE = 4.0e-6
_EARTH, _TOP = 6.36e6, 6.42e6  # radius of the earth and of the top of the air, metres
_STEPS = 20


def _densities(height: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the density of air, haze and ozone at a height in metres, as shares of the densest layer."""
    air = np.exp(-height / 8000)
    mist = np.exp(-height / 1200)
    ozone = np.maximum(0, 1 - np.abs(height - 25000) / 15000)
    return air, mist, ozone


def _depths(
    height: np.ndarray, cosine: np.ndarray, steps: int = 10
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the optical lengths of a ray out of the air, in metres of the densest layer.

    Args:
        height: metres above the ground where the ray starts.
        cosine: of the angle between the ray and the zenith.
        steps: how finely the ray is cut.

    Returns:
        The lengths in air (Rayleigh), haze and ozone, in the shape of `height`.
    """
    radius = _EARTH + height
    reach = -radius * cosine + np.sqrt(np.maximum(radius**2 * (cosine**2 - 1) + _TOP**2, 0))
    total_air = 0.0
    total_mist = 0.0
    total_ozone = 0.0
    for edge in np.linspace(0, 1, steps + 1)[:-1]:
        a, b = edge**2, (edge + 1 / steps) ** 2  # short steps first: the air is dense there
        s = reach * (a + b) / 2
        h = np.maximum(np.sqrt(radius**2 + s**2 + 2 * radius * s * cosine) - _EARTH, 0)
        ds = reach * (b - a)
        air, mist, ozone = _densities(h)
        total_air = total_air + air * ds
        total_mist = total_mist + mist * ds
        total_ozone = total_ozone + ozone * ds
    return total_air, total_mist, total_ozone


def _transmittance(air: np.ndarray, mist: np.ndarray, ozone: np.ndarray, haze: float) -> np.ndarray:
    """Return the share of light (..., 3) that is left after these optical lengths (...,) in metres."""
    air = np.asarray(air)[..., None]
    mist = np.asarray(mist)[..., None]
    ozone = np.asarray(ozone)[..., None]
    return np.exp(-(_RAYLEIGH * air + 1.1 * _MIE * haze * mist + _OZONE * ozone))


def sunlight_at_ground(sine: float, haze: float) -> np.ndarray:
    """Return the share of sunlight (3,) that reaches the ground. sine: of the sun's elevation."""
    air, mist, ozone = _depths(np.zeros(1), np.full(1, sine))
    return _transmittance(air, mist, ozone, haze)[0]


def scattered(elevation: float, haze: float, rows: int = 72, columns: int = 91) -> np.ndarray:
    """Return the radiance of a clear sky under a sun of irradiance 1.

    Args:
        elevation: of the sun, radians.
        haze: 1 for clean air, 8 for murky air.
        rows: of the table. Row i shows the elevation 90 deg * (i / (rows - 1))**2.
        columns: of the table. They run over the angle from the sun's azimuth, 0 to 180 deg.

    Returns:
        (rows, columns, 3).
    """
    theta = (np.linspace(0, 1, rows) ** 2 * np.pi / 2)[:, None]
    away = np.linspace(0, np.pi, columns)[None]
    up = np.maximum(np.sin(theta), 1e-3) * np.ones_like(away)
    cosine = np.sin(theta) * np.sin(elevation) + np.cos(theta) * np.cos(elevation) * np.cos(away)
    rayleigh_phase = (3 / (16 * np.pi) * (1 + cosine**2))[..., None]
    g = 0.78
    spread = (2 + g * g) * np.power(1 + g * g - 2 * g * cosine, 1.5)
    mie_phase = (3 / (8 * np.pi) * (1 - g * g) * (1 + cosine**2) / spread)[..., None]
    reach = -_EARTH * up + np.sqrt(_EARTH**2 * (up**2 - 1) + _TOP**2)
    radiance = np.zeros((rows, columns, 3))
    path_air = 0.0
    path_mist = 0.0
    path_ozone = 0.0
    for i in range(_STEPS):
        a, b = (i / _STEPS) ** 2, ((i + 1) / _STEPS) ** 2
        s = reach * (a + b) / 2
        ds = reach * (b - a)
        radius = np.sqrt(_EARTH**2 + s**2 + 2 * _EARTH * s * up)
        h = np.maximum(radius - _EARTH, 0)
        air, mist, ozone = _densities(h)
        air, mist, ozone = air * ds, mist * ds, ozone * ds
        seen = _transmittance(path_air + air / 2, path_mist + mist / 2, path_ozone + ozone / 2, haze)
        path_air = path_air + air
        path_mist = path_mist + mist
        path_ozone = path_ozone + ozone
        sun_up = (_EARTH * np.sin(elevation) + s * cosine) / radius  # cosine of the sun's zenith angle there
        lit = _transmittance(*_depths(h, np.maximum(sun_up, -0.1)), haze)
        lit = lit * smooth(-0.12, 0.02, sun_up)[..., None]
        # Light scattered more than once, roughly: an even glow that follows the sunlight of the layer.
        again = 0.03 * (lit.mean(-1, keepdims=True) * 0.5 + lit * 0.5 + 0.02)
        from_air = air[..., None] * _RAYLEIGH * (rayleigh_phase * lit + again)
        from_mist = (mist * _MIE * haze)[..., None] * (mie_phase * lit + again)
        radiance += seen * (from_air + from_mist)
    return radiance
