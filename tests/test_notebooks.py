"""What nbval does not check: that every notebook was run from top to bottom, is clean, and builds exactly what the package holds."""

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
IDS = [p.stem for p in NOTEBOOKS]


def cells(path, kind="code"):
    found = [c for c in json.loads(path.read_text())["cells"] if c["cell_type"] == kind]
    return [c for c in found if "".join(c["source"]).strip()]


def test_there_are_notebooks_in_order():
    assert [p.stem[:2] for p in NOTEBOOKS] == [f"{i:02d}" for i in range(1, len(NOTEBOOKS) + 1)] and NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_was_run_from_top_to_bottom(path):
    assert [c["execution_count"] for c in cells(path)] == list(range(1, len(cells(path)) + 1))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_outputs_are_clean(path):
    for cell in cells(path):
        for output in cell["outputs"]:
            assert output.get("name") != "stderr", output
            assert output["output_type"] != "error"
            assert "image/svg+xml" not in output.get("data", {})
    assert not re.search(r"(?<![\w.])/(?:root|home|tmp|work|Users)/", path.read_text()), "a path of a machine"
    assert path.stat().st_size < 4e6


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_few_outputs_are_ignored_and_each_says_why(path):
    ignored = [
        c for c in cells(path) if set(c["metadata"].get("tags", [])) & {"nbval-ignore-output", "nbval-skip"}
    ]
    ignored += [c for c in cells(path) if "NBVAL_" in "".join(c["source"])]
    assert len(ignored) <= 2
    for cell in ignored:
        assert cell["metadata"].get("reason"), "".join(cell["source"])[:80]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_the_readme_lists_it(path):
    assert path.name in (ROOT / "README.md").read_text()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_it_promises_no_fewer_minutes_than_the_readme_says_it_takes(path):
    promised = re.search(
        r"\*\*Time\*\* about (\d+) minutes? on two cores", "".join(cells(path, "markdown")[0]["source"])
    )
    row = next(
        line
        for line in (ROOT / "README.md").read_text().splitlines()
        if f"({path.parent.name}/{path.name})" in line and line.startswith("|")
    )
    minutes, memory = re.search(r"\| ([\d.]+) \| ([\d.]+) GB \|$", row).groups()
    assert 0 < float(minutes) <= int(promised.group(1)) and 0 < float(memory) < 4


# --- a notebook builds, the package holds: both must be the same code -------------------------------------------------------------------


class _Bare(ast.NodeTransformer):
    """Without docstrings and annotations, which a notebook may leave out."""

    def _strip(self, node):
        self.generic_visit(node)
        if (
            node.body
            and isinstance(node.body[0], ast.Expr)
            and isinstance(getattr(node.body[0], "value", None), ast.Constant)
        ):
            node.body = node.body[1:] or [ast.Pass()]
        return node

    def visit_FunctionDef(self, node):
        node.returns, node.type_comment = None, None
        return self._strip(node)

    def visit_ClassDef(self, node):
        return self._strip(node)

    def visit_arg(self, node):
        node.annotation = None
        return node

    def visit_AnnAssign(self, node):
        self.generic_visit(node)
        return ast.Assign([node.target], node.value) if node.value else None


def bare(source):
    return ast.dump(_Bare().visit(ast.parse(textwrap.dedent(source))))


def built():
    """(notebook, cell source, dotted name) of every code cell with a tag builds:package.module.Name."""
    for path in NOTEBOOKS:
        for cell in cells(path):
            for tag in cell["metadata"].get("tags", []):
                if tag.startswith("builds:"):
                    yield pytest.param(
                        "".join(cell["source"]),
                        tag[len("builds:") :],
                        id=f"{path.stem[:2]}-{tag.rsplit('.', 1)[1]}",
                    )


@pytest.mark.parametrize(("source", "name"), list(built()))
def test_what_a_notebook_builds_is_what_the_package_holds(source, name):
    module, attribute = name.rsplit(".", 1)
    ours = inspect.getsource(getattr(importlib.import_module(module), attribute))
    there = [n for n in ast.parse(source).body if getattr(n, "name", None) == attribute]
    assert there, f"the cell tagged {name} does not define {attribute}"
    assert bare(ast.unparse(there[0])) == bare(ours)


# A function of a notebook that has the name of one in the package and is not the same, and why that is on purpose.
OF_THE_SAME_NAME = {
    ("01_dataset", "describe"): "of a flight's geometry; the package describes data sets",
    ("03_keypoint_encoder", "look"): "a look inside the encoder; the package looks up colours",
    (
        "03_keypoint_encoder",
        "fit",
    ): "the shortest loop that trains an encoder on stored features; notebook 07 builds towards the package's",
    ("04_cls_classifier", "fit"): "as in notebook 03",
    (
        "04_cls_classifier",
        "measure",
    ): "two numbers on stored features; notebook 08 explains the package's twelve",
    (
        "08_evaluation_baselines",
        "difference",
    ): "of two methods with one seed; notebook 09 explains the seeds, which the package's asks for",
    ("08_evaluation_baselines", "medians"): "along an axis of a figure; the package's are of a table",
    (
        "08_evaluation_baselines",
        "smooth",
    ): "in frames and by hand; notebook 11 uses the package's, in seconds and with gaps",
    ("11_sequences_speed", "flights_of"): "of recorded predictions; the package groups pictures",
    ("11_sequences_speed", "title"): "of a row of the speed table",
}


def package_names():
    """Every public function and class of the package but the exercises."""
    files = [p for p in (ROOT / "src" / "dronekeypp").rglob("*.py") if "checks" not in p.parts]
    kinds = (ast.FunctionDef, ast.ClassDef)
    return {
        n.name
        for p in files
        for n in ast.parse(p.read_text()).body
        if isinstance(n, kinds) and not n.name.startswith("_")
    }


def test_what_has_a_name_of_the_package_is_the_same_or_says_why_not():
    names, found = package_names(), set()
    for path in NOTEBOOKS:
        for cell in cells(path):
            tagged = {
                tag.rsplit(".", 1)[1] for tag in cell["metadata"].get("tags", []) if tag.startswith("builds:")
            }
            defined = {
                n.name
                for n in ast.parse("".join(cell["source"])).body
                if isinstance(n, (ast.FunctionDef, ast.ClassDef))
            }
            found |= {(path.stem, name) for name in defined & names - tagged}
    assert found == set(OF_THE_SAME_NAME)


def test_the_comparison_sees_a_changed_line():
    a = "def f(x: int) -> int:\n    'doc'\n    return x + 1\n"
    assert bare(a) == bare("def f(x):\n    return x + 1\n")
    assert bare(a) != bare("def f(x):\n    return x + 2\n")
