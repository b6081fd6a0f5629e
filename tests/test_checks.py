"""Every exercise accepts its solution, knows an untouched stub, and names its mistakes.

Every notebook has its exercises, each with a hint and a solution that the exercise accepts.
"""

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from dronekeypp import checks
from dronekeypp.checks import CORRECT, NOTEBOOKS, UNTOUCHED, Exercise, Mistake

ROOT = Path(__file__).parents[1]
EXERCISES: dict[str, Exercise] = {}
for notebook in NOTEBOOKS:
    EXERCISES |= checks.exercises(notebook)
FOLDED = re.compile(r"<details>\s*<summary>(\w+)</summary>(.*?)</details>", re.S)
TITLE = re.compile(r"^### Exercise \d · .+ · [★☆]{3} · \d+ minutes$", re.M)

every_exercise = pytest.mark.parametrize("exercise", EXERCISES.values(), ids=EXERCISES.keys())


def stub(*inputs: Any) -> None:
    """As a notebook leaves it."""
    ...


@every_exercise
def test_the_solution_is_correct_and_the_stub_is_untouched(
    exercise: Exercise, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in range(20):
        assert exercise.judge(exercise.solution, seed) == CORRECT
    assert exercise.judge(stub) == UNTOUCHED
    exercise(stub)
    assert capsys.readouterr().out == f"{exercise.name}: {UNTOUCHED}\n"


@every_exercise
def test_every_mistake_is_named(exercise: Exercise) -> None:
    assert len(exercise.mistakes) >= 2
    for mistake in exercise.mistakes:
        assert len(mistake.message) < 140 and "\n" not in mistake.message
        for seed in range(20):
            assert exercise.judge(mistake.function, seed) == mistake.message


@every_exercise
def test_messages_are_sentences_and_differ(exercise: Exercise) -> None:
    messages = [mistake.message for mistake in exercise.mistakes]
    assert all(message.endswith(".") for message in messages)
    assert len(set(messages)) == len(messages)


@every_exercise
def test_any_other_answer_is_wrong(exercise: Exercise) -> None:
    def numbers_off(*inputs: Any) -> list[np.ndarray]:
        return [np.asarray(array, float) + 0.37 for array in checks.flat(exercise.solution(*inputs))]

    def another_shape(*inputs: Any) -> list[np.ndarray]:
        return [array[None] for array in checks.flat(exercise.solution(*inputs))]

    assert exercise.judge(numbers_off) not in (CORRECT, UNTOUCHED)
    assert exercise.judge(another_shape).startswith("wrong shape")


def test_names_are_unique() -> None:
    assert len(EXERCISES) == sum(len(checks.exercises(module)) for module in NOTEBOOKS)
    assert checks.crop_rays.name == "crop_rays"
    with pytest.raises(AttributeError, match="no exercise 'nothing'"):
        checks.nothing  # noqa: B018


def double(x: np.ndarray) -> np.ndarray:
    return 2 * x


def three_numbers(rng: np.random.Generator) -> tuple[np.ndarray]:
    return (rng.normal(size=3),)


DOUBLE = Exercise("double", double, three_numbers, [Mistake("You squared.", np.square)])


def test_the_judge() -> None:
    assert DOUBLE.judge(lambda x: x + x) == CORRECT
    assert DOUBLE.judge(lambda x: torch.tensor(2 * x)) == CORRECT
    assert DOUBLE.judge(np.square) == "You squared."
    assert DOUBLE.judge(lambda x: (2 * x)[None]) == "wrong shape: (1, 3), expected (3,)"
    assert DOUBLE.judge(lambda x: (x, x)) == "wrong shape: [(3,), (3,)], expected (3,)"
    assert DOUBLE.judge(lambda x: x * np.nan) == "wrong: your answer contains NaN"
    off_by_one = "wrong: the shape is right, but the numbers are off by up to 1"
    assert DOUBLE.judge(lambda x: 2 * x + 1) == off_by_one


def test_the_reader_may_change_the_inputs() -> None:
    def doubles_in_place(x: np.ndarray) -> np.ndarray:
        x *= 2
        return x

    assert DOUBLE.judge(doubles_in_place) == CORRECT


def test_not_implemented_is_untouched_and_other_errors_go_through() -> None:
    def unwritten(x: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def broken(x: np.ndarray) -> np.ndarray:
        return x[10]

    assert DOUBLE.judge(unwritten) == UNTOUCHED
    with pytest.raises(IndexError):
        DOUBLE.judge(broken)


# --- the notebooks ---


class Cell(NamedTuple):
    kind: str
    source: str
    outputs: list[dict[str, Any]]


def cells_of(module: str) -> list[Cell]:
    path = ROOT / "notebooks" / f"{NOTEBOOKS[module]}.ipynb"
    cells = []
    for cell in json.loads(path.read_text())["cells"]:
        cells.append(Cell(cell["cell_type"], "".join(cell["source"]), cell.get("outputs", [])))
    return cells


def namespace_after_imports(cells: list[Cell]) -> dict[str, Any]:
    """Run the first code cell with an import, and return what it defines."""
    imports = next(cell.source for cell in cells if cell.kind == "code" and "import" in cell.source)
    namespace: dict[str, Any] = {}
    exec(imports, namespace)
    return namespace


def parameters(name: str, source: str) -> str:
    """Return the parameters of the function my_NAME as they are written."""
    return re.search(rf"def my_{name}\((.*?)\)", source).group(1)


@pytest.mark.parametrize("module", NOTEBOOKS)
def test_a_notebook_has_its_exercises_each_with_a_hint_and_a_solution_that_passes(module: str) -> None:
    cells, exercises = cells_of(module), checks.exercises(module)
    namespace = namespace_after_imports(cells)
    assert 2 <= len(exercises) <= 4
    names = []
    for i, cell in enumerate(cells):
        call = re.search(r"^checks\.(\w+)\((\w+)\)$", cell.source, re.M)
        if cell.kind != "code" or not call:
            continue
        name = call.group(1)
        assert call.group(2) == f"my_{name}"
        names.append(name)
        assert ["".join(output["text"]) for output in cell.outputs] == [f"{name}: {UNTOUCHED}\n"]

        task = cells[i - 1]
        assert task.kind == "markdown" and TITLE.search(task.source), task.source[:80]
        folded = dict(FOLDED.findall(task.source))
        assert set(folded) == {"Hint", "Solution"} and len(folded["Hint"].strip()) > 20
        solution = re.search(r"```python\n(.*?)```", folded["Solution"], re.S).group(1)
        assert parameters(name, solution) == parameters(name, cell.source)
        solved = dict(namespace)
        exec(solution, solved)
        assert exercises[name].judge(solved[f"my_{name}"]) == CORRECT, name
    assert names == list(exercises)
