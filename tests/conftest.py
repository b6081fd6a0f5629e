"""What many tests share: small panoramas, and a small data set drawn before them."""

import os

import cv2
import numpy as np
import pytest

from dronekeypp.sixdronesyn.generate import generate

# for the processes that tests start; see notebooks/conftest.py
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def paint_environments(folder, n=6, seed=5):
    """Paint `n` small panoramas: a blue sky with a sun over a patterned ground.

    They are quick to draw, and different enough to be told apart.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for i in range(n):
        v, u = np.mgrid[0:256, 0:512]
        sky = np.stack([90 + v * 0.4, 140 + v * 0.35, 215 + v * 0.1], -1)
        if seed != 5:
            sky = sky[..., ::-1]  # another world, at sunset
        ground = np.stack([90 + 40 * np.sin(u / (5 + i)), 110 + 30 * np.cos(v / 3 + i), 60 + 0 * u], -1)
        image = np.where(v[..., None] < 128, sky, ground) + rng.normal(0, 3, (256, 512, 1))
        cv2.circle(image, (60 + 70 * i, 50), 6, (255, 250, 235), -1)
        cv2.imwrite(str(folder / f"place_{i}.png"), image.clip(0, 255).astype(np.uint8)[..., ::-1])
    return folder


@pytest.fixture(scope="session")
def environments(tmp_path_factory):
    return paint_environments(tmp_path_factory.mktemp("data") / "environments")


# 72 frames
SMALL = dict(scene_numbers=[1, 3, 6], drone_names=["Mini2", "Tello"], size=64, stride=30, progress=False)


@pytest.fixture(scope="session")
def small_dataset(tmp_path_factory, environments):
    """Crops of two drones in one scene of each split. Read only: copy it before you break it."""
    root = tmp_path_factory.mktemp("sixdronesyn") / "small"
    generate(root, environments=environments, **SMALL)
    return root
