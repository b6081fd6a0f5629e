"""Rendering that many machines share: shards in folders of their own, and a Dask cluster."""

import os
import shutil

import joblib
import pytest
from conftest import SMALL

from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import flight
from dronekeypp.sixdronesyn import generate as generating
from dronekeypp.sixdronesyn.generate import generate
from dronekeypp.sixdronesyn.validate import validate


def test_shards_of_two_machines_are_copied_together_and_finished(
    small_dataset, environments, tmp_path, monkeypatch
):
    whole, other = tmp_path / "whole", tmp_path / "other"
    generate(whole, environments=environments, **SMALL, shard=(0, 2))
    part = generate(other, environments=environments, **SMALL, shard=(1, 2))
    assert 0 < sum(part["frames"].values()) < part["planned_frames"]
    with pytest.raises(InputError, match="flights are there; run generate again"):
        open_dataset(other, "train")
    shutil.copytree(other, whole, dirs_exist_ok=True)
    monkeypatch.setattr(flight.Flight, "open", lambda *_: pytest.fail("a flight is rendered again"))
    generate(whole, environments=environments, **SMALL)
    assert validate(whole) == []
    names = [path.relative_to(small_dataset) for path in sorted(small_dataset.rglob("*")) if path.is_file()]
    assert [path.relative_to(whole) for path in sorted(whole.rglob("*")) if path.is_file()] == names
    for name in names:
        assert (whole / name).read_bytes() == (small_dataset / name).read_bytes(), name


def test_a_dask_cluster_gives_the_same_digest(environments, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the optional extra dask")
    selection = dict(scene_numbers=[1], drone_names=["Tello"], stride=60, size=64, progress=False)
    alone = generate(tmp_path / "alone", environments=environments, **selection)
    # To make it harder, each worker has two threads and stands in another folder.
    monkeypatch.setattr(generating, "render_flight", lambda *_: pytest.fail("rendered in this process"))
    monkeypatch.chdir(tmp_path)
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        client.run(os.chdir, str(tmp_path / "alone"))
        with joblib.parallel_config("dask"):
            together = generate("together", environments=environments, **selection)
    assert together["digest"] == alone["digest"] and together["frames"]["train"] == 6
