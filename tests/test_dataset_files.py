"""Broken, older and interrupted data sets, and large drones, in `generate`, `validate` and `convert`."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import pyvista as pv
from test_generate import edit, files

from dronekeypp import __version__, camera
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.files import read_json
from dronekeypp.sixdronesyn import bop, depth_files, frame_log, scenes
from dronekeypp.sixdronesyn.coco import coco
from dronekeypp.sixdronesyn.depth import DEEPEST, depth_scale, draw_depth
from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.generate import Flight, finish, generate
from dronekeypp.sixdronesyn.manifest import start_manifest
from dronekeypp.sixdronesyn.manifest_check import FINISHED
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.render import DroneRenderer
from dronekeypp.sixdronesyn.validate import frame_faults, validate

SAMPLES = Path(__file__).parents[1] / "data_samples"
LITTLE = dict(size=64, stride=60, progress=False)
FLIGHT = "test/060060"


@pytest.fixture(scope="module")
def second(tmp_path_factory, environments):
    """Six crops of Tello with depth images and masks. Read only."""
    root = tmp_path_factory.mktemp("files") / "second"
    more = dict(scene_numbers=[6], drone_names=["Tello"], edition=2, depth=True, masks=True)
    generate(root, environments=environments, **LITTLE, **more)
    return root


@pytest.fixture
def copy(second, tmp_path):
    """A copy of `second` to break."""
    return Path(shutil.copytree(second, tmp_path / "copy"))


@pytest.fixture(scope="module")
def quadrotors(tmp_path_factory, environments):
    """Two crops a flight of quadrotor 9. Read only."""
    root = tmp_path_factory.mktemp("files") / "quadrotors"
    generate(root, scene_numbers=[6], environments=environments, quadrotors=(9, 10), **LITTLE)
    return root


# --- manifests --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["crops", "frames", "flight"])
def test_a_data_set_of_an_earlier_version_is_resumed(name, tmp_path):
    shutil.copy(SAMPLES / name / "manifest.json", tmp_path)
    old = read_json(tmp_path / "manifest.json")
    assert old["settings"]["version"] != __version__
    now = {**old["settings"], "version": __version__}
    now |= {"edition": 1, "quadrotors": None, "depth": False, "masks": False}
    with pytest.raises(InputError, match="another seed .0, now 1."):
        start_manifest(tmp_path, {**now, "seed": 1}, None, None)
    with pytest.raises(InputError, match="another edition .1, now 2."):
        start_manifest(tmp_path, {**now, "edition": 2}, None, None)
    assert len(start_manifest(tmp_path, now, [6], ["Tello"])) == 3
    new = read_json(tmp_path / "manifest.json")
    assert new["settings"] == {**now, "version": old["settings"]["version"]}
    assert new["versions"][:-1] == old["versions"] and new["versions"][-1]["dronekeypp"] == __version__
    assert old["planned"].items() <= new["planned"].items()


def _with(**settings):
    """The settings of a sound data set, some of them changed."""
    sound = read_json(SAMPLES / "frames" / "manifest.json")
    return {**sound, "settings": {**sound["settings"], **settings}}


MANIFESTS = {
    "no settings": ({"settings": None, "planned": {}}, "settings is None"),
    "empty settings": ({"settings": {}, "planned": {}}, "the field settings.version is missing"),
    "edition of another kind": (_with(edition=[1]), "edition [1] is unknown"),
    "edition that is true": (_with(edition=True), "edition True is unknown"),
    "edition of the future": (_with(edition=3), "edition 3 is unknown; this version of dronekeypp knows 1"),
    "size": (_with(size="large"), "settings.size is 'large'"),
    "size of whole frames": (_with(size=64), "size 64 of full frames"),
    "frames": (_with(frames=["full"]), "settings.frames is ['full']: it should be 'crop' or 'full'"),
    "stride": (_with(stride=0), "settings.stride is 0"),
    "quadrotors": (_with(quadrotors=[3]), "settings.quadrotors: List should have at least 2"),
    "own drones": (_with(own_drones=["Racer"]), "settings.own_drones is ['Racer']"),
    "environments": (_with(environment_digests=None), "settings.environment_digests is None"),
    "plan": ({**_with(), "planned": {"000610": "four"}}, "planned.000610 is 'four'"),
    "list of flights": ({**_with(), "flights": {"000610": ["test"]}}, "flights.000610 is ['test']"),
    "counts": ({**_with(), "frames": []}, "frames is []"),
    "versions": ({**_with(), "versions": {}}, "versions is {}"),
    "another list": ([1], "not a data set's manifest"),
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_a_broken_manifest_is_one_line(name, tmp_path, environments, capsys):
    content, message = MANIFESTS[name]
    root = tmp_path / "data"
    root.mkdir()
    (root / "manifest.json").write_text(json.dumps(content))
    commands = (
        ["validate", str(root)],
        ["convert", str(root), "--to", "coco"],
        ["generate", str(root), "--environments", str(environments)],
    )
    for command in commands:
        assert main(command) == 2, command
        line = capsys.readouterr().err
        assert line.startswith(f"error: {root / 'manifest.json'}: ") and message in line, command
        assert line.count("\n") == 1


def test_a_flight_without_digests_is_one_line(copy):
    edit(copy / FLIGHT / "flight.json", lambda about: about["digests"].update({"0": [[], "", "", "", ""]}))
    assert any("flight.json: digests.0.0 is []" in fault for fault in validate(copy))
    with pytest.raises(InputError, match=r"flight.json: digests.0.0 is .*; delete its flight folder"):
        finish(copy)


# --- interrupted data sets --------------------------------------------------------------------------------


def test_an_interrupted_data_set_of_quadrotors_has_no_other_faults(quadrotors, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(quadrotors, root, ignore=shutil.ignore_patterns("models*", "coco*", "test_targets*"))
    edit(root / "manifest.json", lambda manifest: [manifest.pop(key) for key in FINISHED])
    (fault,) = validate(root)
    assert "generate has not finished" in fault


@pytest.mark.parametrize("flight", [("Quad9", 0), ("Mav3", 5)])
def test_hubs_of_a_frame_are_its_own(flight, environments):
    drone, number = flight
    settings = {"seed": 0, "edition": 2, "frames": "crop", "size": 64}
    subsequence = scenes.Subsequence(6, drone, 0, number, edition=2)
    frame = Flight(subsequence, settings, sorted(environments.iterdir())).annotate(0)
    assert frame_faults(frame) == []


@pytest.mark.parametrize("junk", [b"\0" * 40, b"5", b"[0]", b'["0", "x"]', b"\xff", b'[0, "x", 5, null]'])
def test_a_torn_line_of_the_frame_log_is_skipped(junk, copy):
    folder, settings = copy / FLIGHT, read_json(copy / "manifest.json")["settings"]
    image, _, *others = read_json(folder / "flight.json")["digests"]["60"]
    frame = frame_log.Finished(image, tuple(others), (7, 7))
    good = frame_log.line(60, frame).encode()
    (folder / frame_log.NAME).write_bytes(junk + b"\n" + good + junk)
    assert frame_log.read(folder, settings) == {60: frame}
    assert (folder / frame_log.NAME).read_bytes() == junk + b"\n" + good


@pytest.mark.parametrize(
    "lost",
    ["models_eval", "models_eval/models_info.json", "models_eval/obj_000003.ply", "models/obj_000007.ply"],
)
def test_generate_writes_a_model_that_is_missing(lost, second, copy):
    path = copy / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    faults = validate(copy)
    assert faults and all("missing; run generate again, it writes what is missing" in f for f in faults)
    finish(copy)
    assert files(copy) == files(second)


# --- broken files -----------------------------------------------------------------------------------------


def settings_of(root):
    return read_json(root / "manifest.json")["settings"]


def test_coco_names_a_mesh_that_is_cut_off(quadrotors, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(quadrotors, root)
    mesh = root / "models" / "obj_000001.ply"
    mesh.write_bytes(mesh.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"obj_000001.ply: not a whole PLY file"):
        coco(root, "test", settings_of(root))
    mesh.unlink()
    with pytest.raises(InputError, match=r"obj_000001.ply: not found"):
        coco(root, "test", settings_of(root))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"propeller_diameter": "wide"}, "object 1: propeller_diameter is 'wide'"),
        ({"keypoints": None}, "object 1: the field keypoints is missing"),
    ],
)
def test_coco_names_what_is_wrong_with_the_models(change, message, quadrotors, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(quadrotors, root)
    path = root / "models" / "models_info.json"
    edit(path, lambda table: table["1"].update(change))
    with pytest.raises(InputError, match=f"{path} {message}"):
        coco(root, "test", settings_of(root))
    path.unlink()
    with pytest.raises(InputError, match=f"{path}: missing; run generate again"):
        coco(root, "test", settings_of(root))


def _cut(path):
    path.write_bytes(path.read_bytes()[:60])


def _repaint(path):
    cv2.imwrite(str(path), np.zeros((64, 64), np.uint8))


@pytest.mark.parametrize("damage", [Path.unlink, _cut, _repaint])
def test_coco_names_a_mask_that_is_broken(damage, copy):
    mask = depth_files.paths(copy / FLIGHT, 60, settings_of(copy))[-1]
    damage(mask)
    for call in (lambda: coco(copy, "test", settings_of(copy)), lambda: finish(copy)):
        with pytest.raises(InputError, match=f"{mask}: .*; delete its flight folder and run generate again"):
            call()


def test_validate_keeps_its_faults_where_the_targets_are_broken(copy):
    (copy / "test_targets_bop19.json").write_text("[")
    bop.image_path(copy / FLIGHT, 60).unlink()
    faults = validate(copy)
    assert any("test_targets_bop19.json: not valid JSON" in fault for fault in faults)
    assert any("rgb/000060.jpg: image missing" in fault for fault in faults)


@pytest.mark.parametrize("count", ["many", None, [1], 1, 2.5])
def test_validate_names_a_pixel_count_that_is_no_number(count, copy):
    path = copy / FLIGHT / "scene_gt_info.json"
    edit(path, lambda table: table["60"][0].update(px_count_all=count))
    assert any(f"{path} frame 60: its pixel counts" in fault for fault in validate(copy))


def test_convert_needs_no_graphics_library():
    code = "import sys, dronekeypp.convert; print({'vtk', 'pyvista', 'vtkmodules'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


# --- large drones -----------------------------------------------------------------------------------------

K = np.array([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]])


@pytest.fixture(scope="module")
def giant(tmp_path_factory):
    """A drone with hubs 1.2 m to the sides, and a boom that reaches 3.4 m to the front and to the back."""
    path = tmp_path_factory.mktemp("files") / "giant.stl"
    pv.Cube(x_length=6.8, y_length=0.3, z_length=0.3).triangulate().save(path)
    return Drone(
        name="Giant",
        label="Giant",
        index=7,
        body_mm=(2400, 2400, 300),
        wheelbase=2.4 * np.sqrt(2),
        propeller_diameter=0.95,
        mass=30,
        motor_radius=0.05,
        hull_rgb=(200, 30, 30),
        trim_rgb=(50, 50, 54),
        propeller_rgb=(60, 60, 64),
        tip_rgb=(60, 60, 64),
        hubs=np.array([[1.2, 1.2, 0], [1.2, -1.2, 0], [-1.2, -1.2, 0], [-1.2, 1.2, 0]]),
        mesh=path,
        digest="giant",
    )


def seen(drone, z):
    """A whole frame of a drone at `z` metres, whose boom points nearly at the camera."""
    a = 0.3
    R = np.array([[np.sin(a), -np.cos(a), 0], [0, 0, -1], [np.cos(a), np.sin(a), 0]])
    t = np.array([0.0, 0.0, z])
    outline = camera.project(drone_mesh(drone).body.points @ R.T + t, K)
    low, high = outline.min(axis=0), outline.max(axis=0)
    box = np.array([*low, *(high - low)])
    return bop.Frame(0, K, None, None, 8, R, t, None, None, None, box, None)


def test_a_large_drone_is_drawn_whole(giant):
    """Its depth reaches from end to end, and its picture shows it wherever there is depth."""
    frame = seen(giant, 12.0)
    depth, _ = draw_depth(giant, frame, scenes.WIDTH, scenes.HEIGHT)
    rows, columns = np.nonzero(depth)
    low, high = frame.box[:2], frame.box[:2] + frame.box[2:]
    np.testing.assert_allclose([columns.min(), rows.min()], low, atol=1)
    np.testing.assert_allclose([columns.max() + 1, rows.max() + 1], high, atol=1)
    ends = drone_mesh(giant).body.points @ frame.R[2] + 12.0
    np.testing.assert_allclose(depth[depth > 0].min(), ends.min(), atol=0.1)
    up = np.array([0.0, -1.0, 0.0])
    light = {"sun": up, "up": up}
    light |= {f"{name}_colour": np.ones(3) for name in ("sun", "sky", "ground")}
    renderer = DroneRenderer(giant, 512)
    picture = renderer.draw(frame.R, frame.t, K, (704, 284, 512), light, np.zeros(4), 1.0)
    shown = picture[..., 3] == 255
    assert (shown | (depth[284:796, 704:1216] == 0)).mean() > 0.9999
    renderer.close()


@pytest.mark.parametrize("z", [5.0, 20.0, 49.8])
def test_sixteen_bits_hold_the_depth_of_a_far_drone(z, giant):
    frame = seen(giant, z)
    scale = depth_scale(giant, frame)
    depth, _ = draw_depth(giant, frame, scenes.WIDTH, scenes.HEIGHT)
    (content,) = depth_files.encode(depth, scale, {"depth": True})
    read = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) * scale / 1000
    np.testing.assert_allclose(read, depth, atol=scale / 1000)
    assert (z + 3.4) * 1000 / DEEPEST < scale
