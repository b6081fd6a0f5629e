"""The drawn environments, their cache on disk, and lookups into panoramas."""

import subprocess
import sys

import cv2
import numpy as np
import pytest

from dronekeypp.environments import ENVIRONMENTS, cache, environment_spec, render_environment
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.panorama import Panorama, load_panorama
from dronekeypp.sixdronesyn.scenes import split_environments

SUNNY = ("city_square", "snowy_village", "rooftop")  # clear enough that the sun's disc shows


@pytest.fixture(scope="module")
def drawn():
    """Small pictures of the sunny environments, by name."""
    return {name: render_environment(name, 128) for name in SUNNY}


def unit(azimuth, elevation):
    """Return the direction (3,) of an azimuth and an elevation in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def draw_grey(name):
    """Stand in for `render_environment`: a grey panorama, at once."""
    return np.full((32, 64, 3), len(name), np.uint8)


def test_there_are_22_different_places():
    assert len(ENVIRONMENTS) == 22 and len(set(ENVIRONMENTS)) == 22
    for name in ENVIRONMENTS:
        spec = environment_spec(name)
        assert spec.name == name and -90 < spec.sun_elevation < 90


def test_every_split_is_varied():
    for split, numbers in split_environments(22).items():
        places = [environment_spec(ENVIRONMENTS[i]) for i in numbers]
        assert len({place.surface for place in places}) >= 3
        elevations = [place.sun_elevation for place in places]
        if split != "val":  # the three of validation share a sunny noon
            assert max(elevations) - min(elevations) > 20


def test_shape_and_the_same_pixels_again(drawn):
    for image in drawn.values():
        assert image.shape == (128, 256, 3) and image.dtype == np.uint8
    assert np.array_equal(drawn["snowy_village"], render_environment("snowy_village", 128))


def test_another_seed_draws_another_picture(drawn):
    other = render_environment("city_square", 128, seed=1)
    assert np.abs(other.astype(int) - drawn["city_square"]).mean() > 2


@pytest.mark.parametrize("name", SUNNY)
def test_the_picture_closes_at_its_seam(drawn, name):
    """The first and the last column differ no more than neighbours do elsewhere."""
    image = drawn[name].astype(float)
    steps = np.abs(np.diff(image, axis=1)).mean((0, 2))
    seam = np.abs(image[:, 0] - image[:, -1]).mean()
    assert seam < np.quantile(steps, 0.99) + 3


@pytest.mark.parametrize("name", SUNNY)
def test_the_light_comes_from_the_sun(drawn, name):
    spec = environment_spec(name)
    light = Panorama(drawn[name]).light()
    sun = unit(spec.sun_azimuth, spec.sun_elevation)
    assert np.degrees(np.arccos(np.clip(light.direction @ sun, -1, 1))) < 8
    assert light.sun_colour.min() > 0.05 and light.sky_colour.shape == light.ground_colour.shape == (3,)


def test_light_turns_with_the_environment(drawn):
    panorama = Panorama(drawn["rooftop"])
    a, b = panorama.light(0).direction, panorama.light(1).direction
    assert np.allclose(b, [-a[1], a[0], a[2]])


@pytest.mark.parametrize("turn", range(4))
def test_sample_finds_a_coloured_patch(turn):
    height = 256
    image = np.zeros((height, 2 * height, 3), np.uint8)
    azimuth, elevation = 72.0, 20.0
    u, v = int((0.5 - azimuth / 360) * 2 * height), int((0.5 - elevation / 180) * height)
    image[v - 4 : v + 5, u - 4 : u + 5] = (200, 30, 90)
    panorama = Panorama(image)
    direction = unit(azimuth + 90 * turn, elevation)
    assert panorama.sample(direction, turn).tolist() == [200, 30, 90]
    assert panorama.sample(-direction, turn).tolist() == [0, 0, 0]
    assert panorama.sample(np.tile(direction, (5, 7, 2, 1)), turn).shape == (5, 7, 2, 3)


def test_sample_is_seamless_and_reaches_the_poles():
    height = 64
    grey = np.linspace(0, 255, height)[:, None, None]
    image = np.broadcast_to(grey, (height, 2 * height, 3)).astype(np.uint8)
    panorama = Panorama(image)
    across_seam = np.stack([unit(azimuth, 10) for azimuth in np.linspace(178, 182, 41)])
    assert np.ptp(panorama.sample(across_seam)[:, 0].astype(int)) <= 1
    top, bottom = panorama.sample(np.array([[0, 0, 1.0], [0, 0, -1.0]]))[:, 0]
    assert top < 6 and bottom > 249


def test_unknown_name_and_bad_height_are_refused():
    with pytest.raises(InputError, match="atlantis.*choose one of"):
        environment_spec("atlantis")
    with pytest.raises(InputError, match="height must be"):
        render_environment(ENVIRONMENTS[0], 7)


def test_broken_files_are_named(tmp_path):
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"\xff\xd8\xff not a picture")
    with pytest.raises(InputError, match="broken.jpg.*not a readable image"):
        load_panorama(broken)
    square = tmp_path / "square.png"
    cv2.imwrite(str(square), np.zeros((64, 64, 3), np.uint8))
    with pytest.raises(InputError, match="square.png.*2:1"):
        load_panorama(square)
    with pytest.raises(InputError, match="no such panorama"):
        load_panorama(tmp_path / "absent.jpg")


def test_a_black_sky_has_no_sun_but_a_direction():
    light = Panorama(np.zeros((64, 128, 3), np.uint8)).light()
    assert np.isfinite(light.direction).all() and np.isclose(np.linalg.norm(light.direction), 1)
    assert np.allclose(light.sun_colour, 0, atol=1e-6)


def test_procedural_files_are_drawn_once(monkeypatch, tmp_path):
    monkeypatch.setenv("DRONEKEYPP_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "render_environment", draw_grey)
    files = cache.environment_files(progress=False)
    assert tuple(file.stem for file in files) == ENVIRONMENTS
    assert sorted(files[0].parent.iterdir()) == sorted(files)
    files[3].unlink()
    written = [file.stat().st_mtime_ns for file in files if file.exists()]
    assert cache.environment_files(progress=False) == files
    again = [file.stat().st_mtime_ns for file in files if file != files[3]]
    assert files[3].exists() and again == written


def test_the_cache_folder_follows_the_variables(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("DRONEKEYPP_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache.cache_folder() == tmp_path / ".cache" / "dronekeypp"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache.cache_folder() == tmp_path / "xdg" / "dronekeypp"
    monkeypatch.setenv("DRONEKEYPP_CACHE", str(tmp_path / "own"))
    assert cache.cache_folder() == tmp_path / "own"


def test_a_folder_of_panoramas_is_listed_in_order(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        cache.environment_files(tmp_path / "absent")
    (tmp_path / "notes.txt").write_text("not a picture")
    with pytest.raises(InputError, match="no .jpg or .png"):
        cache.environment_files(tmp_path)
    for name in ("b.PNG", "c.jpeg", "a.jpg"):
        (tmp_path / name).touch()
    assert [file.name for file in cache.environment_files(tmp_path)] == ["a.jpg", "b.PNG", "c.jpeg"]


def test_the_command_line_explains_itself():
    command = [sys.executable, "-m", "dronekeypp.environments", "--help"]
    assert "--sheet" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
