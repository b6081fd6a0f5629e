"""What an error tells people to do works: a panorama is replaced, a mesh unit corrected, nothing is lost."""

import os
import shutil
import struct
import zlib

import cv2
import numpy as np
import pytest
from conftest import SMALL, paint_environments
from test_generate import files
from test_own import HUBS, RACER, folder, render, write  # noqa: F401 (folder is a fixture)

from dronekeypp.errors import InputError
from dronekeypp.files import LOCK
from dronekeypp.reproduce import reproduce
from dronekeypp.sixdronesyn import bop, panorama, scenes
from dronekeypp.sixdronesyn import generate as module
from dronekeypp.sixdronesyn.generate import generate
from dronekeypp.sixdronesyn.validate import validate

ONE = SMALL | dict(scene_numbers=[6], drone_names=["Tello"], stride=60)


@pytest.fixture
def places(tmp_path):
    """Six small panoramas that a test may break."""
    return paint_environments(tmp_path / "places")


def shown(root):
    """The names of the panoramas that flights of a data set are before."""
    return {bop.read_json(path)["environment"] for path in root.glob("*/*/flight.json")}


# --- panoramas --------------------------------------------------------------------------------------------


def test_a_broken_panorama_is_found_before_anything_is_written(places, tmp_path):
    (places / "place_3.png").write_bytes((places / "place_3.png").read_bytes()[:5000])
    with pytest.raises(InputError, match="place_3.png: not a readable image; replace the file"):
        generate(tmp_path / "set", environments=places, **ONE)
    assert not (tmp_path / "set").exists()


def test_a_panorama_that_no_flight_shows_may_be_replaced(places, tmp_path):
    root = tmp_path / "set"
    generate(root, environments=places, **ONE)
    [unused, *_] = sorted({f"place_{i}" for i in range(6)} - shown(root))
    before = files(root)
    cv2.imwrite(str(places / f"{unused}.png"), np.full((256, 512, 3), 90, np.uint8))
    generate(root, environments=places, **ONE)
    after = files(root)
    assert {name for name in before if before[name] != after[name]} == {"manifest.json"}
    assert validate(root) == []


def test_a_panorama_that_a_flight_shows_may_be_put_back_or_its_flights_deleted(places, tmp_path):
    root = tmp_path / "set"
    generate(root, environments=places, **ONE)
    before = files(root)
    used = sorted(shown(root))[0]
    path = places / f"{used}.png"
    old = path.read_bytes()
    cv2.imwrite(str(path), np.full((256, 512, 3), 90, np.uint8))
    with pytest.raises(InputError, match=f"{used}.png is not the panorama .* put the old one back") as error:
        generate(root, environments=places, **ONE)
    assert files(root) == before
    path.write_bytes(old)
    generate(root, environments=places, **ONE)
    assert files(root) == before
    cv2.imwrite(str(path), np.full((256, 512, 3), 90, np.uint8))
    named = str(error.value).partition("or delete ")[2].partition(" and run")[0].split(", ")
    for name in named:
        assert bop.read_json(root / name / "flight.json")["environment"] == used
        shutil.rmtree(root / name)
    generate(root, environments=places, **ONE)
    after = files(root)
    changed = {name.split("/rgb")[0] for name in before if "/rgb/" in name and before[name] != after[name]}
    assert changed == set(named) and validate(root) == []


def test_a_panorama_too_few_is_named(places, tmp_path):
    generate(tmp_path / "set", environments=places, **ONE)
    (places / "place_2.png").rename(tmp_path / "away.png")
    with pytest.raises(InputError, match="place_2.png was there; put it back"):
        generate(tmp_path / "set", environments=places, **ONE)
    (tmp_path / "away.png").rename(places / "place_2.png")
    generate(tmp_path / "set", environments=places, **ONE)


def test_a_huge_panorama_is_one_line(places, tmp_path, monkeypatch):
    """Its header tells. A PNG of one colour promises 33,000 × 16,500 pixels in a few bytes."""
    header = b"IHDR" + struct.pack(">2I5B", 33000, 16500, 8, 2, 0, 0, 0)
    content = (places / "place_1.png").read_bytes()
    checked = header + struct.pack(">I", zlib.crc32(header))
    (places / "huge.png").write_bytes(content[:12] + checked + content[12 + len(checked) :])
    monkeypatch.setattr(panorama.cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(InputError, match="huge.png: (33000x16500|too many) pixels; make it smaller"):
        panorama.load_panorama(places / "huge.png")
    os.mkfifo(places / "pipe.png")
    with pytest.raises(InputError, match="pipe.png: no such panorama"):
        panorama.load_panorama(places / "pipe.png")


# --- drones of one's own ----------------------------------------------------------------------------------


def test_a_mesh_unit_may_be_corrected(folder, environments, tmp_path):  # noqa: F811
    root = tmp_path / "set"
    write(folder, {**RACER, "mesh_unit": "m"})
    assert "is mesh_unit right?" in render(root, folder, environments, ["Racer"], [1])
    assert not root.exists()
    assert render(root, folder, environments, ["Tello"], [1]) == ""  # Racer is in no frame of it
    write(folder, RACER)
    assert render(root, folder, environments, ["Racer"], [1]) == ""
    assert validate(root) == []


def test_a_drone_that_has_not_flown_may_change(folder, environments, tmp_path):  # noqa: F811
    """Its model is written anew; the flights of one that has flown are named."""
    root = tmp_path / "set"
    assert render(root, folder, environments, ["Racer"], [1]) == ""
    hubs = (1.1 * np.array(HUBS)).tolist()
    write(folder, {**RACER, "hubs": hubs})
    refusal = render(root, folder, environments, ["Racer"], [1])
    named = refusal.partition("or delete ")[2].partition(" and run")[0].split(", ")
    for name in named:
        shutil.rmtree(root / name)
    assert render(root, folder, environments, ["Racer"], [1]) == ""
    info = bop.read_json(root / "models" / "models_info.json")["8"]
    np.testing.assert_allclose(np.array(info["keypoints"]) / 1000, hubs, atol=1e-6)
    assert validate(root) == []


# --- links, and what is not ours --------------------------------------------------------------------------


@pytest.mark.parametrize("place", [".partial", ".partial/{}", ".partial/{}/rgb"])
def test_nothing_is_written_through_a_link(place, places, tmp_path):
    root, victim = tmp_path / "set", tmp_path / "victim"
    flight = scenes.subsequences([6], ["Tello"], {}, 1)[0]
    link = root / place.format(f"{flight.id:06d}")
    link.parent.mkdir(parents=True)
    victim.mkdir()
    link.symlink_to(victim)
    with pytest.raises(InputError, match="a link, and nothing is written through one"):
        generate(root, environments=places, **ONE)
    assert not list(victim.iterdir())


def test_a_file_that_is_a_link_is_replaced(places, tmp_path):
    root, victim = tmp_path / "set", tmp_path / "victim"
    victim.write_text("mine")
    for flight in scenes.subsequences([6], ["Tello"], {}, 1):
        folder = root / ".partial" / f"{flight.id:06d}" / "rgb"  # noqa: F811
        folder.mkdir(parents=True)
        (folder / "000000.jpg").symlink_to(victim)
        (folder.parent / "frames.jsonl").symlink_to(victim)
        (folder / ".000000.jpg.0123456789abcdef.tmp.jpg").write_text("half")
        (folder / ".letter.tmp").write_text("mine")
    generate(root, environments=places, **ONE)
    assert victim.read_text() == "mine"
    hidden = {path.name for path in root.rglob(".*") if path.name != LOCK}
    assert hidden == {".letter.tmp"}


# --- checked before the panoramas are drawn ---------------------------------------------------------------


@pytest.fixture
def undrawn(monkeypatch, tmp_path):
    """Whoever draws a panorama fails."""
    monkeypatch.setenv("DRONEKEYPP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("dronekeypp.environments.cache._draw", lambda _: pytest.fail("it draws"))
    monkeypatch.setattr(module, "check_opengl", lambda: None)


def test_generate_looks_first(undrawn, small_dataset, tmp_path):
    (tmp_path / "file").write_text("mine")
    for root, match in (
        (tmp_path / "file", "is a file"),
        (tmp_path, "not empty"),
        (small_dataset, "another"),
    ):
        with pytest.raises(InputError, match=match):
            generate(root, **SMALL)
    with pytest.raises(InputError, match="workers 1000000: each takes"):
        generate(tmp_path / "set", **(SMALL | dict(workers=10**6)))
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"root": "file"}, "file is a file, not a folder"),
        ({"root": "file/below"}, "file is a file, not a folder"),
        ({"data": "file"}, "file is a file, not a folder"),
        ({"environments": "nowhere"}, "nowhere: no such folder"),
        ({"photographs": "file"}, "file: no such folder"),
        ({"real": "nowhere"}, "nowhere: no such folder"),
        ({"workers": 0}, "at least 1 of each"),
        ({"overrides": {"speed": "9"}}, "unknown setting 'speed'"),
        ({"overrides": {"epochs": "many"}}, "epochs"),
    ],
)
@pytest.mark.parametrize("name", ["table3", "table5", "beyond"])
def test_reproduce_looks_first(name, changes, match, undrawn, tmp_path):
    (tmp_path / "file").write_text("mine")
    arguments = {"root": "root", **changes}
    for key in ("root", "data", "environments", "photographs", "real"):
        if key in arguments:
            arguments[key] = tmp_path / arguments[key]
    with pytest.raises(InputError, match=match):
        reproduce(name, progress=False, **arguments)
    assert not (tmp_path / "root").exists()
    assert (tmp_path / "file").read_text() == "mine"
