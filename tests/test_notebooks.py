"""What nbval does not check of the notebooks.

Every notebook was run from top to bottom, its outputs are clean, and what it builds is exactly what the
package holds.
"""

import ast
import importlib
import inspect
import json
import re
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
IDS = [path.stem for path in NOTEBOOKS]
DEFINITIONS = (ast.FunctionDef, ast.ClassDef)


def source_of(cell):
    return "".join(cell["source"])


def tags_of(cell):
    return cell["metadata"].get("tags", [])


def cells_of(path, kind="code"):
    """The cells of one kind of a notebook, without empty ones."""
    cells = []
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == kind and source_of(cell).strip():
            cells.append(cell)
    return cells


def test_there_are_notebooks_in_order():
    """The notebooks' names start with 01, 02 and so on, without a gap."""
    assert NOTEBOOKS
    for number, path in enumerate(NOTEBOOKS, 1):
        assert path.stem[:2] == f"{number:02d}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_was_run_from_top_to_bottom(path):
    counts = [cell["execution_count"] for cell in cells_of(path)]
    assert counts == list(range(1, len(counts) + 1))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_outputs_are_clean(path):
    """No output is an error, a warning or an SVG, no path of a machine is shown, and the file is small."""
    for cell in cells_of(path):
        for output in cell["outputs"]:
            assert output.get("name") != "stderr", output
            assert output["output_type"] != "error"
            assert "image/svg+xml" not in output.get("data", {})
    assert not re.search(r"(?<![\w.])/(?:root|home|tmp|work|Users)/", path.read_text()), "a path of a machine"
    assert path.stat().st_size < 4e6


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_few_outputs_are_ignored_and_each_says_why(path):
    """At most two cells of a notebook are left out of the comparison, and each gives its reason.

    A cell is left out by a tag or by a comment for nbval. A cell that has both counts twice.
    """
    ignored = []
    for cell in cells_of(path):
        if {"nbval-ignore-output", "nbval-skip"} & set(tags_of(cell)):
            ignored.append(cell)
        if "NBVAL_" in source_of(cell):
            ignored.append(cell)
    assert len(ignored) <= 2
    for cell in ignored:
        assert cell["metadata"].get("reason"), source_of(cell)[:80]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_the_readme_lists_it(path):
    assert path.name in (ROOT / "README.md").read_text()


def readme_row(path):
    """The line of the README's table of notebooks that links to a notebook."""
    for line in (ROOT / "README.md").read_text().splitlines():
        if line.startswith("|") and f"({path.parent.name}/{path.name})" in line:
            return line
    raise AssertionError(f"the README has no row for {path.name}")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_it_promises_no_fewer_minutes_than_the_readme_says_it_takes(path):
    """The first cell promises at least the minutes that the README measured. The memory is below 4 GB."""
    first_cell = source_of(cells_of(path, "markdown")[0])
    promised = re.search(r"\*\*Time\*\* about (\d+) minutes? on two cores", first_cell)
    minutes, memory = re.search(r"\| ([\d.]+) \| ([\d.]+) GB \|$", readme_row(path)).groups()
    assert 0 < float(minutes) <= int(promised.group(1))
    assert 0 < float(memory) < 4


# --- A notebook builds, the package holds: both must be the same code ---------------------------------------


class WithoutDocstringsAndHints(ast.NodeTransformer):
    """It removes what a notebook may leave out: docstrings, annotations, and the check of the arguments."""

    def without_docstring(self, node):
        self.generic_visit(node)
        first = node.body[0] if node.body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            node.body = node.body[1:] or [ast.Pass()]
        return node

    def visit_FunctionDef(self, node):
        node.returns, node.type_comment = None, None
        kept = [part for part in node.decorator_list if not ast.unparse(part).startswith("checks(")]
        node.decorator_list = kept
        return self.without_docstring(node)

    def visit_ClassDef(self, node):
        return self.without_docstring(node)

    def visit_arg(self, node):
        node.annotation = None
        return node

    def visit_AnnAssign(self, node):
        self.generic_visit(node)
        return ast.Assign([node.target], node.value) if node.value else None


def code_alone(source):
    """The syntax tree of a piece of source, as text, without docstrings and annotations."""
    return ast.dump(WithoutDocstringsAndHints().visit(ast.parse(textwrap.dedent(source))))


def names_built_by(cell):
    """The dotted names in a cell's tags builds:package.module.Name."""
    return [tag.removeprefix("builds:") for tag in tags_of(cell) if tag.startswith("builds:")]


def built_cells():
    """A test parameter (cell source, dotted name) for every name that a notebook's cell builds."""
    parameters = []
    for path in NOTEBOOKS:
        for cell in cells_of(path):
            for name in names_built_by(cell):
                test_id = f"{path.stem[:2]}-{name.rsplit('.', 1)[1]}"
                parameters.append(pytest.param(source_of(cell), name, id=test_id))
    return parameters


@pytest.mark.parametrize(("source", "name"), built_cells())
def test_what_a_notebook_builds_is_what_the_package_holds(source, name):
    module, attribute = name.rsplit(".", 1)
    in_package = inspect.getsource(getattr(importlib.import_module(module), attribute))
    definitions = [node for node in ast.parse(source).body if getattr(node, "name", None) == attribute]
    assert definitions, f"the cell tagged {name} does not define {attribute}"
    assert code_alone(ast.unparse(definitions[0])) == code_alone(in_package)


# Functions of notebooks that have the name of one in the package and are not the same, and why that is on
# purpose.
OF_THE_SAME_NAME = {
    "01_dataset": {"describe": "of a flight's geometry; the package describes data sets"},
    "03_keypoint_encoder": {
        "look": "a look inside the encoder; the package looks up colours",
        "fit": "the shortest loop that trains an encoder on stored features; notebook 07 builds towards the "
        "package's",
    },
    "04_cls_classifier": {
        "fit": "as in notebook 03",
        "measure": "two numbers on stored features; notebook 08 explains the package's twelve",
    },
    "05_ray_embedding": {"box": "around points; the package reads one from the command line"},
    "06_pose_decoder": {"run": "of the decoder on rows of a table; the package's is a round of timing"},
    "08_evaluation_baselines": {
        "difference": "of two methods with one seed; notebook 09 explains the seeds, which the package's "
        "asks for",
        "medians": "along an axis of a figure; the package's are of a table",
        "smooth": "in frames and by hand; notebook 11 uses the package's, in seconds and with gaps",
    },
    "11_sequences_speed": {
        "flights_of": "of recorded predictions; the package groups pictures",
        "title": "of a row of the speed table",
    },
}


def names_defined_in(source):
    """The functions and classes that a piece of source defines at the top."""
    return {node.name for node in ast.parse(source).body if isinstance(node, DEFINITIONS)}


def package_names():
    """Every public function and class of the package but the exercises."""
    names = set()
    for path in (ROOT / "src" / "dronekeypp").rglob("*.py"):
        if "checks" not in path.parts:
            names |= names_defined_in(path.read_text())
    return {name for name in names if not name.startswith("_")}


def test_what_has_a_name_of_the_package_is_the_same_or_says_why_not():
    """A notebook's function with a name of the package is either built (and compared) or listed above."""
    names = package_names()
    same_name = {}
    for path in NOTEBOOKS:
        for cell in cells_of(path):
            built = {name.rsplit(".", 1)[1] for name in names_built_by(cell)}
            shared = names_defined_in(source_of(cell)) & names - built
            if shared:
                same_name[path.stem] = same_name.get(path.stem, set()) | shared
    expected = {notebook: set(reasons) for notebook, reasons in OF_THE_SAME_NAME.items()}
    assert same_name == expected


def test_the_comparison_sees_a_changed_line():
    """The comparison ignores docstrings and hints, and nothing else."""
    function = "def f(x: int) -> int:\n    'doc'\n    return x + 1\n"
    assert code_alone(function) == code_alone("def f(x):\n    return x + 1\n")
    assert code_alone(function) != code_alone("def f(x):\n    return x + 2\n")
