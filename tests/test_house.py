"""How the house is built: nothing imported from above, no circles, 110 columns; ruff has nothing to say."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "dronekeypp"
COLUMNS = 110

# From the ground up. A room may import the rooms below its floor; two of one floor do not know each other.
FLOORS = (
    ("errors", "checked", "processes", "output", "files", "schema", "settings", "classes", "colours"),
    ("camera", "rotations", "pnp", "augment"),
    ("environments",),
    ("sixdronesyn",),
    ("stored",),
    ("frame_dataset",),
    ("data",),
    ("checkpoint",),
    ("model",),
    ("exported",),
    ("baselines", "sequences", "footage", "realism", "plots", "presets"),
    ("evaluate",),
    ("train", "export", "predict", "convert"),
    ("pretrain", "bench"),
    ("checks",),
    ("needs",),
    ("reproduce",),
    ("arguments",),
    ("cli",),
    ("__main__",),
)
# These stand on one floor because they are small, and know each other in this order.
NEIGHBOURS = (*FLOORS[0], *FLOORS[1])


def modules():
    """Every module of the package by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = path
    return found


MODULES = modules()


def imports(path):
    """The modules of this package that a file imports, at the top or inside a function."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            for alias in node.names:
                deeper = f"{node.module}.{alias.name}"
                names.add(deeper if deeper in MODULES else node.module)
    return {name for name in names if name in MODULES}


def room(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else None


def floor(name):
    return next(i for i, rooms in enumerate(FLOORS) if name in rooms)


def test_every_room_has_a_floor():
    rooms = {room(module) for module in MODULES} - {None}
    assert rooms == {name for rooms_here in FLOORS for name in rooms_here}


@pytest.mark.parametrize("module", [name for name in MODULES if room(name)])
def test_nothing_is_imported_from_above(module):
    here = room(module)
    for imported in imports(MODULES[module]):
        there = room(imported)
        if there in (None, here):
            continue
        if here in NEIGHBOURS and there in NEIGHBOURS:
            assert NEIGHBOURS.index(there) < NEIGHBOURS.index(here), f"{module} imports {imported}"
        else:
            assert floor(there) < floor(here), f"{module} imports {imported}"


def test_there_are_no_circles():
    """Depth first over the imports: coming back to a module that is still open is a circle."""
    done, open_now = set(), []

    def visit(module):
        if module in done:
            return
        assert module not in open_now, " -> ".join([*open_now[open_now.index(module) :], module])
        open_now.append(module)
        for imported in sorted(imports(MODULES[module]) - {module}):
            visit(imported)
        done.add(open_now.pop())

    for module in MODULES:
        visit(module)


def test_no_decoder_is_asked_for_by_name():
    """Outside the registry nobody knows what decoders there are."""
    for name, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text())):
            compared = isinstance(node, ast.Compare) and ast.unparse(node)
            if compared and ("pose ==" in compared or ".head is" in compared):
                raise AssertionError(f"{name} line {node.lineno}: {compared}")


def long_lines(text):
    return [f"line {n}: {len(line)}" for n, line in enumerate(text.splitlines(), 1) if len(line) > COLUMNS]


@pytest.mark.parametrize("folder", ["src", "tests", "notebooks"])
def test_no_line_is_longer_than_110_columns(folder):
    for path in sorted((ROOT / folder).rglob("*.py")):
        assert not long_lines(path.read_text()), path
    for path in sorted((ROOT / folder).rglob("*.ipynb")):
        for number, cell in enumerate(json.loads(path.read_text())["cells"]):
            if cell["cell_type"] == "code":
                assert not long_lines("".join(cell["source"])), f"{path.name} cell {number}"


@pytest.mark.parametrize("words", [("check",), ("format", "--check")])
def test_ruff_has_nothing_to_say(words):
    command = [sys.executable, "-m", "ruff", *words, "--no-cache", "src", "tests", "notebooks/conftest.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
