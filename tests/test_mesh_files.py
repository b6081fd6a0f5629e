"""Meshes that VTK must never see: cut off, with faces of points that are not there, with NaN."""

import struct

import numpy as np
import pytest
import pyvista as pv
from hypothesis import given
from hypothesis import strategies as st

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.mesh_files import check_mesh
from dronekeypp.sixdronesyn.ply import read_faces, read_points

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]


def ply(path, points=POINTS, faces=FACES, layout="binary_little_endian"):
    """Write a PLY file in one of the three layouts."""
    header = ["ply", f"format {layout} 1.0", f"element vertex {len(points)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    if layout == "ascii":
        lines = [" ".join(map(str, point)) for point in points]
        lines += [" ".join(map(str, [len(face), *face])) for face in faces]
        path.write_text("\n".join([*header, *lines, ""]).replace("end_header\n\n", "end_header\n"))
        return path
    order = "<" if layout == "binary_little_endian" else ">"
    body = b"".join(struct.pack(order + "3f", *point) for point in points)
    body += b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    path.write_bytes("\n".join(header).encode() + body)
    return path


def obj(path, points=POINTS, faces=FACES):
    lines = [f"v {x} {y} {z}" for x, y, z in points] + ["vt 0 0", "# a comment"]
    lines += ["f " + " ".join(f"{corner + 1}/1" for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def stl(path, points=POINTS, faces=FACES):
    content = b"\0" * 80 + struct.pack("<I", len(faces))
    for face in faces:
        content += struct.pack("<12fH", 0, 0, 1, *points[face].ravel(), 0)
    path.write_bytes(content)
    return path


def ascii_stl(path, points=POINTS, faces=FACES):
    lines = ["solid drone"]
    for face in faces:
        lines += ["facet normal 0 0 1", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in points[face])]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid drone", ""]))
    return path


WRITERS = {
    "ascii.ply": lambda path, **mesh: ply(path, layout="ascii", **mesh),
    "little.ply": ply,
    "big.ply": lambda path, **mesh: ply(path, layout="binary_big_endian", **mesh),
    "mesh.obj": obj,
    "binary.stl": stl,
    "ascii.stl": ascii_stl,
}


@pytest.mark.parametrize("name", WRITERS)
def test_whole_meshes_are_read(name, tmp_path):
    path = WRITERS[name](tmp_path / name)
    check_mesh(path)
    assert pv.read(path).n_cells == len(FACES)


@pytest.mark.parametrize("name", WRITERS)
def test_a_point_that_is_not_finite_is_named(name, tmp_path):
    points = POINTS.copy()
    points[2, 1] = np.nan
    with pytest.raises(InputError, match=f"{name}: .*not finite"):
        check_mesh(WRITERS[name](tmp_path / name, points=points))


@pytest.mark.parametrize("name", [name for name in WRITERS if not name.endswith("stl")])
@pytest.mark.parametrize("corner", [4, -1, 2**31 - 1, 10**6])
def test_a_face_of_a_point_that_is_not_there_is_named(name, corner, tmp_path):
    if corner < 0 and name.endswith("obj"):
        corner = -(10**6)  # -1 is a name of its last point
    path = WRITERS[name](tmp_path / name, faces=[*FACES, [0, 1, corner]])
    with pytest.raises(InputError, match=f"{name}: a face names point .*, and there are 4"):
        check_mesh(path)


@pytest.mark.filterwarnings("ignore:The VTK reader")  # `meshes.read_body` takes it for an error
@pytest.mark.parametrize("name", WRITERS)
@given(share=st.floats(0, 0.999))
def test_a_mesh_that_is_cut_off_is_refused_or_whole(name, share, tmp_path_factory):
    """A cut in the last numbers of a text may leave a mesh; PyVista reads that then."""
    path = WRITERS[name](tmp_path_factory.mktemp("cut") / name)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    try:
        check_mesh(path)
    except InputError as error:
        assert str(error).startswith(str(path)) and "\n" not in str(error)
        return
    assert np.isfinite(pv.read(path).points).all()


def test_other_formats_are_tried_in_another_process(tmp_path):
    pv.Cube().save(tmp_path / "cube.vtp")
    check_mesh(tmp_path / "cube.vtp")
    whole = (tmp_path / "cube.vtp").read_bytes()
    (tmp_path / "cube.vtp").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="cube.vtp: not a mesh that PyVista reads"):
        check_mesh(tmp_path / "cube.vtp")


def test_points_and_faces_of_a_file_of_another_program(tmp_path):
    """Faces of several lengths, with a colour before their corners and a number behind them."""
    text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 2\nproperty uchar red\nproperty list uchar int vertex_index\nproperty float q\n"
    text += "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n9 4 0 1 2 3 0.5\n9 3 0 1 4 0.5\n"
    (tmp_path / "a.ply").write_text(text)
    assert read_points(tmp_path / "a.ply").shape == (5, 3)
    assert read_faces(tmp_path / "a.ply").tolist() == [0, 1, 2, 3, 0, 1, 4]
