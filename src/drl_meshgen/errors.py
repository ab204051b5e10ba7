"""What can go wrong, as types: each carries one sentence for the user and decides the exit code."""

from enum import Enum


class MeshgenError(Exception):
    """Base of every error this package raises on purpose. `exit_code` is what the command line returns."""

    exit_code = 1


class InputError(MeshgenError):
    """The user's input cannot be meshed: names the file or model, the defect and what to do."""

    exit_code = 3

    def __init__(self, name: str, defect: str, remedy: str = "") -> None:
        self.name, self.defect, self.remedy = name, defect, remedy
        super().__init__(f"{name}: {defect}" + (f"; {remedy}" if remedy else ""))


class StageError(MeshgenError):
    """A stage ended without a usable result; `outcome` is its verdict, `detail` the values that show it."""

    def __init__(self, stage: str, outcome: Enum, detail: str = "") -> None:
        self.stage, self.outcome, self.detail = stage, outcome, detail
        super().__init__(f"{stage}: {outcome.value}" + (f" ({detail})" if detail else ""))
