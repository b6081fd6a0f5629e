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
    monkeypatch.setattr(needs, "ROOT", tmp_path)
    monkeypatch.setattr(needs, "FREE_GB", 10**9)
    assert main(["check"]) == 2
    found = capsys.readouterr()
    assert "[missing] packages     no-such-package: pip install -r environment.txt" in found.out
    assert "data_samples/backbone/compact.safetensors and 6 more: git checkout data_samples" in found.out
    assert "GB free, 1000000000 needed" in found.out and "[extra]   6DroneSyn" in found.out
    assert found.err == "error: something is missing; the lines above say how to mend it\n"
    monkeypatch.setattr(sys, "version_info", (3, 10))
    with pytest.raises(InputError, match="make the environment with Python 3.11"):
        needs.python()


def test_an_optional_need_is_no_fault_and_a_broken_import_is(monkeypatch, capsys):
    def broken():
        raise ImportError("No module named 'torch'")

    def without():
        raise InputError("none")

    monkeypatch.setattr(needs, "NEEDS", (needs.Need("GPU", without, True),))
    assert needs.check() and "[extra]   GPU" in capsys.readouterr().out
    monkeypatch.setattr(needs, "NEEDS", (needs.Need("ONNX", broken),))
    assert (
        not needs.check()
        and "[missing] ONNX         No module named 'torch': pip install -r environment.txt"
        in capsys.readouterr().out
    )


def test_it_runs_before_anything_is_installed():
    """The verb itself needs nothing but Python."""
    probe = "import sys; sys.modules.update(torch=None, numpy=None, cv2=None); from dronekeypp.cli import main; main(['check'])"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    assert "[ok]      Python" in done.stdout and "[missing]" in done.stdout and "Traceback" not in done.stderr
