"""The package without the repository, as a wheel installs it: every command answers, if only in one line."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import dronekeypp
from dronekeypp.needs import NEEDS

ROOT = Path(__file__).parents[1]
CROPS = ROOT / "data_samples" / "crops"


@pytest.fixture(scope="module")
def outside(tmp_path_factory):
    """A function that runs Python with a copy of the package, away from the repository."""
    site, cwd = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("elsewhere")
    package = Path(dronekeypp.__file__).parent
    shutil.copytree(package, site / "dronekeypp", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(site)}

    def run(*arguments):
        command = [sys.executable, *arguments]
        return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)

    where = run("-c", "import dronekeypp; print(dronekeypp.__file__)").stdout.strip()
    assert Path(where) == site / "dronekeypp" / "__init__.py"  # the editable installation does not win
    return run


def assert_one_line(result):
    """Exit status 2, and one line on stderr that a person can read."""
    assert result.returncode == 2
    assert "Traceback" not in result.stderr and "[Errno" not in result.stderr
    lines = result.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), result.stderr
    return lines[0]


def test_check_prints_its_table(outside):
    result = outside("-m", "dronekeypp", "check")
    assert "the lines above say how to mend it" in assert_one_line(result)
    lines = result.stdout.splitlines()
    assert [line[10:22].strip() for line in lines] == [need.name for need in NEEDS]
    assert "[Errno" not in result.stdout
    [samples] = [line for line in lines if "sample data" in line]
    assert samples.startswith("[missing]") and samples.endswith("clone the repository")
    [packages] = [line for line in lines if line[10:].startswith("packages")]
    assert packages.startswith("[ok]")
    [disk] = [line for line in lines if line[10:].startswith("disk")]
    assert "GB" in disk


def test_bench_says_where_its_checkpoints_are(outside):
    line = assert_one_line(outside("-m", "dronekeypp", "bench"))
    assert "clone the repository" in line


def test_the_preset_cpu_says_where_its_weights_are(outside, tmp_path):
    command = ("-m", "dronekeypp", "train", str(CROPS), "--out", str(tmp_path / "run"))
    line = assert_one_line(outside(*command))
    assert "backbone weights data_samples/backbone/compact.safetensors not found" in line
    assert "clone it" in line and "backbone_weights=none" in line


def test_a_checkpoint_of_your_own_needs_no_repository(outside):
    checkpoint = ROOT / "data_samples" / "checkpoint"
    result = outside("-m", "dronekeypp", "evaluate", str(checkpoint), str(CROPS), "--split", "val")
    assert result.returncode == 0, result.stderr
    assert "R MAE" in result.stdout


def test_an_unknown_split_is_named(outside):
    checkpoint = ROOT / "data_samples" / "checkpoint"
    result = outside("-m", "dronekeypp", "evaluate", str(checkpoint), str(CROPS), "--split", "night")
    assert "'night'" in assert_one_line(result)
