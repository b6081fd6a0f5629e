"""Every exercise takes its solution, knows an untouched stub, and names the mistakes it says it names; every notebook's exercises are complete."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from dronekeypp import checks
from dronekeypp.checks import CORRECT, NOTEBOOKS, UNTOUCHED, Exercise

ROOT = Path(__file__).parents[1]
WRITTEN = [module for module in NOTEBOOKS if (Path(checks.__file__).parent / f"{module}.py").exists()]
ALL = [(module, exercise) for module in WRITTEN for exercise in checks.exercises(module).values()]
IDS = [f"{module}-{exercise.name}" for module, exercise in ALL]
FOLDED = re.compile(r"<details>\s*<summary>(\w+)</summary>(.*?)</details>", re.S)


def stub(*given):
    """As a notebook leaves it."""
    ...


@pytest.mark.parametrize(("module", "exercise"), ALL, ids=IDS)
def test_the_solution_passes_and_the_stub_does_not(module, exercise, capsys):
    for seed in range(20):
        assert exercise.judge(exercise.solution, seed) == CORRECT
    assert exercise.judge(stub) == UNTOUCHED
    exercise(stub)
    assert capsys.readouterr().out == f"{exercise.name}: {UNTOUCHED}\n"


@pytest.mark.parametrize(("module", "exercise"), ALL, ids=IDS)
def test_every_mistake_is_named(module, exercise):
    assert len(exercise.mistakes) >= 2
    for message, wrong in exercise.mistakes.items():
        assert len(message) < 140 and "\n" not in message
        for seed in range(20):
            assert exercise.judge(wrong, seed) == message


@pytest.mark.parametrize(("module", "exercise"), ALL, ids=IDS)
def test_any_other_answer_is_wrong(module, exercise):
    """Numbers a little off, and another shape."""

    def off(*given):
        return [np.asarray(v, float) + 0.37 for v in checks.flat(exercise.solution(*given))]

    def wrapped(*given):
        return [np.asarray(v)[None] for v in checks.flat(exercise.solution(*given))]

    assert (
        "off" in exercise.judge(off)
        or exercise.judge(off) in exercise.mistakes
        or "expected" in exercise.judge(off)
    )
    assert exercise.judge(wrapped).startswith("wrong shape")


def test_names_are_found_once():
    names = [exercise.name for _, exercise in ALL]
    assert len(set(names)) == len(names)
    assert checks.crop_rays.name == "crop_rays"
    with pytest.raises(AttributeError, match="no exercise 'nothing'"):
        checks.nothing  # noqa: B018


def test_the_judge():
    double = Exercise(
        "double", lambda x: 2 * x, lambda rng: (rng.normal(size=3),), {"you squared": np.square}
    )
    assert double.judge(lambda x: x + x) == CORRECT
    assert double.judge(np.square) == "you squared"
    assert double.judge(lambda x: (2 * x)[None]) == "wrong shape: (1, 3), expected (3,)"
    assert double.judge(lambda x: x * np.nan) == "wrong: there are NaN in the answer"
    assert double.judge(lambda x: 2 * x + 1) == "wrong: right shape, but numbers up to 1 off"
    assert double.judge(lambda x: torch.tensor(2 * x)) == CORRECT

    def destroys(x):
        x *= 2  # the reader's own copy
        return x

    def unwritten(x):
        raise NotImplementedError

    def broken(x):
        return x[10]

    assert double.judge(destroys) == CORRECT and double.judge(unwritten) == UNTOUCHED
    with pytest.raises(IndexError):
        double.judge(broken)


# --- the notebooks ---------------------------------------------------------------------------------------------------------------------


def cells(module):
    path = ROOT / "notebooks" / f"{NOTEBOOKS[module]}.ipynb"
    return [
        (cell["cell_type"], "".join(cell["source"]), cell.get("outputs"))
        for cell in json.loads(path.read_text())["cells"]
    ]


@pytest.mark.parametrize("module", NOTEBOOKS)
def test_a_notebook_has_its_exercises_each_with_a_hint_and_a_solution_that_passes(module):
    found, known = cells(module), checks.exercises(module)
    assert 2 <= len(known) <= 4
    asked = [
        re.search(r"^checks\.(\w+)\(my_(\w+)\)$", source, re.M) for kind, source, _ in found if kind == "code"
    ]
    assert [m.group(1) for m in asked if m] == list(known) == [m.group(2) for m in asked if m]
    imports = {}
    exec(next(source for kind, source, _ in found if kind == "code" and "import" in source), imports)
    for i, (_, source, outputs) in enumerate(found):
        called = re.search(r"^checks\.(\w+)\(", source, re.M)
        if not called:
            continue
        name = called.group(1)
        assert ["".join(output["text"]) for output in outputs] == [f"{name}: {UNTOUCHED}\n"]
        kind, text, _ = found[i - 1]
        assert kind == "markdown" and re.search(
            r"^### Exercise \d · .+ · [★☆]{3} · \d+ minutes$", text, re.M
        ), text[:80]
        folded = dict(FOLDED.findall(text))
        assert set(folded) == {"Hint", "Solution"} and len(folded["Hint"].strip()) > 20
        code = re.search(r"```python\n(.*?)```", folded["Solution"], re.S).group(1)
        room = dict(imports)
        exec(code, room)
        assert known[name].judge(room[f"my_{name}"]) == CORRECT, name
        signature = re.search(rf"def my_{name}\((.*?)\)", source).group(1)
        assert re.search(rf"def my_{name}\((.*?)\)", code).group(1) == signature
