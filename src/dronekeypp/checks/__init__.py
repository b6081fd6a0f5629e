"""The exercises of the notebooks, which check themselves.

A notebook calls `checks.NAME(my_NAME)`. The exercise NAME then calls the reader's function with random
inputs, compares its answers with those of the solution, and prints one line: correct, or what is wrong.

Every notebook has a module here with its exercises. An exercise knows its solution and the mistakes that
people make. Each mistake is a function that makes it. A reader whose answers equal the answers of such a
function is told which mistake it is. In these modules a function that makes a mistake has a name that says
the mistake and no docstring: the message of its `Mistake` explains it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import torch

NOTEBOOKS = {  # the module of this package: the notebook whose exercises it holds
    "dataset": "01_dataset",
    "pnp": "02_pnp_scale_ambiguity",
    "encoder": "03_keypoint_encoder",
    "classifier": "04_cls_classifier",
    "embedding": "05_ray_embedding",
    "decoder": "06_pose_decoder",
    "training": "07_training",
    "evaluation": "08_evaluation_baselines",
    "ablation": "09_ablations",
    "realism": "10_realism",
    "sequences": "11_sequences_speed",
    "beyond": "12_beyond",
}
UNTOUCHED = "not solved yet: write the function above, then run this cell again"
CORRECT = "correct"
NUMBER_KINDS = "biuf"  # numpy's letters for boolean, integer, unsigned and floating-point arrays

Inputs = tuple[Any, ...]  # the arguments of one call
Answer = list[np.ndarray]  # what a function returned, see `flat`


@dataclass(frozen=True)
class Mistake:
    """A mistake that readers make.

    Attributes:
        message: what the reader is told, in whole sentences.
        function: a function that makes the mistake. It takes the same inputs as the solution.
    """

    message: str
    function: Callable[..., Any]


@dataclass(frozen=True)
class Exercise:
    """One exercise.

    Attributes:
        name: the name that the notebook uses, as in `checks.NAME(my_NAME)`.
        solution: the right function.
        inputs: takes a random generator and returns the arguments of one call, a tuple.
        mistakes: the known mistakes, the likeliest first.
        close: the largest difference between equal numbers, absolute and relative.
        tries: how many times inputs are drawn.
    """

    name: str
    solution: Callable[..., Any]
    inputs: Callable[[np.random.Generator], Inputs]
    mistakes: list[Mistake]
    close: float = 1e-5
    tries: int = 3

    def judge(self, function: Callable[..., Any], seed: int | None = None) -> str:
        """Compare a reader's function with the solution.

        Every function gets its own copy of the inputs, so a function may change them. An error that the
        reader's function raises is not caught: the reader sees its traceback.

        Args:
            function: the reader's function.
            seed: the seed of the random inputs. With None they differ from call to call.

        Returns:
            UNTOUCHED, CORRECT, or a message that says what is wrong.
        """
        rng = np.random.default_rng(seed)
        cases: list[Inputs] = []
        answers: list[Answer] = []
        expected: list[Answer] = []
        for _ in range(self.tries):
            inputs = self.inputs(rng)
            try:
                answer = function(*copied(inputs))
            except NotImplementedError:
                return UNTOUCHED
            if answer is None:
                return UNTOUCHED
            cases.append(inputs)
            answers.append(flat(answer))
            expected.append(flat(self.solution(*copied(inputs))))

        is_right = [same(answer, right, self.close) for answer, right in zip(answers, expected, strict=True)]
        if all(is_right):
            return CORRECT
        for mistake in self.mistakes:
            if self._explains(mistake, cases, answers):
                return mistake.message
        first_wrong = is_right.index(False)
        return difference(answers[first_wrong], expected[first_wrong])

    def _explains(self, mistake: Mistake, cases: list[Inputs], answers: list[Answer]) -> bool:
        """Tell whether the mistake's function gives the reader's answers in all cases."""
        for inputs, answer in zip(cases, answers, strict=True):
            if not same(answer, flat(mistake.function(*copied(inputs))), self.close):
                return False
        return True

    def __call__(self, function: Callable[..., Any]) -> None:
        """Print one line with the result of `judge`."""
        print(f"{self.name}: {self.judge(function)}")


def copied(value: Any) -> Any:
    """Return a deep copy of arrays and tensors in tuples, lists and dicts. Other values stay as they are."""
    if isinstance(value, (tuple, list)):
        return type(value)(copied(part) for part in value)
    if isinstance(value, dict):
        return {key: copied(part) for key, part in value.items()}
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, torch.Tensor):
        return value.clone()
    return value


def flat(answer: Any) -> Answer:
    """Turn an answer into a list of arrays.

    An answer is a number, an array or a tensor, or a tuple, list or dict of them. A dict is read in the order
    of its keys. A list of plain numbers is one array.
    """
    if isinstance(answer, dict):
        answer = [answer[key] for key in sorted(answer)]
    if isinstance(answer, tuple) or (isinstance(answer, list) and _holds_arrays(answer)):
        arrays = []
        for part in answer:
            arrays.extend(flat(part))
        return arrays
    if isinstance(answer, torch.Tensor):
        answer = answer.detach().cpu()
    return [np.asarray(answer)]


def _holds_arrays(answer: list[Any]) -> bool:
    """Tell whether a part of the list is more than a plain number."""
    return any(isinstance(part, (tuple, list, np.ndarray, torch.Tensor)) for part in answer)


def _shapes(arrays: Answer) -> list[tuple[int, ...]]:
    return [array.shape for array in arrays]


def _all_numbers(arrays: Answer) -> bool:
    """Tell whether the arrays hold numbers, and not text or objects."""
    return all(array.dtype.kind in NUMBER_KINDS for array in arrays)


def same(first: Answer, second: Answer, close: float) -> bool:
    """Tell whether two answers have equally many arrays with the same shapes and values (NaN equals NaN)."""
    if _shapes(first) != _shapes(second):
        return False
    numbers = _all_numbers(first) and _all_numbers(second)
    for a, b in zip(first, second, strict=True):
        if numbers:
            equal = np.allclose(a, b, rtol=close, atol=close, equal_nan=True)
        else:
            equal = np.array_equal(a, b)
        if not equal:
            return False
    return True


def difference(answer: Answer, right: Answer) -> str:
    """Say in one line how an answer differs from the right one, if no known mistake explains it."""
    if _shapes(answer) != _shapes(right):
        return f"wrong shape: {_shape_text(answer)}, expected {_shape_text(right)}"
    if not (_all_numbers(answer) and _all_numbers(right)):
        return f"wrong: {answer[0]!r}, expected {right[0]!r}"
    largest = 0.0
    for a, r in zip(answer, right, strict=True):
        if np.isnan(a).any() and not np.isnan(r).any():
            return "wrong: your answer contains NaN"
        largest = max(largest, float(np.abs(np.asarray(a, float) - r).max(initial=0)))
    return f"wrong: the shape is right, but the numbers are off by up to {largest:.2g}"


def _shape_text(arrays: Answer) -> str:
    """Return the shape of a single array, or the list of the shapes of several."""
    shapes = _shapes(arrays)
    return str(shapes[0]) if len(shapes) == 1 else str(shapes)


def exercises(module: str) -> dict[str, Exercise]:
    """Return the exercises of a module of NOTEBOOKS by name, in the notebook's order."""
    module_exercises = import_module(f"{__name__}.{module}").EXERCISES
    return {exercise.name: exercise for exercise in module_exercises}


def __getattr__(name: str) -> Exercise:
    """Return the exercise `name`, whichever notebook it belongs to.

    Raises:
        AttributeError: no notebook has an exercise of this name.
    """
    if not name.startswith("_"):
        for module in NOTEBOOKS:
            module_exercises = exercises(module)
            if name in module_exercises:
                return module_exercises[name]
    raise AttributeError(f"dronekeypp.checks has no exercise {name!r}")
