"""Data sets of the second edition, and of random quadrotors."""

import numpy as np
import pytest

from dronekeypp.cli import main
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop
from dronekeypp.sixdronesyn.drones import EDITIONS, find_drone
from dronekeypp.sixdronesyn.generate import generate
from dronekeypp.sixdronesyn.validate import validate

LITTLE = dict(scene_numbers=[1, 3, 6], size=64, stride=60, progress=False)


@pytest.fixture(scope="module")
def second(environments, tmp_path_factory):
    """Two frames a flight of Mavic 3 in the second edition."""
    root = tmp_path_factory.mktemp("second") / "data"
    generate(root, drone_names=["Mav3"], environments=environments, edition=2, **LITTLE)
    return root


@pytest.fixture(scope="module")
def quadrotors(environments, tmp_path_factory):
    """Two frames a flight of quadrotors 7 (training), 8 (validation) and 9 (test)."""
    root = tmp_path_factory.mktemp("quadrotors") / "data"
    generate(root, environments=environments, quadrotors=(7, 10), **LITTLE)
    return root


def test_the_second_edition_is_sound_and_has_the_new_shapes(second):
    assert validate(second) == []
    item = open_dataset(second, "test")[0]
    hubs = item["keypoints_3d"].numpy() @ item["R"].numpy()  # from camera axes to body axes
    np.testing.assert_allclose(hubs, EDITIONS[2]["Mav3"].hubs, atol=1e-5)
    assert np.abs(hubs - EDITIONS[1]["Mav3"].hubs).max() > 0.03
    cameras = {tuple(frame.K.ravel()) for frame in open_dataset(second, "test").frames}
    assert len(cameras) == 3  # one a flight


def test_quadrotors_are_sound_and_keep_to_their_split(quadrotors):
    assert validate(quadrotors) == []
    for split, number in (("train", 7), ("val", 8), ("test", 9)):
        dataset = open_dataset(quadrotors, split)
        names = {dataset.drones[label].name for label in dataset.labels}
        assert names == {f"Quad{number}"}
        hubs = dataset.drones[dataset.labels[0]].hubs
        np.testing.assert_allclose(hubs, find_drone(f"Quad{number}").hubs, atol=1e-6)


def test_a_quadrotor_does_not_depend_on_the_range_it_is_made_in(quadrotors, environments, tmp_path):
    manifest = generate(tmp_path, environments=environments, quadrotors=(9, 10), **LITTLE)
    (name, alone), *_ = manifest["flights"].items()
    among = bop.read_json(quadrotors / "manifest.json")["flights"]["060020"]
    assert name == "060000"  # its number in the data set is another
    for number, (picture, _) in alone["digests"].items():
        assert among["digests"][number][0] == picture


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (dict(edition=1, drone_names=["Mav3"]), "another edition (2, now 1)"),
        (dict(quadrotors=(0, 2)), "another quadrotors (null, now [0, 2])"),
    ],
)
def test_editions_are_not_mixed(settings, message, second, environments):
    with pytest.raises(InputError) as refused:
        generate(second, environments=environments, **LITTLE, **settings)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--edition", "3"], "edition 3: choose 1 or 2"),
        (["--quadrotors", "5"], "write A:B"),
        (["--quadrotors", "5:5"], "0 ≤ A < B"),
        (["--quadrotors", "0:2000"], "at most 1000"),
        (["--quadrotors", "0:3", "--drones", "Tello"], "leave out --drones"),
        (["--quadrotors", "0:3", "--edition", "1"], "leave out --edition 1"),
        (["--quadrotors", "0:3", "--scenes", "6"], "no flight"),
    ],
)
def test_bad_calls_are_one_line(words, message, tmp_path, capsys):
    assert main(["generate", str(tmp_path / "data"), *words]) == 2
    line = capsys.readouterr().err
    assert message in line and line.count("\n") == 1
