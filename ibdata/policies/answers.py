"""What a policy returns, as arrays of the right shape."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.errors import excerpt


class AnswerError(Exception):
    """A policy returned no valid answer, or the code of a user failed. The message names no place."""


def numbers(answer: Any, shape: tuple[int, ...], what: str) -> npt.NDArray[np.float64]:
    """An answer as an array of that shape, also a tensor of torch; masked values are NaN.

    Raises AnswerError if it is none.
    """
    tensor: Any = getattr(sys.modules.get("torch"), "Tensor", ())
    if isinstance(answer, tensor):
        answer = answer.double().numpy(force=True)
    if isinstance(answer, np.ma.MaskedArray):
        answer = np.ma.filled(answer.astype(np.float64), np.nan)
    try:
        if np.iscomplexobj(answer):
            raise TypeError
        found = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise AnswerError(f"found {excerpt(answer)}, expected {what} of shape {shape}") from None
    if found.shape != shape:
        shown = excerpt(answer) if found.ndim == 0 else f"{what} of shape {found.shape}"
        raise AnswerError(f"found {shown}, expected {what} of shape {shape}")
    return found


def actions_and_memory(answer: Any) -> tuple[Any, Any]:
    """The two parts of a `Decision`. AnswerError if it is none."""
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise AnswerError(f"found {type(answer).__name__}, expected a Decision of actions and memory")
    return answer
