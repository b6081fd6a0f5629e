"""`generate`, `validate` and the opened data set: bytes, resuming, faults that are named, items."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from conftest import SMALL

from dronekeypp import camera
from dronekeypp.augment import degrade, recolour
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.folders import read_image
from dronekeypp.sixdronesyn.generate import Flight, generate
from dronekeypp.sixdronesyn.validate import frame_faults, validate


def files(root):
    """Everything a data set holds, by relative path."""
    content = {}
    for path in Path(root).rglob("*"):
        if path.is_file():
            content[path.relative_to(root).as_posix()] = path.read_bytes()
    return content


def count_images(root):
    """How many images there are by now. `os.walk` does not mind a folder that is just being moved."""
    count = 0
    for _, _, names in os.walk(root):
        for name in names:
            count += name.endswith(".jpg")
    return count


def test_what_is_generated_is_sound(small_dataset):
    assert validate(small_dataset) == []
    manifest = bop.read_json(small_dataset / "manifest.json")
    assert manifest["frames"] == {"train": 24, "val": 24, "test": 24}
    assert manifest["planned_frames"] == 72


def test_same_seed_same_bytes_on_more_workers_and_shards(small_dataset, environments, tmp_path):
    generate(tmp_path / "again", environments=environments, **SMALL, shard=(1, 2), workers=2)
    generate(tmp_path / "again", environments=environments, **SMALL, shard=(0, 2))
    assert files(tmp_path / "again") == files(small_dataset)


def test_another_seed_gives_other_frames(small_dataset, environments, tmp_path):
    less = SMALL | dict(scene_numbers=[1], drone_names=["Tello"])
    manifest = generate(tmp_path / "other", environments=environments, seed=7, **less)
    old = bop.read_json(small_dataset / "manifest.json")
    for name, flight in manifest["flights"].items():
        assert flight["digests"] != old["flights"][name]["digests"]


def test_killed_generator_resumes_with_nothing_lost_or_doubled(small_dataset, environments, tmp_path):
    root = tmp_path / "killed"
    command = [sys.executable, "-m", "dronekeypp", "generate", str(root), "--environments", str(environments)]
    command += ["--scenes", "1,3,6", "--drones", "Mini2,Tello", "--size", "64", "--stride", "30"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.time() + 60
    while time.time() < deadline and count_images(root) < 10:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    finished = [path for path in root.rglob("*.jpg") if ".partial" not in path.parts]
    before = {path: path.stat().st_mtime_ns for path in finished}
    assert "flights" not in bop.read_json(root / "manifest.json")
    assert any("has not finished" in fault for fault in validate(root))
    generate(root, environments=environments, **SMALL)
    for path, when in before.items():
        assert path.stat().st_mtime_ns == when
    assert files(root) == files(small_dataset)


def test_torn_partial_frames_are_rendered_again(small_dataset, environments, tmp_path):
    root = tmp_path / "torn"
    shutil.copytree(small_dataset, root)
    whole = root / "test" / "000610"
    partial = root / ".partial" / "000610"
    partial.parent.mkdir()
    whole.rename(partial)
    digests = bop.read_json(partial / "flight.json")["digests"]
    numbers = sorted(digests, key=int)
    lines = [json.dumps([int(n), digests[n][0]]) for n in numbers]
    # the fourth line was being written
    (partial / "frames.jsonl").write_text("\n".join(lines[:3]) + "\n" + lines[3][:5])
    # and the second image had not reached the disk
    torn = bop.image_path(partial, int(numbers[1]))
    torn.write_bytes(torn.read_bytes()[:200])
    generate(root, environments=environments, **SMALL)
    assert files(root) == files(small_dataset)


def test_other_settings_in_the_same_folder_are_refused(small_dataset, environments):
    with pytest.raises(InputError, match="another size .64, now 96."):
        generate(small_dataset, environments=environments, **(SMALL | dict(size=96)))


def test_a_folder_with_other_things_is_refused(tmp_path, environments):
    (tmp_path / "thesis.tex").write_text("do not lose me")
    with pytest.raises(InputError, match="not empty"):
        generate(tmp_path, environments=environments, **SMALL)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(scene_numbers=[14]), "scene 14"),
        (dict(drone_names=["Phantom"]), "Phantom"),
        (dict(frames="video"), "crop or full"),
        (dict(size=8), "size 8"),
        (dict(stride=0), "stride"),
        (dict(shard=(2, 2)), "shard 2/2"),
        (dict(environments="nowhere"), "no such folder"),
    ],
)
def test_bad_arguments(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        generate(tmp_path / "out", **(SMALL | change))
    assert not (tmp_path / "out").exists()


def test_a_corrupt_environment_is_named(tmp_path):
    (tmp_path / "env").mkdir()
    (tmp_path / "env" / "broken.jpg").write_bytes(b"\xff\xd8 this is no panorama")
    with pytest.raises(InputError, match="broken.jpg"):
        generate(tmp_path / "out", environments=tmp_path / "env", **SMALL)


def test_no_opengl_names_the_package(monkeypatch, tmp_path, environments):
    from dronekeypp.sixdronesyn import render

    monkeypatch.delenv("DRONEKEYPP_OPENGL_CHECKED", raising=False)
    monkeypatch.setattr(
        render.subprocess,
        "run",
        lambda *a, **k: subprocess.CompletedProcess(a, -11, "", "Segmentation fault"),
    )
    with pytest.raises(InputError, match="libegl1 libgl1-mesa-dri"):
        generate(tmp_path / "out", environments=environments, **SMALL)
    with pytest.raises(InputError, match="libegl1 libgl1-mesa-dri"):
        render.DroneRenderer("Tello", 64)


@pytest.mark.parametrize(
    "subsequence",
    [scenes.Subsequence(6, "Mini2", 0), scenes.Subsequence(7, "Mav3", 1), scenes.Subsequence(4, "Tello", 2)],
)
def test_the_crop_is_the_picture_the_full_frame_gives(subsequence, environments):
    """The stored crop is the same square cut out of the full frame.

    JPEG aside they differ only by how finely the drone was drawn.
    """
    paths = sorted(environments.iterdir())
    crop = Flight(subsequence, dict(seed=0, frames="crop", size=128), paths)
    full = Flight(subsequence, dict(seed=0, frames="full", size=None), paths)
    a = [crop.annotate(n) for n in (0, 60)]
    b = [full.annotate(n) for n in (0, 60)]
    crop.open(a)
    full.open(b)
    for small, large in zip(a, b, strict=True):
        picture, whole = crop.picture(small).astype(int), full.picture(large)
        assert whole.shape == (1080, 1920, 3)
        cut = camera.crop_image(whole, small.square, 128).astype(int)
        difference = np.abs(picture - cut)
        assert difference.mean() < 1.0
        assert np.percentile(difference, 99) < 12
        # and shifted by a single pixel they would differ clearly more
        assert np.abs(picture - np.roll(cut, 1, axis=1)).mean() > 1.5 * difference.mean()


def test_the_drawn_drone_fills_its_box(environments):
    """Pixels that differ from the empty background lie inside the annotated box, and reach near its sides."""
    flight = Flight(
        scenes.Subsequence(4, "Air3", 0),
        dict(seed=0, frames="full", size=None),
        sorted(environments.iterdir()),
    )
    frame = flight.annotate(30)
    flight.open([frame])
    changed = (np.abs(flight.picture(frame).astype(int) - flight.background) > 6).any(-1)
    x, y, w, h = frame.box
    ys, xs = np.nonzero(changed)
    assert xs.min() >= x - 1 and xs.max() <= x + w + 1 and ys.min() >= y - 1 and ys.max() <= y + h + 1
    assert xs.max() - xs.min() > 0.75 * w and ys.max() - ys.min() > 0.6 * h


def test_hub_visibility_from_above_and_below():
    """A camera straight above sees every hub; one far below the drone sees fewer."""
    from dronekeypp.sixdronesyn.occlusion import SelfOcclusion

    # camera←body with the camera above, the drone's z towards it
    look_down = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])
    look_up = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    for name, drone in DRONES.items():
        occlusion = SelfOcclusion(name)
        assert occlusion.visible(drone.hubs, look_down, np.array([0, 0, 3.0])).all(), name
        assert not occlusion.visible(drone.hubs, look_up, np.array([0, 0, 3.0])).all(), name


def test_coco_export_is_in_the_stored_images_pixels(small_dataset):
    coco = bop.read_json(small_dataset / "coco_test.json")
    assert len(coco["images"]) == len(coco["annotations"]) == 24
    assert coco["categories"][1]["name"] == "Mini2" and len(coco["categories"][0]["keypoints"]) == 4
    for image, note in zip(coco["images"], coco["annotations"], strict=True):
        assert (small_dataset / image["file_name"]).exists()
        x, y, w, h = note["bbox"]
        assert x >= -0.1 and y >= -0.1 and x + w <= 64.1 and y + h <= 64.1
        points = np.array(note["keypoints"]).reshape(4, 3)
        assert (points[:, 0] >= x - 0.1).all() and (points[:, 0] <= x + w + 0.1).all()
        assert set(points[:, 2]) <= {1, 2}


def test_models_info_holds_the_hubs_in_millimetres(small_dataset):
    info = bop.read_json(small_dataset / "models" / "models_info.json")
    np.testing.assert_allclose(info["2"]["keypoints"], DRONES["Mini2"].hubs * 1000, atol=1e-3)
    assert (small_dataset / "models" / "obj_000007.ply").exists()


# --- validate names each fault ----------------------------------------------------------------------------


def edit(path, change):
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


FLIGHT = "test/000610"  # the one that is damaged, in frame 30


def _change(file, key, value):
    """Damage that sets a field of the frame in one of the scene files."""

    def damage(root):
        def change(table):
            entry = table["30"]
            if isinstance(entry, list):
                entry = entry[0]
            entry[key] = value

        edit(root / FLIGHT / file, change)

    return damage


def _camera(key, value):
    return _change("scene_camera.json", key, value)


def _truth(key, value):
    return _change("scene_gt.json", key, value)


def _info(key, value):
    return _change("scene_gt_info.json", key, value)


def _manifest(change):
    return lambda root: edit(root / "manifest.json", change)


def _lose_truth(root):
    edit(root / FLIGHT / "scene_gt.json", lambda table: table.pop("30"))


def _lose_pose(root):
    edit(root / FLIGHT / "scene_gt.json", lambda table: table["30"][0].pop("cam_R_m2c"))


def _lose_camera_pose(root):
    """Another BOP folder may lack it everywhere; 6DroneSyn may not."""

    def change(table):
        for entry in table.values():
            entry.pop("cam_R_w2c")

    edit(root / FLIGHT / "scene_camera.json", change)


def _double_truth(root):
    edit(root / FLIGHT / "scene_gt.json", lambda table: table["30"].append(table["30"][0]))


def _null_camera(root):
    edit(root / FLIGHT / "scene_camera.json", lambda table: table.update({"30": None}))


def _huge_box(root):
    """A box with the middle of the crop, and larger than the frame."""

    def change(table):
        x, y, side = table["30"][0]["crop"]
        table["30"][0]["bbox_obj"] = [x + side / 2 - 2000, y + side / 2 - 2000, 4000, 4000]

    edit(root / FLIGHT / "scene_gt_info.json", change)


def _list_instead_of_table(root):
    (root / FLIGHT / "scene_gt.json").write_text("[]")


def _not_json(root):
    (root / FLIGHT / "scene_gt.json").write_text("{")


def _truncate(root):
    path = root / FLIGHT / "rgb/000030.jpg"
    path.write_bytes(path.read_bytes()[:-40])


def _delete_image(root):
    (root / FLIGHT / "rgb/000030.jpg").unlink()


def _repaint(root):
    path = root / FLIGHT / "rgb/000030.jpg"
    cv2.imwrite(str(path), np.zeros((64, 64, 3), np.uint8))


def _stray_image(root):
    shutil.copy(root / FLIGHT / "rgb/000030.jpg", root / FLIGHT / "rgb/000031.jpg")


def _renumber(root):
    def change(table):
        table = table.get("digests", table)
        table["37"] = table.pop("30")

    for name in (*bop.SCENE_FILES, "flight.json"):
        edit(root / FLIGHT / name, change)
    bop.image_path(root / FLIGHT, 30).rename(bop.image_path(root / FLIGHT, 37))


def _lose_flight(root):
    shutil.rmtree(root / FLIGHT)


def _flight_in_two_splits(root):
    shutil.copytree(root / FLIGHT, root / "train/000610")


def _lose_models(root):
    (root / "models/models_info.json").unlink()


def _move_hubs(root):
    """The hubs of a data set are its own; they must fit its keypoints."""

    def change(models):
        models["2"]["keypoints"][0][0] += 5

    edit(root / "models/models_info.json", change)


IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1]
CAMERA, TRUTH, INFO = "scene_camera.json frame 30", "scene_gt.json frame 30", "scene_gt_info.json frame 30"
TRANSPOSED = [1500, 0, 0, 0, 1500, 0, 960, 540, 1]
FAULTS = {
    "truncated JPEG": (_truncate, ["000030.jpg", "truncated"]),
    "image deleted": (_delete_image, ["000030.jpg", "missing"]),
    "other image": (_repaint, ["000030.jpg", "not the image that was generated"]),
    "missing annotation": (_lose_truth, [TRUTH, "no annotation"]),
    "missing field": (_lose_pose, [TRUTH, "cam_R_m2c is missing"]),
    "field missing everywhere": (_lose_camera_pose, [CAMERA, "cam_R_w2c is missing"]),
    "two drones": (_double_truth, [TRUTH, "2 objects instead of one"]),
    "NaN pose": (_truth("cam_t_m2c", [float("nan"), 0, 2000]), [TRUTH, "NaN"]),
    "no rotation": (_truth("cam_R_m2c", [1.1, *IDENTITY[1:]]), [TRUTH, "orthonormal"]),
    "reflection": (_truth("cam_R_m2c", [-1, *IDENTITY[1:]]), [TRUTH, "reflection"]),
    "other pose": (_truth("cam_R_m2c", IDENTITY), [TRUTH, "from R · hubs + t"]),
    "moved keypoints": (_truth("keypoints_2d", [0.0] * 8), [TRUTH, "px from the projection"]),
    "unknown drone": (_truth("obj_id", 9), [TRUTH, "obj_id 9"]),
    "wrong intrinsics shape": (_camera("cam_K", [1, 0, 0, 1]), [CAMERA, "cam_K holds 4 numbers"]),
    "transposed intrinsics": (_camera("cam_K", TRANSPOSED), [CAMERA, "transposed"]),
    "box without area": (_info("bbox_obj", [5, 5, 0, 9]), [INFO, "no area (0 × 9 px)"]),
    "box reaches outside": (_huge_box, ["frame 30", "bbox_obj reaches outside the frame"]),
    "crop without area": (_info("crop", [10, 10, 0]), [INFO, "crop has no area (side 0 px)"]),
    "box outside": (_info("bbox_obj", [-5, 5, 3000, 2000]), [INFO, "the middle of bbox_obj lies outside"]),
    "a list instead of a table": (_list_instead_of_table, ["scene_gt.json", "not a table"]),
    "an entry that is null": (_null_camera, [CAMERA, "no annotation"]),
    "frame renumbered": (_renumber, ["000610", "not the 4 planned"]),
    "manifest forgets a flight": (_manifest(lambda m: m["flights"].pop("000610")), ["its flights"]),
    "manifest with other counts": (_manifest(lambda m: m["frames"].update(test=0)), ["its frames"]),
    "manifest with another digest": (_manifest(lambda m: m.update(digest=16 * "0")), ["its digest"]),
    "flight missing": (_lose_flight, ["000610", "missing"]),
    "flight in two splits": (_flight_in_two_splits, ["000610", "two splits"]),
    "not JSON": (_not_json, ["scene_gt.json", "not valid JSON"]),
    "stray image": (_stray_image, ["000031.jpg", "without"]),
    "no models": (_lose_models, ["models_info.json", "missing"]),
    "other hubs": (_move_hubs, [TRUTH, "from R · hubs + t"]),
}


@pytest.mark.parametrize("name", FAULTS)
def test_validate_names_the_fault(name, small_dataset, tmp_path):
    root = tmp_path / "broken"
    shutil.copytree(small_dataset, root)
    damage, words = FAULTS[name]
    damage(root)
    faults = validate(root)
    assert any(all(word in fault for word in words) for fault in faults), faults


def test_frame_faults_of_one_of_the_seven_and_of_any_drone(small_dataset):
    frame = bop.read_flight(small_dataset / FLIGHT)[0][1]
    hubs = bop.read_models(small_dataset)[frame.obj_id].hubs
    assert frame_faults(frame) == frame_faults(frame, hubs) == []
    (fault,) = frame_faults(frame, 1.1 * hubs)
    assert "from R · hubs + t" in fault
    assert frame_faults(replace(frame, obj_id=8)) == []  # none of the seven: its hubs are not known


def test_validate_without_a_manifest(tmp_path):
    with pytest.raises(InputError, match="manifest.json: missing"):
        validate(tmp_path)


def test_command_line_exit_status(small_dataset, tmp_path, capsys):
    from dronekeypp.cli import main

    assert main(["validate", str(small_dataset)]) == 0
    assert main(["validate", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    for wrong in (
        ["--scenes", "99"],
        ["--scenes", "six"],
        ["--scenes", ","],
        ["--shard", "3"],
        ["--frames", "video"],
        ["--nonsense"],
    ):
        assert main(["generate", str(tmp_path / "x"), *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    (tmp_path / "file").write_text("")
    assert main(["generate", str(tmp_path / "file"), "--scenes", "1"]) == 2


# --- the opened data set ----------------------------------------------------------------------------------


def test_items(small_dataset):
    data = open_dataset(small_dataset, "test", size=48)
    assert len(data) == 24
    item = data[5]
    assert item["image"].shape == (3, 48, 48) and 0 <= item["image"].min() and item["image"].max() <= 1
    pixels = camera.from_crop(item["keypoints"], item["square"])
    np.testing.assert_allclose(pixels, camera.project(item["keypoints_3d"] + item["t"], item["K"]), atol=0.01)
    hubs = DRONES[list(DRONES)[int(item["label"])]].hubs
    np.testing.assert_allclose(item["keypoints_3d"], hubs @ item["R"].numpy().T, atol=1e-5)


def test_augmentation_depends_on_seed_epoch_and_index_alone(small_dataset):
    a = open_dataset(small_dataset, "train", augment=True, seed=3)
    b = open_dataset(small_dataset, "train", augment=True, seed=3)
    first = a.square(4)
    a.set_epoch(1)
    assert not np.allclose(a.square(4), first)
    b.square(7)
    np.testing.assert_array_equal(b.square(4), first)
    np.testing.assert_array_equal(b[-1]["image"], b[len(b) - 1]["image"])


def test_augmented_crops_keep_the_drone_inside(small_dataset):
    data = open_dataset(small_dataset, "train", augment=True)
    for epoch in range(5):
        data.set_epoch(epoch)
        for i in range(len(data)):
            x, y, width, height = data.frames[i].box
            corners = camera.to_crop(np.array([[x, y], [x + width, y + height]]), data.square(i))
            assert corners.min() > -0.01 and corners.max() < 1.01


def test_half_of_the_crops_are_degraded(small_dataset):
    clean = open_dataset(small_dataset, "train", size=64)
    data = open_dataset(small_dataset, "train", size=64, degrade=True)

    def changed():
        return [not torch.equal(clean[i]["image"], data[i]["image"]) for i in range(len(data))]

    first = changed()
    assert 0.3 < np.mean(first) < 0.7
    i = first.index(True)  # the picture changes, the truth does not
    assert torch.equal(clean[i]["keypoints"], data[i]["keypoints"])
    data.set_epoch(1)
    assert changed() != first


def test_degrading_takes_detail_and_keeps_the_scene(small_dataset):
    image = open_dataset(small_dataset, "test", size=64).stored_image(3)
    small = cv2.resize(image, (8, 8), interpolation=cv2.INTER_AREA).astype(float)
    for seed in range(20):
        worse = degrade(image, np.random.default_rng(seed))
        assert worse.shape == image.shape and worse.dtype == np.uint8 and not np.array_equal(worse, image)
        assert np.abs(worse.mean(axis=(0, 1)) - image.mean(axis=(0, 1))).max() < 4  # no shift of colour
        small_worse = cv2.resize(worse, (8, 8), interpolation=cv2.INTER_AREA).astype(float)
        assert np.corrcoef(small.ravel(), small_worse.ravel())[0, 1] > 0.95


def test_a_training_crop_shows_what_the_stored_one_shows(small_dataset):
    """Cutting the stored crop's own square must give the stored crop back."""
    data = open_dataset(small_dataset, "test", size=64)
    data.square = lambda i: data.frames[i].square
    stored = data.stored_image(3).astype(float)
    np.testing.assert_allclose(data[3]["image"].permute(1, 2, 0).numpy() * 255, stored, atol=0.51)


def test_no_frames_of_a_split(small_dataset):
    with pytest.raises(InputError, match="no val frames"):
        open_dataset(small_dataset, "val", drones=["Mav3"])


def test_a_half_generated_data_set_is_refused(small_dataset, tmp_path):
    shutil.copytree(small_dataset, tmp_path / "half")
    shutil.rmtree(tmp_path / "half/train/000110")
    with pytest.raises(InputError, match="5 of 6 train flights"):
        open_dataset(tmp_path / "half", "train")


def test_unknown_drone(small_dataset):
    with pytest.raises(InputError, match="Phantom"):
        open_dataset(small_dataset, "train", drones=["Phantom"])


def test_read_image_errors(tmp_path):
    with pytest.raises(InputError, match="missing"):
        read_image(tmp_path / "none.jpg")
    (tmp_path / "text.jpg").write_text("hello")
    with pytest.raises(InputError, match="not a JPEG"):
        read_image(tmp_path / "text.jpg")


def test_recolouring_changes_light_and_nothing_else():
    image = np.random.default_rng(0).integers(40, 180, (32, 32, 3), dtype=np.uint8)
    other = recolour(image, np.random.default_rng(3))
    np.testing.assert_array_equal(other, recolour(image, np.random.default_rng(3)))
    assert other.shape == image.shape and np.abs(other.astype(int) - image).mean() > 3
    assert np.corrcoef(image.mean(-1).ravel(), other.mean(-1).ravel())[0, 1] > 0.9


@pytest.mark.parametrize(
    ("damage", "match"),
    [
        (_truth("cam_t_m2c", [0, 0, -1000]), "frame 30: cam_t_m2c puts the drone behind the camera"),
        (FAULTS["box outside"][0], "frame 30: the middle of bbox_obj lies outside the stored crop"),
        (_repaint, "000030.jpg: not the image that was generated"),
        (lambda root: (root / "manifest.json").write_text("[]"), "not a data set's manifest"),
    ],
    ids=["behind the camera", "box outside", "other image", "manifest"],
)
def test_what_cannot_be_learned_from_is_not_read(damage, match, small_dataset, tmp_path):
    root = tmp_path / "broken"
    shutil.copytree(small_dataset, root)
    shutil.copytree(root / FLIGHT, root / "test/000610 (copy)")
    shutil.copytree(root / FLIGHT, root / "test/9")
    frames = len(open_dataset(root, "test"))
    assert frames == len(open_dataset(small_dataset, "test"))  # a copy is no flight
    damage(root)
    with pytest.raises(InputError, match=match):
        data = open_dataset(root, "test")
        for i in range(len(data)):
            data.stored_image(i)
