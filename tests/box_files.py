"""Write the same boxes in every format that `predict` reads, as the programs write them."""

import json
from xml.sax.saxutils import escape


def shares(box, width, height):
    """A box (x, y, w, h) in pixels as YOLO has it: centre and size in shares of the frame."""
    x, y, w, h = box
    return (x + w / 2) / width, (y + h / 2) / height, w / width, h / height


def corners(box, width, height):
    """The corners of a box in shares of the frame, all around."""
    x, y, w, h = box
    points = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
    return [value for px, py in points for value in (px / width, py / height)]


def text(values):
    return " ".join(f"{value:.9f}" for value in values)


def csv(folder, names, boxes, size):
    lines = ["frame,x,y,w,h,score"]
    for name, box in zip(names, boxes, strict=True):
        lines.append(",".join([name, *("" if box is None else str(v) for v in box or ("",) * 4), "0.9"]))
    (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    return folder / "boxes.csv"


def spreadsheet(folder, names, boxes, size):
    """As in much of the world: semicolons between the cells, and decimal commas."""
    lines = ["Frame;X;Y;W;H;Score"]
    for name, box in zip(names, boxes, strict=True):
        cells = ["" if value is None else f"{value:.2f}".replace(".", ",") for value in box or [None] * 4]
        lines.append(";".join([name, *cells, "0,90"]))
    (folder / "spreadsheet.csv").write_text("\n".join(lines) + "\n", encoding="utf-8-sig")
    return folder / "spreadsheet.csv"


def pandas(folder, names, boxes, size):
    """With the index in front, frames as floats, and empty cells."""
    lines = [",frame,x,y,w,h,note"]
    for number, box in enumerate(boxes):
        cells = [str(value) for value in box or [""] * 4]
        lines.append(",".join([str(number), f"{number}.0", *cells, "hover"]))
    (folder / "pandas.csv").write_text("\n".join(lines) + "\n")
    return folder / "pandas.csv"


def mot(folder, names, boxes, size):
    lines = [f"{n},7,{','.join(map(str, box))},0.9,-1,-1,-1" for n, box in enumerate(boxes, 1) if box]
    (folder / "mot.txt").write_text("\n".join(lines) + "\n")
    return folder / "mot.txt"


def tracking(folder, names, boxes, size):
    lines = [",".join(map(str, box or ["NaN"] * 4)) for box in boxes]
    (folder / "tracking.txt").write_text("\n".join(lines) + "\n")
    return folder / "tracking.txt"


def yolo(folder, names, boxes, size, write=lambda box, size: text(shares(box, *size)), kind="yolo"):
    (folder / kind).mkdir()
    for name, box in zip(names, boxes, strict=True):
        line = "" if box is None else f"0 {write(box, size)}\n"
        (folder / kind / f"{name.rpartition('.')[0]}.txt").write_text(line)
    return folder / kind


def yolo_tracked(folder, names, boxes, size):
    return yolo(folder, names, boxes, size, lambda b, s: text(shares(b, *s)) + " 0.9 3", "tracked")


def yolo_oriented(folder, names, boxes, size):
    return yolo(folder, names, boxes, size, lambda b, s: text(corners(b, *s)), "oriented")


def yolo_outline(folder, names, boxes, size):
    """The corners and a point on each of three edges: lines of fourteen numbers, and a confidence."""

    def outline(box, size):
        x, y, w, h = box
        middles = [(x + w / 2, y), (x + w, y + h / 2), (x + w / 2, y + h)]
        c, m = corners(box, *size), [v for px, py in middles for v in (px / size[0], py / size[1])]
        return text([*c[:2], *m[:2], *c[2:4], *m[2:4], *c[4:6], *m[4:6], *c[6:]]) + " 0.9"

    return yolo(folder, names, boxes, size, outline, "outline")


def yolo_pose(folder, names, boxes, size):
    """Four keypoints with their visibility, as `convert --keypoints` writes them."""

    def pose(box, size):
        x, y, w, h = box
        hubs = [(0.2, 0.3), (0.8, 0.2), (0.9, 0.7), (0.1, 0.8)]
        keypoints = [f"{(x + a * w) / size[0]:.9f} {(y + b * h) / size[1]:.9f} 2" for a, b in hubs]
        return text(shares(box, *size)) + " " + " ".join(keypoints)

    return yolo(folder, names, boxes, size, pose, "pose")


def voc(folder, names, boxes, size):
    (folder / "voc").mkdir()
    for name, box in zip(names, boxes, strict=True):
        thing = ""
        if box is not None:
            x, y, w, h = box
            ends = f"<xmin>{x}</xmin><ymin>{y}</ymin><xmax>{x + w}</xmax><ymax>{y + h}</ymax>"
            thing = f"<object><name>drone</name><bndbox>{ends}</bndbox></object>"
        picture = f"<size><width>{size[0]}</width><height>{size[1]}</height></size>"
        (folder / "voc" / f"{name.rpartition('.')[0]}.xml").write_text(
            f"<annotation><filename>{escape(name)}</filename>{picture}{thing}</annotation>"
        )
    return folder / "voc"


def save(path, content):
    path.write_text(json.dumps(content))
    return path


def coco(folder, names, boxes, size, rename=str, bbox=list, file="coco.json"):
    """A data set. A frame without a drone has an empty bbox."""
    images, entries = [], []
    for number, (name, box) in enumerate(zip(names, boxes, strict=True), 5):
        images.append(
            {"id": number, "file_name": rename(name), "width": size[0], "height": size[1]},
        )
        entries.append({"id": number, "image_id": number, "category_id": 1, "bbox": bbox(box or [])})
    categories = [{"id": 1, "name": "drone"}]
    return save(folder / file, {"images": images, "annotations": entries, "categories": categories})


def label_studio(folder, names, boxes, size):
    return coco(folder, names, boxes, size, lambda name: f"images\\3f9a1c2b-{name}", file="studio.json")


def roboflow(folder, names, boxes, size):
    """Half as large, and renamed."""

    def renamed(name):
        stem, _, suffix = name.rpartition(".")
        return f"{stem}_{suffix}.rf.0a1b2c3d.jpg"

    half = tuple(side / 2 for side in size)
    return coco(
        folder, names, boxes, half, renamed, lambda box: [value / 2 for value in box], "roboflow.json"
    )


def detections(folder, names, boxes, size):
    found = []
    for name, box in zip(names, boxes, strict=True):
        if box is not None:
            stem = name.rpartition(".")[0]
            image = int(stem) if stem.isnumeric() else stem  # as Ultralytics does
            found.append({"image_id": image, "category_id": 1, "bbox": list(box), "score": 0.9})
    return save(folder / "detections.json", found)


def predictions(folder, names, boxes, size):
    """Of newer Ultralytics, for oriented boxes."""
    found = []
    for name, box in zip(names, boxes, strict=True):
        if box is not None:
            x, y, w, h = box
            poly = [x, y, x + w, y, x + w, y + h, x, y + h]
            found.append({"image_id": 77, "file_name": name, "category_id": 1, "score": 0.9, "poly": poly})
    return save(folder / "predictions.json", found)


BY_NAME = (
    *(csv, spreadsheet, yolo, yolo_tracked, yolo_oriented, yolo_outline, yolo_pose),
    *(voc, coco, label_studio, roboflow, detections, predictions),
)
BY_POSITION = (pandas, mot, tracking)
EVERY = (*BY_NAME, *BY_POSITION)
