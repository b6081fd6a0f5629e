"""Check what a caller hands to the package, and call it by the names of the arguments.

Only the functions that people call check; what they call in turn takes it for checked. While torch records a
graph of a function (`torch.compile`, `torch.export`, `torch.jit`) values are not known, and nothing is
checked.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from dronekeypp.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])
# The size of a dimension: a number, or a letter that stands for one number in all arguments.
Shape = Sequence[int | str]


def tracing() -> bool:
    """Say whether torch is recording a graph of what runs now."""
    return torch.compiler.is_compiling() or torch.jit.is_tracing()


def checks(check: Callable[..., None]) -> Callable[[Function], Function]:
    """Return a decorator for functions whose arguments `check` looks at first.

    `check` takes the same arguments, and raises InputError. While a graph is recorded it is not called.
    """

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def checked(*args: Any, **kwargs: Any) -> Any:
            if not tracing():
                check(*args, **kwargs)
            return function(*args, **kwargs)

        return checked

    return decorate


def check_ends(name: str, value: Any, *end: int) -> None:
    """Check that the shape of an array or tensor ends as it should: (…, *end).

    Raises:
        InputError: it does not, or the value has no shape.
    """
    shape = getattr(value, "shape", None)
    if shape is None:
        raise InputError(f"{name} is a {type(value).__name__}, an array or a tensor is needed")
    if tuple(shape[-len(end) :]) != end:
        raise InputError(f"{name} has shape {_written(shape)}, needed is {_written(('…', *end))}")


def check_shapes(**arguments: tuple[Any, Shape]) -> None:
    """Check the shapes of several arguments, which share their letters.

    `check_shapes(R=(R, ("B", 3, 3)), t=(t, ("B", 3)))` says that there are as many R as t. An argument that
    is None is passed over.

    Raises:
        InputError: a shape does not fit. The message names the argument.
    """
    letters: dict[str, tuple[int, str]] = {}
    for name, (value, wanted) in arguments.items():
        if value is None:
            continue
        shape = getattr(value, "shape", None)
        if shape is None:
            raise InputError(f"{name} is a {type(value).__name__}, an array or a tensor is needed")
        if len(shape) != len(wanted):
            raise InputError(f"{name} has shape {_written(shape)}, needed is {_written(wanted)}")
        for size, want in zip(shape, wanted, strict=True):
            known, where = letters.setdefault(want, (size, name)) if isinstance(want, str) else (want, "")
            if size != known:
                beside = f", and {where} has {want} = {known}" if where else ""
                raise InputError(f"{name} has shape {_written(shape)}, needed is {_written(wanted)}{beside}")


def _written(shape: Sequence[int | str]) -> str:
    """Return a shape as it is written in docstrings, such as (B, 3)."""
    sizes = ", ".join(str(size) for size in shape)
    return f"({sizes},)" if len(shape) == 1 else f"({sizes})"


def as_float64(value: Any, name: str) -> np.ndarray:
    """Return numbers as a float64 array.

    Raises:
        InputError: they are no numbers, or complex ones.
    """
    if isinstance(value, Tensor):
        value = value.detach().cpu()
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers ({error})") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds {array.dtype} values, numbers are needed")
    return array.astype(np.float64)


def check_finite(name: str, value: np.ndarray) -> None:
    """Check that an array holds neither NaN nor infinity.

    Raises:
        InputError: it does.
    """
    if not np.isfinite(value).all():
        raise InputError(f"{name} holds NaN or infinity")


def check_covariance(name: str, covariance: np.ndarray, tolerance: float = 1e-3) -> None:
    """Check that matrices (…, N, N) are covariances: symmetric, and no variance in any direction is negative.

    Args:
        name: what a message calls them.
        covariance: float64.
        tolerance: how far their correlations may be from that. Networks compute them in float32.

    Raises:
        InputError: they are not.
    """
    check_finite(name, covariance)
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)  # (…, N)
    if (variances < 0).any():
        raise InputError(f"{name} is no covariance: a variance is {variances.min():g}")
    sigma = np.sqrt(np.where(variances > 0, variances, 1))
    # Of radians and metres together one is far larger; a correlation has no unit.
    correlation = covariance / (sigma[..., :, None] * sigma[..., None, :])
    if (np.abs(correlation - correlation.swapaxes(-1, -2)) > tolerance).any():
        raise InputError(f"{name} is no covariance: not symmetric")
    least = np.linalg.eigvalsh((correlation + correlation.swapaxes(-1, -2)) / 2).min(initial=0)
    if least < -tolerance:
        raise InputError(f"{name} is no covariance: indefinite, so the variance of a sum is negative")
