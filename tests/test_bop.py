"""The files of the second edition: crop cameras, models, depth images, masks, COCO, targets."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import pyvista as pv
import vtk
from conftest import SMALL
from test_generate import CAMERA, INFO, TRUTH, edit, files

from dronekeypp import camera
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, scenes
from dronekeypp.sixdronesyn.depth import depth_scale, draw_depth
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.generate import Flight, generate
from dronekeypp.sixdronesyn.validate import frame_faults, validate


def second(frames, size, **more):
    """The settings that a flight of the second edition needs."""
    return {"seed": 0, "edition": 2, "frames": frames, "size": size, **more}


@pytest.mark.parametrize(("frames", "size"), [("crop", 48), ("crop", 512), ("full", None)])
def test_scene_files_are_in_the_stored_images_pixels(frames, size, environments):
    """A BOP reader projects the model with cam_K into the stored image; we read full-frame pixels back."""
    subsequence = scenes.Subsequence(6, "Mav3", 1, edition=2)
    flight = Flight(subsequence, second(frames, size), sorted(environments.iterdir()))
    written = [flight.annotate(number) for number in range(0, 120, 10)]
    rows = [(frame.number, *flight.entry(frame)) for frame in written]
    width, height = flight.image_size
    for _, camera_entry, truth, info in rows:
        K = np.reshape(camera_entry["cam_K"], (3, 3))
        R, t = np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"])
        hubs = np.reshape(truth["keypoints_body"], (4, 3))
        pixels = camera.project(hubs @ R.T + t, K)
        np.testing.assert_allclose(pixels, np.reshape(truth["keypoints_2d"], (4, 2)), atol=1e-3)
        x, y, w, h = info["bbox_visib"]
        assert x >= 0 and y >= 0 and x + w <= width and y + h <= height
        assert (pixels > [x, y]).all() and (pixels < [x + w, y + h]).all()
    read = bop.frames_from(Path("flight"), rows, size=(scenes.WIDTH, scenes.HEIGHT))
    for old, new in zip(written, read, strict=True):
        for name in ("K", "R", "t", "keypoints_2d", "keypoints_3d", "box", "hubs"):
            np.testing.assert_allclose(getattr(new, name), getattr(old, name), atol=1e-3, err_msg=name)
        assert frame_faults(new, flight.drone.hubs) == []
        if frames == "crop":
            np.testing.assert_allclose(new.square, old.square, atol=1e-3)


def test_a_camera_matrix_of_another_crop_is_refused(environments):
    flight = Flight(
        scenes.Subsequence(6, "Tello", 0, edition=2), second("crop", 64), sorted(environments.iterdir())
    )
    camera_entry, truth, info = flight.entry(flight.annotate(0))
    info["crop"] = [info["crop"][0] + 3, *info["crop"][1:]]
    with pytest.raises(InputError, match="scene_camera.json frame 0: cam_K is not that of the crop"):
        bop.frames_from(Path("flight"), [(0, camera_entry, truth, info)])
    info["crop"] = None
    with pytest.raises(InputError, match="scene_gt_info.json frame 0: the field crop is missing"):
        bop.frames_from(Path("flight"), [(0, camera_entry, truth, info)])


def test_hubs_of_a_frame_stand_in_for_those_of_the_models(environments):
    """A random quadrotor's shape is in its frame: keypoints follow from it where models/ has none."""
    flight = Flight(
        scenes.Subsequence(6, "Tello", 0, edition=2), second("crop", 64), sorted(environments.iterdir())
    )
    frame = flight.annotate(0)
    camera_entry, truth, info = flight.entry(frame)
    del truth["keypoints_2d"], truth["keypoints_3d"]
    (read,) = bop.frames_from(Path("flight"), [(0, camera_entry, truth, info)])
    np.testing.assert_allclose(read.keypoints_3d, frame.keypoints_3d, atol=1e-6)
    np.testing.assert_allclose(read.keypoints_2d, frame.keypoints_2d, atol=1e-3)


SECOND = SMALL | dict(scene_numbers=[6], drone_names=["Tello"], edition=2, depth=True, masks=True)


@pytest.fixture(scope="module")
def second_dataset(tmp_path_factory, environments):
    """Crops of one drone in one test scene, with depth and masks. Read only: copy it before you break it."""
    root = tmp_path_factory.mktemp("sixdronesyn") / "second"
    generate(root, environments=environments, **SECOND)
    return root


def test_the_second_edition_is_sound(second_dataset):
    assert validate(second_dataset) == []
    data = open_dataset(second_dataset, "test", size=48)
    assert len(data) == 12
    hubs = DRONES["Tello"].hubs
    for i in range(len(data)):
        item = data[i]
        pixels = camera.from_crop(item["keypoints"], item["square"])
        again = camera.project(item["keypoints_3d"] + item["t"], item["K"])
        np.testing.assert_allclose(pixels, again, atol=0.01)
        np.testing.assert_allclose(item["keypoints_3d"], hubs @ item["R"].numpy().T, atol=1e-5)


def test_a_foreign_folder_of_crops_with_their_own_cameras(second_dataset, tmp_path):
    """Without manifest, keypoints and hubs in models/, items are the same; camera.json says the size."""
    root = tmp_path / "foreign"
    shutil.copytree(second_dataset, root)
    (root / "manifest.json").unlink()
    (root / "camera.json").write_text('{"width": 1920, "height": 1080}')
    edit(root / "models/models_info.json", lambda table: table["7"].pop("keypoints"))
    for path in root.rglob("scene_gt.json"):
        edit(path, drop_keypoints)
    ours, theirs = open_dataset(second_dataset, "test", size=48), open_dataset(root, "test", size=48)
    for i in (0, 5, 11):
        for key in ("image", "K", "square", "keypoints", "keypoints_3d", "R", "t"):
            np.testing.assert_allclose(theirs[i][key], ours[i][key], atol=1e-4, err_msg=key)


def drop_keypoints(table):
    """Leave nothing but the hubs in body axes."""
    for (entry,) in table.values():
        del entry["keypoints_2d"], entry["keypoints_3d"]


def test_a_flight_of_the_second_edition_that_is_missing_is_named(second_dataset, tmp_path):
    shutil.copytree(second_dataset, tmp_path / "half")
    shutil.rmtree(tmp_path / "half/test/060060")
    with pytest.raises(InputError, match="2 of 3 test flights"):
        open_dataset(tmp_path / "half", "test")


def test_models_have_normals_and_a_simpler_copy(second_dataset):
    """Normals point out of the body; the copy is the same body, and describes itself in the same words."""
    mesh = pv.read(second_dataset / "models" / "obj_000007.ply")
    simple = pv.read(second_dataset / "models_eval" / "obj_000007.ply")
    assert mesh.point_data["RGB"].dtype == np.uint8 and "RGB" not in simple.point_data
    assert simple.n_points < 0.6 * mesh.n_points
    for body in (mesh, simple):
        normals, corners = body.point_data["Normals"], body.points[body.regular_faces]
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-4)
        turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        agrees = np.einsum("fi,fi->f", turned, normals[body.regular_faces[:, 0]]) >= 0
        assert agrees.mean() > 0.99
    assert np.abs(np.array(mesh.bounds) - simple.bounds).max() < 1.0  # mm
    texts = [(second_dataset / name / "models_info.json").read_text() for name in ("models", "models_eval")]
    assert texts[0] == texts[1]


def test_depth_and_masks_are_those_of_the_model(second_dataset):
    """Rays through the pixels' centres, cast at the mesh of models/, meet it where the depth image says."""
    flight = second_dataset / "test/060061"
    mesh = pv.read(second_dataset / "models" / "obj_000007.ply")
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    entries = bop.read_entries(flight)
    camera_entry, (truth,), (info,) = entries[30]
    depth = cv2.imread(str(flight / "depth/000030.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16 and depth.shape == (64, 64)
    K = np.reshape(camera_entry["cam_K"], (3, 3))
    R, t = np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"])
    expected = np.zeros((64, 64))
    for y, x in np.ndindex(64, 64):
        end = 2 * t[2] * np.linalg.solve(K, [x + 0.5, y + 0.5, 1])
        share, where, parametric, part = vtk.reference(0.0), [0.0] * 3, [0.0] * 3, vtk.reference(0)
        if locator.IntersectWithLine(R.T @ -t, R.T @ (end - t), 1e-9, share, where, parametric, part):
            expected[y, x] = share.get() * 2 * t[2]
    there = (depth > 0) & (expected > 0)
    assert there.sum() > 100 and ((depth > 0) != (expected > 0)).sum() <= 2
    off = np.abs(depth * camera_entry["depth_scale"] - expected)[there]
    assert np.percentile(off, 99) < 0.2 and np.median(off) < 0.11  # mm
    for name in ("mask", "mask_visib"):
        mask = cv2.imread(str(flight / name / "000030_000000.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(mask, np.where(depth > 0, 255, 0))
    count = int((depth > 0).sum())
    assert info["px_count_all"] == info["px_count_visib"] == info["px_count_valid"] == count
    assert info["visib_fract"] == 1.0


def test_a_silhouette_that_the_crop_cuts_counts_outside_pixels(environments):
    flight = Flight(
        scenes.Subsequence(6, "Tello", 0, edition=2), second("crop", 64), sorted(environments.iterdir())
    )
    frame = flight.annotate(0)
    whole, pixels = draw_depth(flight.drone, frame, 64, 64)
    assert pixels == (whole > 0).sum() > 100
    x, y, side = frame.square
    cut, pixels = draw_depth(flight.drone, replace(frame, square=np.array([x + side / 2, y, side])), 64, 64)
    assert (cut[:, :31] > 0).sum() > 50 and (cut > 0).sum() < 0.8 * pixels
    np.testing.assert_array_equal(cut[:, :32], whole[:, 32:])
    far = replace(frame, t=frame.t * 14 / frame.t[2])
    assert depth_scale(flight.drone, frame) == 0.2 and depth_scale(flight.drone, far) == 0.4


def test_targets_and_coco_of_the_second_edition(second_dataset):
    targets = bop.read_json(second_dataset / "test_targets_bop19.json")
    assert len(targets) == 12
    assert targets[5] == {"scene_id": 60061, "im_id": 30, "obj_id": 7, "inst_count": 1}
    coco = bop.read_json(second_dataset / "coco_test.json")
    assert coco["info"]["edition"] == 2 and coco["licenses"][0]["id"] == coco["images"][0]["license"]
    assert "panoramas of environments keep" in coco["licenses"][0]["name"]
    assert coco["categories"][6]["sigmas"] == [0.025] * 4
    for image, note in zip(coco["images"], coco["annotations"], strict=True):
        path = image["file_name"].replace("rgb", "mask_visib").replace(".jpg", "_000000.png")
        mask = cv2.imread(str(second_dataset / path), cv2.IMREAD_GRAYSCALE)
        assert note["area"] == (mask > 0).sum()
        inside = filled(note["segmentation"]) > 0
        assert (inside & (mask > 0)).sum() / (inside | (mask > 0)).sum() > 0.9


def test_coco_without_masks_has_the_convex_outline_of_the_drone(small_dataset):
    """Of the first edition too. It touches the sides of the box, as both hold the propeller discs."""
    coco = bop.read_json(small_dataset / "coco_test.json")
    for note in coco["annotations"]:
        polygon = np.reshape(note["segmentation"][0], (-1, 2))
        x, y, w, h = note["bbox"]
        np.testing.assert_allclose(polygon.min(axis=0), [x, y], atol=0.3)
        np.testing.assert_allclose(polygon.max(axis=0), [x + w, y + h], atol=0.3)
        assert 0.4 * w * h < note["area"] < w * h


def filled(polygons, size=64, finer=8):
    """Return a COCO segmentation as a mask: a pixel belongs to it if its centre does."""
    fine = np.zeros((size * finer, size * finer), np.uint8)
    for polygon in polygons:
        cv2.fillPoly(fine, [np.rint(np.reshape(polygon, (-1, 2)) * finer).astype(int)], 255)
    return fine[finer // 2 :: finer, finer // 2 :: finer]


@pytest.mark.parametrize(
    "torn", ["depth/000030.png", "mask/000060_000000.png", "mask_visib/000000_000000.png"]
)
def test_a_torn_depth_image_or_mask_is_rendered_again(torn, second_dataset, environments, tmp_path):
    root = tmp_path / "torn"
    shutil.copytree(second_dataset, root)
    partial = root / ".partial" / "060060"
    partial.parent.mkdir()
    (root / "test" / "060060").rename(partial)
    infos = bop.read_json(partial / "scene_gt_info.json")
    lines = []
    for number, (image, _, *others) in bop.read_json(partial / "flight.json")["digests"].items():
        count = infos[number][0]["px_count_all"]
        lines.append(json.dumps([int(number), image, others, [count, count]]) + "\n")
    (partial / "frames.jsonl").write_text("".join(lines))
    (partial / torn).write_bytes((partial / torn).read_bytes()[:50])
    before = bop.image_path(partial, 90).stat().st_mtime_ns
    generate(root, environments=environments, **SECOND)
    assert files(root) == files(second_dataset)
    assert bop.image_path(root / "test" / "060060", 90).stat().st_mtime_ns == before


def test_depth_and_masks_leave_pictures_and_annotations_as_they_are(second_dataset, environments, tmp_path):
    plain = generate(tmp_path / "plain", environments=environments, **SECOND | dict(depth=False, masks=False))
    old = bop.read_json(second_dataset / "manifest.json")
    for name, flight in plain["flights"].items():
        for number, digests in flight["digests"].items():
            assert len(digests) == 2 and digests[0] == old["flights"][name]["digests"][number][0]
    with pytest.raises(InputError, match="another depth .false, now true."):
        generate(tmp_path / "plain", environments=environments, **SECOND)
    with pytest.raises(InputError, match="second edition; add --edition 2"):
        generate(tmp_path / "first", environments=environments, **SMALL, depth=True)


def _lose_mask(root):
    (root / "test/060060/mask/000030_000000.png").unlink()


def _repaint_depth(root):
    cv2.imwrite(str(root / "test/060060/depth/000030.png"), np.zeros((64, 64), np.uint16))


def _miscount(root):
    edit(root / "test/060060/scene_gt_info.json", lambda table: table["30"][0].update(px_count_visib=1))


def _stray_depth(root):
    shutil.copy(root / "test/060060/depth/000030.png", root / "test/060060/depth/000031.png")


def _other_hubs_in_a_frame(root):
    def change(table):
        table["30"][0]["keypoints_body"][0] += 5

    edit(root / "test/060060/scene_gt.json", change)


def _lose_frame_matrix(root):
    def change(table):
        for entry in table.values():
            del entry["cam_K_frame"]

    edit(root / "test/060060/scene_camera.json", change)


SECOND_FAULTS = {
    "mask missing": (_lose_mask, ["mask/000030_000000.png", "image missing"]),
    "other depth image": (_repaint_depth, ["depth/000030.png", "not the image that was generated"]),
    "pixel counts": (_miscount, [INFO, "pixel counts"]),
    "stray depth image": (_stray_depth, ["depth/000031.png", "without an annotation"]),
    "hubs of a frame": (_other_hubs_in_a_frame, [TRUTH, "keypoints_body are not the hubs"]),
    "no matrix of the frame": (_lose_frame_matrix, [CAMERA, "cam_K_frame is missing"]),
    "no targets": (lambda root: (root / "test_targets_bop19.json").unlink(), ["test_targets", "list"]),
    "no models_eval": (lambda root: shutil.rmtree(root / "models_eval"), ["obj_000007.ply", "missing"]),
}


@pytest.mark.parametrize("name", SECOND_FAULTS)
def test_validate_names_the_fault_in_the_second_edition(name, second_dataset, tmp_path):
    root = tmp_path / "broken"
    shutil.copytree(second_dataset, root)
    damage, words = SECOND_FAULTS[name]
    damage(root)
    faults = validate(root)
    assert any(all(word in fault for word in words) for fault in faults), faults
