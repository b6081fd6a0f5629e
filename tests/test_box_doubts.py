"""Boxes that can be read without an error and mean something else are refused, or doubted aloud."""

import json
import unicodedata

import box_files
import numpy as np
import pytest

from dronekeypp.errors import InputError
from dronekeypp.footage import check_box, read_boxes

NAMES = tuple(f"{number:06d}.jpg" for number in range(6))
VIDEO = tuple(f"{number:06d}" for number in range(6))
SIZE = (640, 360)
TRUE = [(400.5 - 50 * number, 160.25, 90.0, 26.5) for number in range(6)]
CORNERS = [(x, y, x + w, y + h) for x, y, w, h in TRUE]


def right(found, boxes=TRUE):
    assert list(found) == list(range(len(boxes)))
    np.testing.assert_allclose(list(found.values()), boxes, atol=0.01)


def table(path, rows, header="frame,x,y,w,h", encoding="utf-8"):
    path.write_text("".join(f"{line}\n" for line in (header, *rows)), encoding=encoding)
    return path


def rows_of(boxes, first=0):
    return [",".join(map(str, (number, *box))) for number, box in enumerate(boxes, first)]


@pytest.mark.parametrize("writer", [box_files.csv, box_files.mot, box_files.tracking, box_files.coco])
@pytest.mark.parametrize("count", [1, 6])
def test_corners_in_place_of_a_size_are_refused(writer, count, tmp_path):
    """As programs that count in corners write them by mistake; one of these reaches far over the edge."""
    names = NAMES[:count]
    with pytest.raises(InputError, match="seem to be two corners x1, y1, x2, y2; a corner and the size"):
        read_boxes(writer(tmp_path, names, CORNERS[:count], SIZE), names, *SIZE, tmp_path)


def test_corners_behind_box_are_refused():
    with pytest.raises(InputError, match="--box: its boxes seem to be two corners"):
        check_box(CORNERS[0], *SIZE, "--box")
    assert check_box(TRUE[0], *SIZE, "--box").tolist() == list(TRUE[0])


def test_corners_near_the_upper_left_are_doubted(tmp_path):
    small = [(10.0 + n, 20.0, 40.0 + n, 35.0) for n in range(6)]
    found = read_boxes(table(tmp_path / "b.csv", rows_of(small)), VIDEO, *SIZE)
    assert any(remark.startswith("are its boxes two corners") for remark in found.report.remarks)
    lines = [
        " ".join(f"{value / side:.6f}" for value, side in zip(b, 2 * SIZE, strict=True)) for b in CORNERS
    ]
    (tmp_path / "labels").mkdir()
    for name, line in zip(NAMES, lines, strict=True):
        (tmp_path / "labels" / f"{name[:-4]}.txt").write_text(f"0 {line}\n")
    report = read_boxes(tmp_path / "labels", NAMES, *SIZE).report
    assert report.remarks == (
        "are its boxes two corners x1, y1, x2, y2? They are read as the centre and the size cx, cy, w, h",
    )
    assert report.line().endswith(f"; NOTE: {report.remarks[0]}")


def test_a_large_drone_over_the_edge_is_no_pair_of_corners(tmp_path):
    boxes = [*TRUE[:5], (500.0, 250.0, 200.0, 150.0)]
    found = read_boxes(table(tmp_path / "b.csv", rows_of(boxes)), VIDEO, *SIZE)
    right(found, boxes)
    assert found.report.remarks == ()


def test_boxes_in_per_cent_or_of_a_small_picture_are_doubted(tmp_path):
    per_cent = [(100 * x / 640, 100 * y / 360, 100 * w / 640, 100 * h / 360) for x, y, w, h in TRUE]
    found = read_boxes(table(tmp_path / "b.csv", rows_of(per_cent)), VIDEO, *SIZE)
    assert found.report.remarks == (
        "all boxes lie in the upper left quarter of the frames: are they of smaller pictures, or in %?",
    )
    # Nobody doubts a file that says the size of its pictures.
    sized = read_boxes(box_files.coco(tmp_path, NAMES, per_cent, SIZE), NAMES, *SIZE)
    assert sized.report.remarks == ()


def test_boxes_of_larger_pictures_are_doubted_where_some_lie_outside(tmp_path):
    """Half of them do not, and would be poses at the wrong place without a word."""
    double = [tuple(2 * value for value in box) for box in TRUE]
    found = read_boxes(table(tmp_path / "b.csv", rows_of(double)), VIDEO, *SIZE)
    assert found.report.left_out == {"outside the frame": 3}
    assert found.report.remarks == ("3 boxes lie outside the frames: are all of them of another resolution?",)


def test_a_class_of_boxes_that_have_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="its boxes have no class; leave --class out"):
        read_boxes(table(tmp_path / "b.csv", rows_of(TRUE)), VIDEO, *SIZE, kinds=["drone"])


def test_pictures_of_a_video_without_a_gap_are_doubted(tmp_path):
    """Every second frame, numbered one after the other: each box but the first is of another frame."""

    def remarks(numbers, pattern="frame_{:06d}.png", **choice):
        names = [pattern.format(number) for number in numbers]
        file = box_files.coco(tmp_path, names, TRUE[: len(names)], SIZE)
        return read_boxes(file, VIDEO, *SIZE, tmp_path / "walk", **choice).report.remarks

    [remark] = remarks(range(3))
    assert remark.startswith("its pictures are numbered 0 to 2 without a gap, the video has 6 frames")
    assert remarks((0, 2, 4)) == remarks((0,)) == remarks(range(6)) == remarks(range(3), count_from=0) == ()


def test_a_table_that_begins_with_frame_1_is_doubted(tmp_path):
    file = table(tmp_path / "b.csv", rows_of(TRUE[:3], first=1))
    found = read_boxes(file, VIDEO, *SIZE)
    assert list(found) == [1, 2, 3] and "begin with 1 and were counted from 0" in found.report.line()
    said = read_boxes(file, VIDEO, *SIZE, count_from=1)
    assert list(said) == [0, 1, 2] and said.report.remarks == ()


def test_boxes_none_of_which_can_be_used_are_refused(tmp_path):
    shares = [(x, y, w / 640, h / 360) for x, y, w, h in TRUE]
    with pytest.raises(InputError, match="none of its 6 boxes can be used: 6 smaller than a pixel"):
        read_boxes(table(tmp_path / "b.csv", rows_of(shares)), VIDEO, *SIZE)
    (tmp_path / "mot.txt").write_text("".join(f"{n},7,10,20,30,40,0,-1,-1,-1\n" for n in range(1, 7)))
    with pytest.raises(InputError, match="can be used: 6 marked as not to be used"):
        read_boxes(tmp_path / "mot.txt", VIDEO, *SIZE)


def test_letters_and_accents_may_be_written_apart(tmp_path):
    """A Mac writes the é of a file's name in two characters, other programs in one."""
    names = [f"vol été {number}.jpg" for number in range(6)]
    for form, other in (("NFC", "NFD"), ("NFD", "NFC")):
        footage = tuple(unicodedata.normalize(form, name) for name in names)
        theirs = [unicodedata.normalize(other, f"vol/{name}") for name in names]
        folder = tmp_path / unicodedata.normalize(form, "vol")
        right(read_boxes(box_files.coco(tmp_path, theirs, TRUE, SIZE), footage, *SIZE, folder))
    frames = [unicodedata.normalize("NFD", f"été_{number:04d}.png") for number in range(6)]
    video = tmp_path / unicodedata.normalize("NFC", "été")
    right(read_boxes(box_files.coco(tmp_path, frames, TRUE, SIZE), VIDEO, *SIZE, video))


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".txt"])
def test_tables_of_spreadsheets(separator, suffix, tmp_path):
    rows = [row.replace(",", separator).replace(".", ",") for row in rows_of(TRUE)]
    header = separator.join(["Frame", "X", "Y", "W", "H"])
    right(read_boxes(table(tmp_path / f"b{suffix}", rows, header), VIDEO, *SIZE))
    right(read_boxes(table(tmp_path / f"b{suffix}", rows, header, "utf-16"), VIDEO, *SIZE))


@pytest.mark.parametrize(
    "row, match",
    [
        ("0;1,162;4;90;26", "line 2: the comma of 1,162 may be a decimal one"),
        ("0;1.162,66;4;90;26", "four finite numbers"),
        ("0;1162,66;4;90", "line 2: 5 cells are needed"),
        ("0;1,5;4;90;2,6,5", "four finite numbers"),
    ],
)
def test_commas_that_may_mean_anything_are_refused(row, match, tmp_path):
    with pytest.raises(InputError, match=match):
        read_boxes(table(tmp_path / "b.csv", [row], "frame;x;y;w;h"), VIDEO, 1920, 1080)


def test_a_file_of_another_kind_says_what_is_wrong_with_it(tmp_path):
    (tmp_path / "cvat.xml").write_text("<annotations><version>1.1</version></annotations>")
    with pytest.raises(InputError, match="begins with <annotation>, this with <annotations>"):
        read_boxes(tmp_path / "cvat.xml", NAMES, *SIZE)


def test_remarks_are_in_the_report_for_machines(tmp_path):
    found = read_boxes(table(tmp_path / "b.csv", rows_of(TRUE[:3], first=1)), VIDEO, *SIZE)
    assert len(json.loads(json.dumps(found.report.as_dict()))["remarks"]) == 1
