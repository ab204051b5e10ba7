"""Three tiny stages for tests of store and flows; each call leaves a line in the file that TOY_LOG names."""

import json
import os
import time
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from drl_meshgen.errors import InputError, StageError
from drl_meshgen.store import Stage


class Verdict(Enum):
    TOO_BIG = "the number is too big to double"


@dataclass(frozen=True)
class NumberOptions:
    name: str = "three"
    delay: float = 0.0


@dataclass(frozen=True)
class DoubleOptions:
    times: int = 1
    limit: float = 1e6


@dataclass(frozen=True)
class NoOptions:
    pass


def log(line):
    if os.environ.get("TOY_LOG"):
        with Path(os.environ["TOY_LOG"]).open("a") as handle:
            handle.write(line + "\n")


def calls(path):
    return path.read_text().split() if path.exists() else []


def number(_inputs, options):
    log("number")
    time.sleep(options.delay)
    known = {"three": 3.0, "four": 4.0, "huge": 1e7}
    if options.name not in known:
        raise InputError(options.name, "no such number", "take three or four")
    return known[options.name]


def double(inputs, options):
    log("double")
    if inputs["number"] > options.limit:
        raise StageError("double", Verdict.TOO_BIG, f"{inputs['number']:g}")
    return inputs["number"] * 2**options.times


def total(inputs, _options):
    log("total")
    return inputs["number"] + inputs["double"]


def write(result, folder):
    (folder / "value.json").write_text(json.dumps(result))


def read(folder):
    return json.loads((folder / "value.json").read_text())


CODE = ("drl_meshgen.errors",)
NUMBER = Stage("number", 1, CODE, (), NumberOptions, number, write, read, lambda options: {"name": options.name})
DOUBLE = Stage("double", 1, CODE, ("number",), DoubleOptions, double, write, read)
TOTAL = Stage("total", 1, CODE, ("number", "double"), NoOptions, total, write, read)
STAGES = (NUMBER, DOUBLE, TOTAL)
