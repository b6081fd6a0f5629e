"""ADD, ADD-S, MSSD and MSPD are those of bop_toolkit; the shapes that they are measured on; and the results
file, in the data set's own numbers.
"""

import csv
import json
import shutil
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dronekeypp import checkpoint
from dronekeypp.classes import DroneClass
from dronekeypp.cli import main
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import command, evaluate_checkpoint
from dronekeypp.evaluate.bop_measures import MSPD_THRESHOLDS, MSSD_THRESHOLDS, recall
from dronekeypp.evaluate.pose_errors import add, adds, mspd, mssd
from dronekeypp.sixdronesyn.manifest_check import FINISHED
from dronekeypp.sixdronesyn.object_shapes import read_shapes, symmetries_of
from dronekeypp.sixdronesyn.ply import read_points
from dronekeypp.sixdronesyn.results import object_numbers

FRAMES = Path(__file__).parents[1] / "data_samples" / "frames"
K = np.array([[1500.0, 0, 960], [0, 1490, 540], [0, 0, 1]])
IDENTITY = np.eye(4)[None]

# Symmetries as models_info.json holds them, in millimetres: a half turn and a flip with an offset, a turn
# about a line that is not through the origin, and two that are combined.
FLIP = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 30, 0, 0, 0, 1]
DISCRETE = [[-1, 0, 0, 20, 0, -1, 0, -10, 0, 0, 1, 0, 0, 0, 0, 1], FLIP]
SYMMETRIES = {
    "none": {},
    "discrete": {"symmetries_discrete": DISCRETE},
    "continuous": {"symmetries_continuous": [{"axis": [0, 0, 2], "offset": [10, 20, 0]}]},
    "both": {
        "symmetries_discrete": [FLIP],
        "symmetries_continuous": [{"axis": [0, 1, 0], "offset": [0, 0, 15]}],
    },
}
# What bop_toolkit (commit cea62d65, 19 June 2026, max_sym_disc_step 0.01) gives for `some_poses`: the number
# of symmetries, MSSD in metres, and MSPD in pixels.
OF_BOP_TOOLKIT = {
    "none": (1, [0.0290566796, 0.220357137, 0.728038266], [7.23996701, 72.3815587, 209.987533]),
    "discrete": (3, [0.0290566796, 0.220357137, 0.562390947], [7.23996701, 72.3815587, 186.460079]),
    "continuous": (315, [0.0217534382, 0.172664676, 0.506090168], [5.61252158, 53.584386, 182.493526]),
    "both": (630, [0.0274809074, 0.19527571, 0.539308098], [5.76169378, 60.2862183, 181.315371]),
}


def some_poses():
    """Three estimated and three true poses, from good to bad, and 40 points, in metres."""
    rng = np.random.default_rng(18)
    points = rng.uniform(-0.15, 0.15, (40, 3))
    R = Rotation.from_rotvec(rng.normal(size=(3, 3))).as_matrix()
    t = rng.uniform([-1, -1, 3], [1, 1, 6], (3, 3))
    turns = rng.normal(scale=[[0.05], [0.4], [2.0]], size=(3, 3))
    R_est = R @ Rotation.from_rotvec(turns).as_matrix()
    t_est = t + rng.normal(scale=[[0.01], [0.05], [0.2]], size=(3, 3))
    return (R_est, t_est, R, t), points


def test_add_and_adds_are_those_of_bop_toolkit():
    poses, points = some_poses()
    np.testing.assert_allclose(add(*poses, points), [0.0135583367, 0.120392021, 0.496424339], rtol=1e-7)
    np.testing.assert_allclose(adds(*poses, points), [0.0135583367, 0.0712540758, 0.259098318], rtol=1e-7)


@pytest.mark.parametrize("kind", SYMMETRIES)
def test_mssd_and_mspd_are_those_of_bop_toolkit(kind):
    poses, points = some_poses()
    symmetries = symmetries_of(SYMMETRIES[kind], "here")
    count, metres, pixels = OF_BOP_TOOLKIT[kind]
    assert len(symmetries) == count
    np.testing.assert_array_equal(symmetries[0], np.eye(4))
    np.testing.assert_allclose(mssd(*poses, points, symmetries), metres, rtol=1e-7)
    np.testing.assert_allclose(mspd(*poses, np.stack([K] * 3), points, symmetries), pixels, rtol=1e-7)


def test_errors_by_hand():
    """A drone two metres ahead that is seen 0.1 m to the right of where it is: 75 pixels."""
    points = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    R, t = np.eye(3)[None], np.array([[0.0, 0.0, 2.0]])
    poses = (R, t + [0.1, 0, 0], R, t)
    np.testing.assert_allclose(add(*poses, points), 0.1)
    np.testing.assert_allclose(adds(*poses, points), 0.1 / 3)  # two of three meet a neighbour
    np.testing.assert_allclose(mssd(*poses, points, IDENTITY), 0.1)
    np.testing.assert_allclose(mspd(*poses, K[None], points, IDENTITY), 75)


def test_nan_stays_nan_and_spoils_no_other_frame():
    (R_est, t_est, R, t), points = some_poses()
    R_est = R_est.copy()
    R_est[1] = np.nan
    poses = (R_est, t_est, R, t)
    symmetries = symmetries_of(SYMMETRIES["discrete"], "here")
    found = [
        add(*poses, points),
        adds(*poses, points),
        mssd(*poses, points, symmetries),
        mspd(*poses, np.stack([K] * 3), points, symmetries),
    ]
    for errors in found:
        assert np.isnan(errors).tolist() == [False, True, False]


def test_recall_is_the_share_of_thresholds_above_the_error():
    assert recall(np.array([0.0, 0.12, 0.5, np.inf]), MSSD_THRESHOLDS).tolist() == [1.0, 0.8, 0.0, 0.0]
    assert recall(np.array([4.9, 5.0, 49.0]), MSPD_THRESHOLDS).tolist() == [1.0, 0.9, 0.1]


# --- shapes -----------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    """Whole frames of 6DroneSyn with models to change."""
    root = tmp_path / "set"
    root.mkdir()
    shutil.copy(FRAMES / "manifest.json", root)
    shutil.copytree(FRAMES / "models", root / "models")
    (root / "test").symlink_to(FRAMES / "test")
    return root


def change_models(root, number, **fields):
    path = root / "models" / "models_info.json"
    info = json.loads(path.read_text())
    info[str(number)].update(fields)
    path.write_text(json.dumps(info))


def test_shapes_are_in_metres_and_models_eval_comes_first(folder):
    shapes, missing = read_shapes(folder, [1, 7])
    assert missing == "" and sorted(shapes) == [1, 7]
    info = json.loads((folder / "models" / "models_info.json").read_text())["1"]
    np.testing.assert_allclose(shapes[1].points.min(axis=0)[0], info["min_x"] / 1000, atol=1e-5)
    assert shapes[1].diameter == info["diameter"] / 1000 and not shapes[1].symmetric
    shutil.copytree(folder / "models", folder / "models_eval")
    change_models(folder, 1, diameter=1.0)
    assert read_shapes(folder, [1])[0][1].diameter == info["diameter"] / 1000


@pytest.mark.parametrize(
    "fields, match",
    [
        ({"diameter": -3}, "models_info.json object 1: diameter -3 is not above 0"),
        ({"diameter": "large"}, "models_info.json object 1: diameter is not a list of numbers"),
        ({"symmetries_discrete": [[1, 2]]}, "symmetries_discrete holds 2 numbers instead of 16"),
        ({"symmetries_discrete": [[2, *FLIP[1:]]]}, "object 1: symmetries_discrete: not orthonormal"),
        ({"symmetries_discrete": 4}, "object 1: symmetries_discrete is not a list"),
        ({"symmetries_continuous": [{"axis": [0, 0, 1]}]}, "object 1: the field offset is missing"),
        ({"symmetries_continuous": [[0, 0, 1]]}, "symmetries_continuous needs an axis and an offset"),
        (
            {"symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]},
            "the axis of symmetries_continuous has no length",
        ),
    ],
)
def test_bad_models_info(folder, fields, match):
    change_models(folder, 1, **fields)
    with pytest.raises(InputError, match=match):
        read_shapes(folder, [1])


HEADER = "ply\nformat {} 1.0\nelement vertex 2\nproperty uchar red\n"
HEADER += "property double x\nproperty float y\nproperty short z\n"
HEADER += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
MANY = HEADER.replace("vertex 2", f"vertex {10**23}")


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_points_of_any_ply_file(tmp_path, layout):
    points = [(7, 1.5, -2.25, 3), (8, 4.0, 5.0, -6)]
    if layout == "ascii":
        body = b"7 1.5 -2.25 3\n8 4 5 -6\n3 0 1 1\n"
    else:
        order = "<" if layout == "binary_little_endian" else ">"
        body = b"".join(struct.pack(f"{order}Bdfh", *point) for point in points) + b"the face"
    (tmp_path / "mesh.ply").write_bytes(HEADER.format(layout).encode() + body)
    assert read_points(tmp_path / "mesh.ply").tolist() == [[1.5, -2.25, 3], [4, 5, -6]]


@pytest.mark.parametrize(
    "content, reason",
    [
        (b"", "it does not begin with ply"),
        (b"ply\nformat ascii 1.0\n", "no header, or no point"),
        (b"ply\nformat ascii 1.0\nelement face 1\nend_header\n", "it begins with face"),
        (b"ply\nformat other 1.0\nelement vertex 1\nend_header\n", "format 'other'"),
        (HEADER.format("binary_little_endian").encode() + bytes(20), "buffer is smaller"),
        (HEADER.format("ascii").encode() + b"7 1.5 -2.25 3\n", "points are missing"),
        (HEADER.format("ascii").encode(), "2 points in 0 bytes"),
        (HEADER.format("ascii").encode() + b" \n \n", "2 points in 4 bytes"),
        (HEADER.format("ascii").encode() + b"# a remark\n", "could not convert"),
        (MANY.format("ascii").encode() + b"7 1.5 -2.25 3\n", "points in 14 bytes"),
        (MANY.format("binary_little_endian").encode() + bytes(30), "points in 30 bytes"),
        (HEADER.format("ascii").encode() + b"7 1.5 nan 3\n7 1 2 3\n", "not finite"),
        (HEADER.format("ascii").encode().replace(b" z", b" w") + b"7 1 2 3\n7 1 2 3\n", "not in list"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_broken_mesh_is_named(tmp_path, content, reason):
    (tmp_path / "mesh.ply").write_bytes(content)
    with pytest.raises(InputError, match=f"mesh.ply: not a whole PLY file .*{reason}"):
        read_points(tmp_path / "mesh.ply")


# --- the command ------------------------------------------------------------------------------------------


class Oracle:
    """It answers what it is told for each frame of a data set, which it knows by the crop's square.

    Args:
        dataset: the frames.
        turn: (3, 3) by which its rotations are wrong, in body axes.
        names: what it calls the drones, in the data set's order.
        label: the class that it always names; None: the right one.
    """

    method = "Oracle"
    config = SimpleNamespace(image_size=32, classes=7)

    def __init__(self, dataset, turn=None, names=None, label=None):
        names = names or [drone.name for drone in dataset.drones]
        drones = zip(names, dataset.drones, strict=True)
        self.drones = tuple(DroneClass(name, drone.hubs) for name, drone in drones)
        self.truth, self.turn, self.label = dataset.annotations(), turn, label

    def __call__(self, image, K, square):
        rows = (self.truth["square"] == square[:, None]).all(dim=-1).nonzero()[:, 1]
        R, t, label = (self.truth[name][rows] for name in ("R", "t", "label"))
        if self.turn is not None:
            R = R @ torch.tensor(self.turn, dtype=R.dtype)
        if self.label is not None:
            label = torch.full_like(label, self.label)
        return {"R": R, "t": t, "class_probs": 0.9 * torch.eye(7)[label]}


@pytest.fixture
def oracle(folder, monkeypatch):
    """Call it to put an Oracle in the place of every checkpoint."""

    def install(root=folder, **settings):
        network = Oracle(open_dataset(root, "test", size=32), **settings)
        monkeypatch.setattr(checkpoint, "load", lambda source: network)

    return install


def results_of(path):
    """The rows of a results file by (scene_id, im_id)."""
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return {(int(row["scene_id"]), int(row["im_id"])): row for row in rows}


def test_the_truth_has_no_error_and_its_results_are_the_annotations(folder, oracle, tmp_path, capsys):
    oracle()
    rows = evaluate_checkpoint(
        "any", folder, json_file=tmp_path / "rows.json", bop_file=tmp_path / "results.csv", progress=False
    )
    printed = capsys.readouterr().out
    assert "MSSD %" in printed and "ADD-S" not in printed and "cam_K" not in printed
    stored = json.loads((tmp_path / "rows.json").read_text())
    for row in [*rows, *stored["rows"], *stored["averages"]]:
        assert row["add_recall"] == row["mssd_recall"] == row["mspd_recall"] == 1
        assert max(row["add_mean_m"], row["mssd_median_m"]) < 1e-6 and row["mspd_mean_px"] < 1e-3
    results = results_of(tmp_path / "results.csv")
    assert len(results) == 21
    for (scene, image), row in results.items():
        flight = folder / "test" / f"{scene:06d}"
        truth = json.loads((flight / "scene_gt.json").read_text())[str(image)][0]
        assert int(row["obj_id"]) == truth["obj_id"] and row["score"] == "0.9000" and row["time"] == "-1"
        np.testing.assert_allclose(np.array(row["R"].split(), float), truth["cam_R_m2c"], atol=1e-5)
        np.testing.assert_allclose(np.array(row["t"].split(), float), truth["cam_t_m2c"], atol=2e-3)


def test_a_symmetric_drone_may_be_turned(folder, oracle, capsys):
    """Half a turn about z is no error of a drone whose models_info.json says so; of the others it is."""
    half_turn = np.diag([-1.0, -1.0, 1.0])
    change_models(folder, 2, symmetries_discrete=[np.diag([-1.0, -1, 1, 1]).ravel().tolist()])
    oracle(turn=half_turn)
    rows = {row["drone"]: row for row in evaluate_checkpoint("any", folder, progress=False)}
    assert "of Mini2 ADD is ADD-S" in capsys.readouterr().out
    assert rows["Mini2"]["mssd_mean_m"] < 1e-6 and rows["Mini2"]["mspd_recall"] == 1
    assert rows["Mini2"]["add_recall"] == 1  # nearly: its nose differs from its tail
    assert rows["Mini3"]["mssd_mean_m"] > 0.15 and rows["Mini3"]["add_recall"] == 0


def test_the_number_is_that_of_the_named_drone(folder, oracle, tmp_path):
    """A network calls every frame its class 2, which the data set knows by another number, or not at all."""
    names = ["Air3", "Mini3", "Mini2", "Racer", "Mav2", "Mav3", "Tello"]
    assert object_numbers([DroneClass(name) for name in names], {}) == [1, 2, 3, 4, 5, 6, 7]
    objects = {4: DroneClass("Mini2"), 9: DroneClass("Air3")}
    assert object_numbers([DroneClass(name) for name in names], objects) == [9, 10, 4, 11, 12, 13, 14]
    assert object_numbers([DroneClass("Quad0"), DroneClass("Quad1")], objects) == [10, 11]
    path = folder / "models" / "models_info.json"
    info = json.loads(path.read_text())
    for number, drone in info.items():
        del drone["keypoints"]  # or the hubs of another name are another drone
        drone["name"] = f"Drone{number}"
    path.write_text(json.dumps(info))
    manifest = json.loads((folder / "manifest.json").read_text())
    unfinished = {key: value for key, value in manifest.items() if key not in FINISHED}
    (folder / "manifest.json").write_text(json.dumps(unfinished))  # of a finished one the drones are known
    oracle(names=["Drone1", "Drone2", "Drone5", "Drone4", "Drone3", "Drone6", "Unheard"], label=2)
    file = tmp_path / "results.csv"
    assert main(["evaluate", "any", str(folder), "--bop", str(file)]) == 0
    results = results_of(file)
    assert len(results) == 18  # the network does not know Drone7
    assert {row["obj_id"] for row in results.values()} == {"5"}
    oracle(names=["Drone1", "Drone2", "Drone5", "Drone4", "Drone3", "Drone6", "Unheard"], label=6)
    assert main(["evaluate", "any", str(folder), "--bop", str(file)]) == 0
    assert {row["obj_id"] for row in results_of(file).values()} == {"8"}


def test_without_meshes_the_field_is_left_out(folder, oracle, capsys):
    oracle()
    (folder / "models" / "obj_000003.ply").unlink()
    rows = evaluate_checkpoint("any", folder, progress=False)
    assert "mssd_recall" not in rows[0]
    printed = capsys.readouterr().out
    assert "no ADD, MSSD and MSPD" in printed and "obj_000003.ply is not there" in printed
    change_models(folder, 1, diameter=None)
    evaluate_checkpoint("any", folder, progress=False)
    assert "models_info.json has no diameter of object 1" in capsys.readouterr().out


def test_the_pixels_of_crops_are_said_to_be_the_frames(oracle, tmp_path, capsys):
    crops = FRAMES.parent / "crops"
    oracle(root=crops)
    evaluate_checkpoint("any", crops, progress=False)
    assert "MSPD is in pixels of the whole frame; BOP's toolkit takes" in capsys.readouterr().out


def test_a_broken_mesh_costs_its_errors_and_nothing_else(folder, oracle, tmp_path, capsys, monkeypatch):
    """It is read before the network has run, and what the network says is not lost."""
    oracle()
    (folder / "models" / "obj_000003.ply").write_text("no mesh")
    read, order = command.read_shapes, []
    monkeypatch.setattr(command, "read_shapes", lambda *given: order.append("shapes") or read(*given))
    measure = command.evaluate
    monkeypatch.setattr(command, "evaluate", lambda *a, **k: order.append("network") or measure(*a, **k))
    rows = evaluate_checkpoint("any", folder, bop_file=tmp_path / "poses.csv", progress=False)
    assert order == ["shapes", "network"]
    assert "mssd_recall" not in rows[0] and len(results_of(tmp_path / "poses.csv")) == 21
    printed = capsys.readouterr().out
    assert "no ADD, MSSD and MSPD: " in printed and "obj_000003.ply: not a whole PLY file" in printed


def test_flights_without_numbers_cannot_be_bop_results(folder, oracle, tmp_path, capsys):
    oracle()
    (folder / "manifest.json").unlink()
    (folder / "mine").mkdir()
    (folder / "mine" / "first_flight").symlink_to(FRAMES / "test" / "000651")
    command = ["evaluate", "any", str(folder), "--split", "mine", "--bop", str(tmp_path / "results.csv")]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "first_flight: BOP's results need a number" in error
    for name in ("000001", "1"):
        (folder / "mine" / name).symlink_to(FRAMES / "test" / "000651")
    (folder / "mine" / "first_flight").unlink()
    assert main(command) == 2 and "have one number" in capsys.readouterr().err
    assert not (tmp_path / "results.csv").exists()
    assert main([*command[:-1], str(tmp_path)]) == 2 and "a folder, not a file" in capsys.readouterr().err
