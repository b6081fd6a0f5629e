"""A drone of one's own: it is rendered, annotated and learned beside the seven, changes none of their frames, and every fault is named."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import own, scenes
from dronekeypp.sixdronesyn.drones import DRONES, SEVEN

HUBS = [[0.09, 0.11, 0.03], [0.09, -0.11, 0.03], [-0.08, -0.1, 0.03], [-0.08, 0.1, 0.03]]
RACER = {
    "name": "Racer",
    "mesh": "racer.stl",
    "mesh_unit": "mm",
    "hubs": HUBS,
    "propeller_diameter": 0.13,
    "mass": 0.4,
    "hull_rgb": [200, 30, 30],
}


ROOT = Path(__file__).parents[1]


@pytest.fixture
def folder(tmp_path):
    """A red cross of two beams, in millimetres."""
    arms = [pv.Cube(x_length=300, y_length=24, z_length=20).rotate_z(angle) for angle in (50, -50)]
    (arms[0] + arms[1]).extract_surface(algorithm="dataset_surface").triangulate().save(
        tmp_path / "racer.stl"
    )
    (tmp_path / "racer.json").write_text(json.dumps(RACER))
    return tmp_path


def run(code, folder):
    """Python in a process that knows the drones of `folder`; its output."""
    environment = {**os.environ, "DRONEKEYPP_DRONES": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


GENERATE = """
import sys
from pathlib import Path
from dronekeypp.sixdronesyn.generate import generate
from dronekeypp.sixdronesyn.validate import validate
root, pictures = Path({root!r}), {pictures!r}
manifest = generate(root, [1, 3], ["Racer", "Mini2"], size=64, stride=60, environments=pictures, workers=2, progress=False)
validate(root)
print(sum(manifest["frames"].values()), sorted(manifest["settings"]["own_drones"]))
from dronekeypp.sixdronesyn.dataset import SixDroneSyn
items = SixDroneSyn(root, "train", size=64)
mine = [item for item in items if item["label"] == 7]
print(len(items), len(mine))
image = mine[0]["image"]
red = (image[0] > 1.8 * image[1]) & (image[0] > 0.2)
print(int(red.sum()) > 20)
from dronekeypp.errors import InputError
from dronekeypp.train import train
settings = dict(layers=1, width=16, heads=1, ffn=16, image_size=64, epochs=1, backbone_weights=None)
try:
    train(root, root.parent / "run", overrides=settings, progress=False)
except InputError as error:
    print(error)
print(train(root, root.parent / "run", overrides=dict(settings, classes=8, pose="geometric"), progress=False).name)
"""


def test_it_is_rendered_and_learned(folder, environments, tmp_path):
    root = tmp_path / "set"
    lines = run(GENERATE.format(root=str(root), pictures=str(environments)), folder).splitlines()
    assert lines == [
        "24 ['Racer']",
        "12 6",
        "True",
        "drone number 8 is in the data, and there are 7 classes: --set classes=8",
        "best",
    ]
    info = json.loads((root / "models" / "models_info.json").read_text())["8"]
    assert info["name"] == "Racer" and np.allclose(np.array(info["keypoints"]) / 1000, HUBS)


def test_tables_and_trainings_of_the_seven_stay_as_they_are(folder):
    code = """
from pathlib import Path
from dronekeypp.reproduce import ablations, read_result, table3
figures = Path("figures")
for file, make in (("table3.md", table3.markdown), ("table3.csv", table3.as_csv)):
    print((figures / file).read_text() == make(read_result("table3")))
print((figures / "table5.md").read_text() == ablations.markdown(read_result("table5")))
from dronekeypp.train import train
settings = dict(layers=1, width=16, heads=1, ffn=16, image_size=64, epochs=1, frames=64, val_frames=64, backbone_weights=None)
print(train("data_samples/crops", OUT, overrides=settings, progress=False).name)
"""
    assert run(code.replace("OUT", repr(str(folder / "run"))), folder).split() == [
        "True",
        "True",
        "True",
        "best",
    ]


def test_it_changes_no_frame_of_the_seven(folder):
    code = "from dronekeypp.sixdronesyn import scenes; print([scenes.background(s, 22) for s in scenes.subsequences(drones=scenes.SEVEN)])"
    assert run(code, folder).strip() == str([scenes.background(s, 22) for s in scenes.subsequences()])
    assert tuple(DRONES) == SEVEN


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"hubs": None}, "lacks hubs"),
        ({"colour": 1}, "unknown field colour"),
        ({"name": "Tello"}, "there is a drone 'Tello' already"),
        ({"name": "my racer"}, "letters and digits only"),
        ({"mesh": "other.stl"}, "other.stl not found"),
        ({"mesh_unit": "inch"}, "m or mm"),
        ({"hubs": HUBS[:3]}, "four points of three numbers"),
        ({"hubs": [[1000 * v for v in hub] for hub in HUBS]}, "hubs are in metres"),
        ({"hubs": HUBS[::-1]}, "in the order front-left"),
        ({"hubs": "many"}, "could not convert"),
        ({"mass": 0}, "mass in kg"),
        ({"hull_rgb": [0, 0, 300]}, "three numbers, 0 to 255"),
    ],
)
def test_bad_drones(change, match, folder, monkeypatch):
    fields = {key: value for key, value in {**RACER, **change}.items() if value is not None}
    (folder / "racer.json").write_text(json.dumps(fields))
    monkeypatch.setenv(own.VARIABLE, str(folder))
    with pytest.raises(InputError, match=match):
        own.read(SEVEN)


def test_bad_folders_and_files(folder, tmp_path, monkeypatch):
    monkeypatch.setenv(own.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(InputError, match="no such folder"):
        own.read(SEVEN)
    monkeypatch.setenv(own.VARIABLE, str(folder))
    assert [drone["index"] for drone in own.read(SEVEN)] == [7]
    for name in "abc":
        (folder / f"{name}.json").write_text(json.dumps({**RACER, "name": name}))
    with pytest.raises(InputError, match="4 drones; 1 to 3"):
        own.read(SEVEN)
    (folder / "a.json").write_text('["name", "mesh"]')
    with pytest.raises(InputError, match="not the fields of a drone but a list"):
        own.read(SEVEN)
    (folder / "a.json").write_text("{")
    with pytest.raises(InputError, match="not valid JSON"):
        own.read(SEVEN)


@pytest.mark.parametrize("colour", [np.float32([1.0, 0.5, 0.0]), np.uint8([255, 128, 0])])
def test_a_mesh_keeps_its_colours(colour, folder):
    mesh = pv.read(folder / "racer.stl")
    mesh.point_data["RGB"] = np.tile(colour, (mesh.n_points, 1))
    mesh.save(folder / "racer.vtp")
    (folder / "racer.json").write_text(json.dumps({**RACER, "mesh": "racer.vtp"}))
    probe = "from dronekeypp.sixdronesyn.meshes import drone_mesh\nprint(drone_mesh('Racer').body['rgb'].mean(axis=0).round().astype(int).tolist())"
    assert run(probe, folder).strip() in ("[255, 127, 0]", "[255, 128, 0]")


def test_a_mesh_in_the_wrong_unit_or_none_at_all(folder):
    probe = "from dronekeypp.sixdronesyn.meshes import drone_mesh\nfrom dronekeypp.errors import InputError\n"
    probe += "try: drone_mesh('Racer')\nexcept InputError as error: print(error)"
    (folder / "racer.json").write_text(json.dumps({**RACER, "mesh_unit": "m"}))
    assert "is mesh_unit right?" in run(probe, folder)
    (folder / "racer.json").write_text(json.dumps({**RACER, "hubs": (np.array(HUBS) + [0, 0, 1]).tolist()}))
    assert "its middle is 1.03 m away from that of its hubs" in run(probe, folder)
    (folder / "racer.stl").write_bytes(b"nothing")
    assert "not a mesh that PyVista reads" in run(probe, folder)
