"""Boxes of other programs: every format says the same, no frame is guessed, every box is accounted for."""

import json
import os
from pathlib import Path

import box_files
import cv2
import numpy as np
import pytest

from dronekeypp.errors import InputError
from dronekeypp.footage import Footage, open_footage, read_boxes

NAMES = ("000001.jpg", "000002.jpg", "000003.jpg", "000004.jpg", "000005.jpg", "000006.jpg")
VIDEO = tuple(f"{number:06d}" for number in range(6))
SIZE = (640, 360)
LOCAL = "/data/local-files/?d=flights/000651/{}"  # of Label Studio
UPLOADED = "..\\..\\label-studio\\data\\media\\upload\\3\\3f9a1c2b-{}"
TRUE = [(400.5 - 50 * number, 160.25, 90.0, 26.5) for number in range(6)]


def write(path, *lines):
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(line + "\n" for line in lines))
    return path


def right(found, frames=range(6), atol=0.01):
    assert sorted(found) == list(frames)
    for frame in frames:
        np.testing.assert_allclose(found[frame], TRUE[frame], atol=atol)


def bbox_list(images, **more):
    return [{"image_id": image, "bbox": list(box), **more} for image, box in zip(images, TRUE, strict=False)]


# --- every format -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("writer", box_files.EVERY)
@pytest.mark.parametrize("names", [NAMES, ("a b.jpg", "ü.jpg", "IMG(3).jpg", "d.x.jpg", "e_5.jpg", "f.jpg")])
def test_every_format_says_the_same(writer, names, tmp_path):
    boxes = [*TRUE[:2], None, *TRUE[3:]]  # in the third frame there is no drone
    found = read_boxes(writer(tmp_path, names, boxes, SIZE), names, *SIZE, tmp_path)
    right(found, (0, 1, 3, 4, 5))
    assert found.report.used == 5 and found.report.on_no_frame == 0 and not found.report.left_out


def test_a_table_without_header_and_one_in_utf_16_are_read(tmp_path):
    rows = [",".join(map(str, box)) for box in TRUE]
    right(read_boxes(write(tmp_path / "groundtruth.csv", *rows), VIDEO, *SIZE))
    right(read_boxes(write(tmp_path / "tabs.txt", *[row.replace(",", "\t") for row in rows]), VIDEO, *SIZE))
    text = "\r\n".join(["frame,x,y,w,h", *[f"{n},{row}" for n, row in enumerate(rows)], ""])
    (tmp_path / "excel.csv").write_text(text, encoding="utf-16")
    right(read_boxes(tmp_path / "excel.csv", VIDEO, *SIZE))
    (tmp_path / "list.json").write_text(json.dumps(bbox_list(range(6))), encoding="utf-8-sig")
    right(read_boxes(tmp_path / "list.json", VIDEO, *SIZE))


def test_predictions_with_keypoints_and_confidence_stay_boxes(tmp_path):
    """Keypoints as a network answers them: no visibility of 2, some on the edge of the box."""
    rng = np.random.default_rng(0)
    for tail in ("", " 0.87", " 0.87 4"):
        folder = tmp_path / f"pose{len(tail)}"
        folder.mkdir()
        for number, box in enumerate(TRUE):
            cx, cy, w, h = box_files.shares(box, *SIZE)
            hubs = np.array([[0.02, 0.4], [0.9, 0.1], [1.03, 0.6], [0.1, 0.9]]) + rng.normal(0, 0.02, (4, 2))
            points = [[cx + (a - 0.5) * w, cy + (b - 0.5) * h, 0.9 + 0.02 * a] for a, b in hubs]
            line = box_files.text([cx, cy, w, h, *np.ravel(points)])
            write(folder / f"{number + 1:06d}.txt", f"0 {line}{tail}")
        right(read_boxes(folder, NAMES, *SIZE))


def test_lines_that_may_be_outlines_or_keypoints_are_refused(tmp_path):
    """An outline near the corner whose first points make a box around it."""
    outline = [0.2, 0.2, 0.22, 0.18, 0.25, 0.15, 0.3, 0.2, 0.25, 0.26, 0.15, 0.25]
    (tmp_path / "000001.txt").write_text(f"0 {box_files.text(outline)}\n")
    with pytest.raises(InputError, match="12 numbers behind the class may be an outline, or a box with"):
        read_boxes(tmp_path, NAMES, *SIZE)


def test_a_labels_last_number_may_be_a_track(tmp_path):
    """`save_txt` of a tracker without `save_conf` writes no confidence."""
    for number, box in enumerate(TRUE, 1):
        line = box_files.text(box_files.shares(box, *SIZE))
        other = box_files.text(box_files.shares((5, 5, 20, 20), *SIZE))
        write(tmp_path / f"{number:06d}.txt", f"0 {other} 2", f"0 {line} 1")
    right(read_boxes(tmp_path, NAMES, *SIZE, tracks=["1"]))


# --- which frame ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["frame_", "", "walk-", "walk_frame_"])
def test_names_of_a_video_tell_from_what_they_count(prefix, tmp_path):
    for first in (0, 1):
        names = [f"{prefix}{number:06d}.PNG" for number in range(first, first + 6)]
        file = box_files.coco(tmp_path, names, TRUE, SIZE, file=f"{first}.json")
        found = read_boxes(file, VIDEO, *SIZE, tmp_path / "walk")
        right(found)
        assert found.report.first_number == first
    middle = [f"{prefix}{number:06d}.PNG" for number in range(1, 5)]
    file = box_files.coco(tmp_path, middle, TRUE[1:5], SIZE, file="middle.json")
    with pytest.raises(InputError, match="run from 1 to 4, the footage has 6 .* from 0 or from 1"):
        read_boxes(file, VIDEO, *SIZE, tmp_path / "walk")
    right(read_boxes(file, VIDEO, *SIZE, tmp_path / "walk", count_from=0), range(1, 5))


def labels(folder, names, boxes=TRUE):
    for name, box in zip(names, boxes, strict=True):
        write(folder / f"{name}.txt", f"0 {box_files.text(box_files.shares(box, *SIZE))} 0.8")
    return folder


def test_labels_of_a_video(tmp_path):
    """Those of CVAT count from 0, those of Ultralytics from 1, also where the first frame has none."""
    video = tmp_path / "walk_2"
    right(read_boxes(labels(tmp_path / "a", [f"frame_{n:06d}" for n in range(6)]), VIDEO, *SIZE, video))
    folder = labels(tmp_path / "b", [f"walk_2_{n + 1}" for n in range(2, 5)], TRUE[2:5])
    right(read_boxes(folder, VIDEO, *SIZE, video), (2, 3, 4))
    labels(folder, [f"other_{n}" for n in range(1, 7)])  # of another video of the same run
    found = read_boxes(folder, VIDEO, *SIZE, video)
    right(found, (2, 3, 4))
    assert found.report.on_no_frame == 6
    with pytest.raises(InputError, match="its first name is other_1, the footage's 000000 of the video th"):
        read_boxes(folder, VIDEO, *SIZE, tmp_path / "third")
    with pytest.raises(InputError, match="its first name is other_1"):
        read_boxes(labels(tmp_path / "c", ["other_1"], TRUE[:1]), VIDEO, *SIZE, video)


def test_numbers_are_names_where_all_are(tmp_path):
    """Ultralytics drops the zeros of 000001.jpg."""
    right(read_boxes(box_files.save(tmp_path / "a.json", bbox_list(range(1, 7))), NAMES, *SIZE))
    right(read_boxes(box_files.save(tmp_path / "b.json", bbox_list(range(6))), NAMES, *SIZE))
    strings = bbox_list(map(str, range(1, 7)))
    right(read_boxes(box_files.save(tmp_path / "c.json", strings), NAMES, *SIZE))
    sparse = ("10.jpg", "20.jpg", "30.jpg")
    right(read_boxes(box_files.save(tmp_path / "d.json", bbox_list([10, 20, 30])), sparse, *SIZE), range(3))
    with pytest.raises(InputError, match="may be names or positions .* give file names"):
        read_boxes(box_files.save(tmp_path / "e.json", bbox_list([0, 10, 20])), sparse, *SIZE)


def test_numbers_of_a_video(tmp_path):
    right(read_boxes(box_files.save(tmp_path / "a.json", bbox_list(range(1, 7))), VIDEO, *SIZE))
    file = box_files.save(tmp_path / "b.json", bbox_list([2, 3]))
    with pytest.raises(InputError, match="from 0 or from 1; say --count-from"):
        read_boxes(file, VIDEO, *SIZE)
    assert sorted(read_boxes(file, VIDEO, *SIZE, count_from=1)) == [1, 2]
    rows = [f"{n},{','.join(map(str, box))}" for n, box in enumerate(TRUE, 1)]
    table = write(tmp_path / "one.csv", "frame,x,y,w,h", *rows)
    with pytest.raises(InputError, match="run from 1 to 6, the footage has 6 frames; counting from 0"):
        read_boxes(table, VIDEO, *SIZE)
    right(read_boxes(table, VIDEO, *SIZE, count_from=1))
    found = read_boxes(table, VIDEO, *SIZE, count_from=0)
    assert found.report.on_no_frame == 1 and "1 on no frame" in found.report.line()


def test_mot_counts_positions_unless_they_may_be_names(tmp_path):
    rows = [f"{n},1,{','.join(map(str, box))},1,-1,-1,-1" for n, box in enumerate(TRUE, 1)]
    file = write(tmp_path / "mot.txt", *rows[:5])
    right(read_boxes(file, NAMES, *SIZE), range(5))  # 000001.jpg is both
    with pytest.raises(InputError, match="may be names or positions"):
        read_boxes(file, tuple(f"{n}.jpg" for n in range(6)), *SIZE)
    right(read_boxes(file, tuple(f"{n}.jpg" for n in range(6)), *SIZE, count_from=1), range(5))


def test_names_of_numbers_are_read_as_people_count(tmp_path):
    for name in ("1.jpg", "2.jpg", "10.jpg"):
        cv2.imwrite(str(tmp_path / name), np.zeros((8, 8, 3), np.uint8))
    names = open_footage(tmp_path).names
    assert names == ("1.jpg", "2.jpg", "10.jpg")
    numbers = write(tmp_path / "numbers.csv", "\ufeffframe,x,y,w,h", "0,1,1,2,2", "1,2,1,2,2", "2,3,1,2,2")
    named = write(tmp_path / "names.csv", "frame,x,y,w,h", "1,1,1,2,2", "2,2,1,2,2", "10,3,1,2,2")
    for file in (numbers, named):
        assert [box[0] for box in read_boxes(file, names, 8, 8).values()] == [1, 2, 3], file


def test_coco_sets_of_several_videos(tmp_path):
    """Frames of a video lie as in a folder of its name. Ids may be long. An absolute name counts."""
    ids = (-9223372036854775801, 18446744073709551611, 5.0, "7")
    names = ("v1/000000.jpg", "v2\\000000.jpg", f"{tmp_path}/v2/000001.jpg", "v1/000001.jpg")
    images = [{"id": i, "file_name": name} for i, name in zip(ids, names, strict=True)]
    entries = [{"image_id": i, "bbox": [10 * n, 20, 30, 40]} for n, i in enumerate(ids, 1)]
    file = box_files.save(tmp_path / "coco.json", {"images": images, "annotations": entries})
    found = read_boxes(file, ("000000", "000001"), 200, 100, Footage(tmp_path / "v2.mp4", (), None).folder)
    assert {frame: box[0] for frame, box in found.items()} == {0: 20, 1: 30}
    assert found.report.on_no_frame == 2


@pytest.mark.parametrize("name", ["test/000600/rgb/{}", "C:\\data\\other\\{}", "/data/other/images/{}"])
def test_pictures_of_another_folder_are_refused(name, tmp_path):
    folder = tmp_path / "test" / "000651" / "rgb"
    file = box_files.coco(tmp_path, NAMES, TRUE, SIZE, name.format)
    with pytest.raises(InputError, match="its first name is .*000001.jpg, the footage lies in .*000651/rgb"):
        read_boxes(file, NAMES, *SIZE, folder)
    for same in ("000651/rgb/{}", "C:\\elsewhere\\000651\\{}", "images/train/{}", "{}", LOCAL, UPLOADED):
        right(read_boxes(box_files.coco(tmp_path, NAMES, TRUE, SIZE, same.format), NAMES, *SIZE, folder))


def test_detections_of_several_bop_scenes(tmp_path):
    folder = tmp_path / "000651" / "rgb"
    folder.mkdir(parents=True)
    found = bbox_list([1, 3, 5], scene_id=651) + bbox_list([1, 2], scene_id=600)
    file = box_files.save(tmp_path / "found.json", found)
    boxes = read_boxes(file, NAMES, *SIZE, folder)
    assert sorted(boxes) == [0, 2, 4] and boxes.report.on_no_frame == 2
    with pytest.raises(InputError, match="the footage is no scene of a BOP data set"):
        read_boxes(file, NAMES, *SIZE, tmp_path)


def test_two_pictures_of_one_name(tmp_path):
    file = write(tmp_path / "b.csv", "frame,x,y,w,h", "a,1,2,30,40")
    with pytest.raises(InputError, match="line 2: 2 pictures of the footage could be a"):
        read_boxes(file, ("a.jpg", "a.png"), *SIZE)
    twice = ["000001_jpg.rf.aa11.jpg", "000001_jpg.rf.bb22.jpg"]  # Roboflow's augmentations
    with pytest.raises(InputError, match="2 pictures could be 000001.jpg"):
        read_boxes(box_files.coco(tmp_path, twice, TRUE[:2], SIZE), NAMES, *SIZE)


# --- which box --------------------------------------------------------------------------------------------


def test_the_surest_box_of_a_frame_counts(tmp_path):
    file = write(tmp_path / "b.csv", "frame,x,y,w,h,score", "0,10,20,30,40,0.5", "0,1,2,3,4,0.4")
    found = read_boxes(file, VIDEO, *SIZE)
    assert found[0].tolist() == [10, 20, 30, 40]
    assert found.report.left_out == {"not the surest of their frame": 1}
    for scores in (("0.5", "0.5"), ("", ""), ("0.5", "")):
        rows = [f"0,{10 * n},20,30,40,{score}" for n, score in enumerate(scores)]
        with pytest.raises(InputError, match="frame 000000 has 2 boxes, and no score tells"):
            read_boxes(write(file, "frame,x,y,w,h,score", *rows), VIDEO, *SIZE)


def test_classes_are_chosen_by_name_or_number(tmp_path):
    drone, person = bbox_list(NAMES, category_id=5, score=0.6), bbox_list(NAMES, category_id=1, score=0.95)
    for entry in person:
        entry["bbox"] = [10, 20, 30, 80]
    file = box_files.save(tmp_path / "b.json", [*person, *drone])
    with pytest.raises(InputError, match="several classes: 1 in 6, 5 in 6; choose with --class"):
        read_boxes(file, NAMES, *SIZE)
    found = read_boxes(file, NAMES, *SIZE, kinds=["5"])
    right(found)
    assert found.report.left_out == {"of another class": 6}
    with pytest.raises(InputError, match="no class 7 on these frames; it has 1 in 6, 5 in 6"):
        read_boxes(file, NAMES, *SIZE, kinds=["7"])
    write(tmp_path / "yolo" / "classes.txt", "person", "drone")
    for n, box in enumerate(TRUE, 1):
        line = box_files.text(box_files.shares(box, *SIZE))
        write(tmp_path / "yolo" / f"{n:06d}.txt", "0 0.1 0.1 0.1 0.1", f"1 {line}")
    right(read_boxes(tmp_path / "yolo", NAMES, *SIZE, kinds=["drone"]))


def test_tracks_are_chosen(tmp_path):
    rows = []
    for n, box in enumerate(TRUE, 1):
        pair = [f"{n},1,{','.join(map(str, box))},1,-1,-1,-1", f"{n},2,{20 * n},10,30,20,1,-1,-1,-1"]
        rows += pair[:: 1 if n % 2 else -1]
    file = write(tmp_path / "mot.txt", *rows, "1,3,50,60,70,80,0,-1,-1,-1")
    with pytest.raises(InputError, match="several tracks: 1 in 6, 2 in 6; choose with --track"):
        read_boxes(file, VIDEO, *SIZE)
    found = read_boxes(file, VIDEO, *SIZE, tracks=["1"])
    right(found)
    assert found.report.left_out == {"marked as not to be used": 1, "of another track": 6}


def test_what_cannot_be_used_is_left_out_and_counted(tmp_path):
    rows = [f"{n},{','.join(map(str, box))}" for n, box in enumerate(TRUE[:4])]
    others = ["4,-80,10,90,20", "5,639.8,10,0.2,20", "9,1,2,3,4", "3,0,0,0,0"]
    found = read_boxes(write(tmp_path / "b.csv", "frame,x,y,w,h", *rows, *others), VIDEO, *SIZE)
    right(found, range(4))
    report = found.report
    assert report.left_out == {"smaller than a pixel": 1, "outside the frame": 1}
    assert (report.boxes, report.used, report.on_no_frame, report.no_drone) == (7, 4, 1, 1)
    assert report.line() == (
        "b.csv (CSV): 4 of 7 boxes used, 2 left out (1 smaller than a pixel, 1 outside the frame), "
        "1 on no frame, 1 times no drone; its first name 0, counted from 0, the footage's 000000"
    )


def test_boxes_of_another_resolution_are_scaled_or_refused(tmp_path):
    double = [tuple(2 * value for value in box) for box in TRUE]
    found = read_boxes(box_files.coco(tmp_path, NAMES, double, (1280, 720)), NAMES, *SIZE)
    right(found)
    assert found.report.scaled == 6
    for size in ((640, 640), (360, 640)):
        file = box_files.coco(tmp_path, NAMES, TRUE, size)
        with pytest.raises(InputError, match=f"is {size[0]}×{size[1]}, the frames are 640×360: not the same"):
            read_boxes(file, NAMES, *SIZE)
    rows = [f"{n},{2000 + n},500,270,80" for n in range(6)]
    with pytest.raises(InputError, match="as do 6 of 6; are these boxes of another resolution"):
        read_boxes(write(tmp_path / "b.csv", "frame,x,y,w,h", *rows), VIDEO, *SIZE)


# --- bad files --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, text, match",
    [
        ("b.csv", "frame,x,y\n0,1,2\n", "the header needs frame, x, y, w, h"),
        ("b.csv", "frame,x,x,y,w,h\n0,1,1,2,3,4\n", "has a column twice"),
        ("b.csv", "frame,x,y,w,h\n0,1,5,2,3,4\n", "line 2: 5 cells are needed"),
        ("b.csv", "frame,x,y,w,h\nz.jpg,1,2,3,4\n", "none of its 1 boxes .* first name is z.jpg, .* a.jpg"),
        ("b.csv", "frame,x,y,w,h\n0,1,2,-3,4\n", "line 2: a box needs .* not below 0"),
        ("b.csv", "frame,x,y,w,h\n0,300,2,5,4\n", "outside the 200×100 frame"),
        ("b.csv", "frame,x,y,w,h\n0,nan,2,5,4\n", "finite"),
        ("b.csv", "frame,x,y,w,h\n0,1_0,2,5,4\n", "finite"),
        ("b.csv", "frame,x,y,w,h\n9,1,2,5,4\n", "none of its 1 boxes is on any of the 3 frames"),
        ("b.csv", "frame,x,y,w,h\n1.7,1,2,5,4\n", "line 2: frame '1.7' is no whole number"),
        ("b.csv", "frame,x,y,w,h,score\n0,1,2,5,4,nan\n", "the score is nan"),
        ("b.csv", "frame,x,y,w,h\n0,0.5,0.5,0.1,0.1\n", "shares of the frame"),
        ("b.csv", "frame,x,y,w,h\n-1,1,2,5,4\n", "frame -1; the first is"),
        ("b.csv", "frame,x,y,w,h\n0,10.25,20.25,30.25,40.25\n1,10.25,20.25,30.25,4", "looks cut off"),
        ("b.csv", "frame,x,y,w,h\n", "holds no box"),
        ("b.csv", "\0\0\0", "zero bytes"),
        ("b.txt", "", "holds no box"),
        ("b.txt", "1,2,three\n", "line 1: not numbers"),
        ("b.txt", "1,2,3\n", "a MOT line is"),
        ("b.txt", "1,1,10,20,30,40,1\n2,1,10,20,30,40\n", "line 2: a MOT line is .* as many columns"),
        ("b.txt", "1.5,1,10,20,30,40\n", "line 1: frame 1.5 is no whole number"),
        ("b.txt", "0,7,10,20,30,40,0.9\n", "frame 0; the first is number 1"),
        ("b.txt", "nan,1,2,3,4,5\n", "line 1: frame nan"),
        ("b.txt", "10,20,30,40\n11,20,30,40\n", "2 lines x, y, w, h for 3 frames"),
        ("a.txt", "0 0.5 0.5 0.1\n", "1 lines x, y, w, h for 3 frames"),
        ("a.txt", "0 100 50 20 10\n", "are not shares of the picture"),
        ("a.txt", "0 0.5 0.5 0.1 0.1 1.7\n", "the confidence 1.7"),
        ("a.txt", "0.5 0.5 0.5 0.1 0.1\n", "class 0.5 is no whole number"),
        ("z.txt", "0 0.5 0.5 0.1 0.1\n", "first name is z, the footage's a.jpg"),
        ("a.xml", "<annotation><object/>", "not valid XML"),
        ("a.xml", "<annotation><object/></annotation>", "object 1: bndbox needs the numbers"),
        ("a.xml", "<html></html>", "begins with <annotation>, this with <html>"),
        ("a.xml", "<annotation><filename>b.jpg</filename></annotation>", "call the file like its picture"),
        ("b.json", "{", "not valid JSON"),
        ("b.json", "[" * 500_000, "not valid JSON"),
        ("b.json", '{"a":' * 500_000, "not valid JSON"),
        ("b.json", "{}", "neither a COCO list"),
        ("b.json", '{"images": null, "annotations": []}', "its images are missing"),
        ("b.json", '{"images": [1], "annotations": []}', "an image without id"),
        (
            "b.json",
            '{"images": [{"id": 1}], "annotations": []}',
            "image 0: an image without id and file_name",
        ),
        (
            "b.json",
            '{"images": [{"id": 1, "file_name": "a.jpg", "width": 20}], "annotations": []}',
            "width 20 and height None of a picture must both",
        ),
        (
            "b.json",
            '{"images": [{"id": 1, "file_name": "a.jpg"}], "annotations": [{"image_id": 2, "bbox": []}]}',
            "annotation 0: image_id 2 is none of its images",
        ),
        ("b.json", '[{"bbox": [1, 2, 3, 4]}]', "entry 0: needs image_id"),
        ("b.json", '[{"image_id": 1e999, "bbox": [1, 2, 3, 4]}]', "entry 0: the id inf is no whole"),
        ("b.json", '[{"image_id": true, "bbox": [1, 2, 3, 4]}]', "entry 0: the id True is no whole"),
        ("b.json", '[{"image_id": 0, "bbox": [1, 2, 3, true]}]', "entry 0: a box needs four"),
        ("b.json", '[{"image_id": 0, "bbox": {"x": 1}}]', "entry 0: bbox must be"),
        ("b.json", '[{"image_id": 0, "box": [1, 2, 3, 4]}]', "entry 0: needs bbox"),
        ("b.json", '[{"image_id": 0, "bbox": [1, 2, 3, 4], "bbox": [5, 6, 7, 8]}]', "'bbox' is there twice"),
    ],
)
def test_bad_boxes(name, text, match, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match) as error:
        read_boxes(tmp_path / name, ("a.jpg", "b.jpg", "c.jpg"), 200, 100)
    assert len(str(error.value)) < 600 and "\n" not in str(error.value)


def test_folders_of_nothing_and_of_both(tmp_path):
    (tmp_path / "instances.json").write_text("[]")
    with pytest.raises(InputError, match=r"needs either .txt files \(YOLO\) or .xml .* it holds 1 .json"):
        read_boxes(tmp_path, NAMES, *SIZE)
    (tmp_path / "000001.txt").write_text("")
    (tmp_path / "000001.xml").write_text("<annotation/>")
    with pytest.raises(InputError, match="needs either .txt files"):
        read_boxes(tmp_path, NAMES, *SIZE)
    with pytest.raises(InputError, match="no.json: boxes not found"):
        read_boxes(tmp_path / "no.json", NAMES, *SIZE)


def test_bombs_of_xml_are_refused(tmp_path):
    entities = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    bombs = (
        f"{entities}<annotation><filename>&b;</filename></annotation>",
        "<annotation>" + "<a>" * 100_000,
        "<annotation>" + " " * 2**21 + "</annotation>",
    )
    for number, bomb in enumerate(bombs):
        (tmp_path / f"{number}.xml").write_text(bomb)
        with pytest.raises(InputError, match="too large for an annotation|nested more than 20"):
            read_boxes(tmp_path / f"{number}.xml", (f"{number}.jpg",), *SIZE)


def test_pipes_and_devices_among_the_labels_do_not_hang(tmp_path):
    os.mkfifo(tmp_path / "000001.txt")
    (tmp_path / "000009.txt").symlink_to("/dev/zero")
    labels(tmp_path, ["000002"], TRUE[1:2])
    with pytest.raises(InputError, match="000001.txt: not an ordinary file"):
        read_boxes(tmp_path, NAMES, *SIZE)
    (tmp_path / "000001.txt").unlink()
    right(read_boxes(tmp_path, NAMES, *SIZE), (1,))  # nobody asked for the ninth picture
    with pytest.raises(InputError, match="/dev/zero: not an ordinary file"):
        read_boxes(Path("/dev/zero"), NAMES, *SIZE)


def test_labels_of_no_frame_may_be_anything(tmp_path):
    (tmp_path / "todo.txt").write_text("label the rest\n")
    right(read_boxes(labels(tmp_path, ["000003"], TRUE[2:3]), NAMES, *SIZE), (2,))
