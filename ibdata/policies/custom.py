"""`kind: custom` of an experiment: a policy whose code is not part of ibdata."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from functools import cached_property
from importlib import import_module
from pathlib import Path
from threading import RLock
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, PrivateAttr, SerializerFunctionWrapHandler, model_serializer, model_validator

from ibdata.errors import IbdataError, UsageError, printable
from ibdata.policies.adapter import Adapter
from ibdata.policies.base import Deterministic, Floats, History
from ibdata.policies.code_places import code_places, import_from, located, two_places
from ibdata.policies.given import Decision, Given
from ibdata.policies.parameters import Parameters
from ibdata.policies.support import Support
from ibdata.policies.user_code import told
from ibdata.policies.ways import WAYS, can_act, decides, has_method, is_torch_module

NAME = "[A-Za-z_][A-Za-z0-9_]*"
PART = r"[^/:\\\x00-\x1f\x7f-\x9f]+"  # of a relative path
STEM = r"[^/:\\.\x00-\x1f\x7f-\x9f]+"
TARGET = rf"^({NAME}(\.{NAME})*|({PART}/)*{STEM}\.py):{NAME}$"
TARGET_MEANT = "package.module:name, or file.py:name with a path relative to the YAML file"

importing = RLock()  # held while modules of policies are imported or taken out of sys.modules
_begun: set[str] = set()  # the targets that are being imported or created


class CustomError(IbdataError):
    """The code of a custom policy cannot be loaded."""


class Custom(Adapter):
    """Acts through the object that `target` names; a class or a function makes the object from `params`.

    The object has a method `act(history, u)` like the policies here, or `predict(observations)` like those of
    SB3 and d3rlpy, or is a torch module or another callable, which is called like `predict`. `predict` takes
    float32 observations (n, 6 · history), newest first, and returns actions (n, 3), or a tuple that begins
    with them. A method `log_prob` is used if there is one. The arrays are copies, which the object may
    change.

    A policy may remember earlier steps in one of three ways, and in no other:

    - `decide(given)`, `memory_size` and, if its density is known, `log_density(given, action)`, as in a
      subclass of `Policy`: see [Extending](extending.md#a-policy-that-remembers).
    - `predict` with the keyword `state`: it returns the actions and a state of any kind, which it is given at
      the next step; at the first step it is given None. If it has the keywords `episode_start` and
      `deterministic`, as recurrent policies of SB3 do, `episode_start` is an array (n,), which is true at the
      first step, and `deterministic` is true.
    - `reset(n)`, which is called before n episodes begin; until its next call, the n rows of all arrays
      belong to these episodes.

    A state, and whatever `reset` prepares, belongs to the n episodes that are simulated together. Which
    episodes these are depends on files and workers. So the policy must act in each episode as if it were
    alone, and draw random numbers from `u` only, not from a seed. Only a policy with `decide` can begin at
    any step of an episode. ibdata repeats earlier calls at the steps 0, 1, 10 and 100 of each block of
    episodes or, if there is `reset`, at the steps 0 and 1, and it repeats the first call with the episodes in
    another order. A policy that then acts differently is refused.

    The module or file may be beside the YAML file or in the current folder, and may import other modules
    there. It is not imported before a run begins. The output of its code goes to stderr.

    With `deterministic: true`, you promise that the policy draws no random numbers at all: what it sees
    and remembers in these ways determines its actions. Then `action_log_prob` is known, and the policy may be
    the `base` of `gaussian`, and of `epsilon_greedy` with `per_dimension`. `generate` calls a policy that
    remembers nothing twice at each step, and refuses it if the actions differ.
    """

    kind: Literal["custom"] = "custom"
    target: Annotated[str, Field(pattern=TARGET)] = Field(description=TARGET_MEANT)
    params: Parameters = Field(default={}, description="keyword arguments for a class or a function")
    history: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        default=1, description="number of observations that it sees"
    )
    uniforms: Annotated[int, Field(strict=True, ge=0, le=1000)] = Field(
        default=0, description="number of uniform random numbers per step for act and decide"
    )
    files: list[str] | None = Field(
        default=None,
        description="paths of other files that it reads, such as weights.pt, beside the YAML file or in the "
        "current folder; they are hashed like its code",
    )
    deterministic: bool = Field(
        default=False, strict=True, description="promise that it draws no random numbers of any kind"
    )

    _places: tuple[Path, ...] = PrivateAttr(())  # other folders than those of the run

    @property
    def code_target(self) -> str | None:
        """The target."""
        return self.target

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """The number of observations that the object sees."""
        return self.history

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]
        """The number of uniform random numbers per step."""
        return self.uniforms

    def form(self) -> dict[str, Any]:
        """The kind and the options, without the files, which are recorded with the run like the code."""
        return {key: value for key, value in super().form().items() if key != "files"}

    @model_serializer(mode="wrap")
    def _without_false(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out `deterministic: false`, so that datasets without this option stay as they are."""
        return {key: x for key, x in serialize(self).items() if key != "deterministic" or x}

    @model_validator(mode="after")
    def _check(self) -> Custom:
        if self.deterministic and self.uniforms:
            raise ValueError(
                f"found deterministic: true and uniforms: {self.uniforms}, expected only "
                "one of them, because a deterministic policy draws nothing"
            )
        return self

    def load(self) -> None:
        """Import or create the object, unless this was done before. Raises CustomError if it fails."""
        _ = self.adapted

    def forget(self) -> None:
        """Forget the object, so that it is imported or created anew on its next use."""
        for name in ("adapted", "way", "conversation"):
            self.__dict__.pop(name, None)

    def module(self) -> str:
        """Make the target's module importable and return its name.

        Raises UsageError if the target is a file that is not found.
        """
        import_from(self._code_places())
        if (file := self.file()) is None:
            return self.target.partition(":")[0]
        import_from((file.parent,))
        return file.stem

    def look_beside(self, folder: Path | None) -> None:
        """Look for the code in the current folder and in that of a YAML file, whatever run it belongs to."""
        self._places = two_places(Path.cwd(), folder)

    def _code_places(self) -> tuple[Path, ...]:
        return self._places or code_places()

    def declared(self) -> dict[str, Path]:
        """The paths of the declared files by their names. Raises UsageError if one is not found."""
        what = f"{self.target}: files"
        return {name: located(name, what, self._code_places()) for name in self.files or ()}

    def file(self) -> Path | None:
        """The file that the target names, or None if it names a module. UsageError if it is not found."""
        name = Path(self.target.partition(":")[0])
        is_file = name.suffix == ".py" and "." not in name.stem  # else the module py of a package
        return located(str(name), self.target, self._code_places()) if is_file else None

    @cached_property
    def adapted(self) -> Any:
        """The object, which is imported or created on first use."""
        from ibdata.numerics.code_cache import compile_others_anew

        module, name = self.module(), self.target.partition(":")[2]
        try:
            compile_others_anew(True)
            with importing, self._not_within_itself(), redirect_stdout(sys.stderr):  # stdout is for results
                found = getattr(self._imported(module), name)
                made = isinstance(found, type) or not (has_method(found) or is_torch_module(found))
                own = found(**self.params) if made and callable(found) else found
        except (UsageError, KeyboardInterrupt):
            raise
        except BaseException as error:
            line = f"{self.target}: cannot be loaded: {told(error)}"
            if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
                folders = " or ".join(map(str, self._code_places()))
                line += f"; expected the module in {printable(folders)}, or installed"
            raise CustomError(line) from error
        if not can_act(own):
            raise CustomError(f"{self.target}: found {type(own).__name__}, expected {WAYS}")
        self._refuse_too_little(own)
        return own

    @contextmanager
    def _not_within_itself(self) -> Iterator[None]:
        """A context that raises UsageError within itself, as where the target is in the script."""
        if self.target in _begun:
            raise UsageError(
                f"{self.target}: calls ibdata with itself as a policy while it is imported; put the policy "
                'into a file of its own, or such calls under `if __name__ == "__main__":`'
            )
        _begun.add(self.target)
        try:
            yield
        finally:
            _begun.discard(self.target)

    def _refuse_too_little(self, own: Any) -> None:
        """CustomError if an object with `decide` needs more than the options say, which are known before."""
        for option, length in (("history", "history_length"), ("uniforms", "uniforms_per_step")):
            found, least = getattr(self, option), getattr(own, length, 0) if decides(own) else 0
            if found < least:
                raise CustomError(
                    f"{self.target}: found {option}: {found}, expected at least the {length} of "
                    f"{type(own).__name__}; write {option}: {least}"
                )

    def _imported(self, module: str) -> Any:
        """Import the module. Raises UsageError if its name means another one than the target's file."""
        imported, file = import_module(module), self.file()
        found = getattr(imported, "__file__", None)
        if file is not None and not (found and os.path.samefile(found, file)):
            raise UsageError(
                f"{self.target}: found another module with the name {module}, {found or 'of Python'}; rename "
                "the file, or start Python again if the other one is imported no more"
            )
        return imported

    def decide(self, given: Given) -> Decision:
        with redirect_stdout(sys.stderr):
            return super().decide(given)

    def mean_action(self, history: History) -> npt.NDArray[np.float32]:
        """Return the actions (n, 3), clipped and rounded; only for `deterministic: true`."""
        return Deterministic.mean_action(self, history)  # type: ignore[arg-type]

    def supports(self, step: int) -> tuple[Support, ...] | None:
        if self.deterministic:
            return Deterministic.supports(self, step)  # type: ignore[arg-type]
        return super().supports(step)

    def log_density(self, given: Given, action: npt.NDArray[np.float32]) -> Floats:
        if self.deterministic:
            return Deterministic.log_density(self, given, action)  # type: ignore[arg-type]
        with redirect_stdout(sys.stderr):
            return super().log_density(given, action)
