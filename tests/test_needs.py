"""`check` finds what is missing and says how to mend it."""

import subprocess
import sys

import pytest

from dronekeypp import needs
from dronekeypp.cli import main
from dronekeypp.errors import InputError


def test_a_whole_machine_passes(capsys):
    assert main(["check"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[10:22].strip() for line in lines] == [need.name for need in needs.NEEDS]
    assert all(line.startswith(("[ok]", "[extra]")) for line in lines)


def test_what_is_missing_is_named_with_its_mend(monkeypatch, tmp_path, capsys):
    (tmp_path / "environment.txt").write_text("numpy==0.0.1\nno-such-package==1.0\npyvista[jupyter]==0.1\n")
    monkeypatch.setattr(needs, "repository", lambda: tmp_path)
    monkeypatch.setattr(needs, "FREE_GB", 10**9)
    assert main(["check"]) == 2
    printed = capsys.readouterr()
    assert "[missing] packages     no-such-package: pip install -r environment.txt" in printed.out
    assert "data_samples/backbone/compact.safetensors and 6 more: git checkout data_samples" in printed.out
    assert "GB free, 1000000000 needed" in printed.out and "[extra]   6DroneSyn" in printed.out
    assert printed.err == "error: something is missing; the lines above say how to mend it\n"
    monkeypatch.setattr(sys, "version_info", (3, 10))
    with pytest.raises(InputError, match="make the environment with Python 3.11"):
        needs.python()


def test_other_versions_than_the_tested_ones_are_no_fault(monkeypatch, tmp_path):
    (tmp_path / "environment.txt").write_text("numpy==0.0.1\n")
    monkeypatch.setattr(needs, "repository", lambda: tmp_path)
    assert needs.packages().startswith("1 packages, of other versions: numpy ")


def test_without_the_repository_the_package_says_what_it_needs(monkeypatch, tmp_path):
    monkeypatch.setattr(needs, "repository", lambda: None)
    monkeypatch.chdir(tmp_path)
    required = needs.required_packages()
    assert {"torch", "numpy", "opencv-python-headless"} <= set(required) and "onnx" not in required
    assert set(required.values()) == {None}
    assert needs.packages() == f"{len(required)} packages"
    with pytest.raises(InputError, match="clone the repository"):
        needs.samples()
    with pytest.raises(InputError, match="not rendered"):
        needs.dataset()
    (tmp_path / "data" / "6dronesyn").mkdir(parents=True)
    (tmp_path / "data" / "6dronesyn" / "manifest.json").write_text("{}")
    assert needs.dataset() == "data/6dronesyn"
    monkeypatch.setattr(needs, "required_packages", lambda: {"no-such-package": None})
    with pytest.raises(InputError, match="no-such-package: install dronekeypp again, with pip"):
        needs.packages()


def test_an_optional_need_is_no_fault_and_a_broken_import_is(monkeypatch, capsys):
    def broken():
        raise ImportError("No module named 'torch'")

    def without():
        raise InputError("none")

    monkeypatch.setattr(needs, "NEEDS", (needs.Need("GPU", without, True),))
    assert needs.check()
    assert "[extra]   GPU" in capsys.readouterr().out
    monkeypatch.setattr(needs, "NEEDS", (needs.Need("ONNX", broken),))
    assert not needs.check()
    line = "[missing] ONNX         No module named 'torch': pip install -r environment.txt"
    assert line in capsys.readouterr().out


def test_it_runs_before_anything_is_installed():
    """The verb itself needs nothing but Python."""
    probe = (
        "import sys; sys.modules.update(torch=None, numpy=None, cv2=None, filelock=None); "
        "from dronekeypp.cli import main; main(['check'])"
    )
    result = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    assert "[ok]      Python" in result.stdout and "[ok]      sample data" in result.stdout
    assert "[missing] OpenGL" in result.stdout and "pip install -r environment.txt" in result.stdout
    assert "Traceback" not in result.stderr
