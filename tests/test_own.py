"""Drones of one's own beside the seven.

They are rendered, annotated and learned, change no frame and no class of any other drone, and every fault of
their files is named.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, own, scenes
from dronekeypp.sixdronesyn.drones import DRONES, SEVEN
from dronekeypp.sixdronesyn.generate import finish
from dronekeypp.sixdronesyn.validate import validate

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
ALPHA = {**RACER, "name": "Alpha", "hull_rgb": [30, 30, 200], "mass": 0.5}  # its file comes before Racer's
ROOT = Path(__file__).parents[1]


@pytest.fixture
def folder(tmp_path):
    """A drone of one's own: a red cross of two beams, in millimetres."""
    folder = tmp_path / "drones"
    folder.mkdir()
    arms = [pv.Cube(x_length=300, y_length=24, z_length=20).rotate_z(angle) for angle in (50, -50)]
    cross = (arms[0] + arms[1]).extract_surface(algorithm="dataset_surface").triangulate()
    cross.save(folder / "racer.stl")
    write(folder, RACER)
    return folder


def write(folder, fields):
    """Put a drone's file into the folder."""
    (folder / f"{str(fields['name']).lower()}.json").write_text(json.dumps(fields))


def run(code, folder):
    """Python in a process that knows the drones of `folder`; its output."""
    environment = {**os.environ, "DRONEKEYPP_DRONES": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


GENERATE = """
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.generate import generate
settings = dict(size=64, stride=60, environments={pictures!r}, progress=False)
try:
    generate({root!r}, {scenes!r}, {drones!r}, **settings)
except InputError as error:
    print(error)
"""


def render(root, folder, environments, drones, scene_numbers=(1, 3)):
    """Generate a small data set in a process that knows the drones of `folder`; returns what it refused."""
    code = GENERATE.format(
        root=str(root), pictures=str(environments), scenes=list(scene_numbers), drones=drones
    )
    return run(code, folder).strip()


def files_of(root, drone):
    """Every file of a drone's flights: {(scene, background, name): path}."""
    files = {}
    for path in root.glob("*/*/flight.json"):
        flight = bop.read_json(path)
        if flight["drone"] == drone:
            for file in path.parent.rglob("*.*"):
                files[flight["scene"], flight["take"], file.name] = file
    return files


def content_of(root, drone):
    """The bytes of every file of a drone's flights."""
    return {key: path.read_bytes() for key, path in files_of(root, drone).items()}


TRAIN = """
from dronekeypp import checkpoint
from dronekeypp.errors import InputError
from dronekeypp.train import train
settings = dict(layers=1, width=16, heads=1, ffn=16, image_size=64, epochs=1, backbone_weights=None)
try:
    train({root!r}, {out!r}, overrides=dict(settings, classes=7), progress=False)
except InputError as error:
    print(error)
best = train({root!r}, {out!r}, overrides=dict(settings, pose="geometric"), progress=False)
drones = checkpoint.read_config(best)[2]
print(best.name, len(drones), drones[7].name, drones[7].hubs.tolist())
"""


def test_it_is_rendered_and_learned(folder, environments, tmp_path):
    root, out = tmp_path / "set", tmp_path / "run"
    assert render(root, folder, environments, ["Racer", "Mini2"]) == ""
    # Racer's file is not needed any more: this process and the training know the seven only.
    assert tuple(DRONES) == SEVEN
    assert validate(root) == []
    info = bop.read_json(root / "models" / "models_info.json")["8"]
    assert info["name"] == "Racer" and np.allclose(np.array(info["keypoints"]) / 1000, HUBS)
    data = open_dataset(root, "train", size=64)
    assert data.labels.count(7) == 6 and data.labels.count(1) == 6
    assert data.drones[7].name == "Racer"
    image = data[data.labels.index(7)]["image"]
    red = (image[0] > 1.8 * image[1]) & (image[0] > 0.2)
    assert red.sum() > 20
    lines = run(TRAIN.format(root=str(root), out=str(out)), folder="").splitlines()
    assert lines == [
        f"classes=7: {root} has 8 drones; leave the setting out",
        f"best 8 Racer {HUBS}",
    ]


def test_another_file_changes_no_class(folder, environments, tmp_path):
    """A file that comes before Racer's is added, and the data set is generated on."""
    root = tmp_path / "set"
    assert render(root, folder, environments, ["Racer"]) == ""
    content = content_of(root, "Racer")
    assert len(content) == 36  # 2 scenes before 3 backgrounds, 2 pictures and 4 files each
    written = {path: path.stat().st_mtime_ns for path in files_of(root, "Racer").values()}
    labels = open_dataset(root, "train").labels
    assert set(labels) == {7}

    write(folder, ALPHA)
    assert render(root, folder, environments, ["Alpha", "Racer"]) == ""
    assert content_of(root, "Racer") == content
    for path, when in written.items():  # not rendered again
        assert path.stat().st_mtime_ns == when
    assert validate(root) == []
    assert [drone.name for drone in bop.read_models(root).values()] == [*SEVEN, "Racer", "Alpha"]
    data = open_dataset(root, "train")
    assert [drone.name for drone in data.drones[7:]] == ["Racer", "Alpha"]
    assert sorted(data.labels) == labels + [8] * len(labels)
    assert open_dataset(root, "train", drones=["Racer"]).labels == labels


def test_another_file_changes_no_frame(folder, environments, tmp_path):
    """Racer's frames are the same without Alpha, beside Alpha's file, and behind Alpha in the data set."""
    first, second, third = tmp_path / "first", tmp_path / "second", tmp_path / "third"
    assert render(first, folder, environments, ["Racer"]) == ""
    write(folder, ALPHA)
    assert render(second, folder, environments, ["Racer"]) == ""
    assert render(third, folder, environments, ["Alpha", "Racer"]) == ""
    assert content_of(second, "Racer") == content_of(first, "Racer")
    assert [drone.name for drone in bop.read_models(third).values()] == [*SEVEN, "Alpha", "Racer"]
    expected, content = content_of(first, "Racer"), content_of(third, "Racer")
    assert content.keys() == expected.keys()
    for (scene, take, name), value in content.items():
        if name not in ("scene_gt.json", "flight.json"):  # these hold the drone's number, or its digest
            assert value == expected[scene, take, name]


def test_a_data_set_keeps_its_drones(folder, environments, tmp_path):
    """It opens without their files, and it is not generated on with other drones of their names."""
    root = tmp_path / "set"
    assert render(root, folder, environments, ["Racer"], [1]) == ""
    assert len(open_dataset(root, "train")) == 6
    write(folder, {**RACER, "mass": 0.6})
    for drones in (["Racer"], ["Tello"]):
        refusal = render(root, folder, environments, drones, [1])
        assert "this folder was made with another drone Racer: set DRONEKEYPP_DRONES" in refusal
        assert refusal.startswith(f"{root / 'manifest.json'}: ") and "\n" not in refusal
    assert len(open_dataset(root, "train")) == 6
    (root / "models" / "models_info.json").unlink()  # generate was killed before it wrote it
    with pytest.raises(InputError, match="it holds a drone Racer: set DRONEKEYPP_DRONES"):
        finish(root)


def test_many_drones(folder, environments, tmp_path):
    """A folder holds any number of drones, a data set at most ten."""
    for name in "abcd":
        write(folder, {**RACER, "name": name})
    root = tmp_path / "set"
    refusal = render(root, folder, environments, None, [1])
    assert refusal == "5 drones of your own: a data set holds 3 beside the seven; choose some with --drones"
    assert render(root, folder, environments, ["b", "c", "Racer"], [1]) == ""
    assert [drone.name for drone in open_dataset(root, "train").drones[7:]] == ["b", "c", "Racer"]
    assert "4 drones of your own" in render(root, folder, environments, ["d"], [1])
    assert validate(root) == []


def test_tables_and_trainings_of_the_seven_stay_as_they_are(folder, tmp_path):
    code = """
from pathlib import Path
from dronekeypp.reproduce import ablations, read_result, table3_page
figures = Path("figures")
for file, make in (("table3.md", table3_page.markdown), ("table3.csv", table3_page.as_csv)):
    print((figures / file).read_text() == make(read_result("table3")))
print((figures / "table5.md").read_text() == ablations.markdown(read_result("table5")))
from dronekeypp.train import train
settings = dict(layers=1, width=16, heads=1, ffn=16, image_size=64, epochs=1, backbone_weights=None)
settings |= dict(frames=64, val_frames=64)
print(train("data_samples/crops", OUT, overrides=settings, progress=False).name)
"""
    output = run(code.replace("OUT", repr(str(tmp_path / "run"))), folder)
    assert output.split() == ["True", "True", "True", "best"]


def test_it_changes_no_frame_of_the_seven(folder):
    code = """
from dronekeypp.sixdronesyn import scenes
flights = scenes.subsequences(drones=scenes.SEVEN)
print([scenes.background(flight, 22) for flight in flights])
"""
    expected = [scenes.background(flight, 22) for flight in scenes.subsequences()]
    assert run(code, folder).strip() == str(expected)
    assert tuple(DRONES) == SEVEN


def moved(hub, axis, by):
    """The hubs, one of them moved along an axis."""
    hubs = np.array(HUBS)
    hubs[hub, axis] += by
    return hubs.tolist()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"hubs": None}, "the field hubs is missing"),
        ({"colour": 1}, "the field colour is unknown"),
        ({"name": "Tello"}, "there is a drone 'Tello' already"),
        ({"name": "my racer"}, "letters and digits only"),
        ({"name": "Quad17"}, "that is a random quadrotor's; choose another name"),
        ({"mesh": "other.stl"}, "other.stl not found"),
        ({"mesh_unit": "inch"}, "should be 'm' or 'mm'"),
        ({"hubs": HUBS[:3]}, "hubs: List should have at least 4 items"),
        ({"hubs": (1000 * np.array(HUBS)).tolist()}, "hubs are in metres"),
        ({"hubs": HUBS[::-1]}, "in the order front-left"),
        ({"hubs": "many"}, "hubs is 'many'"),
        ({"hubs": moved(0, 0, 0.01)}, r"racer\.json: hubs are 10\.0 mm from left–right symmetric"),
        ({"hubs": moved(3, 1, 0.02)}, r"racer\.json: hubs are 20\.0 mm from left–right symmetric"),
        ({"hubs": moved(1, 2, 0.04)}, r"racer\.json: hubs are \d+\.\d mm from lying in one plane"),
        ({"mass": 0}, "mass in kg"),
        ({"hull_rgb": [0, 0, 300]}, "hull_rgb.2 is 300: it should be less than or equal to 255"),
    ],
)
def test_bad_drones(change, match, folder, monkeypatch):
    fields = {key: value for key, value in {**RACER, **change}.items() if value is not None}
    (folder / "racer.json").write_text(json.dumps(fields))
    monkeypatch.setenv(own.VARIABLE, str(folder))
    with pytest.raises(InputError, match=match):
        own.read(SEVEN)


def test_hubs_may_be_measured(folder, monkeypatch):
    """A tenth of a millimetre is no asymmetry."""
    write(folder, {**RACER, "hubs": moved(0, 2, 0.0001)})
    monkeypatch.setenv(own.VARIABLE, str(folder))
    assert len(own.read(SEVEN)) == 1


def test_bad_folders_and_files(folder, tmp_path, monkeypatch):
    monkeypatch.setenv(own.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(InputError, match="no such folder"):
        own.read(SEVEN)
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv(own.VARIABLE, str(tmp_path / "empty"))
    with pytest.raises(InputError, match=r"no drone; NAME.json files are read"):
        own.read(SEVEN)
    monkeypatch.setenv(own.VARIABLE, str(folder))
    for name in "abc":
        write(folder, {**RACER, "name": name})
    assert [drone["index"] for drone in own.read(SEVEN)] == [7, 8, 9, 10]
    (folder / "a.json").write_text('["name", "mesh"]')
    with pytest.raises(InputError, match="an object of named fields is needed"):
        own.read(SEVEN)
    (folder / "a.json").write_text("{")
    with pytest.raises(InputError, match="not valid JSON"):
        own.read(SEVEN)


@pytest.mark.parametrize("colour", [np.float32([1.0, 0.5, 0.0]), np.uint8([255, 128, 0])])
def test_a_mesh_keeps_its_colours(colour, folder):
    mesh = pv.read(folder / "racer.stl")
    mesh.point_data["RGB"] = np.tile(colour, (mesh.n_points, 1))
    mesh.save(folder / "racer.vtp")
    write(folder, {**RACER, "mesh": "racer.vtp"})
    probe = """
from dronekeypp.sixdronesyn.meshes import drone_mesh
print(drone_mesh("Racer").body["rgb"].mean(axis=0).round().astype(int).tolist())
"""
    assert run(probe, folder).strip() in ("[255, 127, 0]", "[255, 128, 0]")


def test_a_mesh_in_the_wrong_unit_or_none_at_all(folder):
    probe = """
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.meshes import drone_mesh
try:
    drone_mesh("Racer")
except InputError as error:
    print(error)
"""
    write(folder, {**RACER, "mesh_unit": "m"})
    assert "is mesh_unit right?" in run(probe, folder)
    write(folder, {**RACER, "hubs": (np.array(HUBS) + [0, 0, 1]).tolist()})
    assert "its middle is 1.03 m away from that of its hubs" in run(probe, folder)
    (folder / "racer.stl").write_bytes(b"nothing")
    assert "racer.stl: not a whole STL file; export the mesh again" in run(probe, folder)
