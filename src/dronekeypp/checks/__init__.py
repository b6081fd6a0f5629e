"""The course's exercises check themselves: `checks.rays(my_rays)` tries a reader's function on fresh random input and names the likely mistake.

Every notebook has a module here with its exercises. An exercise is its solution, input to try it on, and the mistakes people make, each as the
function that makes it: an answer that equals a mistake's answer is told so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
import torch

NOTEBOOKS = {  # module here: its notebook
    "dataset": "01_dataset", "pnp": "02_pnp_scale_ambiguity", "encoder": "03_keypoint_encoder", "classifier": "04_cls_classifier",
    "embedding": "05_ray_embedding", "decoder": "06_pose_decoder", "training": "07_training", "evaluation": "08_evaluation_baselines",
    "ablation": "09_ablations", "realism": "10_realism", "sequences": "11_sequences_speed", "beyond": "12_beyond",
}  # fmt: skip
UNTOUCHED = "not solved yet: write the function above, then run this cell again"
CORRECT = "correct"


@dataclass(frozen=True)
class Exercise:
    """One exercise.

    Args:
        name: what the notebook calls: `checks.NAME(my_NAME)`.
        solution: the right function. It is never handed the reader's arrays to change: everybody gets copies.
        inputs: from a random generator the arguments of one try, a tuple.
        mistakes: {what went wrong, as the reader is told it: the function that does it wrong}, the likeliest first.
        close: largest difference that counts as equal, absolute and relative. tries: how many inputs are drawn.
    """

    name: str
    solution: Callable
    inputs: Callable[[np.random.Generator], tuple]
    mistakes: dict[str, Callable] = field(default_factory=dict)
    close: float = 1e-5
    tries: int = 3

    def judge(self, function: Callable, seed: int | None = None) -> str:
        """UNTOUCHED, CORRECT, or what is wrong. An error raised by the reader's function goes through, with its traceback."""
        rng, cases = np.random.default_rng(seed), []
        for _ in range(self.tries):
            given = self.inputs(rng)
            try:
                answer = function(*copied(given))
            except NotImplementedError:
                answer = None
            if answer is None:
                return UNTOUCHED
            cases.append((given, flat(answer), flat(self.solution(*copied(given)))))
        if all(same(answer, right, self.close) for _, answer, right in cases):
            return CORRECT
        for message, wrong in self.mistakes.items():
            if all(same(answer, flat(wrong(*copied(given))), self.close) for given, answer, _ in cases):
                return message
        return difference(
            *next((answer, right) for _, answer, right in cases if not same(answer, right, self.close))
        )

    def __call__(self, function: Callable) -> None:
        """Print the verdict, one line."""
        print(f"{self.name}: {self.judge(function)}")


def copied(value: Any) -> Any:
    """A deep copy of arrays and tensors in tuples, lists and dicts; anything else as it is."""
    if isinstance(value, (tuple, list)):
        return type(value)(copied(v) for v in value)
    if isinstance(value, dict):
        return {key: copied(v) for key, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.copy()
    return value.clone() if torch.is_tensor(value) else value


def flat(answer: Any) -> list[np.ndarray]:
    """An answer as a list of arrays: numbers, arrays, tensors, or a tuple, list or dict of them."""
    if isinstance(answer, dict):
        answer = [answer[key] for key in sorted(answer)]
    if isinstance(answer, tuple) or (
        isinstance(answer, list)
        and any(isinstance(v, (tuple, list, np.ndarray, torch.Tensor)) for v in answer)
    ):
        return [array for part in answer for array in flat(part)]
    return [np.asarray(answer.detach().cpu() if torch.is_tensor(answer) else answer)]


def same(one: list[np.ndarray], other: list[np.ndarray], close: float) -> bool:
    """Whether two answers agree in number, shapes and values (NaN equals NaN)."""
    if [array.shape for array in one] != [array.shape for array in other]:
        return False
    pairs = zip(one, other, strict=True)
    if any(array.dtype.kind not in "biuf" for array in (*one, *other)):
        return all(np.array_equal(a, b) for a, b in pairs)
    return all(np.allclose(a, b, rtol=close, atol=close, equal_nan=True) for a, b in pairs)


def difference(answer: list[np.ndarray], right: list[np.ndarray]) -> str:
    """In a line, how an answer that fits no known mistake differs from the right one."""
    shapes = [tuple(array.shape) for array in answer], [tuple(array.shape) for array in right]
    if shapes[0] != shapes[1]:
        one, other = (s[0] if len(s) == 1 else s for s in shapes)
        return f"wrong shape: {one}, expected {other}"
    if any(array.dtype.kind not in "biuf" for array in (*answer, *right)):
        return f"wrong: {answer[0]!r}, expected {right[0]!r}"
    if any(np.isnan(a).any() and not np.isnan(r).any() for a, r in zip(answer, right, strict=True)):
        return "wrong: there are NaN in the answer"
    off = max(
        float(np.abs(np.asarray(a, float) - r).max(initial=0)) for a, r in zip(answer, right, strict=True)
    )
    return f"wrong: right shape, but numbers up to {off:.2g} off"


def exercises(module: str) -> dict[str, Exercise]:
    """The exercises of a module of NOTEBOOKS by name, in the notebook's order."""
    return {exercise.name: exercise for exercise in import_module(f"{__name__}.{module}").EXERCISES}


def __getattr__(name: str) -> Exercise:
    """`checks.NAME`: any exercise of any notebook."""
    if not name.startswith("_"):
        for module in NOTEBOOKS:
            try:
                found = exercises(module)
            except ModuleNotFoundError:
                continue
            if name in found:
                return found[name]
    raise AttributeError(f"dronekeypp.checks has no exercise {name!r}")
